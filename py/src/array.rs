//! Arrays across the border: borrowed on the way in, moved on the way out.

use numpy::ndarray::{Array, ArrayView, Dimension, IntoDimension, ShapeError};
use numpy::{Element, PyArray, PyArray1, PyArrayMethods, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::marker::Ungil;
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

/// An array that needs no conversion and no message: float64, C-contiguous, aligned, not empty, `columns` long on its last
/// axis, of NumPy's own class. Everything else is left to the Python half of the package.
pub(crate) fn ready<'py, D: Dimension>(
    array: &Bound<'py, PyAny>,
    columns: usize,
) -> Option<PyReadonlyArray<'py, f64, D>> {
    let array = array.cast_exact::<PyArray<f64, D>>().ok()?;
    let fits = array.is_c_contiguous() && array.shape().last() == Some(&columns) && !array.is_empty();
    if fits { array.try_readonly().ok() } else { None }
}

/// Work of fewer multiply-adds (some tens of microseconds) keeps the interpreter: to release it and wait for it again costs
/// more than it gives, up to a switch interval of 5 ms where another thread is busy.
const RELEASED_FROM: usize = 1 << 17;

/// Does work of about `multiply_adds`, with the interpreter released if that takes long.
pub(crate) fn released<R: Ungil>(py: Python<'_>, multiply_adds: usize, work: impl Ungil + FnOnce() -> R) -> R {
    if multiply_adds < RELEASED_FROM { work() } else { py.detach(work) }
}

/// Arrays of up to this many numbers are copied into memory of NumPy's own, which costs less than an owner for theirs.
const COPIED_UP_TO: usize = 256;

fn shaped<T: Element, S: IntoDimension>(
    py: Python<'_>,
    values: Vec<T>,
    shape: S,
) -> PyResult<Bound<'_, PyArray<T, S::Dim>>> {
    let wrong = |_: ShapeError| Failure::Layout { what: "result" };
    let shape = shape.into_dimension();
    if values.len() <= COPIED_UP_TO {
        let view = ArrayView::from_shape(shape, &values).map_err(wrong)?;
        return Ok(PyArray::from_array(py, &view));
    }
    Ok(PyArray::from_owned_array(py, Array::from_shape_vec(shape, values).map_err(wrong)?))
}

/// Hands a vector to Python as a one-dimensional array.
pub(crate) fn moved<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    if values.len() <= COPIED_UP_TO { PyArray::from_slice(py, &values) } else { PyArray::from_vec(py, values) }
}

/// Hands a vector to Python as a two-dimensional array.
pub(crate) fn moved2<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; 2],
) -> PyResult<Bound<'_, PyArray<T, numpy::Ix2>>> {
    shaped(py, values, shape)
}

/// Hands a vector to Python as a three-dimensional array.
pub(crate) fn moved3<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; 3],
) -> PyResult<Bound<'_, PyArray<T, numpy::Ix3>>> {
    shaped(py, values, shape)
}

/// Hands a vector to Python as a four-dimensional array.
pub(crate) fn moved4<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    shape: [usize; 4],
) -> PyResult<Bound<'_, PyArray<T, numpy::Ix4>>> {
    shaped(py, values, shape)
}

/// Hands a vector to Python as an array with the leading axes of another one, then `tail`.
pub(crate) fn moved_under<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    lead: &[usize],
    tail: &[usize],
) -> PyResult<Bound<'py, PyArray<f64, numpy::IxDyn>>> {
    shaped(py, values, numpy::IxDyn(&[lead, tail].concat()))
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
