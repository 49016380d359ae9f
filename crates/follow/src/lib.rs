#![doc = include_str!("../README.md")]

mod control;
mod error;
mod kalman;
mod lift;
mod model;
mod period;
mod phase;
mod plan;
mod posture;
mod predict;
mod retarget;
mod sample;
mod teach;

pub use control::{ControlLoop, ControlParams, Phase, RestCause, StopCause, TickInput, Verdict};
pub use error::Error;
pub use kalman::ConstantVelocity;
pub use lift::{ArmPixels, Lift, PixelSample, Plane};
pub use model::{LearnParams, LearnReport, ModelPoint, MotionModel};
pub use period::find_period;
pub use phase::{PhaseEstimate, PhaseFilter, PhaseParams};
pub use plan::JointPlan;
pub use posture::{DIMENSION, Posture, PostureMatrix, PostureVector};
pub use predict::{Basis, Expected, Prediction, Predictor};
pub use retarget::{HeldBack, Mapping, RetargetParams, Retargeter};
pub use sample::{ArmSample, Evidence, JointSample};
pub use teach::{Demonstration, Lesson, TeachParams, TeachReport, teach};
