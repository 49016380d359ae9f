//! Gaussian mixtures.

use gmr_core::{CovarianceKind, GmmParams, MissingValues, MixtureParts, Samples, Start, Stop};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::array::{borrowed, moved, moved2};
use crate::failure::Failure;

/// A fitted mixture: weights `(k)`, means `(k, d)` and covariances as scikit-learn lays them out.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Mixture {
    pub(crate) inner: gmr_core::Mixture,
}

fn kind_of(name: &str) -> Result<CovarianceKind, Failure> {
    match name {
        "full" => Ok(CovarianceKind::Full),
        "tied" => Ok(CovarianceKind::Tied),
        "diag" => Ok(CovarianceKind::Diagonal),
        "spherical" => Ok(CovarianceKind::Spherical),
        _ => Err(Failure::Argument {
            what: "covariance_type",
            expected: "'full', 'tied', 'diag' or 'spherical'".to_owned(),
            got: format!("{name:?}"),
        }),
    }
}

fn name_of(kind: CovarianceKind) -> &'static str {
    match kind {
        CovarianceKind::Full => "full",
        CovarianceKind::Tied => "tied",
        CovarianceKind::Diagonal => "diag",
        CovarianceKind::Spherical => "spherical",
    }
}

fn start_of(name: &str) -> Result<Start, Failure> {
    match name {
        "kmeans" => Ok(Start::KMeans),
        "k-means++" => Ok(Start::KMeansPlusPlus),
        "random_from_data" => Ok(Start::RandomSamples),
        _ => Err(Failure::Argument {
            what: "init_params",
            expected: "'kmeans', 'k-means++' or 'random_from_data'".to_owned(),
            got: format!("{name:?}"),
        }),
    }
}

pub(crate) fn samples<'a>(x: &'a PyReadonlyArray2<'_, f64>) -> Result<Samples<'a>, Failure> {
    Ok(Samples::new(borrowed("X", x)?, x.shape()[1])?)
}

#[pymethods]
impl Mixture {
    #[new]
    fn new(
        kind: &str,
        weights: Vec<f64>,
        means: PyReadonlyArray2<'_, f64>,
        covariances: PyReadonlyArrayDyn<'_, f64>,
    ) -> PyResult<Self> {
        let parts = MixtureParts {
            kind: kind_of(kind)?,
            dim: means.shape()[1],
            weights,
            means: borrowed("means", &means)?.to_vec(),
            covariances: borrowed("covariances", &covariances)?.to_vec(),
        };
        Ok(Self { inner: gmr_core::Mixture::new(parts).map_err(Failure::from)? })
    }

    #[getter]
    fn kind(&self) -> &'static str {
        name_of(self.inner.covariance_kind())
    }

    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        moved(py, self.inner.weights().to_vec())
    }

    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        moved2(py, self.inner.means().to_vec(), [self.inner.components(), self.inner.dim()])
    }

    /// Flat; the Python half knows the shape.
    #[getter]
    fn covariances<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        moved(py, self.inner.covariances().to_vec())
    }

    fn log_densities<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let samples = samples(&x)?;
        let densities = py.detach(|| self.inner.log_densities(&samples)).map_err(Failure::from)?;
        Ok(moved(py, densities))
    }

    fn responsibilities<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let samples = samples(&x)?;
        let shares = py.detach(|| self.inner.responsibilities(&samples)).map_err(Failure::from)?;
        moved2(py, shares, [samples.len(), self.inner.components()])
    }

    /// The component with the largest responsibility, the first of equals.
    fn labels<'py>(&self, py: Python<'py>, x: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let samples = samples(&x)?;
        let labels = py
            .detach(|| {
                let shares = self.inner.responsibilities(&samples)?;
                Ok::<_, gmr_core::Error>(shares.chunks_exact(self.inner.components()).map(first_largest).collect())
            })
            .map_err(Failure::from)?;
        Ok(moved(py, labels))
    }

    fn bic(&self, py: Python<'_>, x: PyReadonlyArray2<'_, f64>) -> PyResult<f64> {
        let samples = samples(&x)?;
        Ok(py.detach(|| self.inner.bic(&samples)).map_err(Failure::from)?)
    }

    fn aic(&self, py: Python<'_>, x: PyReadonlyArray2<'_, f64>) -> PyResult<f64> {
        let samples = samples(&x)?;
        Ok(py.detach(|| self.inner.aic(&samples)).map_err(Failure::from)?)
    }

    /// The mixture of the other dimensions, given the values of some.
    fn condition(&self, dimensions: Vec<usize>, values: Vec<f64>) -> PyResult<Self> {
        Ok(Self { inner: self.inner.condition(&dimensions, &values).map_err(Failure::from)? })
    }

    fn __repr__(&self) -> String {
        format!("Mixture({} components, {} dimensions, {})", self.inner.components(), self.inner.dim(), self.kind())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (py, this) = (slf.py(), slf.get());
        let weights = this.inner.weights().to_vec();
        let state = (this.kind(), weights, this.means(py)?, this.covariances(py)).into_pyobject(py)?;
        Ok((slf.get_type().into_any(), state))
    }
}

fn first_largest(row: &[f64]) -> i64 {
    let mut best = 0;
    for (index, value) in row.iter().enumerate() {
        if *value > row[best] {
            best = index;
        }
    }
    best as i64
}

/// Fits a mixture to `x: (n, d)`, with the interpreter released.
///
/// Returns the mixture, the mean log-likelihood before each M step, and whether the change fell below the tolerance.
#[pyfunction]
#[pyo3(signature = (x, *, components, covariance, init, restarts, max_iterations, tolerance, ridge, seed, weights=None, start=None))]
#[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
pub(crate) fn fit_mixture<'py>(
    py: Python<'py>,
    x: PyReadonlyArray2<'py, f64>,
    components: usize,
    covariance: &str,
    init: &str,
    restarts: usize,
    max_iterations: usize,
    tolerance: f64,
    ridge: f64,
    seed: u64,
    weights: Option<PyReadonlyArray1<'py, f64>>,
    start: Option<PyRef<'py, Mixture>>,
) -> PyResult<(Mixture, Bound<'py, PyArray1<f64>>, bool)> {
    let mut samples = samples(&x)?;
    if let Some(weights) = &weights {
        samples = samples.with_weights(borrowed("sample_weight", weights)?).map_err(Failure::from)?;
    }
    let start = match start {
        Some(mixture) => Start::Mixture(Box::new(mixture.inner.clone())),
        None => start_of(init)?,
    };
    let params = GmmParams {
        components,
        covariance: kind_of(covariance)?,
        start,
        restarts,
        max_iterations,
        tolerance,
        ridge,
        floor: 0.0,
        shrinkage: 0.0,
        missing: MissingValues::Marginalise,
        seed,
    };
    let (inner, report) = py.detach(|| params.validate().and_then(|plan| plan.fit(&samples))).map_err(Failure::from)?;
    let converged = matches!(report.stop, Stop::Converged { .. });
    Ok((Mixture { inner }, moved(py, report.history), converged))
}
