//! The exact Gaussian likelihood of an ARMA process by a Kalman filter.
//!
//! State space of Harvey (1989), `r = max(p, q + 1)`: `a' = T a + R e`, `w = a_1`, where `T` has `phi` in
//! its first column and ones above the diagonal, `R = (1, theta)`. With every value observed the
//! covariance recursion collapses to
//! `P'_ij = P_i+1,j+1 - P_i+1,1 P_j+1,1 / P_11 + R_i R_j`, and once `P = R R'` (exactly after `p` steps
//! without a moving average, geometrically with one) to the plain recursion
//! `a'_i = a_i+1 + phi_i w + theta_i v`, `v = w - a_1`, in O(p + q) per value.
//!
//! Everything is per unit innovation variance; the variance is concentrated out by the caller.

use pulp::{Arch, Simd, WithSimd};

/// The covariance counts as settled when no entry differs from `R R'` by more than this; the rest
/// of the transient then changes the log-likelihood by less than rounding does.
pub(super) const SETTLED: f64 = 1e-15;

/// `phi` and `theta` padded to the state dimension.
#[derive(Debug, Clone)]
pub(super) struct Arma {
    pub(super) r: usize,
    /// `phi_1 .. phi_r`.
    pub(super) phi: Vec<f64>,
    /// `theta_0 = 1, theta_1 .. theta_r-1`, then zero: `(r + 1)`.
    pub(super) theta: Vec<f64>,
}

impl Arma {
    pub(super) fn new(ar: &[f64], ma: &[f64]) -> Self {
        let r = ar.len().max(ma.len() + 1);
        let mut arma = Self { r, phi: vec![0.0; r], theta: vec![0.0; r + 1] };
        arma.set(ar, ma);
        arma
    }

    /// New coefficients of the same orders.
    pub(super) fn set(&mut self, ar: &[f64], ma: &[f64]) {
        self.phi[..ar.len()].copy_from_slice(ar);
        self.theta[0] = 1.0;
        self.theta[1..=ma.len()].copy_from_slice(ma);
    }

    /// Stationary covariance of the state, `(r, r)`, the solution of `P = T P T' + R R'`, by
    /// doubling: after `j` steps the sum holds `2^j` terms.
    pub(super) fn stationary_covariance(&self, work: &mut Work) {
        let r = self.r;
        let Work { p, a, b, c } = work;
        a.fill(0.0);
        for i in 0..r {
            a[i * r] = self.phi[i];
            if i + 1 < r {
                a[i * r + i + 1] = 1.0;
            }
            for j in 0..r {
                p[i * r + j] = self.theta[i] * self.theta[j];
            }
        }
        // Partial autocorrelations stop at 1 - 1e-6, so sixty doublings reach any memory there is.
        for _ in 0..60 {
            multiply(a, p, b, r, false);
            multiply(b, a, c, r, true);
            let mut small = true;
            for (p, c) in p.iter_mut().zip(c.iter()) {
                small &= c.abs() <= 1e-17 * p.abs();
                *p += c;
            }
            if small {
                break;
            }
            multiply(a, a, b, r, false);
            a.copy_from_slice(b);
        }
        for i in 0..r {
            for j in 0..i {
                let mean = 0.5 * (p[i * r + j] + p[j * r + i]);
                p[i * r + j] = mean;
                p[j * r + i] = mean;
            }
        }
    }
}

/// `out = a b` or `a b'`, square.
fn multiply(a: &[f64], b: &[f64], out: &mut [f64], r: usize, transpose: bool) {
    for i in 0..r {
        for j in 0..r {
            let mut sum = 0.0;
            for k in 0..r {
                sum += a[i * r + k] * if transpose { b[j * r + k] } else { b[k * r + j] };
            }
            out[i * r + j] = sum;
        }
    }
}

/// Square matrices of the filter, allocated once per fit.
#[derive(Debug, Clone)]
pub(super) struct Work {
    pub(super) p: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
    c: Vec<f64>,
}

impl Work {
    pub(super) fn new(r: usize) -> Self {
        Self { p: vec![0.0; r * r], a: vec![0.0; r * r], b: vec![0.0; r * r], c: vec![0.0; r * r] }
    }
}

/// Sums over a filtered series `w` and, beside it, over the constant series 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Sums {
    /// Values.
    pub(super) n: usize,
    /// `sum ln F`.
    pub(super) log_f: f64,
    /// `sum v v / F` of the series.
    pub(super) ww: f64,
    /// `sum v_w v_1 / F`.
    pub(super) w1: f64,
    /// `sum v_1 v_1 / F` of the constant.
    pub(super) one: f64,
}

impl Sums {
    /// Mean estimated by generalised least squares; zero when it is not estimated.
    pub(super) fn mean(&self, constant: bool) -> f64 {
        if constant && self.one > 0.0 { self.w1 / self.one } else { 0.0 }
    }

    /// `sum v v / F` about the estimated mean.
    pub(super) fn squares(&self, constant: bool) -> f64 {
        (self.ww - self.mean(constant) * self.w1).max(0.0)
    }
}

/// Filters a complete series.
///
/// `conditional` starts from a state known to be zero (conditional sum of squares) instead
/// of the stationary distribution.
pub(super) fn filter(arma: &Arma, w: &[f64], constant: bool, conditional: bool, work: &mut Work) -> Sums {
    let r = arma.r;
    let mut sums = Sums { n: w.len(), ..Sums::default() };
    let mut state = [0.0f64; 2 * MAX_STATE];
    let (a, a1) = state.split_at_mut(MAX_STATE);
    let mut t = 0;
    if !conditional {
        arma.stationary_covariance(work);
        let Work { p, a: next, .. } = work;
        while t < w.len() {
            let f = p[0];
            let mut settled = true;
            // The next covariance, and how far the present one is from R R'.
            for i in 0..r {
                for j in 0..=i {
                    let target = arma.theta[i] * arma.theta[j];
                    settled &= (p[i * r + j] - target).abs() <= SETTLED;
                    let shifted = if i + 1 < r && j + 1 < r {
                        p[(i + 1) * r + j + 1] - p[(i + 1) * r] * p[(j + 1) * r] / f
                    } else {
                        0.0
                    };
                    next[i * r + j] = shifted + target;
                    next[j * r + i] = shifted + target;
                }
            }
            if settled {
                break;
            }
            let v = w[t] - a[0];
            let v1 = 1.0 - a1[0];
            sums.log_f += f.ln();
            sums.ww += v * v / f;
            if constant {
                sums.w1 += v * v1 / f;
                sums.one += v1 * v1 / f;
            }
            // a' = T a + K v, K_i = phi_i + P_i+1,1 / F.
            for i in 0..r {
                let (ahead, ahead1, gain) =
                    if i + 1 < r { (a[i + 1], a1[i + 1], p[(i + 1) * r] / f) } else { (0.0, 0.0, 0.0) };
                a[i] = ahead + arma.phi[i] * w[t] + gain * v;
                if constant {
                    a1[i] = ahead1 + arma.phi[i] + gain * v1;
                }
            }
            std::mem::swap(p, next);
            t += 1;
        }
    }
    Arch::new().dispatch(Steady { arma, w: &w[t..], constant, a, a1, sums: &mut sums });
    sums
}

/// Largest state dimension; orders up to 23 fit.
pub(super) const MAX_STATE: usize = 24;

/// The plain recursion over the rest of a series, compiled for each instruction set: with a fused
/// multiply-add, four cycles of latency per value.
struct Steady<'a> {
    arma: &'a Arma,
    w: &'a [f64],
    constant: bool,
    a: &'a mut [f64],
    a1: &'a mut [f64],
    sums: &'a mut Sums,
}

impl WithSimd for Steady<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        match self.arma.r {
            1 => self.run::<1>(),
            2 => self.run::<2>(),
            3 => self.run::<3>(),
            4 => self.run::<4>(),
            5 | 6 => self.run::<6>(),
            _ => self.run::<MAX_STATE>(),
        }
    }
}

impl Steady<'_> {
    #[inline(always)]
    fn run<const R: usize>(self) {
        // a'_i = a_i+1 + phi_i w + theta_i (w - a_1), written as (a_i+1 + (phi_i + theta_i) w) - theta_i a_1,
        // so that only one multiply-add lies between one a_1 and the next.
        let mut both = [0.0; R];
        let mut theta = [0.0; R];
        for i in 0..self.arma.r {
            theta[i] = self.arma.theta[i + 1];
            both[i] = self.arma.phi[i] + theta[i];
        }
        let mut s = [0.0; R];
        let mut s1 = [0.0; R];
        s.copy_from_slice(&self.a[..R]);
        s1.copy_from_slice(&self.a1[..R]);
        let (mut ww, mut w1, mut one) = (0.0, 0.0, 0.0);
        for &value in self.w {
            let v = value - s[0];
            ww = v.mul_add(v, ww);
            let first = s[0];
            for i in 0..R {
                let ahead = if i + 1 < R { s[i + 1] } else { 0.0 };
                s[i] = (-theta[i]).mul_add(first, both[i].mul_add(value, ahead));
            }
            if self.constant {
                let v1 = 1.0 - s1[0];
                w1 = v.mul_add(v1, w1);
                one = v1.mul_add(v1, one);
                let first = s1[0];
                for i in 0..R {
                    let ahead = if i + 1 < R { s1[i + 1] } else { 0.0 };
                    s1[i] = (-theta[i]).mul_add(first, both[i] + ahead);
                }
            }
        }
        self.sums.ww += ww;
        self.sums.w1 += w1;
        self.sums.one += one;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Log-likelihood by the covariance matrix of the whole series: autocovariances from a long
    /// impulse response, then a dense Cholesky factor.
    fn brute_force(ar: &[f64], ma: &[f64], w: &[f64]) -> (f64, f64) {
        let n = w.len();
        let mut psi = vec![0.0; 4000];
        for t in 0..psi.len() {
            let noise = if t == 0 { 1.0 } else { ma.get(t - 1).copied().unwrap_or(0.0) };
            psi[t] = noise + (0..ar.len().min(t)).map(|i| ar[i] * psi[t - 1 - i]).sum::<f64>();
        }
        let gamma: Vec<f64> = (0..n).map(|k| psi.iter().zip(&psi[k..]).map(|(a, b)| a * b).sum()).collect();
        let mut matrix: Vec<f64> = (0..n * n).map(|i| gamma[(i / n).abs_diff(i % n)]).collect();
        assert!(crate::linalg::cholesky(&mut matrix, n).is_ok());
        let mut z = w.to_vec();
        crate::linalg::solve_lower(&matrix, n, &mut z);
        let log_det = 2.0 * (0..n).map(|i| matrix[i * n + i].ln()).sum::<f64>();
        (log_det, z.iter().map(|v| v * v).sum())
    }

    #[test]
    fn filter_equals_the_dense_gaussian_likelihood() {
        let w: Vec<f64> = (0..40).map(|i| (f64::from(i) * 0.9).sin() + 0.3 * (f64::from(i) * 2.3).cos()).collect();
        for (ar, ma) in [
            (vec![], vec![]),
            (vec![0.7], vec![]),
            (vec![], vec![-0.6]),
            (vec![0.5, -0.3], vec![0.4]),
            (vec![0.9, 0.05], vec![0.3, -0.2, 0.5]),
            (vec![1.2, -0.5, 0.1, 0.05, -0.1], vec![0.6, 0.2]),
        ] {
            let arma = Arma::new(&ar, &ma);
            let sums = filter(&arma, &w, false, false, &mut Work::new(arma.r));
            let (log_det, squares) = brute_force(&ar, &ma, &w);
            assert!((sums.log_f - log_det).abs() < 1e-10, "{ar:?} {ma:?}");
            assert!((sums.ww - squares).abs() < 1e-10 * squares, "{ar:?} {ma:?}");
        }
    }

    #[test]
    fn constant_column_equals_generalised_least_squares() {
        let w: Vec<f64> = (0..30).map(|i| 2.0 + (f64::from(i) * 0.9).sin()).collect();
        let arma = Arma::new(&[0.6], &[0.3]);
        let sums = filter(&arma, &w, true, false, &mut Work::new(arma.r));
        let mean = sums.mean(true);
        // At the least squares mean the sum of squares is at its minimum: compare by brute force.
        let at = |m: f64| {
            let moved: Vec<f64> = w.iter().map(|v| v - m).collect();
            brute_force(&[0.6], &[0.3], &moved).1
        };
        assert!((at(mean) - sums.squares(true)).abs() < 1e-10);
        assert!(at(mean) < at(mean + 1e-3) && at(mean) < at(mean - 1e-3));
    }
}
