//! Variance of the samples, whatever their labels.

use pulp::{Arch, Simd, WithSimd};

use super::blocks::Blocks;
use super::{BLOCK, LANES, fold};

impl Blocks {
    /// Mean over features of the variance of the samples.
    pub(crate) fn mean_variance(&self) -> f64 {
        (0..self.dim).map(|feature| Arch::new().dispatch(Variance { blocks: self, feature })).sum::<f64>()
            / self.dim as f64
    }
}

/// Variance of one feature over all samples, each counted once.
struct Variance<'a> {
    blocks: &'a Blocks,
    feature: usize,
}

impl WithSimd for Variance<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let n = self.blocks.len as f64;
        let mean = self.sum(simd, |_, v| v, |v| v) / n;
        let at = simd.splat_f64s(mean);
        let square = |simd: S, v| {
            let z = simd.sub_f64s(v, at);
            simd.mul_f64s(z, z)
        };
        self.sum(simd, square, |v| (v - mean) * (v - mean)) / n
    }
}

impl Variance<'_> {
    /// Sum of a function, given for registers and for one number.
    #[inline(always)]
    fn sum<S: Simd>(&self, simd: S, wide: impl Fn(S, S::f64s) -> S::f64s, one: impl Fn(f64) -> f64) -> f64 {
        let Self { blocks, feature } = self;
        let mut lanes = [0.0; LANES];
        let sums = S::as_mut_simd_f64s(&mut lanes).0;
        let mut rest = 0.0;
        for b in 0..blocks.block_count() {
            let row = &blocks.block(b)[feature * BLOCK..][..(blocks.len - b * BLOCK).min(BLOCK)];
            let (whole, tail) = row.as_chunks::<LANES>();
            for v in whole {
                for (sum, v) in sums.iter_mut().zip(S::as_simd_f64s(v).0) {
                    *sum = simd.add_f64s(*sum, wide(simd, *v));
                }
            }
            rest += tail.iter().map(|v| one(*v)).sum::<f64>();
        }
        fold(&lanes) + rest
    }
}
