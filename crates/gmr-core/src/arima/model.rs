//! A fitted ARIMA model and its run over a series.

use serde::{Deserialize, Serialize};

use super::dense::{self, Mean};
use super::filter::{self, Arma, MAX_STATE, Work};
use super::polynomial::partial_autocorrelations;
use super::state::{ArimaState, Innovation};
use crate::error::{Error, MAX_MAGNITUDE, Result, check_values};
use crate::gmm::LN_2_PI;

/// The numbers of an ARIMA model, as stored in a model file.
///
/// ```
/// # use gmr_core::{Arima, ArimaParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
/// assert_eq!(model.parts().ar, [0.5]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArimaParts {
    /// `phi_1 .. phi_p`.
    pub ar: Vec<f64>,
    /// Order of differencing `d`.
    pub difference: usize,
    /// `theta_1 .. theta_q`.
    pub ma: Vec<f64>,
    /// Mean of the `d` times differenced series: level for `d = 0`, drift per step for `d = 1`.
    pub mean: f64,
    /// Innovation variance `sigma^2`, in the series' units squared.
    pub variance: f64,
}

/// An ARIMA model with stationary autoregression and positive innovation variance.
///
/// ```
/// use gmr_core::{Arima, ArimaParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // AR(1) with phi = 0.5: from a last value of 8 the forecasts halve, their variances grow as
/// // 1, 1 + 0.25, ..
/// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
/// let run = model.filter(&[0.0, 4.0, 8.0])?;
/// let ahead = run.state.forecast(2);
/// assert!((ahead[0].mean - 4.0).abs() < 1e-12 && (ahead[1].mean - 2.0).abs() < 1e-12);
/// assert!((ahead[0].variance - 1.0).abs() < 1e-12 && (ahead[1].variance - 1.25).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ArimaParts", into = "ArimaParts")]
pub struct Arima {
    pub(super) parts: ArimaParts,
}

impl TryFrom<ArimaParts> for Arima {
    type Error = Error;

    fn try_from(parts: ArimaParts) -> Result<Self> {
        Self::new(parts)
    }
}

impl From<Arima> for ArimaParts {
    fn from(model: Arima) -> Self {
        model.parts
    }
}

/// What a model makes of a series.
///
/// ```
/// # use gmr_core::{Arima, ArimaParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
/// let run = model.filter(&[0.0, f64::NAN, 8.0])?;
/// assert!(run.fitted[1].is_none() && run.residuals[1].is_none());
/// // Over the gap the prediction is a quarter of the last value, zero.
/// assert!(run.fitted[2].unwrap_or(f64::NAN).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ArimaRun {
    /// Exact (diffuse for `d > 0`) log-likelihood.
    pub log_likelihood: f64,
    /// One-step prediction error per value given the values before it: `None` for missing values and until
    /// the level is determined (for complete data, the first `d` values).
    pub residuals: Vec<Option<Innovation>>,
    /// One-step prediction per value, `None` where there is no residual.
    pub fitted: Vec<Option<f64>>,
    /// State after the last value.
    pub state: ArimaState,
}

/// Checks a series in which NaN marks a missing value.
pub(super) fn check_series(y: &[f64]) -> Result<()> {
    for (index, &value) in y.iter().enumerate() {
        if value.is_infinite() {
            return Err(Error::NotFinite { what: "series", index, value });
        }
        if value.abs() > MAX_MAGNITUDE {
            return Err(Error::OutOfRange { what: "series", index, value, limit: MAX_MAGNITUDE });
        }
    }
    Ok(())
}

/// Differences a complete series `d` times.
pub(super) fn differenced(y: &[f64], d: usize) -> Vec<f64> {
    let mut w = y.to_vec();
    for _ in 0..d {
        w = w.windows(2).map(|p| p[1] - p[0]).collect();
    }
    w
}

impl Arima {
    /// Checks the numbers of a model.
    ///
    /// ```
    /// # use gmr_core::{Arima, ArimaParts};
    /// let explosive = ArimaParts { ar: vec![1.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 };
    /// assert!(Arima::new(explosive).is_err());
    /// ```
    ///
    /// # Errors
    /// Values that are not finite, an autoregression that is not stationary, a variance that is not
    /// positive, or an order above 23.
    pub fn new(parts: ArimaParts) -> Result<Self> {
        check_values("autoregressive coefficients", &parts.ar)?;
        check_values("moving average coefficients", &parts.ma)?;
        check_values("mean", &[parts.mean])?;
        if !(parts.variance > 0.0 && parts.variance.is_finite()) {
            return Err(Error::InvalidParameter { name: "variance", allowed: "(0, inf)", value: parts.variance });
        }
        if parts.ar.len().max(parts.ma.len() + 1) >= MAX_STATE || parts.difference > 4 {
            return Err(Error::InvalidParameter {
                name: "order",
                allowed: "p <= 23, q <= 22, d <= 4",
                value: parts.ar.len().max(parts.ma.len()).max(parts.difference) as f64,
            });
        }
        if partial_autocorrelations(&parts.ar).is_none() {
            return Err(Error::InvalidParameter {
                name: "autoregression",
                allowed: "stationary: every partial autocorrelation within (-1, 1)",
                value: parts.ar.iter().sum(),
            });
        }
        Ok(Self { parts })
    }

    /// The numbers, for storage.
    ///
    /// ```
    /// # use gmr_core::{Arima, ArimaParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
    /// assert_eq!(model.parts().variance, 1.0);
    /// # Ok(())
    /// # }
    /// ```
    pub fn parts(&self) -> &ArimaParts {
        &self.parts
    }

    pub(super) fn arma(&self) -> Arma {
        Arma::new(&self.parts.ar, &self.parts.ma)
    }

    /// Variance of the differenced series per unit innovation variance.
    pub(super) fn stationary_variance(&self) -> f64 {
        let arma = self.arma();
        let mut work = Work::new(arma.r);
        arma.stationary_covariance(&mut work);
        work.p[0]
    }

    /// Exact log-likelihood of a series (NaN: missing) under this model; for `d > 0` the diffuse
    /// likelihood, which for complete data is that of the differenced series.
    ///
    /// ```
    /// # use gmr_core::{Arima, ArimaParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // White noise of variance 1: each zero has density 1 / sqrt(2 pi).
    /// let noise = Arima::new(ArimaParts { ar: vec![], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
    /// assert!((noise.log_likelihood(&[0.0, 0.0])? + 1.837_877_066_409_345_3).abs() < 1e-14);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Infinite values, or fewer observed values than `d`.
    pub fn log_likelihood(&self, y: &[f64]) -> Result<f64> {
        check_series(y)?;
        let (d, variance) = (self.parts.difference, self.parts.variance);
        let arma = self.arma();
        let (n, log_f, squares) = if y.iter().any(|v| v.is_nan()) || y.len() <= d {
            let filtered = dense::filter(&arma, d, y, Mean::Known(self.parts.mean))?;
            (filtered.observed - d, filtered.log_f, filtered.squares)
        } else {
            let w: Vec<f64> = differenced(y, d).iter().map(|v| v - self.parts.mean).collect();
            let sums = filter::filter(&arma, &w, false, false, &mut Work::new(arma.r));
            (sums.n, sums.log_f, sums.ww)
        };
        Ok(-0.5 * (n as f64 * (LN_2_PI + variance.ln()) + log_f + squares / variance))
    }

    /// Runs the model over a series (NaN: missing).
    ///
    /// ```
    /// # use gmr_core::{Arima, ArimaParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
    /// let run = model.filter(&[0.0, 4.0, 8.0])?;
    /// // 8 was predicted as half of 4.
    /// assert!((run.fitted[2].unwrap_or(f64::NAN) - 2.0).abs() < 1e-12);
    /// assert!((run.residuals[2].map_or(f64::NAN, |r| r.value) - 6.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Infinite values, or fewer observed values than `d`.
    pub fn filter(&self, y: &[f64]) -> Result<ArimaRun> {
        check_series(y)?;
        let (d, variance) = (self.parts.difference, self.parts.variance);
        let arma = self.arma();
        let filtered = dense::filter(&arma, d, y, Mean::Known(self.parts.mean))?;
        let mut residuals = vec![None; y.len()];
        let mut fitted = vec![None; y.len()];
        for &(t, v, f) in &filtered.innovations {
            residuals[t] = Some(Innovation { value: v, variance: f * variance });
            fitted[t] = Some(y[t] - v);
        }
        let n = (filtered.observed - d) as f64;
        let log_likelihood = -0.5 * (n * (LN_2_PI + variance.ln()) + filtered.log_f + filtered.squares / variance);
        let mut state =
            ArimaState { model: self.clone(), state: filtered.state, covariance: Some(filtered.covariance) };
        state.settle(&arma);
        Ok(ArimaRun { log_likelihood, residuals, fitted, state })
    }
}
