//! Many queries, eight at a time, each in a lane of its own.
//!
//! The operations on a lane and their order are those of a single query, so the bytes are the same.

use pulp::{Simd, WithSimd};

use super::{BatchPrediction, Regressor};
use crate::error::{Result, check_len};
use crate::samples::Samples;
use crate::scalar::exp_nonpositive;
use crate::wide::{Aligned, LANES, Wide, in_registers};

impl Regressor {
    /// Means and covariances of `queries: (n, d_i)`.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let regressor = Regressor::new(&joint, &[0], &[1])?;
    /// let batch = regressor.predict_batch(&Samples::new(&[0.0, 2.0], 1)?)?;
    /// assert!(batch.means[0].abs() < 1e-15 && (batch.means[1] - 1.6).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Regressor::predict_into`], for the first query that fails.
    pub fn predict_batch(&self, queries: &Samples<'_>) -> Result<BatchPrediction> {
        let dout = self.outputs.len();
        let mut covariances = vec![0.0; queries.len() * dout * dout];
        let means = self.batch(queries, Some(&mut covariances))?;
        Ok(BatchPrediction { means, covariances })
    }

    /// Means of `queries: (n, d_i)`, `(n, d_o)` row-major, without their covariances.
    ///
    /// ```
    /// # use gmr_core::{CovarianceKind, Mixture, MixtureParts, Regressor, Samples};
    /// # fn main() -> Result<(), gmr_core::Error> {
    /// # let parts = MixtureParts {
    /// #     kind: CovarianceKind::Full, dim: 2, weights: vec![1.0], means: vec![0.0, 0.0], covariances: vec![1.0, 0.8, 0.8, 1.0],
    /// # };
    /// let joint = Mixture::new(parts)?; // unit variances, correlation 0.8
    /// let means = Regressor::new(&joint, &[0], &[1])?.predict_mean_batch(&Samples::new(&[0.0, 2.0], 1)?)?;
    /// assert!(means[0].abs() < 1e-15 && (means[1] - 1.6).abs() < 1e-15);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`Regressor::predict_into`], for the first query that fails.
    pub fn predict_mean_batch(&self, queries: &Samples<'_>) -> Result<Vec<f64>> {
        self.batch(queries, None)
    }

    fn batch(&self, queries: &Samples<'_>, covariances: Option<&mut [f64]>) -> Result<Vec<f64>> {
        check_len("query dimension", self.inputs.len(), queries.dim())?;
        let mut means = vec![0.0; queries.len() * self.outputs.len()];
        let (values, means_out) = (queries.values(), &mut means[..]);
        let batch = Batch { regressor: self, queries: values, means: means_out, covariances };
        if queries.missing() > 0 || !self.arch.dispatch(batch) {
            // Some query fails: one by one they say which and why.
            let mut out = self.prediction();
            for i in 0..queries.len() {
                self.predict_mean_into(queries.row(i), &mut out)?;
            }
        }
        Ok(means)
    }
}

struct Batch<'a> {
    regressor: &'a Regressor,
    /// `(n, d_i)`.
    queries: &'a [f64],
    /// `(n, d_o)`.
    means: &'a mut [f64],
    /// `(n, d_o, d_o)`, if wanted.
    covariances: Option<&'a mut [f64]>,
}

impl WithSimd for Batch<'_> {
    type Output = bool;

    /// False when some query has no support.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        in_registers!(self.in_registers<S>(simd))
    }
}

/// Eight numbers, one per query.
type Lane = [f64; LANES];

/// What is known of eight queries.
struct Work<'a> {
    /// `(d_i)`.
    x: &'a mut [Lane],
    /// `x - mu_i`, `(k, d_i)`.
    z: &'a mut [Lane],
    /// Log densities, then `b_n`, `(k)`.
    b: &'a mut [Lane],
    /// `m_n`, then its difference from the mean, `(k, d_o)`.
    m: &'a mut [Lane],
    /// `(d_o)`.
    mean: &'a mut [Lane],
    /// Lower triangle of `V`, row by row.
    v: &'a mut [Lane],
}

impl Batch<'_> {
    #[inline(always)]
    fn in_registers<S: Simd, const P: usize>(self, simd: S) -> bool {
        let Self { regressor, queries, means, mut covariances } = self;
        let (di, dout, k) = (regressor.inputs.len(), regressor.outputs.len(), regressor.components);
        let triangle = dout * (dout + 1) / 2;
        let mut room = [di, k * di, k, k * dout, dout, triangle].map(|lanes| Aligned::zeros(lanes * LANES));
        let [x, z, b, m, mean, v] = room.each_mut().map(Aligned::lanes_mut);
        let mut work = Work { x, z, b, m, mean, v };
        for (group, (queries, means)) in queries.chunks(LANES * di).zip(means.chunks_mut(LANES * dout)).enumerate() {
            let count = queries.len() / di;
            for (j, x) in work.x.iter_mut().enumerate() {
                for (l, x) in x.iter_mut().enumerate() {
                    // Lanes to spare repeat the last query.
                    *x = queries[l.min(count - 1) * di + j];
                }
            }
            if !regressor.weigh::<S, P>(simd, &mut work) {
                return false;
            }
            regressor.mix_lanes::<S, P>(simd, &mut work);
            for (l, row) in means.chunks_exact_mut(dout).enumerate() {
                for (out, mean) in row.iter_mut().zip(&*work.mean) {
                    *out = mean[l];
                }
            }
            if let Some(covariances) = &mut covariances {
                let rows = &mut covariances[group * LANES * dout * dout..][..count * dout * dout];
                regressor.spread_lanes::<S, P>(simd, &mut work, rows);
            }
        }
        true
    }
}

impl Regressor {
    /// Responsibilities (8). False when a query has no support.
    #[inline(always)]
    fn weigh<S: Simd, const P: usize>(&self, simd: S, work: &mut Work<'_>) -> bool {
        let (di, padded) = (self.inputs.len(), self.padded);
        let (zero, half) = (Wide::<S, P>::splat(simd, 0.0), Wide::splat(simd, -0.5));
        let mut peak = Wide::splat(simd, f64::NEG_INFINITY);
        for (c, (b, z)) in work.b.iter_mut().zip(work.z.chunks_exact_mut(di)).enumerate() {
            let mut norm = zero;
            for i in 0..di {
                let centre = Wide::<S, P>::splat(simd, self.input_means[i * padded + c]);
                let difference = Wide::load(simd, &work.x[i]) - centre;
                difference.store(&mut z[i]);
                let mut y = zero;
                for (j, z) in z[..=i].iter().enumerate() {
                    let w = self.whitening[(i * (i + 1) / 2 + j) * padded + c];
                    y = Wide::splat(simd, w).mul_add(Wide::load(simd, z), y);
                }
                norm = y.mul_add(y, norm);
            }
            let q = half.mul_add(norm, Wide::splat(simd, self.offsets[c]));
            peak = q.larger(peak);
            q.store(b);
        }
        let mut peaks = [0.0; LANES];
        peak.store(&mut peaks);
        if !peaks.iter().all(|p| *p > f64::NEG_INFINITY) {
            return false;
        }
        for b in &mut *work.b {
            (Wide::<S, P>::load(simd, b) - peak).store(b);
        }
        for b in work.b.as_flattened_mut() {
            *b = exp_nonpositive(*b);
        }
        // The sums of a single query, which has eight components to a register.
        let mut sums = [zero; LANES];
        for b in work.b.chunks(LANES) {
            for (sum, b) in sums.iter_mut().zip(b) {
                *sum = *sum + Wide::load(simd, b);
            }
        }
        let sum = ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]));
        let scale = Wide::splat(simd, 1.0) / sum;
        for b in &mut *work.b {
            (Wide::<S, P>::load(simd, b) * scale).store(b);
        }
        true
    }

    /// Component means (7) and their mix (9).
    #[inline(always)]
    fn mix_lanes<S: Simd, const P: usize>(&self, simd: S, work: &mut Work<'_>) {
        let (di, dout, width) = (self.inputs.len(), self.outputs.len(), self.width);
        let Work { z, b, m, mean, .. } = work;
        mean.fill([0.0; LANES]);
        for c in 0..self.components {
            let weight = Wide::<S, P>::load(simd, &b[c]);
            let z = &z[c * di..][..di];
            let (m, mean) = (&mut m[c * dout..][..dout], &mut mean[..dout]);
            let base = &self.output_means[c * width..][..dout];
            let gains = &self.gains[c * di * width..][..di * width];
            for o in 0..dout {
                let mut value = Wide::splat(simd, base[o]);
                for j in 0..di {
                    value = Wide::splat(simd, gains[j * width + o]).mul_add(Wide::load(simd, &z[j]), value);
                }
                value.store(&mut m[o]);
                weight.mul_add(value, Wide::load(simd, &mean[o])).store(&mut mean[o]);
            }
        }
    }

    /// Law of total covariance (10), into one row of `rows` per query.
    #[inline(always)]
    fn spread_lanes<S: Simd, const P: usize>(&self, simd: S, work: &mut Work<'_>, rows: &mut [f64]) {
        let dout = self.outputs.len();
        let Work { b, m, mean, v, .. } = work;
        let size = dout * dout;
        v.fill([0.0; LANES]);
        for c in 0..self.components {
            let weight = Wide::<S, P>::load(simd, &b[c]);
            let (e, within) = (&mut m[c * dout..][..dout], &self.covariances[c * size..][..size]);
            for (e, mean) in e.iter_mut().zip(&**mean) {
                (Wide::<S, P>::load(simd, e) - Wide::load(simd, mean)).store(e);
            }
            let mut v = v.iter_mut();
            for (i, within) in within.chunks_exact(dout).enumerate() {
                let row = Wide::load(simd, &e[i]);
                for ((e, within), v) in e[..=i].iter().zip(within).zip(&mut v) {
                    let total = row.mul_add(Wide::load(simd, e), Wide::splat(simd, *within));
                    weight.mul_add(total, Wide::load(simd, v)).store(v);
                }
            }
        }
        for (l, out) in rows.chunks_exact_mut(size).enumerate() {
            let mut v = v.iter();
            for i in 0..dout {
                for (j, v) in (0..=i).zip(&mut v) {
                    out[i * dout + j] = v[l];
                    out[j * dout + i] = v[l];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{CovarianceKind, Error, Mixture, MixtureParts, Regressor, Samples};

    fn mixture(dim: usize, k: usize) -> Mixture {
        let entry = |c: usize, i: usize| if i.is_multiple_of(dim + 1) { 1.0 + c as f64 * 0.1 } else { 0.02 * c as f64 };
        Mixture::new(MixtureParts {
            kind: CovarianceKind::Full,
            dim,
            weights: vec![1.0 / k as f64; k],
            means: (0..k * dim).map(|i| (i as f64 * 0.7).sin()).collect(),
            covariances: (0..k).flat_map(|c| (0..dim * dim).map(move |i| entry(c, i))).collect(),
        })
        .unwrap()
    }

    #[test]
    fn a_batch_gives_the_bytes_of_single_queries() {
        for (inputs, outputs, k, n) in
            [(vec![0], vec![1, 2, 3, 4, 5, 6], 10, 21), (vec![3, 1], vec![0], 3, 8), (vec![2], vec![6, 4], 17, 1)]
        {
            let regressor = Regressor::new(&mixture(7, k), &inputs, &outputs).unwrap();
            let queries: Vec<f64> = (0..n * inputs.len()).map(|i| (i as f64 * 0.37).cos() * 2.0).collect();
            let queries = Samples::new(&queries, inputs.len()).unwrap();
            let batch = regressor.predict_batch(&queries).unwrap();
            assert_eq!(regressor.predict_mean_batch(&queries).unwrap(), batch.means);
            let mut out = regressor.prediction();
            let (mut means, mut covariances) = (Vec::new(), Vec::new());
            for i in 0..n {
                regressor.predict_into(queries.row(i), &mut out).unwrap();
                means.extend_from_slice(out.mean());
                covariances.extend_from_slice(out.covariance());
            }
            let bits = |v: &[f64]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&batch.means), bits(&means));
            assert_eq!(bits(&batch.covariances), bits(&covariances));
        }
    }

    #[test]
    fn the_first_query_that_fails_gives_the_error_and_none_gives_nothing() {
        let narrow = Mixture::new(MixtureParts {
            kind: CovarianceKind::Diagonal,
            dim: 2,
            weights: vec![1.0],
            means: vec![0.0, 0.0],
            covariances: vec![1e-100, 1.0],
        });
        let regressor = Regressor::new(&narrow.unwrap(), &[0], &[1]).unwrap();
        for values in [[0.0, 1e139, 1.0], [0.0, 1e139, f64::NAN]] {
            let far = Samples::new(&values, 1).unwrap();
            assert_eq!(regressor.predict_batch(&far), Err(Error::NoSupport { components: 1 }));
            assert_eq!(regressor.predict_mean_batch(&far), Err(Error::NoSupport { components: 1 }));
        }
        let hole = Samples::new(&[0.0, f64::NAN, 1e139], 1).unwrap();
        assert!(matches!(regressor.predict_batch(&hole), Err(Error::NotFinite { index: 0, .. })));
        assert!(regressor.predict_batch(&Samples::new(&[], 1).unwrap()).unwrap().means.is_empty());
    }
}
