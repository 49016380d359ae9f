//! The state a model is in after a series, and what it says of the values to come.

use serde::{Deserialize, Serialize};

use super::dense;
use super::filter::Arma;
use super::model::{Arima, check_series};
use crate::error::Result;

/// A one-step prediction error.
///
/// ```
/// # use gmr_core::{Arima, ArimaParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
/// let run = model.filter(&[0.0, 4.0, 8.0])?;
/// // 8 was predicted as half of 4, with the variance of the noise.
/// let last = run.residuals[2].map(|r| (r.value, r.variance)).unwrap_or_default();
/// assert!((last.0 - 6.0).abs() < 1e-12 && (last.1 - 1.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Innovation {
    /// Value minus its prediction.
    pub value: f64,
    /// Variance the model gives it.
    pub variance: f64,
}

/// A forecast.
///
/// ```
/// # use gmr_core::{Arima, ArimaParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
/// let ahead = model.filter(&[0.0, 4.0, 8.0])?.state.forecast(1);
/// assert!((ahead[0].mean - 4.0).abs() < 1e-12 && (ahead[0].variance - 1.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    /// Expected value.
    pub mean: f64,
    /// Variance about it.
    pub variance: f64,
}

/// The state of a model after a series; takes further values in O(p + q) without a refit.
///
/// ```
/// # use gmr_core::{Arima, ArimaParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
/// let mut state = model.filter(&[0.0, 4.0])?.state;
/// state.append(8.0)?;
/// assert!((state.forecast(1)[0].mean - 4.0).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArimaState {
    pub(super) model: Arima,
    pub(super) state: Vec<f64>,
    /// Covariance per unit variance; `None` once it is settled at `R R'` with known levels.
    pub(super) covariance: Option<Vec<f64>>,
}

impl ArimaState {
    /// The model.
    ///
    /// ```
    /// # use gmr_core::{Arima, ArimaParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
    /// assert_eq!(model.filter(&[0.0, 4.0])?.state.model().parts().ar, [0.5]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn model(&self) -> &Arima {
        &self.model
    }

    /// Drops the covariance once it equals `R R'` with known levels to rounding.
    pub(super) fn settle(&mut self, arma: &Arma) {
        let s = self.state.len();
        if let Some(p) = &self.covariance {
            let settled = (0..s * s).all(|i| {
                let (a, b) = (i / s, i % s);
                let target = if a < arma.r && b < arma.r { arma.theta[a] * arma.theta[b] } else { 0.0 };
                (p[i] - target).abs() <= 1e-14
            });
            if settled {
                self.covariance = None;
            }
        }
    }

    fn settled_covariance(&self, arma: &Arma) -> Vec<f64> {
        let s = self.state.len();
        (0..s * s)
            .map(|i| {
                let (a, b) = (i / s, i % s);
                if a < arma.r && b < arma.r { arma.theta[a] * arma.theta[b] } else { 0.0 }
            })
            .collect()
    }

    /// Takes the next value (NaN: missing, then `None` comes back).
    ///
    /// Costs O(p + q + d) once the filter has settled, O((p + q + d)^2) before and after a gap.
    ///
    /// ```
    /// # use gmr_core::{Arima, ArimaParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let model = Arima::new(ArimaParts { ar: vec![0.5], difference: 0, ma: vec![], mean: 0.0, variance: 1.0 })?;
    /// let mut state = model.filter(&[0.0, 4.0, 8.0])?.state;
    /// let innovation = state.append(5.0)?; // 4 was predicted
    /// assert!((innovation.map_or(f64::NAN, |i| i.value) - 1.0).abs() < 1e-12);
    /// assert!((state.forecast(1)[0].mean - 2.5).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// An infinite value or one beyond 1e140; the state is then unchanged.
    pub fn append(&mut self, y: f64) -> Result<Option<Innovation>> {
        check_series(&[y])?;
        let parts = &self.model.parts;
        let (d, mean, variance) = (parts.difference, parts.mean, parts.variance);
        let arma = self.model.arma();
        let predicted = dense::observe(&arma, &self.state) + mean;
        let v = y - predicted;
        let mut next = vec![0.0; self.state.len()];
        dense::advance(&arma, d, &self.state, mean, &mut next);
        let observed = !y.is_nan();
        if self.covariance.is_none() && !observed {
            self.covariance = Some(self.settled_covariance(&arma));
        }
        let f = if let Some(p) = &mut self.covariance {
            let (gain, f) = dense::step_covariance(&arma, d, p, observed);
            if observed {
                for (n, k) in next.iter_mut().zip(&gain) {
                    *n += k * v;
                }
            }
            f
        } else {
            // Settled gain: phi_i + theta_i for the ARMA state, one for the levels.
            for ((n, phi), theta) in next.iter_mut().zip(&arma.phi).zip(&arma.theta[1..]) {
                *n += (phi + theta) * v;
            }
            for n in &mut next[arma.r..] {
                *n += v;
            }
            1.0
        };
        self.state = next;
        self.settle(&arma);
        Ok(observed.then_some(Innovation { value: v, variance: f * variance }))
    }

    /// Means and variances of the next `steps` values.
    ///
    /// ```
    /// # use gmr_core::{Arima, ArimaParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// // A random walk stays where it is, ever less surely.
    /// let walk = Arima::new(ArimaParts { ar: vec![], difference: 1, ma: vec![], mean: 0.0, variance: 1.0 })?;
    /// let ahead = walk.filter(&[1.0, 2.0, 5.0])?.state.forecast(3);
    /// assert!((ahead[2].mean - 5.0).abs() < 1e-12 && (ahead[2].variance - 3.0).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn forecast(&self, steps: usize) -> Vec<Forecast> {
        let parts = &self.model.parts;
        let arma = self.model.arma();
        let mut state = self.state.clone();
        let mut next = state.clone();
        let mut p = self.covariance.clone().unwrap_or_else(|| self.settled_covariance(&arma));
        (0..steps)
            .map(|_| {
                let mean = dense::observe(&arma, &state) + parts.mean;
                let (_, f) = dense::step_covariance(&arma, parts.difference, &mut p, false);
                dense::advance(&arma, parts.difference, &state, parts.mean, &mut next);
                std::mem::swap(&mut state, &mut next);
                // No forecast is surer than the innovation; rounding may say so by a little.
                Forecast { mean, variance: f.max(1.0) * parts.variance }
            })
            .collect()
    }
}
