//! Sums over the samples of each label.

use pulp::{Arch, Simd, WithSimd};

use super::blocks::{Blocks, groups};
use super::{GROUPS, LANES, fold};
use crate::wide::{Aligned, Wide};

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

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.lanes.fill(0.0);
        by_dimension!(self, simd, self.blocks.dim);
    }
}

impl LabelSums<'_> {
    #[inline(always)]
    fn of<S: Simd, const D: usize, const P: usize>(self, simd: S) {
        let Self { blocks, labels, lanes } = self;
        let sums = lanes.as_chunks_mut::<LANES>().0;
        for b in 0..blocks.block_count() {
            let rows = &groups(blocks.block(b)).as_chunks::<D>().0[0];
            let (labels, weights) = (&groups(labels)[b], &groups(&blocks.weights)[b]);
            for g in 0..blocks.groups_in(b).min(GROUPS) {
                each_label(simd, &labels[g], &weights[g], |c, weight| {
                    let weight = Wide::<S, P>::load(simd, weight);
                    let (mass, sums) = sums[c * (D + 1)..][..=D].split_at_mut(1);
                    (Wide::load(simd, &mass[0]) + weight).store(&mut mass[0]);
                    for j in 0..D {
                        weight.mul_add(Wide::load(simd, &rows[j][g]), Wide::load(simd, &sums[j])).store(&mut sums[j]);
                    }
                });
            }
        }
    }

    #[inline(always)]
    fn of_any_dimension<S: Simd>(self, simd: S) {
        let Self { blocks, labels, lanes } = self;
        let sums = lanes.as_chunks_mut::<LANES>().0;
        for b in 0..blocks.block_count() {
            let rows = groups(blocks.block(b));
            let (labels, weights) = (&groups(labels)[b], &groups(&blocks.weights)[b]);
            for g in 0..blocks.groups_in(b).min(GROUPS) {
                each_label(simd, &labels[g], &weights[g], |c, weight| {
                    let (mass, sums) = sums[c * (rows.len() + 1)..][..=rows.len()].split_at_mut(1);
                    for l in 0..LANES {
                        mass[0][l] += weight[l];
                    }
                    for (sum, row) in sums.iter_mut().zip(rows) {
                        for l in 0..LANES {
                            sum[l] = weight[l].mul_add(row[g][l], sum[l]);
                        }
                    }
                });
            }
        }
    }
}

/// Calls `add` once for each label in a group, with the weights of the samples of other labels zero: samples of a motion
/// come in runs of one label, so mostly once.
#[inline(always)]
fn each_label<S: Simd>(
    simd: S,
    labels: &[f64; LANES],
    weights: &[f64; LANES],
    mut add: impl FnMut(usize, &[f64; LANES]),
) {
    let mut first = 0;
    // Lanes whose label has been seen, one bit each.
    let mut seen = 0u32;
    while first < LANES {
        let label = simd.splat_f64s(labels[first]);
        let mut mine = [0.0; LANES];
        let given = S::as_simd_f64s(labels).0.iter().zip(S::as_simd_f64s(weights).0);
        let (zero, unit) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let mut same = [0.0; LANES];
        let out = S::as_mut_simd_f64s(&mut mine).0.iter_mut().zip(S::as_mut_simd_f64s(&mut same).0);
        for ((l, w), (mine, same)) in given.zip(out) {
            let equal = simd.equal_f64s(*l, label);
            *mine = simd.select_f64s(equal, *w, zero);
            *same = simd.select_f64s(equal, unit, zero);
        }
        for (l, same) in same.iter().enumerate() {
            seen |= u32::from(*same > 0.0) << l;
        }
        add(labels[first] as usize, &mine);
        first = (!seen).trailing_zeros() as usize;
    }
}
