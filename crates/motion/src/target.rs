//! What arrives from outside: targets, and how old they may become.

use std::time::Duration;

use crate::error::{Error, Result};

/// Target of one joint at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Position.
    pub position_rad: f64,
    /// Velocity; what keeps the motion going between targets.
    pub velocity_rad_s: f64,
    /// Acceleration, where it is known.
    pub acceleration_rad_s2: Option<f64>,
}

impl Sample {
    /// A target with position and velocity.
    ///
    /// ```
    /// assert_eq!(motion::Sample::new(0.2, 1.0).acceleration_rad_s2, None);
    /// ```
    pub const fn new(position_rad: f64, velocity_rad_s: f64) -> Self {
        Self { position_rad, velocity_rad_s, acceleration_rad_s2: None }
    }

    fn check(&self, joint: usize) -> Result<()> {
        let quantities = [
            ("target position_rad", self.position_rad),
            ("target velocity_rad_s", self.velocity_rad_s),
            ("target acceleration_rad_s2", self.acceleration_rad_s2.unwrap_or(0.0)),
        ];
        for (what, value) in quantities {
            if !value.is_finite() {
                return Err(Error::NotFinite { joint, what, value });
            }
        }
        Ok(())
    }
}

/// One target for all joints.
///
/// With a horizon the reference follows the predicted points (cubic Hermite curve through
/// positions and velocities); beyond the last point, and without a horizon, it moves on with
/// the last velocity and, as long as [`AgePolicy::coast`] lasts, acceleration.
#[derive(Debug, Clone, Copy)]
pub struct Target<'a> {
    /// Time since the instant that the samples describe; negative if they lie in the future.
    pub age_s: f64,
    /// One sample per joint.
    pub joints: &'a [Sample],
    /// Predicted samples after `joints`, row by row (one row holds all joints); may be empty.
    pub horizon: &'a [Sample],
    /// Time between the rows of the horizon; ignored when that is empty.
    pub horizon_step: Duration,
}

impl<'a> Target<'a> {
    /// A target without horizon, `age_s` seconds after its instant.
    pub const fn new(age_s: f64, joints: &'a [Sample]) -> Self {
        Self { age_s, joints, horizon: &[], horizon_step: Duration::ZERO }
    }

    pub(crate) fn check(&self, joints: usize, capacity: usize) -> Result<()> {
        if self.joints.len() != joints {
            return Err(Error::Count { what: "target joints", expected: joints, got: self.joints.len() });
        }
        if !(self.age_s >= -LONGEST_LEAD_S && self.age_s.is_finite()) {
            return Err(Error::Age { age_s: self.age_s, lead_s: LONGEST_LEAD_S });
        }
        let rows = self.horizon.len() / joints;
        if rows * joints != self.horizon.len() {
            return Err(Error::Count {
                what: "last horizon row",
                expected: joints,
                got: self.horizon.len() - rows * joints,
            });
        }
        if rows > capacity {
            return Err(Error::HorizonTooLong { got: rows, capacity });
        }
        if rows > 0 && self.horizon_step < SHORTEST_HORIZON_STEP {
            return Err(Error::InvalidParameter {
                field: "horizon_step",
                allowed: "[1 ms, inf)",
                value: self.horizon_step.as_secs_f64(),
            });
        }
        for row in std::iter::once(self.joints).chain(self.horizon.chunks(joints)) {
            for (joint, sample) in row.iter().enumerate() {
                sample.check(joint)?;
            }
        }
        Ok(())
    }
}

/// Furthest into the future that the instant of a target may lie.
pub(crate) const LONGEST_LEAD_S: f64 = 1.0;
/// Shorter steps would divide prediction noise by almost nothing.
const SHORTEST_HORIZON_STEP: Duration = Duration::from_millis(1);

/// What happens when targets stop coming.
///
/// The reference follows the newest target for `coast` (and to the end of its horizon, if that
/// is later), then slows down along its path over `fade` and rests. A new target at any time
/// takes over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AgePolicy {
    /// Age up to which the target is extrapolated at full speed.
    pub coast: Duration,
    /// Time over which the extrapolation slows down to rest.
    pub fade: Duration,
}

/// Where the acceleration of the reference comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AccelerationSource {
    /// Always zero: least noise, most lag on curved motion.
    Zero,
    /// From the target where it says so, else zero.
    Given,
    /// From the target where it says so, else from the velocities of the last targets: of constant acceleration, or of a
    /// swing to and fro where that has lately predicted better.
    Estimated,
}
