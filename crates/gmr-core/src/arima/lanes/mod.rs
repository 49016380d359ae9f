//! The likelihood of eight models over one series at once, each in a lane of its own.
//!
//! The filter of [`super::filter`] waits for one multiply-add per value, whose result the next value needs. Eight
//! models side by side wait no longer than one, so a gradient by differences costs about as much as a likelihood.

mod model;

use pulp::{Arch, Simd, WithSimd};

use model::Model;

use super::filter::{MAX_STATE, Sums};
use crate::wide::{Aligned, LANES, Wide, in_registers};

/// Coefficients of [`LANES`] models of the same orders, padded to the state dimension.
#[derive(Debug, Clone)]
pub(super) struct Models {
    r: usize,
    /// `phi_1 .. phi_r`.
    phi: Vec<[f64; LANES]>,
    /// `theta_1 .. theta_r`, without `theta_0 = 1`.
    theta: Vec<[f64; LANES]>,
}

impl Models {
    pub(super) fn new(p: usize, q: usize) -> Self {
        let r = p.max(q + 1);
        Self { r, phi: vec![[0.0; LANES]; r], theta: vec![[0.0; LANES]; r] }
    }

    pub(super) fn set(&mut self, lane: usize, ar: &[f64], ma: &[f64]) {
        for (phi, a) in self.phi.iter_mut().zip(ar) {
            phi[lane] = *a;
        }
        for (theta, m) in self.theta.iter_mut().zip(ma) {
            theta[lane] = *m;
        }
    }
}

/// Square matrices of the filter, allocated once per fit.
#[derive(Debug)]
pub(super) struct Work {
    p: Aligned,
    a: Aligned,
    b: Aligned,
    c: Aligned,
}

impl Work {
    pub(super) fn new(models: &Models) -> Self {
        let [p, a, b, c] = [(); 4].map(|()| Aligned::zeros(models.r * models.r * LANES));
        Self { p, a, b, c }
    }
}

/// Filters a complete series by each model; the arguments as in [`super::filter::filter`].
pub(super) fn filter(models: &Models, w: &[f64], constant: bool, conditional: bool, work: &mut Work) -> [Sums; LANES] {
    Arch::new().dispatch(Pass { models, w, constant, conditional, work })
}

struct Pass<'a> {
    models: &'a Models,
    w: &'a [f64],
    constant: bool,
    conditional: bool,
    work: &'a mut Work,
}

impl WithSimd for Pass<'_> {
    type Output = [Sums; LANES];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [Sums; LANES] {
        in_registers!(self.in_registers<S>(simd))
    }
}

/// Where a run over the series stands.
struct State<S: Simd, const P: usize, const R: usize> {
    /// Prediction of the series, `a_1 .. a_r`.
    series: [Wide<S, P>; R],
    /// The same of the constant series 1.
    one: [Wide<S, P>; R],
    squares: Wide<S, P>,
    cross: Wide<S, P>,
    ones: Wide<S, P>,
}

/// A product of numbers whose logarithm is wanted, kept from overflowing.
struct LogProduct<S: Simd, const P: usize> {
    product: Wide<S, P>,
    logarithm: [f64; LANES],
}

impl<S: Simd, const P: usize> LogProduct<S, P> {
    #[inline(always)]
    fn multiply(&mut self, simd: S, factor: Wide<S, P>) {
        self.product = self.product * factor;
        // A variance is at most 1e131 (twenty-three partial autocorrelations at their limit).
        if !self.product.all_within(1e150) {
            self.settle(simd);
        }
    }

    #[inline(always)]
    fn settle(&mut self, simd: S) {
        let mut product = [0.0; LANES];
        self.product.store(&mut product);
        for (l, p) in self.logarithm.iter_mut().zip(product) {
            *l += p.ln();
        }
        self.product = Wide::splat(simd, 1.0);
    }
}

impl Pass<'_> {
    #[inline(always)]
    fn in_registers<S: Simd, const P: usize>(self, simd: S) -> [Sums; LANES] {
        match self.models.r {
            1 => self.run::<S, P, 1>(simd),
            2 => self.run::<S, P, 2>(simd),
            3 => self.run::<S, P, 3>(simd),
            4 => self.run::<S, P, 4>(simd),
            5 | 6 => self.run::<S, P, 6>(simd),
            _ => self.run::<S, P, MAX_STATE>(simd),
        }
    }

    #[inline(always)]
    fn run<S: Simd, const P: usize, const R: usize>(self, simd: S) -> [Sums; LANES] {
        let Self { models, w, constant, conditional, work } = self;
        let zero = Wide::<S, P>::splat(simd, 0.0);
        let mut model = Model { r: if R <= 4 { R } else { models.r }, phi: [zero; R], theta: [zero; R] };
        for i in 0..model.r {
            model.phi[i] = Wide::load(simd, &models.phi[i]);
            model.theta[i] = Wide::load(simd, &models.theta[i]);
        }
        let mut state = State { series: [zero; R], one: [zero; R], squares: zero, cross: zero, ones: zero };
        let mut log_f = LogProduct { product: Wide::splat(simd, 1.0), logarithm: [0.0; LANES] };
        let mut t = 0;
        if !conditional {
            model.stationary_covariance(simd, work);
            t = model.settle(simd, w, constant, work, &mut state, &mut log_f);
            log_f.settle(simd);
        }
        model.steady(simd, &w[t..], constant, &mut state);
        let [mut ww, mut w1, mut one] = [[0.0; LANES]; 3];
        state.squares.store(&mut ww);
        state.cross.store(&mut w1);
        state.ones.store(&mut one);
        std::array::from_fn(|l| Sums { n: w.len(), log_f: log_f.logarithm[l], ww: ww[l], w1: w1[l], one: one[l] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arima::filter::{self, Arma};
    use crate::arima::polynomial::{invertible, stationary};

    /// Eight models of the given orders, one of them near a unit root.
    fn eight(p: usize, q: usize) -> Vec<(Vec<f64>, Vec<f64>)> {
        let numbers = |lane: usize, order: usize, turn: f64| {
            let near = |i: usize| match (lane, i) {
                (3, 0) => 4.0,
                (3, _) => 0.0,
                _ => 0.6 * ((lane * 7 + i * 3) as f64 + turn).sin(),
            };
            (0..order).map(near).collect::<Vec<f64>>()
        };
        let model = |lane: usize| {
            let (mut ar, mut ma) = (vec![0.0; p], vec![0.0; q]);
            stationary(&numbers(lane, p, 0.3), &mut ar);
            invertible(&numbers(lane, q, 1.7), &mut ma);
            (ar, ma)
        };
        (0..LANES).map(model).collect()
    }

    #[test]
    fn each_lane_gives_what_the_filter_of_one_model_gives() {
        let w: Vec<f64> = (0..150).map(|i| (f64::from(i) * 0.9).sin() + 0.3 * (f64::from(i) * 2.3).cos()).collect();
        for (p, q) in [(0, 0), (1, 0), (0, 1), (2, 1), (3, 2), (1, 3), (5, 2), (2, 5), (8, 1)] {
            let models = eight(p, q);
            let mut lanes = Models::new(p, q);
            for (lane, (ar, ma)) in models.iter().enumerate() {
                lanes.set(lane, ar, ma);
            }
            let mut work = Work::new(&lanes);
            for (constant, conditional) in [(false, false), (true, false), (false, true), (true, true)] {
                let all = filter(&lanes, &w, constant, conditional, &mut work);
                for ((ar, ma), sums) in models.iter().zip(all) {
                    let arma = Arma::new(ar, ma);
                    let one = filter::filter(&arma, &w, constant, conditional, &mut filter::Work::new(arma.r));
                    for (a, b) in [(sums.log_f, one.log_f), (sums.ww, one.ww), (sums.w1, one.w1), (sums.one, one.one)] {
                        assert!((a - b).abs() <= 1e-9 * b.abs().max(1.0), "{ar:?} {ma:?}: {sums:?} {one:?}");
                    }
                }
            }
        }
    }
}
