//! Distances to centres, for the start of a fit.

use pulp::{Arch, Simd, WithSimd};

use super::blocks::{Blocks, groups, groups_mut};
use super::{BLOCK, GROUPS, LANES, fold};
use crate::wide::Wide;

impl Blocks {
    /// The smaller of `distances` and the squared distance of each sample to `centre`, and the weighted sum of that;
    /// both slices have [`Self::padded`] entries.
    pub(crate) fn closer(&self, centre: &[f64], distances: &[f64], out: &mut [f64]) -> f64 {
        Arch::new().dispatch(Closer { blocks: self, centre, distances, out })
    }

    /// The index of the nearest of `centres: (k, d)` for each sample; `labels` has [`Self::padded`] entries.
    pub(crate) fn nearest(&self, centres: &[f64], labels: &mut [f64]) {
        Arch::new().dispatch(Nearest { blocks: self, centres, labels });
    }
}

/// The smaller of `distances` and the squared distance to one centre.
struct Closer<'a> {
    blocks: &'a Blocks,
    centre: &'a [f64],
    distances: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Closer<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        by_dimension!(self, simd, self.blocks.dim)
    }
}

impl Closer<'_> {
    #[inline(always)]
    fn of<S: Simd, const D: usize, const P: usize>(self, simd: S) -> f64 {
        let Self { blocks, centre, distances, out } = self;
        let zero = Wide::<S, P>::splat(simd, 0.0);
        let mut at = [zero; D];
        for j in 0..D {
            at[j] = Wide::splat(simd, centre[j]);
        }
        let mut potential = zero;
        let (before, weights, out) = (groups(distances), groups(&blocks.weights), groups_mut(out));
        for b in 0..blocks.block_count() {
            let rows = &groups(blocks.block(b)).as_chunks::<D>().0[0];
            let (before, weights, out) = (&before[b], &weights[b], &mut out[b]);
            for g in 0..blocks.groups_in(b).min(GROUPS) {
                let mut d = zero;
                for j in 0..D {
                    let z = Wide::load(simd, &rows[j][g]) - at[j];
                    d = z.mul_add(z, d);
                }
                let d = d.smaller(Wide::load(simd, &before[g]));
                potential = d.mul_add(Wide::load(simd, &weights[g]), potential);
                d.store(&mut out[g]);
            }
        }
        let mut sums = [0.0; LANES];
        potential.store(&mut sums);
        fold(&sums)
    }

    #[inline(always)]
    fn of_any_dimension<S: Simd>(self, simd: S) -> f64 {
        let Self { blocks, centre, distances, out } = self;
        let mut potential = [0.0; LANES];
        let sums = S::as_mut_simd_f64s(&mut potential).0;
        for b in 0..blocks.block_count() {
            let block = blocks.block(b);
            let range = b * BLOCK..b * BLOCK + blocks.lanes_in(b);
            let out = S::as_mut_simd_f64s(&mut out[range.clone()]).0;
            let before = S::as_simd_f64s(&distances[range.clone()]).0;
            let weights = S::as_simd_f64s(&blocks.weights[range]).0;
            for (v, ((out, before), w)) in out.iter_mut().zip(before).zip(weights).enumerate() {
                let mut d = simd.splat_f64s(0.0);
                for (x, c) in block.chunks_exact(BLOCK).zip(centre) {
                    let z = simd.sub_f64s(S::as_simd_f64s(x).0[v], simd.splat_f64s(*c));
                    d = simd.mul_add_f64s(z, z, d);
                }
                let d = simd.select_f64s(simd.less_than_f64s(d, *before), d, *before);
                let s = &mut sums[v % (LANES / S::F64_LANES)];
                *s = simd.mul_add_f64s(d, *w, *s);
                *out = d;
            }
        }
        fold(&potential)
    }
}

struct Nearest<'a> {
    blocks: &'a Blocks,
    centres: &'a [f64],
    labels: &'a mut [f64],
}

impl WithSimd for Nearest<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        by_dimension!(self, simd, self.blocks.dim);
    }
}

impl Nearest<'_> {
    /// The nearest centre is the one with the largest `x.c - |c|^2 / 2`, both taken from the first centre, so that samples
    /// far from the origin keep their digits. Two groups of samples in registers, then all centres.
    #[inline(always)]
    fn of<S: Simd, const D: usize, const P: usize>(self, simd: S) {
        const TWO: usize = 2;
        let Self { blocks, centres, labels } = self;
        let centres = centres.as_chunks::<D>().0;
        let origin = centres[0];
        let shifted: Vec<([f64; D], f64)> = centres
            .iter()
            .map(|centre| {
                let mut c = *centre;
                let mut square = 0.0;
                for j in 0..D {
                    c[j] -= origin[j];
                    square += c[j] * c[j];
                }
                (c, -0.5 * square)
            })
            .collect();
        let zero = Wide::<S, P>::splat(simd, 0.0);
        for (b, labels) in groups_mut(labels).iter_mut().enumerate() {
            let rows = groups(blocks.block(b)).as_chunks::<D>().0[0].each_ref().map(|row| row.as_chunks::<TWO>().0);
            let labels = labels.as_chunks_mut::<TWO>().0;
            for pair in 0..blocks.groups_in(b).div_ceil(TWO).min(GROUPS / TWO) {
                let mut x = [[zero; TWO]; D];
                for j in 0..D {
                    for t in 0..TWO {
                        x[j][t] = Wide::load(simd, &rows[j][pair][t]) - Wide::splat(simd, origin[j]);
                    }
                }
                let mut best = [Wide::splat(simd, f64::NEG_INFINITY); TWO];
                let mut at = [zero; TWO];
                let mut index = zero;
                for (centre, square) in &shifted {
                    let mut score = [Wide::splat(simd, *square); TWO];
                    for j in 0..D {
                        for t in 0..TWO {
                            score[t] = Wide::splat(simd, centre[j]).mul_add(x[j][t], score[t]);
                        }
                    }
                    for t in 0..TWO {
                        (best[t], at[t]) = best[t].or_larger(score[t], at[t], index);
                    }
                    index = index + Wide::splat(simd, 1.0);
                }
                for t in 0..TWO {
                    at[t].store(&mut labels[pair][t]);
                }
            }
        }
    }

    #[inline(always)]
    fn of_any_dimension<S: Simd>(self, _: S) {
        let Self { blocks, centres, labels } = self;
        for b in 0..blocks.block_count() {
            let block = blocks.block(b);
            let label = &mut labels[b * BLOCK..b * BLOCK + blocks.lanes_in(b)];
            let mut best = [f64::INFINITY; BLOCK];
            label.fill(0.0);
            for (k, centre) in centres.chunks_exact(blocks.dim).enumerate() {
                let mut distance = [0.0; BLOCK];
                for (x, c) in block.chunks_exact(BLOCK).zip(centre) {
                    for (d, v) in distance.iter_mut().zip(x) {
                        let z = v - c;
                        *d = z.mul_add(z, *d);
                    }
                }
                let index = k as f64;
                for ((d, l), best) in distance.iter().zip(&mut *label).zip(&mut best) {
                    let closer = *d < *best;
                    *l = if closer { index } else { *l };
                    *best = if closer { *d } else { *best };
                }
            }
        }
    }
}
