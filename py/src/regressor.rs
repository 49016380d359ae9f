//! Gaussian mixture regression.

use std::sync::{Mutex, TryLockError};

use gmr_core::{Prediction, Samples};
use numpy::{Ix2, PyArray2, PyArray3, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::array::{moved, moved2, moved3, ready, released};
use crate::failure::Failure;
use crate::mixture::{Mixture, samples};

/// Means `(n, outputs)` and covariances `(n, outputs, outputs)`.
type MeansAndCovariances<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// A mixture prepared for the regression of some of its dimensions on others.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Regressor {
    inner: gmr_core::Regressor,
    /// Working space of the last call, for the next one; a call beside another one makes its own.
    space: Mutex<Option<Box<Prediction>>>,
}

impl Regressor {
    fn kept_space(&self) -> Option<Box<Prediction>> {
        match self.space.try_lock() {
            Ok(mut place) => place.take(),
            Err(TryLockError::WouldBlock | TryLockError::Poisoned(_)) => None,
        }
    }

    /// Multiply-adds of `n` queries.
    fn cost(&self, n: usize) -> usize {
        let (inputs, outputs) = (self.inner.inputs().len(), self.inner.outputs().len());
        n * self.inner.components() * (inputs + outputs) * (inputs + 1)
    }

    /// What `take` finds in the answer to each query, one after the other.
    fn answers(
        &self,
        queries: &Samples<'_>,
        width: usize,
        answer: impl Fn(&gmr_core::Regressor, &[f64], &mut Prediction) -> Result<(), gmr_core::Error>,
        take: impl Fn(&Prediction) -> &[f64],
    ) -> Result<Vec<f64>, gmr_core::Error> {
        let mut space = self.kept_space().unwrap_or_else(|| Box::new(self.inner.prediction()));
        let mut found = Vec::with_capacity(queries.len() * width);
        for i in 0..queries.len() {
            answer(&self.inner, queries.row(i), &mut space)?;
            found.extend_from_slice(take(&space));
        }
        if let Ok(mut place) = self.space.try_lock() {
            *place = Some(space);
        }
        Ok(found)
    }

    fn mean_rows(&self, py: Python<'_>, queries: &Samples<'_>) -> Result<Vec<f64>, gmr_core::Error> {
        let width = self.inner.outputs().len();
        released(py, self.cost(queries.len()), || {
            self.answers(queries, width, gmr_core::Regressor::predict_mean_into, Prediction::mean)
        })
    }
}

#[pymethods]
impl Regressor {
    #[new]
    fn new(mixture: &Mixture, inputs: Vec<usize>, outputs: Vec<usize>) -> PyResult<Self> {
        let inner = gmr_core::Regressor::new(&mixture.inner, &inputs, &outputs).map_err(Failure::from)?;
        Ok(Self { inner, space: Mutex::new(None) })
    }

    /// Means of an array that is ready for it and whose queries all have an answer, `(n, outputs)`, or `(n)` where they are
    /// flat; else `None`, and [`Regressor::means`] says why.
    fn means_if_ready<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>, flat: bool) -> Option<Bound<'py, PyAny>> {
        let x = ready::<Ix2>(x, self.inner.inputs().len())?;
        let means = self.mean_rows(py, &samples(&x).ok()?).ok()?;
        if flat {
            return Some(moved(py, means).into_any());
        }
        Some(moved2(py, means, [x.shape()[0], self.inner.outputs().len()]).ok()?.into_any())
    }

    fn means<'py>(&self, py: Python<'py>, x: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let queries = samples(&x)?;
        let means = self.mean_rows(py, &queries).map_err(Failure::from)?;
        moved2(py, means, [queries.len(), self.inner.outputs().len()])
    }

    fn means_and_covariances<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<MeansAndCovariances<'py>> {
        let (queries, outputs) = (samples(&x)?, self.inner.outputs().len());
        let batch = released(py, self.cost(outputs * queries.len()), || self.inner.predict_batch(&queries));
        let batch = batch.map_err(Failure::from)?;
        let means = moved2(py, batch.means, [queries.len(), outputs])?;
        Ok((means, moved3(py, batch.covariances, [queries.len(), outputs, outputs])?))
    }

    /// `dm/dx`, `(n, outputs, inputs)`.
    fn derivatives<'py>(&self, py: Python<'py>, x: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (queries, [outputs, inputs]) = (samples(&x)?, [self.inner.outputs().len(), self.inner.inputs().len()]);
        let slopes = released(py, self.cost(inputs * queries.len()), || {
            let answer = gmr_core::Regressor::predict_with_jacobian_into;
            self.answers(&queries, outputs * inputs, answer, Prediction::jacobian)
        });
        moved3(py, slopes.map_err(Failure::from)?, [queries.len(), outputs, inputs])
    }
}
