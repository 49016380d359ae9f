//! The paper's way: three angles of the arm drive joints 2, 3 and 4.
//!
//! With `u` the direction from shoulder to elbow, `f` that from elbow to wrist, and z up:
//!
//! | angle | definition | range |
//! |---|---|---|
//! | upper-arm elevation | `atan2(u_z, hypot(u_x, u_y))`: above the horizontal | [-pi/2, pi/2]; hanging -pi/2, level 0 |
//! | elbow flexion | `atan2(\|u x f\|, u . f)`: between upper arm and forearm | [0, pi]; stretched 0, right angle pi/2 |
//! | forearm inclination | `atan2(f_z, hypot(f_x, f_y))`: above the horizontal | [-pi/2, pi/2] |
//!
//! None of them depends on where the worker faces, none jumps anywhere, and all lie within (-pi, pi].

use nalgebra::{Point3, Vector3};

use crate::{Chain, Error};

/// Wraps an angle to (-pi, pi].
///
/// ```
/// use std::f64::consts::PI;
/// assert_eq!(kin::wrap_rad(-PI), PI);
/// assert!((kin::wrap_rad(4.0) - (4.0 - 2.0 * PI)).abs() < 1e-15);
/// ```
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let turn = 2.0 * std::f64::consts::PI;
    let wrapped = angle_rad - turn * ((angle_rad - std::f64::consts::PI) / turn).ceil();
    // Rounding of the division may leave the result one turn off at the border.
    if wrapped <= -std::f64::consts::PI { std::f64::consts::PI } else { wrapped.min(std::f64::consts::PI) }
}

/// Turns a stream of wrapped angles into a continuous one. A value that is not finite is refused and changes
/// nothing.
///
/// ```
/// let mut unwrap = kin::Unwrap::default();
/// assert_eq!(unwrap.next(3.0), Some(3.0));
/// let after = unwrap.next(-3.0).unwrap(); // crossed pi
/// assert!((after - (2.0 * std::f64::consts::PI - 3.0)).abs() < 1e-15);
/// assert_eq!(unwrap.next(f64::NAN), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Unwrap {
    last_rad: Option<f64>,
}

impl Unwrap {
    /// The value nearest to the last one among `angle_rad + 2 pi n`.
    pub fn next(&mut self, angle_rad: f64) -> Option<f64> {
        if !angle_rad.is_finite() {
            return None;
        }
        let continuous = self.last_rad.map_or(angle_rad, |last| last + wrap_rad(angle_rad - last));
        self.last_rad = Some(continuous);
        Some(continuous)
    }
}

/// Shoulder, elbow and wrist in `world` (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmPoints {
    /// Shoulder (m).
    pub shoulder_m: Point3<f64>,
    /// Elbow (m).
    pub elbow_m: Point3<f64>,
    /// Wrist (m).
    pub wrist_m: Point3<f64>,
}

/// Segments shorter than this have no direction (m). A tenth of any real forearm.
const SHORTEST_SEGMENT_M: f64 = 0.02;

impl ArmPoints {
    /// Upper arm plus forearm (m).
    pub fn length_m(&self) -> f64 {
        (self.elbow_m - self.shoulder_m).norm() + (self.wrist_m - self.elbow_m).norm()
    }

    /// The three angles of the paper; `None` when a point is not finite or two joints are closer than 20 mm.
    ///
    /// ```
    /// use kin::ArmPoints;
    /// use nalgebra::Point3;
    /// // Upper arm hanging, forearm level.
    /// let arm = ArmPoints {
    ///     shoulder_m: Point3::new(0.0, 0.0, 0.5),
    ///     elbow_m: Point3::new(0.0, 0.0, 0.2),
    ///     wrist_m: Point3::new(0.25, 0.0, 0.2),
    /// };
    /// let angles = arm.angles().unwrap();
    /// let right = std::f64::consts::FRAC_PI_2;
    /// assert!((angles.upper_arm_elevation_rad + right).abs() < 1e-12);
    /// assert!((angles.elbow_flexion_rad - right).abs() < 1e-12);
    /// assert!(angles.forearm_inclination_rad.abs() < 1e-12);
    /// ```
    pub fn angles(&self) -> Option<ArmAngles> {
        let upper = self.elbow_m - self.shoulder_m;
        let fore = self.wrist_m - self.elbow_m;
        if !(upper.norm() > SHORTEST_SEGMENT_M && fore.norm() > SHORTEST_SEGMENT_M) {
            return None;
        }
        let elevation = |v: &Vector3<f64>| v.z.atan2(v.x.hypot(v.y));
        let angles = ArmAngles {
            upper_arm_elevation_rad: elevation(&upper),
            elbow_flexion_rad: upper.cross(&fore).norm().atan2(upper.dot(&fore)),
            forearm_inclination_rad: elevation(&fore),
        };
        angles.to_array().iter().all(|angle| angle.is_finite()).then_some(angles)
    }
}

/// The three angles of the arm, defined in the module documentation of [`ArmPoints::angles`]' table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmAngles {
    /// Upper arm above the horizontal, [-pi/2, pi/2].
    pub upper_arm_elevation_rad: f64,
    /// Between upper arm and forearm, [0, pi]; stretched is 0.
    pub elbow_flexion_rad: f64,
    /// Forearm above the horizontal, [-pi/2, pi/2].
    pub forearm_inclination_rad: f64,
}

impl ArmAngles {
    /// Elevation, flexion, inclination.
    pub fn to_array(&self) -> [f64; 3] {
        [self.upper_arm_elevation_rad, self.elbow_flexion_rad, self.forearm_inclination_rad]
    }

    /// From elevation, flexion, inclination.
    pub fn from_array([upper_arm_elevation_rad, elbow_flexion_rad, forearm_inclination_rad]: [f64; 3]) -> Self {
        Self { upper_arm_elevation_rad, elbow_flexion_rad, forearm_inclination_rad }
    }
}

/// How one arm angle becomes one joint value: `q = offset + scale * angle`; a negative scale turns the sense round.
#[derive(Debug, Clone, PartialEq)]
pub struct JointMap {
    /// The joint.
    pub joint: String,
    /// Sense of rotation times gain.
    pub scale: f64,
    /// Joint value at angle zero (rad).
    pub offset_rad: f64,
}

/// Three maps: for the elevation, the flexion and the inclination.
#[derive(Debug, Clone, PartialEq)]
pub struct AngleRetarget {
    indices: [usize; 3],
    maps: [JointMap; 3],
    lower: [f64; 3],
    upper: [f64; 3],
}

/// Joint values after retargeting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Retargeted {
    /// The values of the three joints (rad), within their limits.
    pub values_rad: [f64; 3],
    /// Which of them were cut off at a limit.
    pub clamped: [bool; 3],
}

impl AngleRetarget {
    /// Maps for the joints of a chain.
    ///
    /// # Errors
    /// [`Error::UnknownJoint`] for a joint that is not in the chain, [`Error::Domain`] for a number that is not
    /// finite.
    pub fn new(chain: &Chain, maps: [JointMap; 3]) -> Result<Self, Error> {
        let mut indices = [0; 3];
        for (index, map) in indices.iter_mut().zip(&maps) {
            *index = chain.joint_index(&map.joint).ok_or_else(|| Error::UnknownJoint {
                robot: format!("{} -> {}", chain.base(), chain.tip()),
                name: map.joint.clone(),
                known: chain.joint_names().to_vec(),
            })?;
            for (what, got) in [("scale of a joint map", map.scale), ("offset of a joint map (rad)", map.offset_rad)] {
                if !got.is_finite() {
                    return Err(Error::Domain { what, expected: "a finite value", got });
                }
            }
        }
        Ok(Self {
            indices,
            maps,
            lower: indices.map(|index| chain.limits()[index].lower),
            upper: indices.map(|index| chain.limits()[index].upper),
        })
    }

    /// Maps for the built-in arm, which works with the elbow up where a worker's elbow hangs down. With the upper arm
    /// hanging and the forearm level the robot's upper arm leans back a little and its forearm reaches forward;
    /// lifting the arm forward, or stretching it, reaches out; and the tool keeps pointing down throughout.
    ///
    /// # Errors
    /// [`Error::UnknownJoint`] for a chain without `joint2`, `joint3` and `joint4`.
    pub fn for_builtin_arm(chain: &Chain) -> Result<Self, Error> {
        let map = |joint: &str, scale: f64, offset_rad: f64| JointMap { joint: joint.to_owned(), scale, offset_rad };
        let lean_rad = 1.9;
        let level_rad = lean_rad - std::f64::consts::FRAC_PI_2;
        Self::new(
            chain,
            [
                map("joint2", -1.0, level_rad),
                map("joint3", -1.0, 0.0),
                map("joint4", 1.0, -std::f64::consts::FRAC_PI_2 - level_rad),
            ],
        )
    }

    /// Where the three joints stand in a joint vector of the chain.
    pub fn indices(&self) -> [usize; 3] {
        self.indices
    }

    /// Joint values for arm angles.
    pub fn apply(&self, angles: &ArmAngles) -> Retargeted {
        let angles = angles.to_array();
        let wanted: [f64; 3] = std::array::from_fn(|i| self.maps[i].offset_rad + self.maps[i].scale * angles[i]);
        let values_rad: [f64; 3] = std::array::from_fn(|i| wanted[i].clamp(self.lower[i], self.upper[i]));
        Retargeted {
            values_rad,
            clamped: std::array::from_fn(|i| wanted[i] < self.lower[i] || wanted[i] > self.upper[i]),
        }
    }

    /// Joint speeds for speeds of the arm angles (rad/s): the scales alone.
    pub fn apply_rates(&self, rates_rad_s: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| self.maps[i].scale * rates_rad_s[i])
    }

    /// Writes the three joint values into a joint vector of the chain.
    ///
    /// # Panics
    /// When `q` is shorter than the chain's joint vector.
    pub fn apply_to(&self, angles: &ArmAngles, q: &mut [f64]) -> Retargeted {
        let retargeted = self.apply(angles);
        for (index, value) in self.indices.iter().zip(retargeted.values_rad) {
            q[*index] = value;
        }
        retargeted
    }
}
