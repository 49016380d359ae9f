//! Gaussian mixture regression (paper, eqs. 6-10).
//!
//! For a split of the dimensions into inputs `i` and outputs `o`, and with the gain
//! `A_n = S_oi,n S_ii,n^-1`,
//!
//! - `m_n(x) = mu_o,n + A_n (x - mu_i,n)`: eq. (7), which prints `mu_h` where `mu_t` is meant,
//! - `C_n = S_oo,n - A_n S_io,n`: eq. (7), second line,
//! - `b_n(x) = pi_n N(x | mu_i,n, S_ii,n) / sum`: eq. (8),
//! - `m(x) = sum b_n m_n`: eq. (9),
//! - `V(x) = sum b_n (C_n + (m_n - m)(m_n - m)')`: eq. (10), as a full matrix and in the centred
//!   form, which is equal and cannot lose its digits to cancellation.
//!
//! Gains and `C_n` come from one Cholesky factor of the joint covariance in the order
//! (inputs, outputs): `C_n = L_oo L_oo'` is positive definite by construction. They are computed once;
//! a query costs `k (d_i^2 + d_o d_i + d_o^2)` multiply-adds and allocates nothing.

mod batch;

use pulp::{Arch, Simd, WithSimd};

use crate::error::{Error, Result, check_len, check_values};
use crate::gmm::{LN_2_PI, Mixture, check_dimensions};
use crate::linalg::{cholesky, invert_lower};
use crate::scalar::{exp_nonpositive, ln_positive};
use crate::wide::LANES;

/// A mixture prepared for one split into inputs and outputs.
///
/// ```
/// use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor};
/// # fn main() -> Result<(), gmr_core::Error> {
/// // One Gaussian over (t, h): slope S_ht / S_tt = 0.5, conditional variance 1 - 0.5 * 0.5 = 0.75.
/// let mixture = Mixture::new(MixtureParts {
///     kind: CovarianceKind::Full,
///     dim: 2,
///     weights: vec![1.0],
///     means: vec![1.0, 2.0],
///     covariances: vec![1.0, 0.5, 0.5, 1.0],
/// })?;
/// let regressor = Regressor::new(&mixture, &[0], &[1])?;
/// let mut out = regressor.prediction();
/// regressor.predict_with_jacobian_into(&[3.0], &mut out)?;
/// assert!((out.mean()[0] - 3.0).abs() < 1e-15);
/// assert!((out.covariance()[0] - 0.75).abs() < 1e-15);
/// assert!((out.jacobian()[0] - 0.5).abs() < 1e-15);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct Regressor {
    inputs: Vec<usize>,
    outputs: Vec<usize>,
    components: usize,
    arch: Arch,
    /// Components padded to whole lanes, each with density zero.
    padded: usize,
    /// Outputs padded to whole lanes.
    width: usize,
    /// Component-minor: `(d_i, padded)`.
    input_means: Vec<f64>,
    /// `L_ii^-1`, component-minor lower triangle: `(d_i (d_i + 1) / 2, padded)`.
    whitening: Vec<f64>,
    /// `ln pi + ln det L_ii^-1 - d_i/2 ln 2 pi`, `(padded)`.
    offsets: Vec<f64>,
    /// `(k, width)`.
    output_means: Vec<f64>,
    /// `A`, stored by input: `(k, d_i, width)`.
    gains: Vec<f64>,
    /// `C`, `(k, d_o, width)`.
    wide_covariances: Vec<f64>,
    /// `C`, `(k, d_o, d_o)`.
    covariances: Vec<f64>,
}

/// The slice as whole groups of lanes.
#[inline(always)]
fn groups(v: &[f64]) -> &[[f64; LANES]] {
    v.as_chunks().0
}

#[inline(always)]
fn groups_mut(v: &mut [f64]) -> &mut [[f64; LANES]] {
    v.as_chunks_mut().0
}

/// Result and working space of a query; made once by [`Regressor::prediction`], then reused.
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
    mean: Vec<f64>,
    covariance: Vec<f64>,
    jacobian: Vec<f64>,
    responsibilities: Vec<f64>,
    log_density: f64,
    /// `m_n`, `(k, width)`.
    wide_means: Vec<f64>,
    /// `m_n`, `(k, d_o)`.
    component_means: Vec<f64>,
    /// `b_n`, `(padded)`.
    wide_responsibilities: Vec<f64>,
    /// `m`, `(width)`, and room for `V`, `(d_o, width)`.
    wide: Vec<f64>,
    /// `x - mu_i`, component-minor: `(d_i, padded)`.
    differences: Vec<f64>,
    /// `L_ii^-1 (x - mu_i)`, component-minor: `(d_i, padded)`.
    whitened: Vec<f64>,
    /// `dm/dx` by input, `(d_i, width)`.
    wide_jacobian: Vec<f64>,
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
    /// Zero until [`Regressor::predict_with_jacobian_into`] has filled it.
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

/// How much of a prediction is wanted.
#[derive(Clone, Copy, PartialEq)]
enum Part {
    Mean,
    Covariance,
    Jacobian,
}

/// One query, compiled for each instruction set.
struct Query<'a> {
    regressor: &'a Regressor,
    x: &'a [f64],
    out: &'a mut Prediction,
    part: Part,
}

impl WithSimd for Query<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        let supported = self.regressor.mix(self.x, self.out);
        if self.part != Part::Mean {
            self.regressor.spread(self.out);
        }
        if self.part == Part::Jacobian {
            self.regressor.slope(self.out);
        }
        supported
    }
}

impl Regressor {
    /// Prepares `mixture` for regression of `outputs` on `inputs`; other dimensions are marginalised.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// assert!(Regressor::new(&joint, &[0], &[0]).is_err()); // on both sides
    /// assert!((regressor.gain(0)[0] - 0.8).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// An empty list, an index out of bounds, listed twice or on both sides, or a joint
    /// covariance that is not positive definite.
    pub fn new(mixture: &Mixture, inputs: &[usize], outputs: &[usize]) -> Result<Self> {
        let (k, dim) = (mixture.components(), mixture.dim());
        if inputs.is_empty() || outputs.is_empty() {
            return Err(Error::InvalidParameter {
                name: "number of inputs and outputs",
                allowed: "at least 1",
                value: 0.0,
            });
        }
        let order: Vec<usize> = inputs.iter().chain(outputs).copied().collect();
        check_dimensions("regression dimensions", &order, dim)?;
        let (di, dout, d) = (inputs.len(), outputs.len(), order.len());
        let (padded, width) = (k.next_multiple_of(LANES), dout.next_multiple_of(LANES));
        let mut regressor = Self {
            inputs: inputs.to_vec(),
            outputs: outputs.to_vec(),
            components: k,
            arch: Arch::new(),
            padded,
            width,
            input_means: vec![0.0; di * padded],
            whitening: vec![0.0; di * (di + 1) / 2 * padded],
            offsets: vec![f64::NEG_INFINITY; padded],
            output_means: vec![0.0; k * width],
            gains: vec![0.0; k * di * width],
            wide_covariances: vec![0.0; k * dout * width],
            covariances: Vec::with_capacity(k * dout * dout),
        };
        for c in 0..k {
            let (mean, covariance) = (mixture.mean(c), mixture.covariance(c));
            let mut factor: Vec<f64> = order
                .iter()
                .flat_map(|&a| order.iter().map(move |&b| (a, b)))
                .map(|(a, b)| covariance[a * dim + b])
                .collect();
            cholesky(&mut factor, d).map_err(|p| Error::NotPositiveDefinite {
                what: "joint covariance of component",
                index: c,
                pivot: p.row,
                value: p.value,
            })?;
            let corner: Vec<f64> = (0..di * di).map(|i| factor[i / di * d + i % di]).collect();
            let mut whitening = vec![0.0; di * di];
            invert_lower(&corner, di, &mut whitening);
            let weight = mixture.weights()[c];
            let log_weight = if weight > 0.0 { weight.ln() } else { f64::NEG_INFINITY };
            let log_det: f64 = (0..di).map(|i| ln_positive(whitening[i * di + i])).sum();
            regressor.offsets[c] = log_weight + (log_det - 0.5 * di as f64 * LN_2_PI);
            // A = L_oi L_ii^-1; C = L_oo L_oo'.
            for j in 0..di {
                regressor.input_means[j * padded + c] = mean[inputs[j]];
                for m in 0..=j {
                    regressor.whitening[(j * (j + 1) / 2 + m) * padded + c] = whitening[j * di + m];
                }
                for o in 0..dout {
                    let row = &factor[(di + o) * d..];
                    regressor.gains[(c * di + j) * width + o] = (j..di).map(|m| row[m] * whitening[m * di + j]).sum();
                }
            }
            for a in 0..dout {
                regressor.output_means[c * width + a] = mean[outputs[a]];
                for b in 0..dout {
                    let (ra, rb) = (&factor[(di + a) * d + di..], &factor[(di + b) * d + di..]);
                    let value = (0..=a.min(b)).map(|m| ra[m] * rb[m]).sum();
                    regressor.covariances.push(value);
                    regressor.wide_covariances[(c * dout + a) * width + b] = value;
                }
            }
        }
        Ok(regressor)
    }

    /// The input dimensions, in query order.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// assert_eq!(regressor.inputs(), [0]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn inputs(&self) -> &[usize] {
        &self.inputs
    }

    /// The output dimensions, in answer order.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// assert_eq!(regressor.outputs(), [1]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn outputs(&self) -> &[usize] {
        &self.outputs
    }

    /// Number of components.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// assert_eq!(regressor.components(), 1);
    /// # Ok(())
    /// # }
    /// ```
    pub fn components(&self) -> usize {
        self.components
    }

    /// Gain `A_n = S_oi S_ii^-1` of one component, `(d_o, d_i)` row-major.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// assert!((regressor.gain(0)[0] - 0.8).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn gain(&self, component: usize) -> Vec<f64> {
        let (di, dout) = (self.inputs.len(), self.outputs.len());
        let at = |o: usize, j: usize| self.gains[(component * di + j) * self.width + o];
        (0..dout * di).map(|i| at(i / di, i % di)).collect()
    }

    /// Conditional covariance `C_n` of one component, `(d_o, d_o)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// assert!((regressor.component_covariance(0)[0] - 0.36).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn component_covariance(&self, component: usize) -> &[f64] {
        let dout = self.outputs.len();
        &self.covariances[component * dout * dout..(component + 1) * dout * dout]
    }

    /// Space for the results and the work of a query. The only allocation of a regression.
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
    /// regressor.predict_into(&[-1.0], &mut out)?;
    /// assert!((out.mean()[0] + 0.8).abs() < 1e-12);
    /// # Ok(())
    /// # }
    /// ```
    pub fn prediction(&self) -> Prediction {
        let (k, di, dout) = (self.components, self.inputs.len(), self.outputs.len());
        Prediction {
            mean: vec![0.0; dout],
            covariance: vec![0.0; dout * dout],
            jacobian: vec![0.0; dout * di],
            responsibilities: vec![0.0; k],
            log_density: f64::NEG_INFINITY,
            wide_means: vec![0.0; k * self.width],
            component_means: vec![0.0; k * dout],
            wide_responsibilities: vec![0.0; self.padded],
            wide: vec![0.0; (1 + dout) * self.width],
            differences: vec![0.0; di * self.padded],
            whitened: vec![0.0; di * self.padded],
            wide_jacobian: vec![0.0; di * self.width],
        }
    }

    fn check(&self, x: &[f64], out: &Prediction) -> Result<()> {
        check_len("query", self.inputs.len(), x.len())?;
        check_values("query", x)?;
        check_len("prediction", self.outputs.len(), out.mean.len())?;
        check_len("prediction components", self.components, out.responsibilities.len())?;
        check_len("prediction inputs", self.inputs.len() * self.padded, out.differences.len())
    }

    /// Mean, full covariance, responsibilities and log density at `x: (d_i)`. Allocates nothing.
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
    /// regressor.predict_into(&[2.0], &mut out)?;
    /// assert!((out.mean()[0] - 1.6).abs() < 1e-15 && (out.covariance()[0] - 0.36).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// A wrong length, a value that is not finite, or [`Error::NoSupport`] so far out that every
    /// density underflows even as a logarithm; `out` is then unspecified.
    pub fn predict_into(&self, x: &[f64], out: &mut Prediction) -> Result<()> {
        self.check(x, out)?;
        self.run(x, out, Part::Covariance)
    }

    /// As [`Regressor::predict_into`], and the Jacobian `dm/dx` as well.
    ///
    /// `dm/dx = sum b_n (A_n + (m_n - m) g_n')` with `g_n = -S_ii,n^-1 (x - mu_i,n)`.
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
    /// assert!((out.jacobian()[0] - 0.8).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Regressor::predict_into`].
    pub fn predict_with_jacobian_into(&self, x: &[f64], out: &mut Prediction) -> Result<()> {
        self.check(x, out)?;
        self.run(x, out, Part::Jacobian)
    }

    /// Mean and responsibilities only; the covariance in `out` keeps its old value.
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
    /// regressor.predict_mean_into(&[-1.0], &mut out)?;
    /// assert!((out.mean()[0] + 0.8).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Regressor::predict_into`].
    pub fn predict_mean_into(&self, x: &[f64], out: &mut Prediction) -> Result<()> {
        self.check(x, out)?;
        self.run(x, out, Part::Mean)
    }

    fn run(&self, x: &[f64], out: &mut Prediction, part: Part) -> Result<()> {
        if self.arch.dispatch(Query { regressor: self, x, out, part }) {
            Ok(())
        } else {
            Err(Error::NoSupport { components: self.components })
        }
    }

    /// Responsibilities (8), component means (7) and their mix (9). False without support.
    #[inline(always)]
    fn mix(&self, x: &[f64], out: &mut Prediction) -> bool {
        let (di, dout, padded, width) = (self.inputs.len(), self.outputs.len(), self.padded, self.width);
        // Densities: eight components at a time.
        let mut peaks = [f64::NEG_INFINITY; LANES];
        for (g, b) in groups_mut(&mut out.wide_responsibilities).iter_mut().enumerate() {
            let at = |j: usize| j * padded + g * LANES..j * padded + (g + 1) * LANES;
            let mut norm = [0.0; LANES];
            for (i, x) in x.iter().enumerate() {
                let z = &mut groups_mut(&mut out.differences[at(i)])[0];
                let m = &groups(&self.input_means[at(i)])[0];
                for l in 0..LANES {
                    z[l] = x - m[l];
                }
                let mut y = [0.0; LANES];
                for j in 0..=i {
                    let w = &groups(&self.whitening[at(i * (i + 1) / 2 + j)])[0];
                    let z = &groups(&out.differences[at(j)])[0];
                    for l in 0..LANES {
                        y[l] = w[l].mul_add(z[l], y[l]);
                    }
                }
                for l in 0..LANES {
                    norm[l] = y[l].mul_add(y[l], norm[l]);
                }
                out.whitened[at(i)].copy_from_slice(&y);
            }
            let offset = &groups(&self.offsets)[g];
            for l in 0..LANES {
                b[l] = (-0.5f64).mul_add(norm[l], offset[l]);
                peaks[l] = if b[l] > peaks[l] { b[l] } else { peaks[l] };
            }
        }
        let peak = peaks.iter().fold(f64::NEG_INFINITY, |m, p| if *p > m { *p } else { m });
        let supported = peak > f64::NEG_INFINITY;
        let peak = if supported { peak } else { 0.0 };
        // One plain loop: inner loops of eight would be unrolled into pieces of registers.
        for b in &mut out.wide_responsibilities {
            *b = exp_nonpositive(*b - peak);
        }
        let mut sums = [0.0; LANES];
        for b in groups(&out.wide_responsibilities) {
            for l in 0..LANES {
                sums[l] += b[l];
            }
        }
        let sum = ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
        let scale = if supported { 1.0 / sum } else { 0.0 };
        out.log_density = if supported { peak + ln_positive(sum) } else { f64::NEG_INFINITY };
        for (b, wide) in out.responsibilities.iter_mut().zip(&mut out.wide_responsibilities) {
            *wide *= scale;
            *b = *wide;
        }
        // Means: eight outputs at a time.
        for o in 0..width / LANES {
            let mut mean = [0.0; LANES];
            for (c, b) in out.responsibilities.iter().enumerate() {
                let mut m = groups(&self.output_means[c * width..])[o];
                for j in 0..di {
                    let z = out.differences[j * padded + c];
                    let a = &groups(&self.gains[(c * di + j) * width..])[o];
                    for l in 0..LANES {
                        m[l] = a[l].mul_add(z, m[l]);
                    }
                }
                groups_mut(&mut out.wide_means[c * width..])[o] = m;
                for l in 0..LANES {
                    mean[l] = b.mul_add(m[l], mean[l]);
                }
            }
            groups_mut(&mut out.wide)[o] = mean;
        }
        out.mean.copy_from_slice(&out.wide[..dout]);
        for (dense, wide) in out.component_means.chunks_exact_mut(dout).zip(out.wide_means.chunks_exact(width)) {
            dense.copy_from_slice(&wide[..dout]);
        }
        supported
    }

    /// Law of total covariance (10). Products commute, so the result is exactly symmetric.
    #[inline(always)]
    fn spread(&self, out: &mut Prediction) {
        match self.outputs.len() {
            1 => self.spread_of::<1>(out),
            2 => self.spread_of::<2>(out),
            3 => self.spread_of::<3>(out),
            4 => self.spread_of::<4>(out),
            5 => self.spread_of::<5>(out),
            6 => self.spread_of::<6>(out),
            7 => self.spread_of::<7>(out),
            8 => self.spread_of::<8>(out),
            _ => self.spread_of_any_dimension(out),
        }
    }

    /// With all rows of the covariance in registers.
    #[inline(always)]
    fn spread_of<const D: usize>(&self, out: &mut Prediction) {
        let mean = groups(&out.wide)[0];
        let mut v = [[0.0; LANES]; D];
        let within = groups(&self.wide_covariances).as_chunks::<D>().0;
        for ((b, m), within) in out.responsibilities.iter().zip(groups(&out.wide_means)).zip(within) {
            let mut e = [0.0; LANES];
            for l in 0..LANES {
                e[l] = m[l] - mean[l];
            }
            for i in 0..D {
                for l in 0..LANES {
                    v[i][l] = b.mul_add(e[i].mul_add(e[l], within[i][l]), v[i][l]);
                }
            }
        }
        for (dense, row) in out.covariance.as_chunks_mut::<D>().0.iter_mut().zip(&v) {
            dense.copy_from_slice(&row[..D]);
        }
    }

    #[inline(always)]
    fn spread_of_any_dimension(&self, out: &mut Prediction) {
        let (dout, width) = (self.outputs.len(), self.width);
        let (mean, covariance) = out.wide.split_at_mut(width);
        for i in 0..dout {
            for o in 0..width / LANES {
                let mut v = [0.0; LANES];
                let mean_o = &groups(mean)[o];
                for (c, b) in out.responsibilities.iter().enumerate() {
                    let m = &out.wide_means[c * width..(c + 1) * width];
                    let ei = m[i] - mean[i];
                    let m = &groups(m)[o];
                    let within = &groups(&self.wide_covariances[(c * dout + i) * width..])[o];
                    for l in 0..LANES {
                        v[l] = b.mul_add(ei.mul_add(m[l] - mean_o[l], within[l]), v[l]);
                    }
                }
                groups_mut(&mut covariance[i * width..])[o] = v;
            }
        }
        for (dense, wide) in out.covariance.chunks_exact_mut(dout).zip(covariance.chunks_exact(width)) {
            dense.copy_from_slice(&wide[..dout]);
        }
    }

    /// Derivative of the mixed mean.
    #[inline(always)]
    fn slope(&self, out: &mut Prediction) {
        let (di, dout, padded, width) = (self.inputs.len(), self.outputs.len(), self.padded, self.width);
        out.wide_jacobian.fill(0.0);
        for (c, b) in out.responsibilities.iter().enumerate() {
            for j in 0..di {
                let mut pull = 0.0;
                for i in j..di {
                    let w = self.whitening[(i * (i + 1) / 2 + j) * padded + c];
                    pull = w.mul_add(out.whitened[i * padded + c], pull);
                }
                for o in 0..width / LANES {
                    let a = &groups(&self.gains[(c * di + j) * width..])[o];
                    let m = &groups(&out.wide_means[c * width..])[o];
                    let mean = &groups(&out.wide)[o];
                    let jacobian = &mut groups_mut(&mut out.wide_jacobian[j * width..])[o];
                    for l in 0..LANES {
                        jacobian[l] = b.mul_add((-pull).mul_add(m[l] - mean[l], a[l]), jacobian[l]);
                    }
                }
            }
        }
        for o in 0..dout {
            for j in 0..di {
                out.jacobian[o * di + j] = out.wide_jacobian[j * width + o];
            }
        }
    }
}
