//! The native half of the Python package ogg_rs.
//!
//! Everything here is private to the package: arguments arrive checked for type and shape by the Python half, as
//! C-contiguous `float64` arrays that are borrowed, and results leave as arrays that own the memory Rust computed them in;
//! small ones are copied. Methods named `.._if_ready` take what a caller gave, unchecked, for the Python half would cost more
//! than the work: they answer `None` to everything that has to be converted or refused.
#![allow(clippy::needless_pass_by_value, reason = "arguments of Python functions are extracted by value")]

mod arima;
mod array;
mod can;
mod command;
mod evaluation;
mod failure;
mod mixture;
mod model;
mod network;
mod pose;
mod recording;
mod regressor;
mod robot;
mod sim;
mod tracker;

/// The extension module `ogg_rs._native`.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use crate::arima::{Arima, auto_arima, fit_arima};
    #[pymodule_export]
    use crate::can::{Codec, controller_states, crc16, dbc_text, read_candump, stop_causes};
    #[pymodule_export]
    use crate::command::main;
    #[pymodule_export]
    use crate::evaluation::{coco_sigmas, evaluate_keypoints};
    #[pymodule_export]
    use crate::mixture::{Mixture, arima_errors, fit_mixture, select_mixture};
    #[pymodule_export]
    use crate::model::MotionModel;
    #[pymodule_export]
    use crate::network::{Estimator, builtin_cards};
    #[pymodule_export]
    use crate::pose::{decode, encode_targets, fuse_labels, published_limbs, skeleton_sources, skeletons};
    #[pymodule_export]
    use crate::recording::Recording;
    #[pymodule_export]
    use crate::regressor::Regressor;
    #[pymodule_export]
    use crate::robot::Robot;
    #[pymodule_export]
    use crate::sim::{Arm, Scene, Worker, random_frame, worker_keypoints};
    #[pymodule_export]
    use crate::tracker::Tracker;
}
