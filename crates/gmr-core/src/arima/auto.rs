//! Automatic order: differences by the KPSS test, orders by AICc.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::model::{Arima, check_series};
use super::params::{ArimaOrder, ArimaParams, ArimaPlan};
use super::report::ArimaReport;
use crate::error::{Error, Result};

/// 5 % critical value of the level-stationarity test (Kwiatkowski et al. 1992, table 1).
const KPSS_CRITICAL: f64 = 0.463;

/// Bounds of the search for an order.
///
/// ```
/// use gmr_core::AutoArimaParams;
/// # fn main() -> Result<(), gmr_core::Error> {
/// // A logistic map is stationary: no difference is taken.
/// let mut x = 0.3;
/// let y: Vec<f64> = (0..120).map(|_| { x = 3.9 * x * (1.0 - x); x }).collect();
/// let found = AutoArimaParams { max_p: 2, max_q: 2, ..AutoArimaParams::default() }.validate()?.fit(&y)?;
/// assert_eq!(found.order.d, 0);
/// assert_eq!(found.candidates.len(), 18);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AutoArimaParams {
    /// Largest autoregressive order.
    pub max_p: usize,
    /// Largest order of differencing.
    pub max_d: usize,
    /// Largest moving average order.
    pub max_q: usize,
    /// Largest `p + q`.
    pub max_terms: usize,
    /// Quasi-Newton iterations at most, per fit.
    pub max_iterations: usize,
}

impl Default for AutoArimaParams {
    /// Up to ARIMA(5, 2, 5) with at most five terms.
    fn default() -> Self {
        Self { max_p: 5, max_d: 2, max_q: 5, max_terms: 5, max_iterations: 100 }
    }
}

/// Checked bounds.
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// let plan = gmr_core::AutoArimaParams { max_p: 1, max_q: 1, ..Default::default() }.validate()?;
/// // A series of zeros fits no order: its likelihood is unbounded.
/// assert!(plan.fit(&[0.0; 50]).is_err());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AutoArimaPlan {
    params: AutoArimaParams,
}

/// One order that was tried.
///
/// ```
/// # use gmr_core::AutoArimaParams;
/// # fn main() -> Result<(), gmr_core::Error> {
/// // A logistic map is stationary: no difference is taken.
/// let mut x = 0.3;
/// let y: Vec<f64> = (0..120).map(|_| { x = 3.9 * x * (1.0 - x); x }).collect();
/// let found = AutoArimaParams { max_p: 1, max_q: 0, ..AutoArimaParams::default() }.validate()?.fit(&y)?;
/// // Orders 0 and 1, each without and with a mean.
/// assert_eq!(found.candidates.iter().filter(|c| c.constant).count(), 2);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ArimaCandidate {
    /// Its order.
    pub order: ArimaOrder,
    /// Whether a mean or drift was estimated.
    pub constant: bool,
    /// Its report, or why it could not be fitted.
    pub result: Result<ArimaReport>,
}

/// The chosen model and all that were tried.
///
/// ```
/// # use gmr_core::AutoArimaParams;
/// # fn main() -> Result<(), gmr_core::Error> {
/// // A logistic map is stationary: no difference is taken.
/// let mut x = 0.3;
/// let y: Vec<f64> = (0..120).map(|_| { x = 3.9 * x * (1.0 - x); x }).collect();
/// let found = AutoArimaParams { max_p: 1, max_q: 0, ..AutoArimaParams::default() }.validate()?.fit(&y)?;
/// assert_eq!((found.order.d, found.kpss.len(), found.candidates.len()), (0, 1, 4));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct AutoArima {
    /// The model with the lowest AICc.
    pub model: Arima,
    /// Its report.
    pub report: ArimaReport,
    /// Its order.
    pub order: ArimaOrder,
    /// KPSS statistic of the series after 0, 1, .. differences, up to the chosen `d`.
    pub kpss: Vec<f64>,
    /// Everything tried, in a fixed order.
    pub candidates: Vec<ArimaCandidate>,
}

type Tried = (ArimaOrder, bool, Result<(Arima, ArimaReport)>);

impl AutoArimaParams {
    /// Checks the bounds.
    ///
    /// ```
    /// assert!(gmr_core::AutoArimaParams { max_d: 5, ..Default::default() }.validate().is_err());
    /// ```
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] for orders beyond what a fit accepts.
    pub fn validate(self) -> Result<AutoArimaPlan> {
        let order = ArimaOrder { p: self.max_p, d: self.max_d, q: self.max_q };
        ArimaParams { order, max_iterations: self.max_iterations, ..ArimaParams::default() }.validate()?;
        Ok(AutoArimaPlan { params: self })
    }
}

impl AutoArimaPlan {
    /// Chooses `d` by repeated KPSS tests and `(p, q, constant)` by the lowest AICc over the whole
    /// grid, in parallel. A constant is tried for `d <= 1`. The tests see the observed values one after another, as if
    /// there were no gaps; the fits see the gaps.
    ///
    /// ```
    /// # use gmr_core::AutoArimaParams;
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // A logistic map is stationary: no difference is taken.
    /// let mut x = 0.3;
    /// let y: Vec<f64> = (0..120).map(|_| { x = 3.9 * x * (1.0 - x); x }).collect();
    /// let found = AutoArimaParams { max_p: 1, max_q: 0, ..AutoArimaParams::default() }.validate()?.fit(&y)?;
    /// assert_eq!(found.order.d, 0);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Infinite values, too few values, or a series no order fits (for instance one of zeros).
    pub fn fit(&self, y: &[f64]) -> Result<AutoArima> {
        check_series(y)?;
        let mut series: Vec<f64> = y.iter().copied().filter(|v| !v.is_nan()).collect();
        let mut statistics = Vec::new();
        let mut d = 0;
        loop {
            let statistic = kpss(&series)?;
            statistics.push(statistic);
            if statistic <= KPSS_CRITICAL || d == self.params.max_d {
                break;
            }
            d += 1;
            series = series.windows(2).map(|p| p[1] - p[0]).collect();
        }
        let mut grid = Vec::new();
        for p in 0..=self.params.max_p {
            for q in 0..=self.params.max_q {
                if p + q <= self.params.max_terms {
                    let order = ArimaOrder { p, d, q };
                    grid.push((order, false));
                    if d <= 1 {
                        grid.push((order, true));
                    }
                }
            }
        }
        let fits: Vec<Tried> = grid
            .into_par_iter()
            .map(|(order, constant)| {
                let params = ArimaParams {
                    order,
                    constant,
                    max_iterations: self.params.max_iterations,
                    ..ArimaParams::default()
                };
                (order, constant, params.validate().and_then(|plan: ArimaPlan| plan.fit(y)))
            })
            .collect();
        let mut best: Option<(f64, ArimaOrder, Arima, ArimaReport)> = None;
        let mut last_error = None;
        let mut candidates = Vec::with_capacity(fits.len());
        for (order, constant, fit) in fits {
            let result = match fit {
                Ok((model, report)) => {
                    if best.as_ref().is_none_or(|(aicc, ..)| report.aicc < *aicc) {
                        best = Some((report.aicc, order, model, report.clone()));
                    }
                    Ok(report)
                }
                Err(error) => {
                    last_error = Some(error.clone());
                    Err(error)
                }
            };
            candidates.push(ArimaCandidate { order, constant, result });
        }
        match (best, last_error) {
            (Some((_, order, model, report)), _) => {
                Ok(AutoArima { model, report, order, kpss: statistics, candidates })
            }
            (None, Some(error)) => Err(error),
            (None, None) => Err(Error::TooFewSamples { what: "ARIMA orders", needed: 1, got: 0 }),
        }
    }
}

/// KPSS statistic of level stationarity with Bartlett weights up to lag `4 (n / 100)^(1/4)`;
/// above 0.463 stationarity is rejected at 5 %. A constant series has statistic zero.
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// // Deviations (-1, 0, 1) with running sums (-1, -1, 0): (2 / 9) / (2 / 3).
/// assert!((gmr_core::kpss(&[0.0, 1.0, 2.0])? - 1.0 / 3.0).abs() < 1e-15);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Fewer than three values or values that are not finite.
pub fn kpss(y: &[f64]) -> Result<f64> {
    let n = y.len();
    if n < 3 {
        return Err(Error::TooFewSamples { what: "KPSS test", needed: 3, got: n });
    }
    crate::error::check_values("series", y)?;
    let mean = y.iter().sum::<f64>() / n as f64;
    let peak = y.iter().fold(0.0f64, |m, v| m.max((v - mean).abs()));
    if !(peak >= 1e-290) {
        return Ok(0.0);
    }
    let e: Vec<f64> = y.iter().map(|v| (v - mean) / peak).collect();
    let lags = (4.0 * (n as f64 / 100.0).powf(0.25)) as usize;
    let product = |lag: usize| e.iter().zip(&e[lag.min(n)..]).map(|(a, b)| a * b).sum::<f64>() / n as f64;
    let long_run =
        product(0) + 2.0 * (1..=lags).map(|l| (1.0 - l as f64 / (lags as f64 + 1.0)) * product(l)).sum::<f64>();
    let mut partial = 0.0;
    let squares: f64 = e
        .iter()
        .map(|v| {
            partial += v;
            partial * partial
        })
        .sum();
    Ok(squares / (n * n) as f64 / long_run)
}
