//! What the gates let through.

use std::time::Duration;

#[cfg(doc)]
use super::ArmGate;
use crate::{Calibration, Error, OneEuroParams, Result};

/// Parameters of [`ArmGate`]. Lengths are in `reach`, the longest of upper arm and forearm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GateOptions {
    /// From score to probability.
    pub calibration: Calibration,
    /// Keypoints less probable than this are not believed, 0 to 1.
    pub min_probability: f64,
    /// Standard deviation of a keypoint of probability 1, reach. The networks of this field are at 0.04 to 0.08.
    pub noise: f64,
    /// Standard deviation of acceleration, reach/s^2. An arm of 0.28 m reach at 100 reach/s^2 pulls 28 m/s^2.
    pub acceleration: f64,
    /// Fastest motion, reach/s. 20 reach/s are 5.6 m/s for an arm of 0.28 m reach: a thrown punch.
    pub max_speed: f64,
    /// Joints of both arms closer than this cannot tell a swap, reach; three times the noise of their difference.
    pub swap_separation: f64,
    /// Longest limb, relative to the longest of late.
    pub max_stretch: f64,
    /// Longest time without a believed keypoint.
    pub max_inferred: Duration,
    /// Low-pass on the result; `None` leaves the filter's own estimate.
    pub smoothing: Option<OneEuroParams>,
}

impl Default for GateOptions {
    fn default() -> Self {
        Self {
            calibration: Calibration { intercept: -3.0, slope: 10.0 },
            min_probability: 0.3,
            noise: 0.05,
            acceleration: 100.0,
            max_speed: 20.0,
            swap_separation: 0.2,
            max_stretch: 1.35,
            max_inferred: Duration::from_millis(300),
            smoothing: None,
        }
    }
}

impl GateOptions {
    pub(super) fn validate(&self) -> Result<()> {
        let bad = |field, expected, got: f64| Err(Error::Parameter { field, expected, got: got.to_string() });
        if !(0.0..=1.0).contains(&self.min_probability) {
            return bad("min_probability", "0 to 1", self.min_probability);
        }
        for (field, x) in [
            ("noise", self.noise),
            ("acceleration", self.acceleration),
            ("max_speed", self.max_speed),
            ("swap_separation", self.swap_separation),
        ] {
            if !(x > 0.0 && x.is_finite()) {
                return bad(field, "above 0", x);
            }
        }
        if !(self.max_stretch >= 1.0 && self.max_stretch.is_finite()) {
            return bad("max_stretch", "1 or more", self.max_stretch);
        }
        if !(self.calibration.intercept.is_finite() && self.calibration.slope > 0.0) {
            return bad("calibration.slope", "above 0", self.calibration.slope);
        }
        Ok(())
    }
}
