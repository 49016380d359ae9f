//! Learned motion models, as the `ogg` command writes them.

use std::path::PathBuf;

use follow::DIMENSION;
use numpy::{PyArray2, PyArray3, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::array::{borrowed, check_finite, moved2, moved3};
use crate::failure::Failure;

/// Means and rates `(m, 6)`, covariances `(m, 6, 6)`.
type Points<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// A learned action.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct MotionModel {
    inner: follow::MotionModel,
}

#[pymethods]
impl MotionModel {
    #[new]
    fn new(text: &str) -> PyResult<Self> {
        Ok(Self { inner: follow::MotionModel::from_json(text).map_err(Failure::from)? })
    }

    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let text = std::fs::read_to_string(&path).map_err(|source| Failure::File { path, source })?;
        Self::new(&text)
    }

    fn save(&self, path: PathBuf) -> PyResult<()> {
        Ok(std::fs::write(&path, self.inner.to_json()).map_err(|source| Failure::File { path, source })?)
    }

    fn to_json(&self) -> String {
        self.inner.to_json()
    }

    #[getter]
    fn duration_s(&self) -> f64 {
        self.inner.duration_s()
    }

    #[getter]
    fn is_cyclic(&self) -> bool {
        self.inner.is_cyclic()
    }

    #[getter]
    fn elements(&self) -> usize {
        self.inner.elements()
    }

    #[getter]
    fn demonstrations(&self) -> usize {
        self.inner.demonstrations()
    }

    /// Means, rates and covariances at times `(m)`.
    fn at<'py>(&self, py: Python<'py>, times_s: PyReadonlyArray1<'py, f64>) -> PyResult<Points<'py>> {
        let times = borrowed("t", &times_s)?;
        check_finite("t", times)?;
        let points: Vec<_> = py.detach(|| times.iter().map(|t| self.inner.at(*t)).collect());
        let means = points.iter().flat_map(|p| p.mean.iter().copied()).collect();
        let rates = points.iter().flat_map(|p| p.rate.iter().copied()).collect();
        // Symmetric: the order of rows and columns does not matter.
        let covariances = points.iter().flat_map(|p| p.covariance.iter().copied()).collect();
        let count = points.len();
        Ok((
            moved2(py, means, [count, DIMENSION])?,
            moved2(py, rates, [count, DIMENSION])?,
            moved3(py, covariances, [count, DIMENSION, DIMENSION])?,
        ))
    }
}
