//! Which family a chain belongs to, from its axes alone.

use nalgebra::{Matrix3, Vector3};

use super::Analytic;
use super::subproblems::{Reach, Slide};
use crate::Chain;
use crate::chain::z_onto;

/// Axes count as parallel, and points as one, below this (rad, m): descriptions are written with micrometres.
const TOLERANCE: f64 = 1e-6;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Family {
    Parallel,
    SphericalWrist,
}

pub(crate) fn recognise(chain: &Chain) -> Option<Analytic> {
    let (axes, origins, tip_rotation, tip) = chain.screws_at_zero()?;
    let wrist_at_five = meeting(&origins[4], &axes[4], &origins[5], &axes[5]);
    let family = if parallel(&axes[1], &axes[2]) && parallel(&axes[1], &axes[3]) && wrist_at_five.is_some() {
        Family::Parallel
    } else if parallel(&axes[1], &axes[2])
        && wrist_at_five.is_some_and(|point| distance(&point, &origins[3], &axes[3]) < TOLERANCE)
    {
        Family::SphericalWrist
    } else {
        return None;
    };
    // The closed form of q1 needs axis 2 to swing with joint 1, and of q5 axis 6 with joint 5.
    let middle = if family == Family::Parallel { &axes[1] } else { &axes[3] };
    if parallel(&axes[0], &axes[1]) || parallel(middle, &axes[4]) || parallel(&axes[4], &axes[5]) {
        return None;
    }
    let wrist = wrist_at_five?;
    let h = align_signs(axes);
    // Joint 4 of a spherical wrist sits in the wrist; otherwise on its own axis.
    let fourth = if family == Family::SphericalWrist { wrist } else { origins[3] };
    let places = [origins[0], origins[1], origins[2], fourth, wrist];
    let p = [
        places[1] - places[0],
        places[2] - places[1],
        places[3] - places[2],
        places[4] - places[3],
        Vector3::zeros(),
        tip - wrist,
    ];
    // From here on in axes whose z is axis 2.
    let from_base = *z_onto(axes[1]).inverse().to_rotation_matrix().matrix();
    let (h, signs) = (h.0.map(|axis| from_base * axis), h.1);
    let p = p.map(|offset| from_base * offset);
    let middle = if family == Family::Parallel { Vector3::z() } else { h[3] };
    let limits = chain.limits();
    Some(Analytic {
        family,
        machine: chain.machine,
        from_base,
        h,
        signs,
        p,
        start: places[0],
        tip_to_axes: tip_rotation.transpose() * from_base.transpose(),
        elbow: Reach::new(&p[1], &p[2]),
        wrist: Slide::new(&middle, &h[5], &h[4]),
        lower: std::array::from_fn(|i| limits[i].lower),
        upper: std::array::from_fn(|i| limits[i].upper),
    })
}

/// Turns axes 3 and 4 into the sense of axis 2 where they are parallel to it; the sign goes to the joint value.
fn align_signs(axes: [Vector3<f64>; 6]) -> ([Vector3<f64>; 6], [f64; 6]) {
    let mut h = axes;
    let mut signs = [1.0; 6];
    for joint in 2..4 {
        if parallel(&axes[joint], &axes[1]) {
            signs[joint] = axes[joint].dot(&axes[1]).signum();
            h[joint] = axes[1];
        }
    }
    (h, signs)
}

fn parallel(a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
    a.cross(b).norm() < TOLERANCE
}

fn distance(point: &Vector3<f64>, on: &Vector3<f64>, axis: &Vector3<f64>) -> f64 {
    (point - on).cross(axis).norm()
}

/// The point where two lines meet.
fn meeting(o1: &Vector3<f64>, h1: &Vector3<f64>, o2: &Vector3<f64>, h2: &Vector3<f64>) -> Option<Vector3<f64>> {
    let normal = h1.cross(h2);
    let square = normal.norm_squared();
    if square < TOLERANCE {
        return None;
    }
    let between = o2 - o1;
    if (between.dot(&normal) / square.sqrt()).abs() > TOLERANCE {
        return None;
    }
    Some(o1 + h1 * (between.cross(h2).dot(&normal) / square))
}

impl Chain {
    /// Axes and origins of six turning joints at zero, and the tip: rotation and place. `None` for other chains.
    #[expect(clippy::type_complexity, reason = "one caller, which names the parts")]
    fn screws_at_zero(&self) -> Option<([Vector3<f64>; 6], [Vector3<f64>; 6], Matrix3<f64>, Vector3<f64>)> {
        if !self.is_plain_turning() || self.dof() != 6 {
            return None;
        }
        let mut axes = [Vector3::zeros(); 6];
        let mut origins = [Vector3::zeros(); 6];
        let tip = self.walk(&[0.0; 6], |joint, frame| {
            axes[joint] = Vector3::new(frame.z[0], frame.z[1], frame.z[2]);
            origins[joint] = Vector3::new(frame.p[0], frame.p[1], frame.p[2]);
        });
        Some((axes, origins, tip.rotation(), tip.position()))
    }
}
