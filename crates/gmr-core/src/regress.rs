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

use pulp::Arch;

use crate::error::{Error, Result, check_len, check_values};
use crate::gmm::{LN_2_PI, Mixture, check_dimensions};
use crate::linalg::{cholesky, invert_lower};
use crate::samples::Samples;
use crate::scalar::{exp_nonpositive, ln_positive};

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
    /// `(k, d_i)`.
    input_means: Vec<f64>,
    /// `L_ii^-1`, `(k, d_i, d_i)`.
    whitening: Vec<f64>,
    /// `ln pi + ln det L_ii^-1 - d_i/2 ln 2 pi`, `(k)`.
    offsets: Vec<f64>,
    /// `(k, d_o)`.
    output_means: Vec<f64>,
    /// `A`, stored by input: `(k, d_i, d_o)`.
    gains: Vec<f64>,
    /// `C`, `(k, d_o, d_o)`.
    covariances: Vec<f64>,
}

/// Result and working space of a query; made once by [`Regressor::prediction`], then reused.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    mean: Vec<f64>,
    covariance: Vec<f64>,
    jacobian: Vec<f64>,
    responsibilities: Vec<f64>,
    log_density: f64,
    /// `m_n`, `(k, d_o)`.
    component_means: Vec<f64>,
    /// `x - mu_i`, then the gradient `-S_ii^-1 (x - mu_i)`, `(k, d_i)`.
    slopes: Vec<f64>,
    /// One row of working space, `(max(d_i, d_o))`.
    row: Vec<f64>,
}

impl Prediction {
    /// Conditional mean `m(x)`, `(d_o)`.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Conditional covariance `V(x)`, `(d_o, d_o)`, exactly symmetric.
    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }

    /// `dm/dx`, `(d_o, d_i)` row-major; with time as the only input, the velocity of the mean.
    /// Zero until [`Regressor::predict_with_jacobian_into`] has filled it.
    pub fn jacobian(&self) -> &[f64] {
        &self.jacobian
    }

    /// `b_n(x)`, `(k)`.
    pub fn responsibilities(&self) -> &[f64] {
        &self.responsibilities
    }

    /// `m_n(x)` of each component, `(k, d_o)` row-major.
    pub fn component_means(&self) -> &[f64] {
        &self.component_means
    }

    /// `ln p(x)` of the inputs: how usual this query is.
    pub fn log_density(&self) -> f64 {
        self.log_density
    }
}

/// Means and covariances of many queries.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchPrediction {
    /// `(n, d_o)` row-major.
    pub means: Vec<f64>,
    /// `(n, d_o, d_o)` row-major.
    pub covariances: Vec<f64>,
}

impl Regressor {
    /// Prepares `mixture` for regression of `outputs` on `inputs`; other dimensions are marginalised.
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
        let mut regressor = Self {
            inputs: inputs.to_vec(),
            outputs: outputs.to_vec(),
            components: k,
            arch: Arch::new(),
            input_means: Vec::with_capacity(k * di),
            whitening: Vec::with_capacity(k * di * di),
            offsets: Vec::with_capacity(k),
            output_means: Vec::with_capacity(k * dout),
            gains: Vec::with_capacity(k * di * dout),
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
            regressor.offsets.push(log_weight + (log_det - 0.5 * di as f64 * LN_2_PI));
            // A = L_oi L_ii^-1; C = L_oo L_oo'.
            for j in 0..di {
                for o in 0..dout {
                    let row = &factor[(di + o) * d..];
                    regressor.gains.push((j..di).map(|m| row[m] * whitening[m * di + j]).sum());
                }
            }
            for a in 0..dout {
                for b in 0..dout {
                    let (ra, rb) = (&factor[(di + a) * d + di..], &factor[(di + b) * d + di..]);
                    regressor.covariances.push((0..=a.min(b)).map(|m| ra[m] * rb[m]).sum());
                }
            }
            regressor.whitening.extend_from_slice(&whitening);
            regressor.input_means.extend(inputs.iter().map(|&i| mean[i]));
            regressor.output_means.extend(outputs.iter().map(|&o| mean[o]));
        }
        Ok(regressor)
    }

    /// The input dimensions, in query order.
    pub fn inputs(&self) -> &[usize] {
        &self.inputs
    }

    /// The output dimensions, in answer order.
    pub fn outputs(&self) -> &[usize] {
        &self.outputs
    }

    /// Number of components.
    pub fn components(&self) -> usize {
        self.components
    }

    /// Gain `A_n = S_oi S_ii^-1` of one component, `(d_o, d_i)` row-major.
    pub fn gain(&self, component: usize) -> Vec<f64> {
        let (di, dout) = (self.inputs.len(), self.outputs.len());
        let stored = &self.gains[component * di * dout..(component + 1) * di * dout];
        (0..dout * di).map(|i| stored[i % di * dout + i / di]).collect()
    }

    /// Conditional covariance `C_n` of one component, `(d_o, d_o)`.
    pub fn component_covariance(&self, component: usize) -> &[f64] {
        let dout = self.outputs.len();
        &self.covariances[component * dout * dout..(component + 1) * dout * dout]
    }

    /// Space for the results and the work of a query. The only allocation of a regression.
    pub fn prediction(&self) -> Prediction {
        let (k, di, dout) = (self.components, self.inputs.len(), self.outputs.len());
        Prediction {
            mean: vec![0.0; dout],
            covariance: vec![0.0; dout * dout],
            jacobian: vec![0.0; dout * di],
            responsibilities: vec![0.0; k],
            log_density: f64::NEG_INFINITY,
            component_means: vec![0.0; k * dout],
            slopes: vec![0.0; k * di],
            row: vec![0.0; di.max(dout)],
        }
    }

    fn check(&self, x: &[f64], out: &Prediction) -> Result<()> {
        check_len("query", self.inputs.len(), x.len())?;
        check_values("query", x)?;
        check_len("prediction", self.outputs.len(), out.mean.len())?;
        check_len("prediction components", self.components, out.responsibilities.len())?;
        check_len("prediction inputs", self.inputs.len() * self.components, out.slopes.len())
    }

    /// Mean, full covariance, responsibilities and log density at `x: (d_i)`. Allocates nothing.
    ///
    /// # Errors
    /// A wrong length, a value that is not finite, or [`Error::NoSupport`] so far out that every
    /// density underflows even as a logarithm; `out` is then unspecified.
    pub fn predict_into(&self, x: &[f64], out: &mut Prediction) -> Result<()> {
        self.check(x, out)?;
        let supported = self.arch.dispatch(
            #[inline(always)]
            || {
                let supported = self.mix(x, out);
                self.spread(out);
                supported
            },
        );
        if supported { Ok(()) } else { Err(Error::NoSupport { components: self.components }) }
    }

    /// As [`Regressor::predict_into`], and the Jacobian `dm/dx` as well.
    ///
    /// `dm/dx = sum b_n (A_n + (m_n - m) g_n')` with `g_n = -S_ii,n^-1 (x - mu_i,n)`.
    ///
    /// # Errors
    /// As [`Regressor::predict_into`].
    pub fn predict_with_jacobian_into(&self, x: &[f64], out: &mut Prediction) -> Result<()> {
        self.check(x, out)?;
        let supported = self.arch.dispatch(
            #[inline(always)]
            || {
                let supported = self.mix(x, out);
                self.spread(out);
                self.slope(out);
                supported
            },
        );
        if supported { Ok(()) } else { Err(Error::NoSupport { components: self.components }) }
    }

    /// Mean and responsibilities only; the covariance in `out` keeps its old value.
    ///
    /// # Errors
    /// As [`Regressor::predict_into`].
    pub fn predict_mean_into(&self, x: &[f64], out: &mut Prediction) -> Result<()> {
        self.check(x, out)?;
        let supported = self.arch.dispatch(
            #[inline(always)]
            || self.mix(x, out),
        );
        if supported { Ok(()) } else { Err(Error::NoSupport { components: self.components }) }
    }

    /// Means and covariances of `queries: (n, d_i)`.
    ///
    /// # Errors
    /// As [`Regressor::predict_into`], for the first query that fails.
    pub fn predict_batch(&self, queries: &Samples<'_>) -> Result<BatchPrediction> {
        check_len("query dimension", self.inputs.len(), queries.dim())?;
        let dout = self.outputs.len();
        let mut batch = BatchPrediction {
            means: Vec::with_capacity(queries.len() * dout),
            covariances: Vec::with_capacity(queries.len() * dout * dout),
        };
        let mut out = self.prediction();
        for i in 0..queries.len() {
            self.predict_into(queries.row(i), &mut out)?;
            batch.means.extend_from_slice(&out.mean);
            batch.covariances.extend_from_slice(&out.covariance);
        }
        Ok(batch)
    }

    /// Responsibilities (8), component means (7) and their mix (9). False without support.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must be compiled inside the caller's target features")]
    fn mix(&self, x: &[f64], out: &mut Prediction) -> bool {
        let (di, dout) = (self.inputs.len(), self.outputs.len());
        let mut peak = f64::NEG_INFINITY;
        for (c, log) in out.responsibilities.iter_mut().enumerate() {
            let z = &mut out.slopes[c * di..(c + 1) * di];
            for ((z, x), m) in z.iter_mut().zip(x).zip(&self.input_means[c * di..]) {
                *z = x - m;
            }
            let mut norm = 0.0;
            for (i, row) in self.whitening[c * di * di..(c + 1) * di * di].chunks_exact(di).enumerate() {
                let mut y = 0.0;
                for (w, z) in row[..=i].iter().zip(z.iter()) {
                    y = w.mul_add(*z, y);
                }
                norm = y.mul_add(y, norm);
            }
            *log = (-0.5f64).mul_add(norm, self.offsets[c]);
            peak = if *log > peak { *log } else { peak };
        }
        let supported = peak > f64::NEG_INFINITY;
        let peak = if supported { peak } else { 0.0 };
        let mut sum = 0.0;
        for b in &mut out.responsibilities {
            *b = exp_nonpositive(*b - peak);
            sum += *b;
        }
        let scale = if supported { 1.0 / sum } else { 0.0 };
        out.log_density = if supported { peak + ln_positive(sum) } else { f64::NEG_INFINITY };
        out.mean.fill(0.0);
        for (c, b) in out.responsibilities.iter_mut().enumerate() {
            *b *= scale;
            let m = &mut out.component_means[c * dout..(c + 1) * dout];
            m.copy_from_slice(&self.output_means[c * dout..(c + 1) * dout]);
            for (j, z) in out.slopes[c * di..(c + 1) * di].iter().enumerate() {
                for (m, a) in m.iter_mut().zip(&self.gains[(c * di + j) * dout..(c * di + j + 1) * dout]) {
                    *m = a.mul_add(*z, *m);
                }
            }
            for (sum, m) in out.mean.iter_mut().zip(m.iter()) {
                *sum = b.mul_add(*m, *sum);
            }
        }
        supported
    }

    /// Law of total covariance (10).
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must be compiled inside the caller's target features")]
    fn spread(&self, out: &mut Prediction) {
        let dout = self.outputs.len();
        out.covariance.fill(0.0);
        for (c, b) in out.responsibilities.iter().enumerate() {
            let e = &mut out.row[..dout];
            for ((e, m), mean) in e.iter_mut().zip(&out.component_means[c * dout..]).zip(&out.mean) {
                *e = m - mean;
            }
            let within = &self.covariances[c * dout * dout..(c + 1) * dout * dout];
            for ((v, within), ei) in out.covariance.chunks_exact_mut(dout).zip(within.chunks_exact(dout)).zip(e.iter())
            {
                for ((v, within), ej) in v.iter_mut().zip(within).zip(e.iter()) {
                    *v = b.mul_add(ei.mul_add(*ej, *within), *v);
                }
            }
        }
    }

    /// Derivative of the mixed mean.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must be compiled inside the caller's target features")]
    fn slope(&self, out: &mut Prediction) {
        let (di, dout) = (self.inputs.len(), self.outputs.len());
        out.jacobian.fill(0.0);
        for (c, b) in out.responsibilities.iter().enumerate() {
            let z = &mut out.slopes[c * di..(c + 1) * di];
            let w = &self.whitening[c * di * di..(c + 1) * di * di];
            let y = &mut out.row[..di];
            for (i, y) in y.iter_mut().enumerate() {
                *y = w[i * di..=i * di + i].iter().zip(z.iter()).map(|(w, z)| w * z).sum();
            }
            for (j, z) in z.iter_mut().enumerate() {
                *z = -(j..di).map(|i| w[i * di + j] * y[i]).sum::<f64>();
            }
            for o in 0..dout {
                let e = out.component_means[c * dout + o] - out.mean[o];
                for (j, z) in z.iter().enumerate() {
                    let gain = self.gains[(c * di + j) * dout + o];
                    out.jacobian[o * di + j] = b.mul_add(e.mul_add(*z, gain), out.jacobian[o * di + j]);
                }
            }
        }
    }
}
