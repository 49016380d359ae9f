//! Arrays across the border: borrowed on the way in, moved on the way out.

use numpy::ndarray::Dimension;
use numpy::{Element, IntoPyArray, PyArray, PyArray1, PyArrayMethods, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::failure::Failure;

/// The numbers of a C-contiguous array, without a copy.
pub(crate) fn borrowed<'a, T: Element, D: Dimension>(
    what: &'static str,
    array: &'a PyReadonlyArray<'_, T, D>,
) -> Result<&'a [T], Failure> {
    if !array.is_c_contiguous() {
        return Err(Failure::Layout { what });
    }
    array.as_slice().map_err(|_| Failure::Layout { what })
}

/// Hands a vector to Python as a one-dimensional array.
pub(crate) fn moved<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    values.into_pyarray(py)
}

/// Hands a vector to Python as a two-dimensional array.
pub(crate) fn moved2<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; 2],
) -> PyResult<Bound<'_, PyArray<T, numpy::Ix2>>> {
    moved(py, values).reshape(shape)
}

/// Hands a vector to Python as a three-dimensional array.
pub(crate) fn moved3<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; 3],
) -> PyResult<Bound<'_, PyArray<T, numpy::Ix3>>> {
    moved(py, values).reshape(shape)
}

/// Hands a vector to Python as a four-dimensional array.
pub(crate) fn moved4<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; 4],
) -> PyResult<Bound<'_, PyArray<T, numpy::Ix4>>> {
    moved(py, values).reshape(shape)
}

/// Refuses NaN and infinity.
pub(crate) fn check_finite(what: &'static str, values: &[f64]) -> Result<(), Failure> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Failure::Argument {
            what,
            expected: "finite numbers".to_owned(),
            got: format!("{} at flat index {index}", values[index]),
        }),
    }
}

/// Refuses a length that does not fit.
pub(crate) fn check_len(what: &'static str, expected: usize, got: usize) -> Result<(), Failure> {
    if expected == got {
        Ok(())
    } else {
        Err(Failure::Argument { what, expected: format!("length {expected}"), got: got.to_string() })
    }
}
