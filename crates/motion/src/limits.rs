//! Limits of a joint. All of them are mandatory: there is no default.

use crate::error::{Error, Result};

/// Position, velocity, acceleration and jerk limits of one joint, symmetric in all but position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Lower end of the position range.
    pub lower_rad: f64,
    /// Upper end of the position range; above `lower_rad`.
    pub upper_rad: f64,
    /// Largest speed, above zero.
    pub velocity_rad_s: f64,
    /// Largest acceleration, above zero.
    pub acceleration_rad_s2: f64,
    /// Largest jerk, above zero.
    pub jerk_rad_s3: f64,
}

/// Magnitudes that keep squares and cubes of limits, and their ratios, far from overflow and
/// underflow of f64.
const SMALLEST: f64 = 1e-6;
const LARGEST: f64 = 1e6;
/// Positions beyond this have too few digits left for a limit kept within 1e-9.
const FURTHEST: f64 = 1e3;

impl JointLimits {
    pub(crate) fn check(&self, joint: usize) -> Result<()> {
        let positive = [
            ("velocity_rad_s", self.velocity_rad_s),
            ("acceleration_rad_s2", self.acceleration_rad_s2),
            ("jerk_rad_s3", self.jerk_rad_s3),
            ("upper_rad - lower_rad", self.upper_rad - self.lower_rad),
        ];
        for (field, value) in positive {
            if !(SMALLEST..=LARGEST).contains(&value) {
                return Err(Error::InvalidLimit { joint, field, allowed: "a value in [1e-6, 1e6]", value });
            }
        }
        if !(-FURTHEST..=FURTHEST).contains(&self.lower_rad) {
            return Err(Error::InvalidLimit {
                joint,
                field: "lower_rad",
                allowed: "a value in [-1e3, 1e3]",
                value: self.lower_rad,
            });
        }
        Ok(())
    }
}
