#![doc = include_str!("../README.md")]

mod error;
mod gmm;
mod kernel;
mod linalg;
mod regress;
mod samples;
mod scalar;
mod segment;
mod sequence;
mod trajectory;

pub use error::{Error, Result};
pub use gmm::{
    CovarianceKind, FitReport, Floored, GmmParams, GmmPlan, Mixture, MixtureParts, Regularisation, RestartOutcome,
    RestartReport, Start, Stop,
};
pub use regress::{BatchPrediction, Prediction, Regressor};
pub use samples::Samples;
pub use segment::{MotionElement, segment_fixed};
pub use sequence::{ElementModel, ElementSequence, ElementSequenceParts, Phase, SequencePrediction, SequenceRegressor};
pub use trajectory::{Trajectory, TrajectoryParts};
