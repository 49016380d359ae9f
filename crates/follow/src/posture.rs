//! The six numbers that describe an arm: h = (x, y, z, alpha, beta, theta) of the paper's equation (5).
//!
//! x, y, z is the wrist in `world`, metres. alpha is the elevation of the upper arm, beta the flexion of the elbow, theta
//! the inclination of the forearm, in radians as [`kin::ArmAngles`] defines them. Angles are followed continuously from
//! sample to sample, so that nothing breaks at +-pi.

use kin::{ArmPoints, wrap_rad};
use nalgebra::{Point3, SMatrix, SVector};

use crate::sample::{ArmSample, JointSample};

/// Number of coordinates of a posture.
pub const DIMENSION: usize = 6;

/// Mean of a posture: metres and radians.
pub type PostureVector = SVector<f64, DIMENSION>;

/// Covariance of a posture: m^2, m rad and rad^2.
pub type PostureMatrix = SMatrix<f64, DIMENSION, DIMENSION>;

/// Step of the numerical derivative of the angles by the joint positions, m. The angles bend over the length of a bone
/// (a quarter of a metre): 1e-6 m leaves a truncation error of 1e-11 and a rounding error of 1e-10.
const STEP_M: f64 = 1e-6;

/// Smallest variance of any coordinate: 0.1 mm and 0.1 mrad, squared. Keeps covariances factorable.
const FLOOR: f64 = 1e-8;

/// A posture with the covariance that it inherits from the three joint positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Posture {
    vector: PostureVector,
    noise: PostureMatrix,
}

impl Posture {
    /// The posture of a sample; `None` where a joint is lost or two joints coincide.
    pub fn of(sample: &ArmSample) -> Option<Self> {
        let joints = [sample.shoulder?, sample.elbow?, sample.wrist?];
        let points = joints.map(|joint| joint.position_m);
        let vector = vector(&points)?;
        let mut jacobian = SMatrix::<f64, DIMENSION, 9>::zeros();
        let mut covariance = SMatrix::<f64, 9, 9>::zeros();
        for (index, JointSample { covariance_m2, .. }) in joints.iter().enumerate() {
            covariance.fixed_view_mut::<3, 3>(3 * index, 3 * index).copy_from(covariance_m2);
            for axis in 0..3 {
                let moved = |by: f64| {
                    let mut points = points;
                    points[index][axis] += by;
                    self::vector(&points)
                };
                let difference = moved(STEP_M)? - moved(-STEP_M)?;
                let wrapped =
                    PostureVector::from_fn(|d, _| if d < 3 { difference[d] } else { wrap_rad(difference[d]) });
                jacobian.set_column(3 * index + axis, &(wrapped / (2.0 * STEP_M)));
            }
        }
        let noise = jacobian * covariance * jacobian.transpose() + PostureMatrix::identity() * FLOOR;
        Some(Self { vector, noise: (noise + noise.transpose()) * 0.5 })
    }

    /// Wrist (m) and angles (rad, in (-pi, pi]).
    pub fn row(&self) -> [f64; DIMENSION] {
        self.vector.into()
    }

    /// The same, with each angle moved by whole turns to lie within half a turn of the one before.
    pub fn unwrapped_near(&self, before: &[f64; DIMENSION]) -> [f64; DIMENSION] {
        core::array::from_fn(|d| if d < 3 { self.vector[d] } else { before[d] + wrap_rad(self.vector[d] - before[d]) })
    }

    /// Covariance: m^2, m rad, rad^2.
    pub fn noise(&self) -> PostureMatrix {
        self.noise
    }
}

fn vector(points: &[Point3<f64>; 3]) -> Option<PostureVector> {
    let [shoulder, elbow, wrist] = points;
    let [alpha, beta, theta] =
        ArmPoints { shoulder_m: *shoulder, elbow_m: *elbow, wrist_m: *wrist }.angles()?.to_array();
    Some(PostureVector::from([wrist.x, wrist.y, wrist.z, alpha, beta, theta]))
}
