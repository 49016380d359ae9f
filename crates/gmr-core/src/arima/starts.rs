//! Where the search for the maximum begins.

use pulp::{Arch, Simd, WithSimd};

use super::polynomial::unconstrained_near;
use crate::linalg::{cholesky, solve_lower, solve_lower_transpose};
use crate::wide::{LANES, Wide, in_registers};

/// Grid points from which a search is begun. The likelihood of mixed models has several maxima; two more
/// starts find the highest one wherever the tests know it.
pub(super) const GRID_STARTS: usize = 2;
/// Grid points at most; with more than four numbers only their joint signs vary.
const GRID_POINTS: usize = 81;

/// Points with each unconstrained number at -0.8, 0 or 0.8 (partial autocorrelations of 0.66), one after the other; for
/// more numbers than that allows, a fixed pseudo-random choice among them.
pub(super) fn coarse_grid(numbers: usize) -> Vec<f64> {
    if numbers == 0 {
        return Vec::new();
    }
    let all = 3usize.checked_pow(numbers as u32).filter(|n| *n <= GRID_POINTS);
    let mut state = 1u64;
    let mut points = Vec::with_capacity(all.unwrap_or(GRID_POINTS) * numbers);
    for index in 0..all.unwrap_or(GRID_POINTS) {
        let mut rest = index;
        for _ in 0..numbers {
            let digit = if all.is_some() {
                let digit = rest % 3;
                rest /= 3;
                digit
            } else {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) as usize % 3
            };
            points.push(0.8 * (digit as f64 - 1.0));
        }
    }
    points
}

/// Indices of the `count` smallest values, smallest first; of equals the earlier.
pub(super) fn lowest(values: &[f64], count: usize) -> impl Iterator<Item = usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    order.into_iter().take(count)
}

/// Two-stage regression of Hannan and Rissanen (1982): residuals of a long autoregression stand in
/// for the innovations. `None` when the series is too short.
pub(super) fn hannan_rissanen(w: &[f64], p: usize, q: usize) -> Option<Vec<f64>> {
    let n = w.len();
    let long = if q == 0 { 0 } else { (p + q + 4).max((10.0 * (n as f64).log10()) as usize).min(n / 4) };
    let first = long + p.max(q);
    if n < first + 3 * (p + q) + 2 {
        return None;
    }
    let innovations = if q > 0 { residuals(w, long)? } else { Vec::new() };
    let lag = |j: usize| {
        if j < p { &w[first - 1 - j..n - 1 - j] } else { &innovations[first - 1 - (j - p)..n - 1 - (j - p)] }
    };
    let m = p + q;
    let mut gram = vec![0.0; m * m];
    let mut cross = vec![0.0; m];
    for i in 0..m {
        cross[i] = dot(lag(i), &w[first..]);
        for j in 0..=i {
            gram[i * m + j] = dot(lag(i), lag(j));
        }
    }
    solve(&mut gram, &mut cross)?;
    let mut x = unconstrained_near(&cross[..p], false);
    x.extend(unconstrained_near(&cross[p..], true));
    Some(x)
}

/// Residuals of an autoregression of order `order` by least squares, zero for the first `order` values.
fn residuals(w: &[f64], order: usize) -> Option<Vec<f64>> {
    let (n, m) = (w.len(), order);
    let lag = |j: usize| &w[m - 1 - j..n - 1 - j];
    let mut gram = vec![0.0; m * m];
    let mut cross: Vec<f64> = (0..m).map(|j| dot(lag(j), &w[m..])).collect();
    for i in 0..m {
        gram[i * m] = dot(lag(i), lag(0));
    }
    // A pair of lags one further back shares all but the first and the last product.
    for i in 1..m {
        for j in 1..=i {
            let (enters, leaves) = (w[m - 1 - i] * w[m - 1 - j], w[n - 1 - i] * w[n - 1 - j]);
            gram[i * m + j] = gram[(i - 1) * m + j - 1] + enters - leaves;
        }
    }
    solve(&mut gram, &mut cross)?;
    let mut innovations = w.to_vec();
    innovations[..m].fill(0.0);
    Arch::new().dispatch(Less { w, coefficients: &cross, out: &mut innovations });
    Some(innovations)
}

/// Solves normal equations in place.
fn solve(gram: &mut [f64], cross: &mut [f64]) -> Option<()> {
    let m = cross.len();
    // A start needs no digits; the ridge keeps collinear lags from failing.
    let ridge = 1e-9 * (0..m).map(|i| gram[i * m + i]).fold(0.0, f64::max);
    (0..m).for_each(|i| gram[i * m + i] += ridge);
    cholesky(gram, m).ok()?;
    solve_lower(gram, m, cross);
    solve_lower_transpose(gram, m, cross);
    Some(())
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    Arch::new().dispatch(Dot { a, b })
}

struct Dot<'a> {
    a: &'a [f64],
    b: &'a [f64],
}

impl WithSimd for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        in_registers!(self.in_registers<S>(simd))
    }
}

impl Dot<'_> {
    /// Four sums of eight lanes, so that they do not wait for each other.
    #[inline(always)]
    fn in_registers<S: Simd, const P: usize>(self, simd: S) -> f64 {
        const SUMS: usize = 4;
        let (a, a_rest) = self.a.as_chunks::<LANES>();
        let (b, b_rest) = self.b.as_chunks::<LANES>();
        let mut sums = [Wide::<S, P>::splat(simd, 0.0); SUMS];
        for (a, b) in a.chunks(SUMS).zip(b.chunks(SUMS)) {
            for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                *sum = Wide::load(simd, a).mul_add(Wide::load(simd, b), *sum);
            }
        }
        let mut lanes = [0.0; LANES];
        ((sums[0] + sums[2]) + (sums[1] + sums[3])).store(&mut lanes);
        let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
        lanes.iter().sum::<f64>() + rest
    }
}

/// Takes `sum_j c_j w_t-1-j` from each `out_t` beyond the first ones.
struct Less<'a> {
    w: &'a [f64],
    coefficients: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Less<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { w, coefficients, out } = self;
        let m = coefficients.len();
        for (j, c) in coefficients.iter().enumerate() {
            for (out, v) in out[m..].iter_mut().zip(&w[m - 1 - j..]) {
                *out = (-c).mul_add(*v, *out);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_long_autoregression_solves_its_normal_equations() {
        let w: Vec<f64> = (0..90).map(|i| (f64::from(i) * 0.7).sin() + (f64::from(i * i) * 0.13).cos()).collect();
        let e = residuals(&w, 7).unwrap();
        // Least squares leaves residuals that are orthogonal to each lag.
        for j in 0..7 {
            let product: f64 = (7..90).map(|t| e[t] * w[t - 1 - j]).sum();
            assert!(product.abs() < 1e-6, "lag {j}: {product}");
        }
    }

    #[test]
    fn a_first_order_autoregression_starts_at_its_coefficient() {
        let mut w = vec![1.0];
        for t in 1..400 {
            w.push(0.6 * w[t - 1] + (f64::from(t as u32 * t as u32 % 1009) / 1009.0 - 0.5));
        }
        let x = hannan_rissanen(&w, 1, 0).unwrap();
        assert!((x[0].tanh() - 0.6).abs() < 0.1, "{x:?}");
    }
}
