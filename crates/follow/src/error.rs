//! What can go wrong between a picture and a joint target.

use core::time::Duration;

/// Errors of the pipeline.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting is outside its interval.
    #[error("{name}: {value} given, expected {expected}")]
    Parameter {
        /// The setting, as it is written in the configuration.
        name: &'static str,
        /// What was given.
        value: f64,
        /// The allowed interval or relation.
        expected: String,
    },
    /// A number from outside was NaN or infinite.
    #[error("{what}: a finite number was expected")]
    NotFinite {
        /// Which quantity.
        what: &'static str,
    },
    /// Samples must come in the order of their capture.
    #[error("sample captured at {captured:?} came after one of {last:?}")]
    TimeRunsBackwards {
        /// Capture time of the newest sample taken so far.
        last: Duration,
        /// Capture time of the refused one.
        captured: Duration,
    },
    /// A covariance could not be factored.
    #[error("{what} (number {index}) is not positive definite")]
    NotPositiveDefinite {
        /// Which matrix.
        what: &'static str,
        /// Its place in the sequence.
        index: usize,
    },
    /// Too little of the worker's arm was seen to learn from.
    #[error(
        "the demonstration holds {usable} usable arm samples over {span_s:.2} s; at least {needed} over {needed_s:.2} s are needed"
    )]
    TooLittleSeen {
        /// Samples with all three joints.
        usable: usize,
        /// Time between the first and the last of them, seconds.
        span_s: f64,
        /// Samples needed.
        needed: usize,
        /// Time needed, seconds.
        needed_s: f64,
    },
    /// The joint tracker refused its limits or its settings.
    #[error(transparent)]
    Motion(#[from] motion::Error),
    /// The mixture could not be fitted or regressed.
    #[error(transparent)]
    Mixture(#[from] gmr_core::Error),
    /// Kinematics refused its input.
    #[error(transparent)]
    Kin(#[from] kin::Error),
    /// A motion model file holds something else than expected.
    #[error("{message}; expected a motion model written by this program")]
    ModelFile {
        /// Where, and what it holds.
        message: String,
    },
    /// The number of pictures differs from the number of cameras.
    #[error("{got} pictures given for {expected} cameras")]
    ViewCount {
        /// Pictures given.
        got: usize,
        /// Cameras calibrated.
        expected: usize,
    },
    /// A list has another length than the chain has joints.
    #[error("{what}: {got} numbers given, the chain has {expected} joints")]
    JointCount {
        /// Which list.
        what: &'static str,
        /// Its length.
        got: usize,
        /// Joints of the chain.
        expected: usize,
    },
    /// The home position is outside a joint's limits.
    #[error("home_rad: joint {joint}: {home_rad} rad outside [{lower_rad}, {upper_rad}] rad")]
    HomeOutsideLimits {
        /// The joint.
        joint: String,
        /// Its home, rad.
        home_rad: f64,
        /// Its lower limit, rad.
        lower_rad: f64,
        /// Its upper limit, rad.
        upper_rad: f64,
    },
    /// A joint is named that the chain does not have.
    #[error("joint {joint}: not in the chain; it has {known}")]
    UnknownJoint {
        /// The name.
        joint: String,
        /// The joints there are.
        known: String,
    },
}
