//! The filter's recursions on coefficients in registers.

use pulp::Simd;

use super::{LogProduct, State, Work};
use crate::arima::filter::SETTLED;
use crate::wide::{Aligned, LANES, Wide};

/// The coefficients in registers.
pub(super) struct Model<S: Simd, const P: usize, const R: usize> {
    pub(super) r: usize,
    pub(super) phi: [Wide<S, P>; R],
    pub(super) theta: [Wide<S, P>; R],
}

impl<S: Simd, const P: usize, const R: usize> Model<S, P, R> {
    /// `R R'` of the state space: `theta_i theta_j` with `theta_0 = 1`.
    #[inline(always)]
    fn noise(&self, simd: S, i: usize, j: usize) -> Wide<S, P> {
        let theta = |i: usize| if i == 0 { Wide::splat(simd, 1.0) } else { self.theta[i - 1] };
        theta(i) * theta(j)
    }

    /// Leaves the stationary covariance in `work.p`; the method of [`crate::arima::filter::Arma::stationary_covariance`].
    #[inline(always)]
    pub(super) fn stationary_covariance(&self, simd: S, work: &mut Work) {
        let r = self.r;
        let [p, mut a, mut b, c] = [&mut work.p, &mut work.a, &mut work.b, &mut work.c].map(Aligned::lanes_mut);
        a.fill([0.0; LANES]);
        for i in 0..r {
            self.phi[i].store(&mut a[i * r]);
            if i + 1 < r {
                a[i * r + i + 1] = [1.0; LANES];
            }
            for j in 0..r {
                self.noise(simd, i, j).store(&mut p[i * r + j]);
            }
        }
        for _ in 0..60 {
            multiply::<S, P>(simd, a, p, b, r, false);
            multiply::<S, P>(simd, b, a, c, r, true);
            let mut small = true;
            for (p, c) in p.iter_mut().zip(c.iter()) {
                let (sum, more) = (Wide::<S, P>::load(simd, p), Wide::<S, P>::load(simd, c));
                small &= within_share(p, c);
                (sum + more).store(p);
            }
            if small {
                break;
            }
            multiply::<S, P>(simd, a, a, b, r, false);
            std::mem::swap(&mut a, &mut b);
        }
    }

    /// Runs until every covariance equals `R R'` to rounding; the number of values taken.
    #[inline(always)]
    pub(super) fn settle(
        &self,
        simd: S,
        w: &[f64],
        constant: bool,
        work: &mut Work,
        state: &mut State<S, P, R>,
        log_f: &mut LogProduct<S, P>,
    ) -> usize {
        let r = self.r;
        let (zero, unit) = (Wide::<S, P>::splat(simd, 0.0), Wide::<S, P>::splat(simd, 1.0));
        let [mut p, mut next] = [&mut work.p, &mut work.a].map(Aligned::lanes_mut);
        for (t, value) in w.iter().enumerate() {
            let at = |i: usize, j: usize| Wide::<S, P>::load(simd, &p[i * r + j]);
            let f = at(0, 0);
            let inverse = unit / f;
            let mut settled = true;
            for i in 0..r {
                let gain = if i + 1 < r { at(i + 1, 0) * inverse } else { zero };
                for j in 0..=i {
                    let noise = self.noise(simd, i, j);
                    settled &= (at(i, j) - noise).all_within(SETTLED);
                    let shifted = if i + 1 < r { at(i + 1, j + 1) - gain * at(j + 1, 0) } else { zero };
                    (shifted + noise).store(&mut next[i * r + j]);
                }
            }
            if settled {
                return t;
            }
            let value = Wide::splat(simd, *value);
            let v = value - state.series[0];
            let scaled = v * inverse;
            log_f.multiply(simd, f);
            state.squares = v.mul_add(scaled, state.squares);
            let v1 = unit - state.one[0];
            if constant {
                state.cross = v1.mul_add(scaled, state.cross);
                state.ones = v1.mul_add(v1 * inverse, state.ones);
            }
            for i in 0..r {
                let last = i + 1 == r;
                let gain = if last { zero } else { at(i + 1, 0) * inverse };
                let ahead = if last { zero } else { state.series[i + 1] };
                state.series[i] = gain.mul_add(v, self.phi[i].mul_add(value, ahead));
                if constant {
                    let ahead = if last { zero } else { state.one[i + 1] };
                    state.one[i] = gain.mul_add(v1, self.phi[i] + ahead);
                }
            }
            std::mem::swap(&mut p, &mut next);
        }
        w.len()
    }

    /// The plain recursion over the rest of the series: one multiply-add lies between one `a_1` and the next.
    #[inline(always)]
    pub(super) fn steady(&self, simd: S, w: &[f64], constant: bool, state: &mut State<S, P, R>) {
        let (zero, unit) = (Wide::<S, P>::splat(simd, 0.0), Wide::<S, P>::splat(simd, 1.0));
        let (mut both, mut minus) = ([zero; R], [zero; R]);
        for i in 0..self.r {
            both[i] = self.phi[i] + self.theta[i];
            minus[i] = zero - self.theta[i];
        }
        let (mut s, mut squares) = (state.series, state.squares);
        if !constant {
            for value in w {
                let value = Wide::splat(simd, *value);
                let (v, first) = (value - s[0], s[0]);
                squares = v.mul_add(v, squares);
                for i in 0..R {
                    let ahead = if i + 1 < R { s[i + 1] } else { zero };
                    s[i] = minus[i].mul_add(first, both[i].mul_add(value, ahead));
                }
            }
            state.squares = squares;
            return;
        }
        let (mut s1, mut cross, mut ones) = (state.one, state.cross, state.ones);
        for value in w {
            let value = Wide::splat(simd, *value);
            let (v, first) = (value - s[0], s[0]);
            let (v1, first1) = (unit - s1[0], s1[0]);
            squares = v.mul_add(v, squares);
            cross = v.mul_add(v1, cross);
            ones = v1.mul_add(v1, ones);
            for i in 0..R {
                let (ahead, ahead1) = if i + 1 < R { (s[i + 1], s1[i + 1]) } else { (zero, zero) };
                s[i] = minus[i].mul_add(first, both[i].mul_add(value, ahead));
                s1[i] = minus[i].mul_add(first1, both[i] + ahead1);
            }
        }
        (state.squares, state.cross, state.ones) = (squares, cross, ones);
    }
}

/// Whether each `c` is at most 1e-17 of its `p`.
#[inline(always)]
fn within_share(p: &[f64; LANES], c: &[f64; LANES]) -> bool {
    p.iter().zip(c).fold(true, |all, (p, c)| all & (c.abs() <= 1e-17 * p.abs()))
}

/// `out = a b` or `a b'`, square.
#[inline(always)]
fn multiply<S: Simd, const P: usize>(
    simd: S,
    a: &[[f64; LANES]],
    b: &[[f64; LANES]],
    out: &mut [[f64; LANES]],
    r: usize,
    transpose: bool,
) {
    for i in 0..r {
        for j in 0..r {
            let mut sum = Wide::<S, P>::splat(simd, 0.0);
            for k in 0..r {
                let b = if transpose { &b[j * r + k] } else { &b[k * r + j] };
                sum = Wide::load(simd, &a[i * r + k]).mul_add(Wide::load(simd, b), sum);
            }
            sum.store(&mut out[i * r + j]);
        }
    }
}
