//! EM statistics of samples with missing values, exactly marginalised.
//!
//! For a row with observed part `o` and missing part `m` (Ghahramani and Jordan 1994), component `n`
//! has density `N(x_o | mu_o, S_oo)`, and the missing part contributes its conditional moments
//! `E[x_m] = mu_m + S_mo S_oo^-1 (x_o - mu_o)` and `Cov[x_m] = S_mm - S_mo S_oo^-1 S_om` to the M step. Rows share
//! the factorisations of their pattern of gaps. A row without any value carries no information
//! about the mixture and takes no part.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::gmm::{LN_2_PI, Mixture};
use crate::kernel::Moments;
use crate::linalg::{cholesky, invert_lower};
use crate::samples::Samples;
use crate::scalar::exp_nonpositive;

/// Rows per unit of parallel work; fixed, so that sums do not depend on the thread count.
const CHUNK_ROWS: usize = 512;

/// Samples sorted by their pattern of missing values.
#[derive(Debug)]
pub(crate) struct Gaps<'a> {
    samples: Samples<'a>,
    extra: Option<&'a [f64]>,
    /// Observed dimensions, then missing ones; and how many are observed.
    patterns: Vec<(Vec<usize>, usize)>,
    /// `(row, pattern)` of each row with at least one value.
    rows: Vec<(usize, usize)>,
}

/// Factors of one component for one pattern.
struct Conditional {
    /// `L_oo^-1`, `(o, o)`.
    whitening: Vec<f64>,
    /// `ln pi + ln det L_oo^-1 - o/2 ln 2 pi`.
    offset: f64,
    /// `S_mo S_oo^-1`, `(m, o)`.
    gain: Vec<f64>,
    /// `Cov[x_m]`, `(m, m)`.
    covariance: Vec<f64>,
}

impl<'a> Gaps<'a> {
    pub(crate) fn new(samples: &Samples<'a>, extra: Option<&'a [f64]>) -> Self {
        let d = samples.dim();
        let mut patterns: Vec<(Vec<usize>, usize)> = Vec::new();
        let mut rows = Vec::new();
        for i in 0..samples.len() {
            let row = samples.row(i);
            let mut order: Vec<usize> = (0..d).filter(|&j| !row[j].is_nan()).collect();
            let observed = order.len();
            if observed == 0 || samples.weight(i) == 0.0 {
                continue;
            }
            order.extend((0..d).filter(|&j| row[j].is_nan()));
            let key = (order, observed);
            let pattern = patterns.iter().position(|p| *p == key).unwrap_or_else(|| {
                patterns.push(key);
                patterns.len() - 1
            });
            rows.push((i, pattern));
        }
        Self { samples: *samples, extra, patterns, rows }
    }

    /// Rows that take part, and the sum of their weights.
    pub(crate) fn usable(&self) -> (usize, f64) {
        (self.rows.len(), self.rows.iter().map(|(i, _)| self.samples.weight(*i)).sum())
    }

    fn conditionals(&self, mixture: &Mixture) -> Result<Vec<Vec<Conditional>>> {
        let (k, d) = (mixture.components(), mixture.dim());
        let covariances: Vec<Vec<f64>> = (0..k).map(|c| mixture.covariance(c)).collect();
        self.patterns
            .iter()
            .map(|(order, o)| {
                (0..k)
                    .map(|c| {
                        let s = &covariances[c];
                        let mut factor: Vec<f64> = (0..d * d).map(|i| s[order[i / d] * d + order[i % d]]).collect();
                        cholesky(&mut factor, d).map_err(|p| Error::NotPositiveDefinite {
                            what: "covariance of component",
                            index: c,
                            pivot: p.row,
                            value: p.value,
                        })?;
                        let (o, m) = (*o, d - o);
                        let corner: Vec<f64> = (0..o * o).map(|i| factor[i / o * d + i % o]).collect();
                        let mut whitening = vec![0.0; o * o];
                        invert_lower(&corner, o, &mut whitening);
                        let log_det: f64 = (0..o).map(|i| whitening[i * o + i].ln()).sum();
                        let row = |i: usize| &factor[(o + i) * d..(o + i + 1) * d];
                        let gain = (0..m * o)
                            .map(|i| (i % o..o).map(|l| row(i / o)[l] * whitening[l * o + i % o]).sum())
                            .collect();
                        let covariance = (0..m * m)
                            .map(|i| {
                                let (a, b) = (i / m, i % m);
                                (0..=a.min(b)).map(|l| row(a)[o + l] * row(b)[o + l]).sum()
                            })
                            .collect();
                        let weight = mixture.weights()[c];
                        let log_weight = if weight > 0.0 { weight.ln() } else { f64::NEG_INFINITY };
                        Ok(Conditional {
                            whitening,
                            offset: log_weight + log_det - 0.5 * o as f64 * LN_2_PI,
                            gain,
                            covariance,
                        })
                    })
                    .collect()
            })
            .collect()
    }

    /// Moments about `centres: (k, d)` under the posterior of `mixture`.
    pub(crate) fn moments(&self, mixture: &Mixture, centres: &[f64]) -> Result<Moments> {
        let conditionals = self.conditionals(mixture)?;
        let parts: Vec<Moments> =
            self.rows.par_chunks(CHUNK_ROWS).map(|rows| self.chunk(rows, mixture, &conditionals, centres)).collect();
        let mut total = Moments::zero(mixture.components(), mixture.dim());
        for part in &parts {
            total.add(part);
        }
        Ok(total)
    }

    fn chunk(
        &self,
        rows: &[(usize, usize)],
        mixture: &Mixture,
        conditionals: &[Vec<Conditional>],
        centres: &[f64],
    ) -> Moments {
        let (k, d) = (mixture.components(), mixture.dim());
        let mut out = Moments::zero(k, d);
        let mut log = vec![0.0; k];
        // Completed rows less the mean of each component, in pattern order.
        let mut z = vec![0.0; k * d];
        let mut about = vec![0.0; d];
        for &(i, pattern) in rows {
            let (order, o) = &self.patterns[pattern];
            let (o, m) = (*o, d - o);
            let x = self.samples.row(i);
            let mut peak = f64::NEG_INFINITY;
            for (c, part) in conditionals[pattern].iter().enumerate() {
                let mean = mixture.mean(c);
                let z = &mut z[c * d..(c + 1) * d];
                for (z, &j) in z.iter_mut().zip(&order[..o]) {
                    *z = x[j] - mean[j];
                }
                let mut norm = 0.0;
                for (a, row) in part.whitening.chunks_exact(o).enumerate() {
                    let y: f64 = row[..=a].iter().zip(z.iter()).map(|(w, z)| w * z).sum();
                    norm += y * y;
                }
                let (seen, hidden) = z.split_at_mut(o);
                for (h, row) in hidden.iter_mut().zip(part.gain.chunks_exact(o)) {
                    *h = row.iter().zip(seen.iter()).map(|(g, z)| g * z).sum();
                }
                log[c] = part.offset - 0.5 * norm;
                peak = peak.max(log[c]);
            }
            let weight = self.samples.weight(i);
            if peak == f64::NEG_INFINITY {
                out.log_likelihood = f64::NEG_INFINITY;
                continue;
            }
            let sum: f64 = log.iter().map(|l| exp_nonpositive(l - peak)).sum();
            out.log_likelihood += weight * (peak + sum.ln());
            for (c, part) in conditionals[pattern].iter().enumerate() {
                let r = weight * exp_nonpositive(log[c] - peak) / sum;
                let mean = mixture.mean(c);
                for (z, &j) in z[c * d..(c + 1) * d].iter().zip(order) {
                    about[j] = z + (mean[j] - centres[c * d + j]);
                }
                out.mass[c] += r;
                out.extra[c] += r * self.extra.map_or(0.0, |e| e[i]);
                let second = &mut out.second[c * d * d..(c + 1) * d * d];
                for a in 0..d {
                    out.first[c * d + a] += r * about[a];
                    for b in 0..=a {
                        second[a * d + b] += r * about[a] * about[b];
                    }
                }
                for a in 0..m {
                    for b in 0..m {
                        let (i, j) = (order[o + a], order[o + b]);
                        if j <= i {
                            second[i * d + j] += r * part.covariance[a * m + b];
                        }
                    }
                }
            }
        }
        out
    }
}
