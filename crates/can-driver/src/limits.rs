//! What a joint may do at most.

use serde::{Deserialize, Serialize};

use crate::{Angle, Error, MAX_JOINTS};

/// Limits of one joint. There is no default: a robot without limits is not driven.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointLimits {
    /// Lowest angle.
    pub min_rad: f64,
    /// Highest angle.
    pub max_rad: f64,
    /// Highest speed.
    pub velocity_rad_s: f64,
    /// Highest acceleration and deceleration.
    pub acceleration_rad_s2: f64,
}

/// Number of values that a limit write carries for one joint.
pub(crate) const PARAMETERS: u8 = 4;

impl JointLimits {
    /// The limits as the wire carries them: micro-radians, per second, per second squared.
    pub(crate) fn to_wire(self) -> [i32; PARAMETERS as usize] {
        [self.min_rad, self.max_rad, self.velocity_rad_s, self.acceleration_rad_s2].map(|x| (x * 1e6).round() as i32)
    }

    pub(crate) fn from_wire(wire: [i32; PARAMETERS as usize]) -> Self {
        let [min_rad, max_rad, velocity_rad_s, acceleration_rad_s2] = wire.map(|x| f64::from(x) * 1e-6);
        Self { min_rad, max_rad, velocity_rad_s, acceleration_rad_s2 }
    }

    /// What both allow.
    #[must_use]
    pub fn intersect(self, other: Self) -> Self {
        Self {
            min_rad: self.min_rad.max(other.min_rad),
            max_rad: self.max_rad.min(other.max_rad),
            velocity_rad_s: self.velocity_rad_s.min(other.velocity_rad_s),
            acceleration_rad_s2: self.acceleration_rad_s2.min(other.acceleration_rad_s2),
        }
    }

    /// # Errors
    /// [`Error::InvalidLimit`] for the first that is not finite, not positive, empty or beyond
    /// what the wire can carry.
    pub(crate) fn validate(&self, joint: usize) -> Result<(), Error> {
        let reach_rad = Angle::MAX.rad().unwrap_or(0.0);
        let fail = |field, value, expected| Err(Error::InvalidLimit { joint, field, value, expected });
        if !(self.min_rad >= -reach_rad) {
            return fail("min_rad", self.min_rad, "at least -6.28317 rad");
        }
        if !(self.max_rad <= reach_rad) {
            return fail("max_rad", self.max_rad, "at most 6.28317 rad");
        }
        if !(self.min_rad < self.max_rad) {
            return fail("max_rad", self.max_rad, "above min_rad");
        }
        if !(self.velocity_rad_s > 0.0 && self.velocity_rad_s <= 100.0) {
            return fail("velocity_rad_s", self.velocity_rad_s, "above 0, at most 100 rad/s");
        }
        if !(self.acceleration_rad_s2 > 0.0 && self.acceleration_rad_s2 <= 1000.0) {
            return fail("acceleration_rad_s2", self.acceleration_rad_s2, "above 0, at most 1000 rad/s^2");
        }
        Ok(())
    }
}

/// Checks the limits of a whole robot.
///
/// # Errors
/// [`Error::JointCount`] unless there are 1 to 6, and [`Error::InvalidLimit`].
pub(crate) fn validate(limits: &[JointLimits]) -> Result<(), Error> {
    if limits.is_empty() || limits.len() > MAX_JOINTS {
        return Err(Error::JointCount { found: limits.len(), expected: "1 to 6" });
    }
    limits.iter().enumerate().try_for_each(|(joint, l)| l.validate(joint))
}

/// Keys of CONFIG that are not limits.
pub(crate) const KEY_BEGIN: u8 = 240;
pub(crate) const KEY_SEAL: u8 = 241;

/// Key of one limit of one joint.
pub(crate) const fn limit_key(joint: usize, parameter: usize) -> u8 {
    (joint * 8 + parameter) as u8
}

/// Joint and parameter of a key.
pub(crate) fn split_key(key: u8) -> Option<(usize, usize)> {
    let (joint, parameter) = (usize::from(key / 8), usize::from(key % 8));
    (joint < MAX_JOINTS && parameter < usize::from(PARAMETERS)).then_some((joint, parameter))
}

/// The number that seals a set of limits: the CRC-32 of their wire values, joint after joint.
pub(crate) fn seal(limits: &[[i32; PARAMETERS as usize]]) -> i32 {
    crate::protocol::crc32(limits.iter().flatten().flat_map(|value| value.to_le_bytes())).cast_signed()
}
