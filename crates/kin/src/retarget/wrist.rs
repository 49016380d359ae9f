//! The wrist's way: the worker's wrist, scaled to the robot's reach, becomes a pose of the tool.
//!
//! ```text
//! reach   = scale * base_from_world.rotation * (wrist - shoulder),   scale = robot_reach / arm_length
//! tool    = anchor + reach, pulled onto the shell least_reach <= |reach| <= largest_reach
//! ```
//!
//! `anchor` is the point of the robot that stands for the worker's shoulder.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};

use super::ArmPoints;
use crate::Error;

/// How the tool is turned. The tool's z axis is the direction it works in.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum ToolOrientation {
    /// Always the same, in the base frame.
    Fixed(UnitQuaternion<f64>),
    /// z along the forearm; x as level as it can be.
    AlongForearm,
    /// z straight down; x away from the anchor.
    Down,
}

/// Maps arms to tool poses.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct WristRetarget {
    /// Takes `world` directions to the base frame of the robot.
    pub base_from_world: Isometry3<f64>,
    /// The point of the robot, in its base frame, that stands for the worker's shoulder (m).
    pub anchor_m: Point3<f64>,
    /// Robot metres per worker metre.
    pub scale: f64,
    /// The tool does not come nearer to the anchor than this (m).
    pub least_reach_m: f64,
    /// The tool does not go farther from the anchor than this (m).
    pub largest_reach_m: f64,
    /// How the tool is turned.
    pub orientation: ToolOrientation,
}

/// Whether the scaled wrist was within reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ReachStatus {
    /// Taken as it was.
    Within,
    /// Pulled in by so much (m).
    TooFar {
        /// Distance between the wanted and the given position (m).
        by_m: f64,
    },
    /// Pushed out by so much (m).
    TooNear {
        /// Distance between the wanted and the given position (m).
        by_m: f64,
    },
}

/// A pose for the tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WristTarget {
    /// Pose of the tool in the base frame.
    pub base_from_tool: Isometry3<f64>,
    /// Whether the reach clamp acted.
    pub reach: ReachStatus,
}

impl WristRetarget {
    /// A map by arm length: a stretched worker's arm of `arm_length_m` is a robot reach of `largest_reach_m`.
    ///
    /// # Errors
    /// [`Error::Domain`] unless `arm_length_m > 0` and `0 <= least_reach_m < largest_reach_m`, all finite.
    pub fn by_arm_length(
        base_from_world: Isometry3<f64>,
        anchor_m: Point3<f64>,
        arm_length_m: f64,
        least_reach_m: f64,
        largest_reach_m: f64,
        orientation: ToolOrientation,
    ) -> Result<Self, Error> {
        if !(arm_length_m > SHORTEST_ARM_M && arm_length_m.is_finite()) {
            return Err(Error::Domain { what: "arm length (m)", expected: "finite and > 0.1", got: arm_length_m });
        }
        if !(least_reach_m >= 0.0 && least_reach_m.is_finite()) {
            return Err(Error::Domain { what: "least reach (m)", expected: "finite and >= 0", got: least_reach_m });
        }
        if !(largest_reach_m > least_reach_m && largest_reach_m.is_finite()) {
            return Err(Error::Domain {
                what: "largest reach (m)",
                expected: "finite and > least reach",
                got: largest_reach_m,
            });
        }
        Ok(Self {
            base_from_world,
            anchor_m,
            scale: largest_reach_m / arm_length_m,
            least_reach_m,
            largest_reach_m,
            orientation,
        })
    }

    /// The tool pose for an arm; `None` when a point is not finite or the wanted orientation is not defined by it.
    ///
    /// ```
    /// use kin::{ArmPoints, ReachStatus, ToolOrientation, WristRetarget};
    /// use nalgebra::{Isometry3, Point3};
    /// let map = WristRetarget::by_arm_length(
    ///     Isometry3::identity(), Point3::new(0.0, 0.0, 0.14), 0.5, 0.2, 0.8, ToolOrientation::Down,
    /// )?;
    /// let arm = ArmPoints {
    ///     shoulder_m: Point3::new(1.0, 2.0, 0.5),
    ///     elbow_m: Point3::new(1.0, 2.0, 0.25),
    ///     wrist_m: Point3::new(1.25, 2.0, 0.25),
    /// };
    /// let target = map.apply(&arm).unwrap();
    /// assert_eq!(target.reach, ReachStatus::Within);
    /// // 1.6 robot metres per worker metre.
    /// assert!((target.base_from_tool.translation.x - 0.4).abs() < 1e-12);
    /// assert!((target.base_from_tool.translation.z - (0.14 - 0.4)).abs() < 1e-12);
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn apply(&self, arm: &ArmPoints) -> Option<WristTarget> {
        let wanted = self.base_from_world.rotation * (arm.wrist_m - arm.shoulder_m) * self.scale;
        let distance_m = wanted.norm();
        if !distance_m.is_finite() {
            return None;
        }
        let (offset, reach) = if distance_m > self.largest_reach_m {
            let by_m = distance_m - self.largest_reach_m;
            (wanted * (self.largest_reach_m / distance_m), ReachStatus::TooFar { by_m })
        } else if distance_m < self.least_reach_m {
            let by_m = self.least_reach_m - distance_m;
            let direction = Unit::try_new(wanted, 1e-6).map_or_else(Vector3::x, Unit::into_inner);
            (direction * self.least_reach_m, ReachStatus::TooNear { by_m })
        } else {
            (wanted, ReachStatus::Within)
        };
        let rotation = match self.orientation {
            ToolOrientation::Fixed(rotation) => rotation,
            ToolOrientation::Down => tool_along(&-Vector3::z(), &offset),
            ToolOrientation::AlongForearm => {
                let forearm = self.base_from_world.rotation * (arm.wrist_m - arm.elbow_m);
                let z = Unit::try_new(forearm, 1e-3)?;
                tool_along(&z, &Vector3::z().cross(&z))
            }
        };
        Some(WristTarget {
            base_from_tool: Isometry3::from_parts(Translation3::from(self.anchor_m.coords + offset), rotation),
            reach,
        })
    }
}

/// Shorter arms are a mistake in units or in the pose.
const SHORTEST_ARM_M: f64 = 0.1;

/// A rotation whose z is the given direction and whose x is as near to `towards` as it can be.
fn tool_along(z: &Vector3<f64>, towards: &Vector3<f64>) -> UnitQuaternion<f64> {
    let sideways = |v: &Vector3<f64>| Unit::try_new(v - z * z.dot(v), 1e-9);
    let x = sideways(towards)
        .or_else(|| sideways(&Vector3::x()))
        .or_else(|| sideways(&Vector3::y()))
        .expect("x and y cannot both be parallel to z");
    let y = z.cross(&x);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[
        x.into_inner(),
        y,
        *z,
    ])))
}
