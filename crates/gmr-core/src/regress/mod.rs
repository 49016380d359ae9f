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
mod prediction;
mod query;

use pulp::Arch;

pub use prediction::{BatchPrediction, Prediction};

use crate::error::{Error, Result};
use crate::gmm::{LN_2_PI, Mixture, check_dimensions};
use crate::linalg::{cholesky, invert_lower};
use crate::scalar::ln_positive;
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
}
