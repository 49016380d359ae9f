#![doc = include_str!("../README.md")]

mod align;
mod arima;
mod chart;
mod condition;
mod error;
mod fusion;
mod gaps;
mod gmm;
mod kernel;
mod linalg;
mod regress;
mod samples;
mod scalar;
mod segment;
mod sequence;
mod trajectory;
mod wide;

pub use align::{Alignment, DtwParams, align, dtw};
pub use arima::{
    Arima, ArimaCandidate, ArimaOrder, ArimaParams, ArimaParts, ArimaPlan, ArimaReport, ArimaRun, ArimaStart,
    ArimaState, ArimaStop, AutoArima, AutoArimaParams, AutoArimaPlan, Forecast, Innovation, kpss,
};
pub use chart::{Chart, Coordinate, CoordinateKind, unwrap_rad, wrap_rad};
pub use condition::Filled;
pub use error::{Error, Result};
pub use fusion::{ArimaErrors, Fusion, FusionReading, FusionReport, FusionStep, arima_errors, mutual_support};
pub use gmm::{
    Candidate, CovarianceKind, Criterion, FitReport, Floored, GmmParams, GmmPlan, MissingReport, MissingValues,
    Mixture, MixtureParts, Regularisation, RestartOutcome, RestartReport, Selection, Start, Stop, select_components,
};
pub use regress::{BatchPrediction, Prediction, Regressor};
pub use samples::Samples;
pub use segment::{
    ChangePointParams, MotionElement, RestParams, segment_at_rest, segment_change_points, segment_fixed,
};
pub use sequence::{ElementModel, ElementSequence, ElementSequenceParts, Phase, SequencePrediction, SequenceRegressor};
pub use trajectory::{Trajectory, TrajectoryParts};
