//! Marginal and conditional mixtures, and the completion of rows with hidden values.

use crate::error::{Error, Result, check_len};
use crate::gmm::{CovarianceKind, Mixture, MixtureParts, check_dimensions};
use crate::regress::Regressor;

/// A row whose hidden values have been filled in.
///
/// ```
/// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let parts = MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
/// # };
/// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
/// let filled = joint.fill(&[2.0, f64::NAN])?;
/// assert_eq!(filled.hidden, [1]);
/// assert!((filled.values[1] - 1.6).abs() < 1e-12 && (filled.covariance[0] - 0.36).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Filled {
    /// The row: observed values as they were, hidden ones at their conditional mean, `(d)`.
    pub values: Vec<f64>,
    /// Which dimensions were hidden, ascending, `(m)`.
    pub hidden: Vec<usize>,
    /// Conditional covariance of the hidden values, `(m, m)`.
    pub covariance: Vec<f64>,
    /// Log density of the observed values; zero when everything was hidden.
    pub log_density: f64,
}

impl Mixture {
    /// The mixture of some of its dimensions, in the given order.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let second = joint.marginal(&[1])?;
    /// assert_eq!((second.dim(), second.covariance(0)[0]), (1, 1.0));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// An empty list, or an index out of bounds or listed twice.
    pub fn marginal(&self, dimensions: &[usize]) -> Result<Self> {
        check_dimensions("marginal dimensions", dimensions, self.dim())?;
        let d = self.dim();
        let mut means = Vec::new();
        let mut covariances = Vec::new();
        for c in 0..self.components() {
            let (mean, covariance) = (self.mean(c), self.covariance(c));
            means.extend(dimensions.iter().map(|&i| mean[i]));
            for &i in dimensions {
                covariances.extend(dimensions.iter().map(|&j| covariance[i * d + j]));
            }
        }
        Self::new(MixtureParts {
            kind: CovarianceKind::Full,
            dim: dimensions.len(),
            weights: self.weights().to_vec(),
            means,
            covariances,
        })
    }

    /// The mixture of the remaining dimensions, in ascending order, given the values of some.
    ///
    /// Allocates; for many queries with one split use a [`Regressor`].
    ///
    /// ```
    /// use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let joint = Mixture::new(MixtureParts {
    ///     kind: CovarianceKind::Full,
    ///     dim: 2,
    ///     weights: vec![1.0],
    ///     means: vec![0.0, 0.0],
    ///     covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// })?;
    /// let given = joint.condition(&[0], &[2.0])?;
    /// assert!((given.mean(0)[0] - 1.6).abs() < 1e-15);
    /// assert!((given.covariance(0)[0] - 0.36).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Regressor::new`] and [`Regressor::predict_into`].
    pub fn condition(&self, dimensions: &[usize], values: &[f64]) -> Result<Self> {
        let rest: Vec<usize> = (0..self.dim()).filter(|i| !dimensions.contains(i)).collect();
        let regressor = Regressor::new(self, dimensions, &rest)?;
        let mut out = regressor.prediction();
        regressor.predict_mean_into(values, &mut out)?;
        let covariances = (0..self.components()).flat_map(|c| regressor.component_covariance(c).to_vec()).collect();
        Self::new(MixtureParts {
            kind: CovarianceKind::Full,
            dim: rest.len(),
            weights: out.responsibilities().to_vec(),
            means: out.component_means().to_vec(),
            covariances,
        })
    }

    /// Mean and full covariance of the whole mixture, `(d)` and `(d, d)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// let (mean, covariance) = pair.moments();
    /// assert_eq!((mean[0], covariance[0]), (0.0, 2.0)); // 1 within, 1 between
    /// # Ok(())
    /// # }
    /// ```
    pub fn moments(&self) -> (Vec<f64>, Vec<f64>) {
        let d = self.dim();
        let mut mean = vec![0.0; d];
        for (c, w) in self.weights().iter().enumerate() {
            for (m, v) in mean.iter_mut().zip(self.mean(c)) {
                *m += w * v;
            }
        }
        let mut covariance = vec![0.0; d * d];
        for (c, w) in self.weights().iter().enumerate() {
            let within = self.covariance(c);
            let e: Vec<f64> = self.mean(c).iter().zip(&mean).map(|(a, b)| a - b).collect();
            for i in 0..d {
                for j in 0..d {
                    covariance[i * d + j] += w * (within[i * d + j] + e[i] * e[j]);
                }
            }
        }
        (mean, covariance)
    }

    /// Fills the NaN entries of a row with their conditional mean and says how sure that is.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let filled = joint.fill(&[2.0, f64::NAN])?;
    /// assert!((filled.values[1] - 1.6).abs() < 1e-15);
    /// assert!((filled.covariance[0] - 0.36).abs() < 1e-15);
    /// assert_eq!(filled.hidden, [1]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// A wrong length, an infinite value, or observed values that no component reaches.
    pub fn fill(&self, row: &[f64]) -> Result<Filled> {
        check_len("row", self.dim(), row.len())?;
        let (hidden, seen): (Vec<usize>, Vec<usize>) = (0..row.len()).partition(|&i| row[i].is_nan());
        let mut values = row.to_vec();
        if seen.is_empty() {
            let (mean, covariance) = self.moments();
            return Ok(Filled { values: mean, hidden, covariance, log_density: 0.0 });
        }
        if hidden.is_empty() {
            let log_density = self.log_density(row)?;
            if !log_density.is_finite() {
                return Err(Error::NoSupport { components: self.components() });
            }
            return Ok(Filled { values, hidden, covariance: Vec::new(), log_density });
        }
        let regressor = Regressor::new(self, &seen, &hidden)?;
        let mut out = regressor.prediction();
        let given: Vec<f64> = seen.iter().map(|&i| row[i]).collect();
        regressor.predict_into(&given, &mut out)?;
        for (&i, m) in hidden.iter().zip(out.mean()) {
            values[i] = *m;
        }
        Ok(Filled { values, hidden, covariance: out.covariance().to_vec(), log_density: out.log_density() })
    }
}
