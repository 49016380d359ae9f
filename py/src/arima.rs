//! ARIMA models of one series.

use gmr_core::{ArimaOrder, ArimaParams, ArimaParts, AutoArimaParams};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::array::{borrowed, moved};
use crate::failure::Failure;

type Array<'py> = Bound<'py, PyArray1<f64>>;

/// A model: `ar`, order of differencing, `ma`, mean of the differenced series, innovation variance.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Arima {
    inner: gmr_core::Arima,
}

#[pymethods]
impl Arima {
    #[new]
    fn new(ar: Vec<f64>, difference: usize, ma: Vec<f64>, mean: f64, variance: f64) -> PyResult<Self> {
        let parts = ArimaParts { ar, difference, ma, mean, variance };
        Ok(Self { inner: gmr_core::Arima::new(parts).map_err(Failure::from)? })
    }

    /// `(ar, difference, ma, mean, variance)`.
    fn parts(&self) -> (Vec<f64>, usize, Vec<f64>, f64, f64) {
        let p = self.inner.parts();
        (p.ar.clone(), p.difference, p.ma.clone(), p.mean, p.variance)
    }

    fn log_likelihood(&self, py: Python<'_>, y: PyReadonlyArray1<'_, f64>) -> PyResult<f64> {
        let y = borrowed("y", &y)?;
        Ok(py.detach(|| self.inner.log_likelihood(y)).map_err(Failure::from)?)
    }

    /// Log-likelihood, fitted values and residuals; NaN where a value is missing or the level is not yet known.
    fn filter<'py>(&self, py: Python<'py>, y: PyReadonlyArray1<'py, f64>) -> PyResult<(f64, Array<'py>, Array<'py>)> {
        let y = borrowed("y", &y)?;
        let run = py.detach(|| self.inner.filter(y)).map_err(Failure::from)?;
        let fitted = run.fitted.iter().map(|v| v.unwrap_or(f64::NAN)).collect();
        let residuals = run.residuals.iter().map(|v| v.map_or(f64::NAN, |v| v.value)).collect();
        Ok((run.log_likelihood, moved(py, fitted), moved(py, residuals)))
    }

    /// Means and variances of the `steps` values after `y`.
    fn forecast<'py>(
        &self,
        py: Python<'py>,
        y: PyReadonlyArray1<'py, f64>,
        steps: usize,
    ) -> PyResult<(Array<'py>, Array<'py>)> {
        let y = borrowed("y", &y)?;
        let ahead = py.detach(|| self.inner.filter(y).map(|run| run.state.forecast(steps))).map_err(Failure::from)?;
        let means = ahead.iter().map(|f| f.mean).collect();
        let variances = ahead.iter().map(|f| f.variance).collect();
        Ok((moved(py, means), moved(py, variances)))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> (Bound<'py, PyAny>, (Vec<f64>, usize, Vec<f64>, f64, f64)) {
        (slf.get_type().into_any(), slf.get().parts())
    }
}

/// Fits a model of a given order by exact maximum likelihood; NaN marks missing values.
#[pyfunction]
pub(crate) fn fit_arima(
    py: Python<'_>,
    y: PyReadonlyArray1<'_, f64>,
    order: (usize, usize, usize),
    constant: bool,
) -> PyResult<Arima> {
    let y = borrowed("y", &y)?;
    let order = ArimaOrder { p: order.0, d: order.1, q: order.2 };
    let params = ArimaParams { order, constant, ..ArimaParams::default() };
    let (inner, _) = py.detach(|| params.validate().and_then(|plan| plan.fit(y))).map_err(Failure::from)?;
    Ok(Arima { inner })
}

/// Order and constant with the lowest AICc, differences by the KPSS test.
#[pyfunction]
pub(crate) fn auto_arima(
    py: Python<'_>,
    y: PyReadonlyArray1<'_, f64>,
    max_p: usize,
    max_d: usize,
    max_q: usize,
) -> PyResult<((usize, usize, usize), bool)> {
    let y = borrowed("y", &y)?;
    let params = AutoArimaParams { max_p, max_d, max_q, ..AutoArimaParams::default() };
    let found = py.detach(|| params.validate().and_then(|plan| plan.fit(y))).map_err(Failure::from)?;
    let order = found.order;
    let chosen = |c: &&gmr_core::ArimaCandidate| c.order == order && c.result.as_ref() == Ok(&found.report);
    let constant = found.candidates.iter().find(chosen).is_some_and(|c| c.constant);
    Ok(((order.p, order.d, order.q), constant))
}
