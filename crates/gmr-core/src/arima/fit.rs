//! Maximum likelihood.

use super::model::{Arima, ArimaParts, check_series};
use super::objective::{Objective, Prepared};
use super::optimise::{Minimum, minimise};
use super::params::{ArimaOrder, ArimaPlan};
use super::report::{ArimaReport, ArimaStart, ArimaStop};
use super::starts::{GRID_STARTS, coarse_grid, hannan_rissanen, lowest};
use crate::error::{Error, Result};
use crate::gmm::LN_2_PI;

impl ArimaPlan {
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
            if found.value.is_finite() && objective.exact(&found.x).is_finite() {
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
