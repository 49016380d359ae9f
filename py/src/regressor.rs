//! Gaussian mixture regression.

use numpy::{PyArray2, PyArray3, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::array::{moved2, moved3};
use crate::failure::Failure;
use crate::mixture::{Mixture, samples};

/// Means `(n, outputs)` and covariances `(n, outputs, outputs)`.
type MeansAndCovariances<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// A mixture prepared for the regression of some of its dimensions on others.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Regressor {
    inner: gmr_core::Regressor,
}

#[pymethods]
impl Regressor {
    #[new]
    fn new(mixture: &Mixture, inputs: Vec<usize>, outputs: Vec<usize>) -> PyResult<Self> {
        let inner = gmr_core::Regressor::new(&mixture.inner, &inputs, &outputs).map_err(Failure::from)?;
        Ok(Self { inner })
    }

    fn means<'py>(&self, py: Python<'py>, x: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (queries, outputs) = (samples(&x)?, self.inner.outputs().len());
        let means = py.detach(|| {
            let mut out = self.inner.prediction();
            let mut means = Vec::with_capacity(queries.len() * outputs);
            for i in 0..queries.len() {
                self.inner.predict_mean_into(queries.row(i), &mut out)?;
                means.extend_from_slice(out.mean());
            }
            Ok::<_, gmr_core::Error>(means)
        });
        moved2(py, means.map_err(Failure::from)?, [queries.len(), outputs])
    }

    fn means_and_covariances<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<MeansAndCovariances<'py>> {
        let (queries, outputs) = (samples(&x)?, self.inner.outputs().len());
        let batch = py.detach(|| self.inner.predict_batch(&queries)).map_err(Failure::from)?;
        let means = moved2(py, batch.means, [queries.len(), outputs])?;
        Ok((means, moved3(py, batch.covariances, [queries.len(), outputs, outputs])?))
    }

    /// `dm/dx`, `(n, outputs, inputs)`.
    fn derivatives<'py>(&self, py: Python<'py>, x: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (queries, shape) = (samples(&x)?, [self.inner.outputs().len(), self.inner.inputs().len()]);
        let slopes = py.detach(|| {
            let mut out = self.inner.prediction();
            let mut slopes = Vec::with_capacity(queries.len() * shape[0] * shape[1]);
            for i in 0..queries.len() {
                self.inner.predict_with_jacobian_into(queries.row(i), &mut out)?;
                slopes.extend_from_slice(out.jacobian());
            }
            Ok::<_, gmr_core::Error>(slopes)
        });
        moved3(py, slopes.map_err(Failure::from)?, [queries.len(), shape[0], shape[1]])
    }
}
