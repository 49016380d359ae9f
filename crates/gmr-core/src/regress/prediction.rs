//! Answers of a regression.

/// Result and working space of a query; made once by [`Regressor::prediction`](crate::Regressor::prediction), then reused.
///
/// ```
/// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let parts = MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
/// # };
/// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
/// let regressor = Regressor::new(&joint, &[0], &[1])?;
/// let mut out = regressor.prediction();
/// regressor.predict_with_jacobian_into(&[2.0], &mut out)?;
/// // The line 0.8 x with the variance 1 - 0.8^2.
/// assert!((out.mean()[0] - 1.6).abs() < 1e-12 && (out.covariance()[0] - 0.36).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    pub(super) mean: Vec<f64>,
    pub(super) covariance: Vec<f64>,
    pub(super) jacobian: Vec<f64>,
    pub(super) responsibilities: Vec<f64>,
    pub(super) log_density: f64,
    /// `m_n`, `(k, width)`.
    pub(super) wide_means: Vec<f64>,
    /// `m_n`, `(k, d_o)`.
    pub(super) component_means: Vec<f64>,
    /// `b_n`, `(padded)`.
    pub(super) wide_responsibilities: Vec<f64>,
    /// `m`, `(width)`, and room for `V`, `(d_o, width)`.
    pub(super) wide: Vec<f64>,
    /// `x - mu_i`, component-minor: `(d_i, padded)`.
    pub(super) differences: Vec<f64>,
    /// `L_ii^-1 (x - mu_i)`, component-minor: `(d_i, padded)`.
    pub(super) whitened: Vec<f64>,
    /// `dm/dx` by input, `(d_i, width)`.
    pub(super) wide_jacobian: Vec<f64>,
}

impl Prediction {
    /// Conditional mean `m(x)`, `(d_o)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_with_jacobian_into(&[2.0], &mut out)?;
    /// assert!((out.mean()[0] - 1.6).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Conditional covariance `V(x)`, `(d_o, d_o)`, exactly symmetric.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_with_jacobian_into(&[2.0], &mut out)?;
    /// assert!((out.covariance()[0] - 0.36).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }

    /// `dm/dx`, `(d_o, d_i)` row-major; with time as the only input, the velocity of the mean.
    /// Zero until [`predict_with_jacobian_into`](crate::Regressor::predict_with_jacobian_into) has filled it.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_with_jacobian_into(&[2.0], &mut out)?;
    /// assert!((out.jacobian()[0] - 0.8).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn jacobian(&self) -> &[f64] {
        &self.jacobian
    }

    /// `b_n(x)`, `(k)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_with_jacobian_into(&[2.0], &mut out)?;
    /// assert_eq!(out.responsibilities(), [1.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn responsibilities(&self) -> &[f64] {
        &self.responsibilities
    }

    /// `m_n(x)` of each component, `(k, d_o)` row-major.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_with_jacobian_into(&[2.0], &mut out)?;
    /// assert!((out.component_means()[0] - 1.6).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn component_means(&self) -> &[f64] {
        &self.component_means
    }

    /// `ln p(x)` of the inputs: how usual this query is.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// let mut out = regressor.prediction();
    /// regressor.predict_with_jacobian_into(&[2.0], &mut out)?;
    /// assert!((out.log_density() + 0.918_938_533_204_672_7 + 2.0).abs() < 1e-12); // ln N(2 | 0, 1)
    /// # Ok(())
    /// # }
    /// ```
    pub fn log_density(&self) -> f64 {
        self.log_density
    }
}

/// Means and covariances of many queries.
///
/// ```
/// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
/// # fn main() -> Result<(), gmr_core::Error> {
/// # let parts = MixtureParts {
/// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
/// # };
/// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
/// let regressor = Regressor::new(&joint, &[0], &[1])?;
/// let out = regressor.predict_batch(&Samples::new(&[0.0, 2.0], 1)?)?;
/// assert!((out.means[1] - 1.6).abs() < 1e-12 && (out.covariances[1] - 0.36).abs() < 1e-12);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct BatchPrediction {
    /// `(n, d_o)` row-major.
    pub means: Vec<f64>,
    /// `(n, d_o, d_o)` row-major.
    pub covariances: Vec<f64>,
}
