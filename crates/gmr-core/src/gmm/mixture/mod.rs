//! A fitted mixture: always normalised, always factored.

mod densities;
mod draw;
mod numbers;

use serde::{Deserialize, Serialize};

use super::factors::whiten;
use super::params::CovarianceKind;
use crate::error::{Error, Result, check_len, check_values};
use crate::kernel::{self, Components};
use crate::linalg::{cholesky, invert_lower};

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

    pub(crate) fn kernel(&self) -> Components<'_> {
        Components {
            means: &self.parts.means,
            whitening: &self.whitening,
            offsets: &self.offsets,
            diagonal: self.parts.kind.is_diagonal(),
        }
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
