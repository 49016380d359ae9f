//! The native half of the Python package ogg_rs.
//!
//! Everything here is private to the package: arguments arrive checked for type and shape by the Python half, as
//! C-contiguous `float64` arrays that are borrowed, and results leave as arrays that own the memory Rust computed them in.
#![allow(clippy::needless_pass_by_value, reason = "arguments of Python functions are extracted by value")]

mod arima;
mod array;
mod failure;
mod mixture;
mod model;
mod regressor;
mod robot;
mod tracker;

/// The extension module `ogg_rs._native`.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use crate::arima::{Arima, auto_arima, fit_arima};
    #[pymodule_export]
    use crate::mixture::{Mixture, fit_mixture};
    #[pymodule_export]
    use crate::model::MotionModel;
    #[pymodule_export]
    use crate::regressor::Regressor;
    #[pymodule_export]
    use crate::robot::Robot;
    #[pymodule_export]
    use crate::tracker::Tracker;
}
