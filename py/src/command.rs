//! The `ogg` command.

use std::ffi::OsString;

use pyo3::prelude::*;

/// Runs the command with the arguments given, the program's name first; its exit code.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| ogg::commands::main(arguments))
}
