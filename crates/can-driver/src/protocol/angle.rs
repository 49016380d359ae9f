//! Angles as the wire carries them: 20 bits, two's complement, 4 pi / 2^20 rad a step.

use std::f64::consts::PI;

use crate::Error;

/// One step: 4 pi / 2^20 rad, about 12 urad, or 10 um at the end of an 0.85 m arm.
pub const ANGLE_LSB_RAD: f64 = 4.0 * PI / 1_048_576.0;

/// An angle on the wire: -524287 to 524287 steps (just under +-2 pi), or no value.
///
/// ```
/// use can_driver::{ANGLE_LSB_RAD, Angle};
/// let angle = Angle::from_rad(1.0)?;
/// assert!((angle.rad().unwrap() - 1.0).abs() <= ANGLE_LSB_RAD / 2.0);
/// assert!(Angle::from_rad(f64::NAN).is_err());
/// assert_eq!(Angle::NO_VALUE.rad(), None);
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Angle(i32);

impl Default for Angle {
    fn default() -> Self {
        Self::NO_VALUE
    }
}

impl Angle {
    /// The reserved code -2^19: there is no value. A joint that does not exist, or whose angle is
    /// not known, carries it, so that a missing number never reads as joint zero.
    pub const NO_VALUE: Self = Self(-524_288);
    /// The highest angle.
    pub const MAX: Self = Self(524_287);

    /// The nearest step.
    ///
    /// # Errors
    /// [`Error::AngleOutOfRange`] beyond +-524287 steps and for NaN.
    pub fn from_rad(angle_rad: f64) -> Result<Self, Error> {
        let steps = (angle_rad / ANGLE_LSB_RAD).round();
        if steps.abs() <= f64::from(Self::MAX.0) {
            Ok(Self(steps as i32))
        } else {
            Err(Error::AngleOutOfRange { angle_rad })
        }
    }

    /// The angle of a code; `None` outside 20 bits.
    pub const fn from_code(code: i32) -> Option<Self> {
        if code >= Self::NO_VALUE.0 && code <= Self::MAX.0 { Some(Self(code)) } else { None }
    }

    /// The 20-bit code as a number.
    pub const fn code(self) -> i32 {
        self.0
    }

    /// The angle, unless there is none.
    pub fn rad(self) -> Option<f64> {
        (self != Self::NO_VALUE).then(|| f64::from(self.0) * ANGLE_LSB_RAD)
    }
}
