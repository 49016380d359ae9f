//! A fitted mixture: always normalised, always factored.

use rand::Rng;
use serde::{Deserialize, Serialize};

use super::factors::whiten;
use super::params::CovarianceKind;
use crate::error::{Error, Result, check_len, check_values};
use crate::kernel::{self, Blocks, Components};
use crate::linalg::{cholesky, invert_lower};
use crate::samples::Samples;

/// How far weights read from outside may sum away from one.
const WEIGHT_TOLERANCE: f64 = 1e-9;
/// `ln(2 pi)`.
pub(crate) const LN_2_PI: f64 = 1.837_877_066_409_345_3;

/// The numbers of a mixture, as stored in a model file.
///
/// ```
/// use gmr_core::{CovarianceKind, Mixture, MixtureParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let parts = MixtureParts {
///     kind: CovarianceKind::Spherical, dim: 2, weights: vec![1.0], means: vec![0.0, 1.0], covariances: vec![4.0],
/// };
/// assert_eq!(Mixture::new(parts)?.covariance(0), [4.0, 0.0, 0.0, 4.0]);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MixtureParts {
    /// Shape of the covariances.
    pub kind: CovarianceKind,
    /// Dimension `d`.
    pub dim: usize,
    /// `pi: (k)`, non-negative, summing to one within 1e-9.
    pub weights: Vec<f64>,
    /// `mu: (k, d)` row-major.
    pub means: Vec<f64>,
    /// Full `(k, d, d)`, tied `(d, d)`, diagonal `(k, d)` or spherical `(k)`.
    pub covariances: Vec<f64>,
}

/// A Gaussian mixture `p(x) = sum_n pi_n N(x | mu_n, Sigma_n)` (paper, eq. 5).
///
/// Serialises as [`MixtureParts`]; reading one back checks and factors it again.
///
/// ```
/// use gmr_core::{CovarianceKind, Mixture, MixtureParts};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let standard = Mixture::new(MixtureParts {
///     kind: CovarianceKind::Full,
///     dim: 1,
///     weights: vec![1.0],
///     means: vec![0.0],
///     covariances: vec![1.0],
/// })?;
/// // ln N(0 | 0, 1) = -ln(2 pi) / 2.
/// assert!((standard.log_density(&[0.0])? + 0.918_938_533_204_672_7).abs() < 1e-15);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "MixtureParts", into = "MixtureParts")]
pub struct Mixture {
    parts: MixtureParts,
    /// `L^-1` per component `(k, d, d)`, or reciprocal deviations `(k, d)`.
    whitening: Vec<f64>,
    /// `ln pi + ln det W - d/2 ln 2 pi`.
    offsets: Vec<f64>,
}

impl TryFrom<MixtureParts> for Mixture {
    type Error = Error;

    fn try_from(parts: MixtureParts) -> Result<Self> {
        Self::new(parts)
    }
}

impl From<Mixture> for MixtureParts {
    fn from(mixture: Mixture) -> Self {
        mixture.parts
    }
}

impl CovarianceKind {
    /// Numbers stored for `k` components of `d` dimensions.
    pub(crate) fn stored(self, k: usize, d: usize) -> usize {
        match self {
            Self::Full => k * d * d,
            Self::Tied => d * d,
            Self::Diagonal => k * d,
            Self::Spherical => k,
        }
    }

    /// Whether the passes run on reciprocal deviations instead of triangular factors.
    pub(crate) fn is_diagonal(self) -> bool {
        matches!(self, Self::Diagonal | Self::Spherical)
    }

    /// Free parameters of a mixture.
    pub(crate) fn parameters(self, k: usize, d: usize) -> usize {
        let covariance = match self {
            Self::Full => k * d * (d + 1) / 2,
            Self::Tied => d * (d + 1) / 2,
            Self::Diagonal => k * d,
            Self::Spherical => k,
        };
        covariance + k * d + k - 1
    }
}

impl Mixture {
    /// Checks and factors the numbers of a mixture.
    ///
    /// ```
    /// use gmr_core::{CovarianceKind, Error, Mixture, MixtureParts};
    /// let flat = MixtureParts {
    ///     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 1.0, 1.0, 1.0],
    /// };
    /// // Correlation one: the second pivot of the Cholesky factor is zero.
    /// assert!(matches!(Mixture::new(flat), Err(Error::NotPositiveDefinite { index: 0, pivot: 1, .. })));
    /// ```
    ///
    /// # Errors
    /// Wrong lengths, values that are not finite, weights that are negative or do not sum to one,
    /// an asymmetric covariance, or one that is not positive definite.
    pub fn new(parts: MixtureParts) -> Result<Self> {
        let (k, d) = (parts.weights.len(), parts.dim);
        if k == 0 || d == 0 {
            return Err(Error::InvalidParameter { name: "components and dim", allowed: "at least 1", value: 0.0 });
        }
        check_len("means", k * d, parts.means.len())?;
        check_len("covariances", parts.kind.stored(k, d), parts.covariances.len())?;
        check_values("means", &parts.means)?;
        for (index, &value) in parts.covariances.iter().enumerate() {
            if !value.is_finite() {
                return Err(Error::NotFinite { what: "covariances", index, value });
            }
        }
        for &value in &parts.weights {
            if !(0.0..=1.0 + WEIGHT_TOLERANCE).contains(&value) {
                return Err(Error::InvalidParameter { name: "weight", allowed: "[0, 1]", value });
            }
        }
        let sum: f64 = parts.weights.iter().sum();
        if !((sum - 1.0).abs() <= WEIGHT_TOLERANCE) {
            return Err(Error::WeightsNotNormalised { sum, tolerance: WEIGHT_TOLERANCE });
        }
        if !parts.kind.is_diagonal() {
            for matrix in parts.covariances.chunks_exact(d * d) {
                for i in 0..d {
                    for j in 0..i {
                        let (a, b) = (matrix[i * d + j], matrix[j * d + i]);
                        let scale = (matrix[i * d + i] * matrix[j * d + j]).abs().sqrt();
                        if (a - b).abs() > 1e-9 * scale {
                            return Err(Error::InvalidParameter {
                                name: "covariance asymmetry",
                                allowed: "below 1e-9 of the deviations",
                                value: a - b,
                            });
                        }
                    }
                }
            }
        }
        let mut mixture = Self { parts, whitening: Vec::new(), offsets: Vec::new() };
        mixture.factor()?;
        Ok(mixture)
    }

    /// Takes the numbers of an M step, of the same shape, symmetric and with normalised weights, and leaves the former
    /// ones in `parts`. After an error the mixture is not to be used.
    pub(super) fn exchange(&mut self, parts: &mut MixtureParts) -> Result<()> {
        std::mem::swap(&mut self.parts, parts);
        let MixtureParts { weights, means, covariances, .. } = &self.parts;
        for (what, values) in [("weights", weights), ("means", means), ("covariances", covariances)] {
            // Without an early end the check of all values compiles to vector code.
            if !values.iter().fold(true, |finite, v| finite & v.is_finite()) {
                let index = values.iter().position(|v| !v.is_finite()).unwrap_or(0);
                return Err(Error::NotFinite { what, index, value: values[index] });
            }
        }
        self.factor()
    }

    fn factor(&mut self) -> Result<()> {
        let MixtureParts { kind, dim: d, weights, covariances, .. } = &self.parts;
        let (k, d) = (weights.len(), *d);
        let refused =
            |index, pivot, value| Error::NotPositiveDefinite { what: "covariance of component", index, pivot, value };
        self.whitening.clear();
        self.offsets.clear();
        if kind.is_diagonal() {
            for c in 0..k {
                for j in 0..d {
                    let v = if *kind == CovarianceKind::Diagonal { covariances[c * d + j] } else { covariances[c] };
                    if !(v >= f64::MIN_POSITIVE) {
                        return Err(refused(c, j, v));
                    }
                    self.whitening.push(1.0 / v.sqrt());
                }
            }
        } else {
            let matrices = if *kind == CovarianceKind::Tied { 1 } else { k };
            self.whitening.resize(k * d * d, 0.0);
            if !whiten(covariances, d, &mut self.whitening) {
                // One by one, many features at once or to say which covariance has no factor.
                for (c, inverse) in self.whitening.chunks_exact_mut(d * d).take(matrices).enumerate() {
                    let mut factor = covariances[c * d * d..(c + 1) * d * d].to_vec();
                    cholesky(&mut factor, d).map_err(|p| refused(c, p.row, p.value))?;
                    invert_lower(&factor, d, inverse);
                }
            }
            for c in matrices..k {
                self.whitening.copy_within(..d * d, c * d * d);
            }
        }
        let diagonal = |c: usize, j: usize| if kind.is_diagonal() { c * d + j } else { (c * d + j) * d + j };
        let whitening = &self.whitening;
        let mut log_diagonals: Vec<f64> = (0..k).flat_map(|c| (0..d).map(move |j| whitening[diagonal(c, j)])).collect();
        kernel::ln_all(&mut log_diagonals);
        for (logs, &weight) in log_diagonals.chunks_exact(d).zip(weights) {
            let log_weight = if weight > 0.0 { weight.ln() } else { f64::NEG_INFINITY };
            let log_det: f64 = logs.iter().sum();
            self.offsets.push(log_weight + (log_det - 0.5 * d as f64 * LN_2_PI));
        }
        Ok(())
    }

    /// Number of components `k`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.components(), 2);
    /// # Ok(())
    /// # }
    /// ```
    pub fn components(&self) -> usize {
        self.parts.weights.len()
    }

    /// Dimension `d`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.dim(), 2);
    /// # Ok(())
    /// # }
    /// ```
    pub fn dim(&self) -> usize {
        self.parts.dim
    }

    /// Shape of the covariances.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.covariance_kind(), CovarianceKind::Diagonal);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariance_kind(&self) -> CovarianceKind {
        self.parts.kind
    }

    /// Weights `pi: (k)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.weights(), [0.25, 0.75]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn weights(&self) -> &[f64] {
        &self.parts.weights
    }

    /// Means `mu: (k, d)`, row-major.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.means(), [0.0, 1.0, 2.0, 3.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn means(&self) -> &[f64] {
        &self.parts.means
    }

    /// Mean of one component, `(d)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.mean(1), [2.0, 3.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn mean(&self, component: usize) -> &[f64] {
        let d = self.dim();
        &self.parts.means[component * d..(component + 1) * d]
    }

    /// Stored covariances: full `(k, d, d)`, tied `(d, d)`, diagonal `(k, d)`, spherical `(k)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.covariances(), [4.0, 9.0, 1.0, 1.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariances(&self) -> &[f64] {
        &self.parts.covariances
    }

    /// Covariance of one component as a full matrix, `(d, d)`.
    ///
    /// ```
    /// use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// let parts = MixtureParts {
    ///     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![4.0, 9.0],
    /// };
    /// assert_eq!(Mixture::new(parts)?.covariance(0), [4.0, 0.0, 0.0, 9.0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn covariance(&self, component: usize) -> Vec<f64> {
        let d = self.dim();
        let stored = &self.parts.covariances;
        let mut out = vec![0.0; d * d];
        match self.parts.kind {
            CovarianceKind::Full => out.copy_from_slice(&stored[component * d * d..(component + 1) * d * d]),
            CovarianceKind::Tied => out.copy_from_slice(stored),
            CovarianceKind::Diagonal => (0..d).for_each(|j| out[j * d + j] = stored[component * d + j]),
            CovarianceKind::Spherical => (0..d).for_each(|j| out[j * d + j] = stored[component]),
        }
        out
    }

    /// The numbers, for storage.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Diagonal, dim: 2, weights: vec![0.25, 0.75], means: vec![0.0, 1.0, 2.0, 3.0],
    /// #     covariances: vec![4.0, 9.0, 1.0, 1.0],
    /// # };
    /// let mixture = Mixture::new(parts)?; // means (0, 1) and (2, 3)
    /// assert_eq!(mixture.parts().weights, [0.25, 0.75]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn parts(&self) -> &MixtureParts {
        &self.parts
    }

    pub(crate) fn kernel(&self) -> Components<'_> {
        Components {
            means: &self.parts.means,
            whitening: &self.whitening,
            offsets: &self.offsets,
            diagonal: self.parts.kind.is_diagonal(),
        }
    }

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

    /// Draws `n` samples, `(n, d)` row-major, and the component each came from, `(n)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// use rand::SeedableRng;
    /// let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    /// let (values, components) = pair.sample(20_000, &mut rng);
    /// let mean = values.iter().sum::<f64>() / 20_000.0;
    /// let share = components.iter().filter(|c| **c == 0).count() as f64 / 20_000.0;
    /// assert!(mean.abs() < 0.05 && (share - 0.5).abs() < 0.02);
    /// # Ok(())
    /// # }
    /// ```
    pub fn sample(&self, n: usize, rng: &mut impl Rng) -> (Vec<f64>, Vec<usize>) {
        let (k, d) = (self.components(), self.dim());
        let factors: Vec<Vec<f64>> = (0..k)
            .map(|c| {
                let mut factor = self.covariance(c);
                // Construction has factored the same matrix, so the Cholesky succeeds.
                let ok = cholesky(&mut factor, d).is_ok();
                debug_assert!(ok, "stored covariances are positive definite");
                factor
            })
            .collect();
        let mut values = Vec::with_capacity(n * d);
        let mut labels = Vec::with_capacity(n);
        let mut z = vec![0.0; d];
        for _ in 0..n {
            let mut u: f64 = rng.random();
            let mut c = 0;
            while c + 1 < k && u >= self.parts.weights[c] {
                u -= self.parts.weights[c];
                c += 1;
            }
            for v in &mut z {
                *v = standard_normal(rng);
            }
            let (mean, factor) = (self.mean(c), &factors[c]);
            values.extend((0..d).map(|i| mean[i] + (0..=i).map(|j| factor[i * d + j] * z[j]).sum::<f64>()));
            labels.push(c);
        }
        (values, labels)
    }

    /// The same mixture with its components in the given order.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 1, weights: vec![0.5, 0.5], means: vec![-1.0, 1.0], covariances: vec![1.0, 1.0],
    /// # };
    /// let pair = Mixture::new(parts)?; // N(-1, 1) and N(1, 1), half each
    /// assert_eq!(pair.reordered(&[1, 0])?.means(), [1.0, -1.0]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// `order` is not a permutation of the components.
    pub fn reordered(&self, order: &[usize]) -> Result<Self> {
        let (k, d) = (self.components(), self.dim());
        check_len("component order", k, order.len())?;
        check_dimensions("component order", order, k)?;
        let p = &self.parts;
        let gather = |v: &[f64], stride: usize| -> Vec<f64> {
            order.iter().flat_map(|&c| v[c * stride..(c + 1) * stride].iter().copied()).collect()
        };
        let covariances = match p.kind {
            CovarianceKind::Full => gather(&p.covariances, d * d),
            CovarianceKind::Tied => p.covariances.clone(),
            CovarianceKind::Diagonal => gather(&p.covariances, d),
            CovarianceKind::Spherical => gather(&p.covariances, 1),
        };
        Self::new(MixtureParts {
            kind: p.kind,
            dim: d,
            weights: gather(&p.weights, 1),
            means: gather(&p.means, d),
            covariances,
        })
    }
}

/// Refuses indices out of bounds or listed twice.
pub(crate) fn check_dimensions(what: &'static str, indices: &[usize], dim: usize) -> Result<()> {
    for (position, &index) in indices.iter().enumerate() {
        if index >= dim || indices[..position].contains(&index) {
            return Err(Error::Dimension { what, index, dim });
        }
    }
    Ok(())
}

/// One standard normal number by the polar method of Marsaglia.
pub(crate) fn standard_normal(rng: &mut impl Rng) -> f64 {
    loop {
        let u = rng.random::<f64>().mul_add(2.0, -1.0);
        let v = rng.random::<f64>().mul_add(2.0, -1.0);
        let s = u * u + v * v;
        if s > 0.0 && s < 1.0 {
            return u * (-2.0 * s.ln() / s).sqrt();
        }
    }
}
