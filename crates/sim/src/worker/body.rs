//! Lengths and girths of the worker.

use rand::Rng;

use crate::error::{Error, within};

/// Segment lengths and thickness of a seated person.
///
/// The defaults are close to the 50th percentile of adults in ISO/TR 7250-2; segment ratios follow
/// Drillis and Contini (1966).
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BodyShape {
    /// Shoulder centre to elbow centre.
    pub upper_arm_m: f64,
    /// Elbow centre to wrist centre.
    pub forearm_m: f64,
    /// Wrist centre to fingertips.
    pub hand_m: f64,
    /// Spine to shoulder centre.
    pub shoulder_half_width_m: f64,
    /// Hip height to the base of the neck.
    pub spine_m: f64,
    /// Spine to hip centre.
    pub hip_half_width_m: f64,
    /// Hip centre to knee centre.
    pub thigh_m: f64,
    /// Knee centre to ankle centre.
    pub shin_m: f64,
    /// Size of the head, 1 for a head 0.23 m high.
    pub head_scale: f64,
    /// Thickness of trunk and limbs, 1 for a person of middle build.
    pub girth: f64,
}

impl Default for BodyShape {
    fn default() -> Self {
        Self {
            upper_arm_m: 0.29,
            forearm_m: 0.25,
            hand_m: 0.18,
            shoulder_half_width_m: 0.18,
            spine_m: 0.50,
            hip_half_width_m: 0.09,
            thigh_m: 0.41,
            shin_m: 0.40,
            head_scale: 1.0,
            girth: 1.0,
        }
    }
}

impl BodyShape {
    /// A body drawn from a broad adult range: stature scale 0.88 to 1.12, each segment a further 6 %.
    pub fn random(rng: &mut impl Rng) -> Self {
        let stature = rng.random_range(0.88..1.12);
        let mut vary = |mean: f64| mean * stature * rng.random_range(0.94..1.06);
        let base = Self::default();
        let mut shape = Self {
            upper_arm_m: vary(base.upper_arm_m),
            forearm_m: vary(base.forearm_m),
            hand_m: vary(base.hand_m),
            shoulder_half_width_m: vary(base.shoulder_half_width_m),
            spine_m: vary(base.spine_m),
            hip_half_width_m: vary(base.hip_half_width_m),
            thigh_m: vary(base.thigh_m),
            shin_m: vary(base.shin_m),
            ..base
        };
        shape.head_scale = rng.random_range(0.9..1.1);
        shape.girth = rng.random_range(0.8..1.3);
        shape
    }

    /// Full length of the arm without the hand, metres.
    pub fn arm_m(&self) -> f64 {
        self.upper_arm_m + self.forearm_m
    }

    pub(crate) fn validate(&self) -> Result<(), Error> {
        within("body.upper_arm_m", self.upper_arm_m, 0.15, 0.45)?;
        within("body.forearm_m", self.forearm_m, 0.15, 0.40)?;
        within("body.hand_m", self.hand_m, 0.08, 0.28)?;
        within("body.shoulder_half_width_m", self.shoulder_half_width_m, 0.10, 0.30)?;
        within("body.spine_m", self.spine_m, 0.30, 0.75)?;
        within("body.hip_half_width_m", self.hip_half_width_m, 0.05, 0.20)?;
        within("body.thigh_m", self.thigh_m, 0.25, 0.60)?;
        within("body.shin_m", self.shin_m, 0.25, 0.60)?;
        within("body.head_scale", self.head_scale, 0.6, 1.5)?;
        within("body.girth", self.girth, 0.5, 2.0)
    }
}
