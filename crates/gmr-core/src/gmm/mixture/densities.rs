//! Densities, responsibilities and the criteria made of them.

use super::Mixture;
use crate::error::{Error, Result, check_len};
use crate::kernel::{self, Blocks};
use crate::samples::Samples;

impl Mixture {
    fn check_query(&self, samples: &Samples<'_>) -> Result<()> {
        check_len("sample dimension", self.dim(), samples.dim())?;
        if samples.missing() > 0 {
            let index = samples.values().iter().position(|v| v.is_nan()).unwrap_or(0);
            return Err(Error::NotFinite { what: "samples", index, value: f64::NAN });
        }
        Ok(())
    }

    /// Log density `ln p(x)` of each sample, `(n)`; -inf where no component has a finite one.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// let at_zero = pair.log_densities(&Samples::new(&[0.0], 1)?)?[0];
    /// assert!((at_zero + 1.418_938_533_204_672_7).abs() < 1e-14); // ln N(1 | 0, 1)
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Wrong dimension or a missing value.
    pub fn log_densities(&self, samples: &Samples<'_>) -> Result<Vec<f64>> {
        self.check_query(samples)?;
        if samples.is_empty() {
            return Ok(Vec::new());
        }
        Ok(kernel::densities(&Blocks::new(samples, None), self.kernel(), false).0)
    }

    /// Log density of one point.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// assert!((pair.log_density(&[0.0])? + 1.418_938_533_204_672_7).abs() < 1e-14);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Wrong dimension or a value that is not finite.
    pub fn log_density(&self, x: &[f64]) -> Result<f64> {
        check_len("query", self.dim(), x.len())?;
        Ok(self.log_densities(&Samples::new(x, self.dim())?)?[0])
    }

    /// Responsibilities `p(n | x)`, `(n, k)` row-major; each row sums to one.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// let r = pair.responsibilities(&Samples::new(&[0.0, 1.0], 1)?)?;
    /// assert!((r[0] - 0.5).abs() < 1e-15);
    /// assert!((r[3] - 1.0 / (1.0 + (-2.0_f64).exp())).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Wrong dimension, a missing value, or a sample that no component reaches.
    pub fn responsibilities(&self, samples: &Samples<'_>) -> Result<Vec<f64>> {
        self.check_query(samples)?;
        if samples.is_empty() {
            return Ok(Vec::new());
        }
        let (densities, responsibilities) = kernel::densities(&Blocks::new(samples, None), self.kernel(), true);
        if densities.iter().any(|d| !d.is_finite()) {
            return Err(Error::NoSupport { components: self.components() });
        }
        Ok(responsibilities)
    }

    /// Log-likelihood of the samples, weighted and summed (nats).
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// let samples = Samples::new(&[0.0, 0.0], 1)?.with_weights(&[1.0, 2.0])?;
    /// assert!((pair.log_likelihood(&samples)? + 3.0 * 1.418_938_533_204_672_7).abs() < 1e-13);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// Wrong dimension or a missing value.
    pub fn log_likelihood(&self, samples: &Samples<'_>) -> Result<f64> {
        let densities = self.log_densities(samples)?;
        Ok(densities
            .iter()
            .enumerate()
            .filter(|(i, _)| samples.weight(*i) > 0.0)
            .map(|(i, d)| samples.weight(i) * d)
            .sum())
    }

    /// Free parameters: weights, means and covariances.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// assert_eq!(pair.parameters(), 5); // two means, two variances, one free weight
    /// # Ok(())
    /// # }
    /// ```
    pub fn parameters(&self) -> usize {
        self.parts.kind.parameters(self.components(), self.dim())
    }

    /// Bayesian information criterion on these samples (lower is better).
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// let bic = pair.bic(&Samples::new(&[0.0, 0.0], 1)?)?;
    /// assert!((bic - (5.0 * 2.0_f64.ln() + 4.0 * 1.418_938_533_204_672_7)).abs() < 1e-13);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Mixture::log_likelihood`].
    pub fn bic(&self, samples: &Samples<'_>) -> Result<f64> {
        Ok(self.parameters() as f64 * samples.total_weight().ln() - 2.0 * self.log_likelihood(samples)?)
    }

    /// Akaike information criterion on these samples (lower is better).
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// let aic = pair.aic(&Samples::new(&[0.0, 0.0], 1)?)?;
    /// assert!((aic - (10.0 + 4.0 * 1.418_938_533_204_672_7)).abs() < 1e-13);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Mixture::log_likelihood`].
    pub fn aic(&self, samples: &Samples<'_>) -> Result<f64> {
        Ok(2.0 * self.parameters() as f64 - 2.0 * self.log_likelihood(samples)?)
    }
}
