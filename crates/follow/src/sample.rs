//! What the camera side hands over: the worker's arm at one capture time, in `world` metres.

use core::time::Duration;

use nalgebra::{Matrix3, Point3};

/// How a joint position came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Evidence {
    /// Seen in this frame and accepted by every gate.
    Measured,
    /// Bridged from earlier frames or from the other joints; its covariance says how far to trust it.
    Inferred,
}

/// One joint of the worker's arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointSample {
    /// Position in `world`, metres.
    pub position_m: Point3<f64>,
    /// Covariance of the position, m^2.
    pub covariance_m2: Matrix3<f64>,
    /// Seen or bridged. A lost joint is not a `JointSample` at all.
    pub evidence: Evidence,
}

/// The worker's arm at one instant. A joint that is lost is `None`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSample {
    /// When the picture was taken, since the start of the source.
    pub captured: Duration,
    /// Shoulder centre.
    pub shoulder: Option<JointSample>,
    /// Elbow centre.
    pub elbow: Option<JointSample>,
    /// Wrist centre.
    pub wrist: Option<JointSample>,
}

impl ArmSample {
    /// Whether all three joints are there and at least the wrist was measured in this frame.
    pub fn is_complete(&self) -> bool {
        self.shoulder.is_some() && self.elbow.is_some() && self.wrist.is_some_and(|w| w.evidence == Evidence::Measured)
    }
}
