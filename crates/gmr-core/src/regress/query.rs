//! One query: the mixture regression proper.

use pulp::{Simd, WithSimd};

use super::prediction::Prediction;
use super::{Regressor, groups, groups_mut};
use crate::error::{Error, Result, check_len, check_values};
use crate::scalar::{exp_nonpositive, ln_positive};
use crate::wide::LANES;

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
