//! Maximum likelihood.

use serde::{Deserialize, Serialize};

use super::filter::MAX_STATE;
use super::model::{Arima, ArimaParts, check_series};
use super::objective::{Objective, Prepared};
use super::optimise::{Minimum, minimise};
use super::starts::{GRID_STARTS, coarse_grid, hannan_rissanen, lowest};
use crate::error::{Error, Result};
use crate::gmm::LN_2_PI;

/// Orders of an ARIMA model.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.fit(&y)?.1.parameters, 1); // the variance
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ArimaOrder {
    /// Autoregressive order.
    pub p: usize,
    /// Differences taken.
    pub d: usize,
    /// Moving average order.
    pub q: usize,
}

/// Freely set parameters of an ARIMA fit.
///
/// ```
/// use gmr_core::{ArimaOrder, ArimaParams};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // A straight line with a little alternating noise: one difference leaves the drift.
/// let y: Vec<f64> = (0..60).map(|i| 0.5 * f64::from(i) + 0.01 * f64::from(i % 2)).collect();
/// let plan = ArimaParams { order: ArimaOrder { p: 1, d: 1, q: 0 }, constant: true, ..ArimaParams::default() }.validate()?;
/// let (model, report) = plan.fit(&y)?;
/// assert!((model.parts().mean - 0.5).abs() < 1e-3);
/// assert_eq!(report.observations, 59);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArimaParams {
    /// Orders.
    pub order: ArimaOrder,
    /// Whether the mean (`d = 0`) or drift (`d = 1`) is estimated; otherwise it is zero.
    pub constant: bool,
    /// Quasi-Newton iterations at most, per start.
    pub max_iterations: usize,
    /// Largest gradient component of the log-likelihood per value at which the search stops.
    pub tolerance: f64,
}

impl Default for ArimaParams {
    /// ARIMA(1, 0, 0) with a mean, at most 200 iterations, tolerance 1e-6.
    fn default() -> Self {
        Self { order: ArimaOrder { p: 1, d: 0, q: 0 }, constant: true, max_iterations: 200, tolerance: 1e-6 }
    }
}

/// Checked parameters; the only thing that can fit an ARIMA model.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.params().order, order);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArimaPlan {
    params: ArimaParams,
}

/// Where the kept search began.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.fit(&y)?.1.start, ArimaStart::Closed);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArimaStart {
    /// At the minimum of the conditional sum of squares, reached from the two-stage regression of
    /// Hannan and Rissanen (1982).
    ConditionalSquares,
    /// At one of the best points of a coarse grid over the whole region.
    Grid,
    /// Nothing to search: `p = q = 0`.
    Closed,
}

/// Why the kept search ended.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// assert_eq!(plan.fit(&y)?.1.stop, ArimaStop::Converged);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArimaStop {
    /// The gradient fell below the tolerance.
    Converged,
    /// No step raised the likelihood any further; the usual end on a border of the region.
    NoFurtherGain,
    /// The iteration limit was reached first.
    IterationLimit,
}

/// What an ARIMA fit did.
///
/// ```
/// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // White noise of +-1: the variance is the mean square, nothing is searched.
/// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let order = ArimaOrder { p: 0, d: 0, q: 0 };
/// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
/// let report = plan.fit(&y)?.1;
/// // Each of 60 values has the log density -(ln(2 pi) + 1) / 2.
/// assert!((report.log_likelihood + 60.0 * 1.418_938_533_204_672_7).abs() < 1e-9);
/// assert!((report.aic - (2.0 - 2.0 * report.log_likelihood)).abs() < 1e-9);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArimaReport {
    /// Exact log-likelihood (diffuse for `d > 0`) of the returned model.
    pub log_likelihood: f64,
    /// Free parameters, the variance included.
    pub parameters: usize,
    /// Akaike's criterion.
    pub aic: f64,
    /// Akaike's criterion corrected for small samples; infinite when there are too few values.
    pub aicc: f64,
    /// Schwarz' criterion.
    pub bic: f64,
    /// Values that count in the likelihood: observed minus `d`.
    pub observations: usize,
    /// Missing values.
    pub missing: usize,
    /// Iterations of the kept search.
    pub iterations: usize,
    /// Largest gradient component per value at the end.
    pub gradient: f64,
    /// Where the kept search began.
    pub start: ArimaStart,
    /// Why it ended.
    pub stop: ArimaStop,
    /// Whether a partial autocorrelation ended within 1e-6 of one: a unit root, so the likelihood
    /// has its maximum on the border of the region.
    pub on_border: bool,
}

impl ArimaParams {
    /// Checks every field.
    ///
    /// ```
    /// use gmr_core::{ArimaOrder, ArimaParams};
    /// let order = ArimaOrder { p: 1, d: 5, q: 0 };
    /// assert!(ArimaParams { order, constant: false, ..ArimaParams::default() }.validate().is_err());
    /// ```
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] with the field, the allowed interval and the value.
    pub fn validate(self) -> Result<ArimaPlan> {
        let ArimaOrder { p, d, q } = self.order;
        if p.max(q + 1) >= MAX_STATE || d > 4 {
            return Err(Error::InvalidParameter {
                name: "order",
                allowed: "p <= 23, q <= 22, d <= 4",
                value: p.max(q).max(d) as f64,
            });
        }
        if self.max_iterations == 0 {
            return Err(Error::InvalidParameter { name: "max_iterations", allowed: "at least 1", value: 0.0 });
        }
        if !(self.tolerance > 0.0 && self.tolerance.is_finite()) {
            return Err(Error::InvalidParameter { name: "tolerance", allowed: "(0, inf)", value: self.tolerance });
        }
        Ok(ArimaPlan { params: self })
    }
}

impl ArimaPlan {
    /// The checked parameters.
    ///
    /// ```
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let plan = gmr_core::ArimaParams::default().validate()?;
    /// assert_eq!(plan.params().order.p, 1);
    /// # Ok(())
    /// # }
    /// ```
    pub fn params(&self) -> &ArimaParams {
        &self.params
    }

    /// Fits the model to `y`, NaN marking missing values.
    ///
    /// ```
    /// # use gmr_core::{ArimaOrder, ArimaParams, ArimaStart, ArimaStop};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // White noise of +-1: the variance is the mean square, nothing is searched.
    /// let y: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
    /// let order = ArimaOrder { p: 0, d: 0, q: 0 };
    /// let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
    /// assert!((plan.fit(&y)?.0.parts().variance - 1.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Infinite values, too few observed values for the parameters, a series that is constant
    /// after differencing, whose likelihood is unbounded, or one so close to unit roots that no filter can
    /// follow it ([`Error::NotPositiveDefinite`]).
    pub fn fit(&self, y: &[f64]) -> Result<(Arima, ArimaReport)> {
        check_series(y)?;
        let ArimaOrder { p, d, q } = self.params.order;
        let constant = self.params.constant;
        let searched = p + q;
        let parameters = searched + usize::from(constant) + 1;
        let observed = y.iter().filter(|v| !v.is_nan()).count();
        if observed < d + parameters + 1 {
            return Err(Error::TooFewSamples { what: "ARIMA fit", needed: d + parameters + 1, got: observed });
        }
        let prepared = Prepared::new(y, d, constant)?;
        let n = prepared.n as f64;
        let mut objective = Objective::new(&prepared, p, q);
        let at_once = objective.at_once();
        let (iterations, tolerance) = (self.params.max_iterations, self.params.tolerance);
        let mut starts = Vec::new();
        if searched == 0 {
            starts.push((ArimaStart::Closed, Vec::new()));
        } else if prepared.complete
            && let Some(x) = hannan_rissanen(&prepared.values, p, q)
        {
            // The conditional sum of squares costs half a likelihood and has the same landscape.
            let rough = minimise(&x, 50, 1e-3, at_once, |x, out| objective.values(x, true, out));
            starts.push((ArimaStart::ConditionalSquares, rough.x));
        }
        let grid = coarse_grid(searched);
        let mut heights = vec![0.0; grid.len() / searched.max(1)];
        objective.values(&grid, false, &mut heights);
        starts.extend(
            lowest(&heights, GRID_STARTS).map(|i| (ArimaStart::Grid, grid[i * searched..][..searched].to_vec())),
        );
        let mut best: Option<(ArimaStart, Minimum)> = None;
        for (start, x) in starts {
            let found = match &best {
                None => minimise(&x, iterations, tolerance, at_once, |x, out| objective.values(x, false, out)),
                // Another start only matters when it leads to a higher maximum, which shows early.
                Some((_, known)) => {
                    let coarse = tolerance.max(1e-3);
                    let rough = minimise(&x, iterations, coarse, at_once, |x, out| objective.values(x, false, out));
                    if !(rough.value < known.value + 1e-5) || near(&rough.x, &known.x) {
                        continue;
                    }
                    minimise(&rough.x, iterations, tolerance, at_once, |x, out| objective.values(x, false, out))
                }
            };
            if best.as_ref().is_some_and(|(_, known)| !(found.value < known.value - 1e-12)) {
                continue;
            }
            if found.value.is_finite() {
                best = Some((start, found));
            }
        }
        let Some((start, found)) = best else {
            return Err(Error::Degenerate { what: "series for this ARIMA order" });
        };
        let stop = if found.gradient <= tolerance {
            ArimaStop::Converged
        } else if found.iterations >= iterations {
            ArimaStop::IterationLimit
        } else {
            ArimaStop::NoFurtherGain
        };
        let (Some(at), ar, ma) = objective.at(&found.x) else {
            return Err(Error::Degenerate { what: "series for this ARIMA order" });
        };
        let log_scale = prepared.scale.ln();
        let sigma2 = at.squares / n;
        let log_likelihood = -0.5 * (n * (LN_2_PI + 1.0 + sigma2.ln() + 2.0 * log_scale) + at.log_f);
        let model = Arima::new(ArimaParts {
            ar,
            difference: d,
            ma,
            mean: if constant { at.mean * prepared.scale + prepared.centre } else { 0.0 },
            variance: sigma2 * prepared.scale * prepared.scale,
        })?;
        // So close to unit roots that the stationary variance is beyond 1e8, a filter may run out of digits:
        // a model that cannot be run over its own series is no fit.
        if !(model.stationary_variance() < 1e8) {
            model.filter(y)?;
        }
        let k = parameters as f64;
        let aic = 2.0 * k - 2.0 * log_likelihood;
        let report = ArimaReport {
            log_likelihood,
            parameters,
            aic,
            aicc: if n > k + 1.0 { aic + 2.0 * k * (k + 1.0) / (n - k - 1.0) } else { f64::INFINITY },
            bic: k * n.ln() - 2.0 * log_likelihood,
            observations: prepared.n,
            missing: y.len() - observed,
            iterations: found.iterations,
            gradient: found.gradient,
            start,
            stop,
            // tanh(7.25) = 1 - 1e-6.
            on_border: found.x.iter().any(|x| x.abs() > 7.25),
        };
        Ok((model, report))
    }
}

/// Whether two ends of a rough search lie in the same hollow.
fn near(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a.tanh() - b.tanh()).abs() < 0.02)
}
