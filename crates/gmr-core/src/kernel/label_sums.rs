//! Sums over the samples of each label.

use pulp::{Arch, Simd, WithSimd};

use super::blocks::Blocks;
use super::{BLOCK, LANES, fold};
use crate::wide::Aligned;

impl Blocks {
    /// Weighted sums of the samples of each label, rows of `[weight, sum_1 .. sum_d]` in `sums: (k, d + 1)`.
    pub(crate) fn label_sums(&self, labels: &[f64], sums: &mut [f64], lanes: &mut LabelLanes) {
        Arch::new().dispatch(LabelSums { blocks: self, labels, lanes: &mut lanes.0 });
        for (sum, lanes) in sums.iter_mut().zip(lanes.0.as_chunks::<LANES>().0) {
            *sum = fold(lanes);
        }
    }
}

/// Interleaved partial sums of [`Blocks::label_sums`].
#[derive(Debug)]
pub(crate) struct LabelLanes(Aligned);

impl LabelLanes {
    pub(crate) fn new(k: usize, dim: usize) -> Self {
        Self(Aligned::zeros(k * (dim + 1) * LANES))
    }
}

struct LabelSums<'a> {
    blocks: &'a Blocks,
    labels: &'a [f64],
    /// `(k, d + 1, LANES)`.
    lanes: &'a mut [f64],
}

impl WithSimd for LabelSums<'_> {
    type Output = ();

    /// A register of samples is added once for each label in it, with the weights of the others zero: samples of a
    /// motion come in runs of one label, so mostly once.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { blocks, labels, lanes } = self;
        let stride = (blocks.dim + 1) * LANES;
        let zero = simd.splat_f64s(0.0);
        lanes.fill(0.0);
        for b in 0..blocks.block_count() {
            let block = blocks.block(b);
            let range = b * BLOCK..b * BLOCK + blocks.lanes_in(b);
            let weights = S::as_simd_f64s(&blocks.weights[range.clone()]).0;
            for (v, (labels, weight)) in labels[range].chunks_exact(S::F64_LANES).zip(weights).enumerate() {
                let label = S::as_simd_f64s(labels).0[0];
                let others = simd.not_m64s(simd.equal_f64s(label, simd.splat_f64s(labels[0])));
                if simd.first_true_m64s(others) >= S::F64_LANES {
                    add_samples(simd, &mut lanes[labels[0] as usize * stride..][..stride], block, v, *weight);
                    continue;
                }
                for (i, &c) in labels.iter().enumerate() {
                    if !labels[..i].contains(&c) {
                        let mine = simd.equal_f64s(label, simd.splat_f64s(c));
                        let weight = simd.select_f64s(mine, *weight, zero);
                        add_samples(simd, &mut lanes[c as usize * stride..][..stride], block, v, weight);
                    }
                }
            }
        }
    }
}

/// Adds register `v` of a block, weighted, to the interleaved sums `(d + 1, LANES)` of one label.
#[inline(always)]
fn add_samples<S: Simd>(simd: S, lanes: &mut [f64], block: &[f64], v: usize, weight: S::f64s) {
    let per = LANES / S::F64_LANES;
    let (mass, sums) = S::as_mut_simd_f64s(lanes).0.split_at_mut(per);
    mass[v % per] = simd.add_f64s(mass[v % per], weight);
    for (s, x) in sums.chunks_exact_mut(per).zip(block.chunks_exact(BLOCK)) {
        s[v % per] = simd.mul_add_f64s(weight, S::as_simd_f64s(x).0[v], s[v % per]);
    }
}
