//! Gaussian mixtures.

use std::time::Instant;

use gmr_core::{
    ArimaOrder, ArimaParams, CovarianceKind, Criterion, FitReport, Fusion, FusionReading, GmmParams, MissingValues,
    MixtureParts, Samples, Start, Stop, Trajectory,
};
use numpy::{Ix2, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::array::{borrowed, moved, moved2, ready, released};
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

/// The kernel takes samples in blocks of this many.
const BLOCK: usize = 128;

impl Mixture {
    /// Multiply-adds of the densities of `n` samples.
    fn cost(&self, n: usize) -> usize {
        let d = self.inner.dim();
        n.next_multiple_of(BLOCK) * self.inner.components() * d * (d + 1) / 2
    }

    fn densities(&self, py: Python<'_>, samples: &Samples<'_>) -> Result<Vec<f64>, gmr_core::Error> {
        released(py, self.cost(samples.len()), || self.inner.log_densities(samples))
    }

    fn shares(&self, py: Python<'_>, samples: &Samples<'_>) -> Result<Vec<f64>, gmr_core::Error> {
        released(py, self.cost(samples.len()), || self.inner.responsibilities(samples))
    }

    fn labels_of(&self, samples: &Samples<'_>) -> Result<Vec<i64>, gmr_core::Error> {
        let shares = self.inner.responsibilities(samples)?;
        Ok(shares.chunks_exact(self.inner.components()).map(first_largest).collect())
    }
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

    /// Log densities, responsibilities or labels of an array that is ready for it and whose rows all have them; else
    /// `None`, and the method of that name says why.
    fn log_densities_if_ready<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArray1<f64>>> {
        let x = ready::<Ix2>(x, self.inner.dim())?;
        Some(moved(py, self.densities(py, &samples(&x).ok()?).ok()?))
    }

    fn responsibilities_if_ready<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> Option<Bound<'py, PyArray2<f64>>> {
        let x = ready::<Ix2>(x, self.inner.dim())?;
        let shares = self.shares(py, &samples(&x).ok()?).ok()?;
        moved2(py, shares, [x.shape()[0], self.inner.components()]).ok()
    }

    fn labels_if_ready<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> Option<Bound<'py, PyArray1<i64>>> {
        let x = ready::<Ix2>(x, self.inner.dim())?;
        let samples = samples(&x).ok()?;
        let labels = released(py, self.cost(samples.len()), || self.labels_of(&samples));
        Some(moved(py, labels.ok()?))
    }

    fn log_densities<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(moved(py, self.densities(py, &samples(&x)?).map_err(Failure::from)?))
    }

    fn responsibilities<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let samples = samples(&x)?;
        let shares = self.shares(py, &samples).map_err(Failure::from)?;
        moved2(py, shares, [samples.len(), self.inner.components()])
    }

    /// The component with the largest responsibility, the first of equals.
    fn labels<'py>(&self, py: Python<'py>, x: PyReadonlyArray2<'py, f64>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let samples = samples(&x)?;
        let labels = released(py, self.cost(samples.len()), || self.labels_of(&samples)).map_err(Failure::from)?;
        Ok(moved(py, labels))
    }

    /// Mean time of the work inside [`Mixture::labels`], seconds: what a benchmark takes off the time of a call.
    fn labels_seconds(&self, py: Python<'_>, x: PyReadonlyArray2<'_, f64>, repeats: u32) -> PyResult<f64> {
        let samples = samples(&x)?;
        let taken = py.detach(|| {
            let begin = Instant::now();
            for _ in 0..repeats {
                std::hint::black_box(self.labels_of(std::hint::black_box(&samples))?);
            }
            Ok::<_, gmr_core::Error>(begin.elapsed())
        });
        Ok(taken.map_err(Failure::from)?.as_secs_f64() / f64::from(repeats))
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

/// History, whether it converged, and per step the reliability and the omega of weight fusion.
type FitAnswer<'py> = (Bound<'py, PyArray1<f64>>, bool, Option<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>)>);

fn answer(py: Python<'_>, report: FitReport) -> PyResult<FitAnswer<'_>> {
    let converged = matches!(report.stop, Stop::Converged { .. });
    let fusion = match report.fusion {
        None => None,
        Some(fusion) => {
            let width = fusion.steps.first().map_or(0, |step| step.omega.len());
            let shape = [fusion.steps.len(), width];
            let reliability = fusion.steps.iter().flat_map(|step| step.reliability.iter().copied()).collect();
            let omega = fusion.steps.iter().flat_map(|step| step.omega.iter().copied()).collect();
            Some((moved2(py, reliability, shape)?, moved2(py, omega, shape)?))
        }
    };
    Ok((moved(py, report.history), converged, fusion))
}

/// What a fit does, but for the number of components.
struct Settings<'a> {
    covariance: &'a str,
    init: &'a str,
    restarts: usize,
    max_iterations: usize,
    tolerance: f64,
    ridge: f64,
    seed: u64,
}

impl Settings<'_> {
    fn params(&self, components: usize, start: Option<PyRef<'_, Mixture>>) -> Result<GmmParams, Failure> {
        let start = match start {
            Some(mixture) => Start::Mixture(Box::new(mixture.inner.clone())),
            None => start_of(self.init)?,
        };
        Ok(GmmParams {
            components,
            covariance: kind_of(self.covariance)?,
            start,
            restarts: self.restarts,
            max_iterations: self.max_iterations,
            tolerance: self.tolerance,
            ridge: self.ridge,
            floor: 0.0,
            shrinkage: 0.0,
            missing: MissingValues::Marginalise,
            seed: self.seed,
        })
    }
}

fn weighted<'a>(samples: Samples<'a>, weights: Option<&'a PyReadonlyArray1<'_, f64>>) -> Result<Samples<'a>, Failure> {
    match weights {
        Some(weights) => Ok(samples.with_weights(borrowed("sample_weight", weights)?)?),
        None => Ok(samples),
    }
}

/// Fits a mixture to `x: (n, d)`, with the interpreter released.
///
/// `fusion` is one ARIMA error per sample and the reading of equations (11)-(14).
#[pyfunction]
#[pyo3(signature = (x, *, components, covariance, init, restarts, max_iterations, tolerance, ridge, seed, weights=None, start=None, fusion=None))]
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
    fusion: Option<(PyReadonlyArray1<'py, f64>, String)>,
) -> PyResult<(Mixture, FitAnswer<'py>)> {
    let samples = weighted(samples(&x)?, weights.as_ref())?;
    let settings = Settings { covariance, init, restarts, max_iterations, tolerance, ridge, seed };
    let params = settings.params(components, start)?;
    let fusion = match &fusion {
        None => None,
        Some((errors, reading)) => {
            let errors = borrowed("weight_fusion errors", errors)?;
            Some(Fusion::new(errors, reading_of(reading)?).map_err(Failure::from)?)
        }
    };
    let fitted = py.detach(|| {
        let plan = params.validate()?;
        match &fusion {
            None => plan.fit(&samples),
            Some(fusion) => plan.fit_fused(&samples, fusion),
        }
    });
    let (inner, report) = fitted.map_err(Failure::from)?;
    Ok((Mixture { inner }, answer(py, report)?))
}

fn reading_of(name: &str) -> Result<FusionReading, Failure> {
    match name {
        "components" => Ok(FusionReading::Components),
        "literal" => Ok(FusionReading::Literal),
        _ => Err(Failure::Argument {
            what: "weight_fusion reading",
            expected: "'components' or 'literal'".to_owned(),
            got: format!("{name:?}"),
        }),
    }
}

/// Fits every number of components up to `most`; the one with the lowest criterion, and the criterion of each (NaN
/// where no mixture could be fitted).
#[pyfunction]
#[pyo3(signature = (x, *, least, most, criterion, covariance, init, restarts, max_iterations, tolerance, ridge, seed, weights=None))]
#[expect(clippy::too_many_arguments, reason = "a keyword-only Python signature")]
pub(crate) fn select_mixture<'py>(
    py: Python<'py>,
    x: PyReadonlyArray2<'py, f64>,
    least: usize,
    most: usize,
    criterion: &str,
    covariance: &str,
    init: &str,
    restarts: usize,
    max_iterations: usize,
    tolerance: f64,
    ridge: f64,
    seed: u64,
    weights: Option<PyReadonlyArray1<'py, f64>>,
) -> PyResult<(Mixture, Bound<'py, PyArray1<f64>>, FitAnswer<'py>)> {
    let samples = weighted(samples(&x)?, weights.as_ref())?;
    let settings = Settings { covariance, init, restarts, max_iterations, tolerance, ridge, seed };
    let params = settings.params(1, None)?;
    let criterion = match criterion {
        "bic" => Criterion::Bic,
        "aic" => Criterion::Aic,
        _ => {
            let (what, expected) = ("criterion", "'bic' or 'aic'".to_owned());
            return Err(Failure::Argument { what, expected, got: format!("{criterion:?}") }.into());
        }
    };
    let found = py.detach(|| gmr_core::select_components(&samples, &params, least..=most, criterion));
    let mut found = found.map_err(Failure::from)?;
    let value = |report: &FitReport| match criterion {
        Criterion::Bic => report.bic,
        Criterion::Aic => report.aic,
    };
    let values = found.table.iter().map(|row| row.result.as_ref().map_or(f64::NAN, value)).collect();
    let report = found.table.swap_remove(found.best).result.map_err(Failure::from)?;
    Ok((Mixture { inner: found.mixture }, moved(py, values), answer(py, report)?))
}

/// Standardised ARIMA errors of the rows of `x: (n, d)`, one demonstration after the other.
#[pyfunction]
pub(crate) fn arima_errors<'py>(
    py: Python<'py>,
    x: PyReadonlyArray2<'py, f64>,
    lengths: Vec<usize>,
    order: (usize, usize, usize),
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (values, dim) = (borrowed("X", &x)?, x.shape()[1]);
    let order = ArimaOrder { p: order.0, d: order.1, q: order.2 };
    let params = ArimaParams { order, constant: order.d == 0, ..ArimaParams::default() };
    let errors = py.detach(|| {
        let mut rest = values;
        let mut demonstrations = Vec::with_capacity(lengths.len());
        for &length in &lengths {
            let (rows, others) = rest.split_at_checked(length * dim).ok_or(gmr_core::Error::Length {
                what: "weight_fusion lengths",
                expected: values.len() / dim,
                got: lengths.iter().sum(),
            })?;
            let times = (0..length).map(|i| i as f64).collect();
            demonstrations.push(Trajectory::new(times, rows.to_vec(), dim)?);
            rest = others;
        }
        gmr_core::arima_errors(&demonstrations, &params.validate()?)
    });
    Ok(moved(py, errors.map_err(Failure::from)?.errors.concat()))
}
