//! Samples as the kernels read them: feature-major blocks on cache lines.

use super::{BLOCK, GROUPS, LANES};
use crate::samples::Samples;
use crate::wide::Aligned;

/// One number per sample of a block.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Row(pub(super) [f64; BLOCK]);

/// One number per sample of a block, by groups.
pub(super) type Groups = [[f64; LANES]; GROUPS];

/// Rows of [`BLOCK`] numbers by groups.
#[inline(always)]
pub(super) fn groups(rows: &[f64]) -> &[Groups] {
    rows.as_chunks::<LANES>().0.as_chunks::<GROUPS>().0
}

/// As [`groups`].
#[inline(always)]
pub(super) fn groups_mut(rows: &mut [f64]) -> &mut [Groups] {
    rows.as_chunks_mut::<LANES>().0.as_chunks_mut::<GROUPS>().0
}

/// Samples in feature-major blocks, padded to whole lanes with weight zero.
#[derive(Debug)]
pub(crate) struct Blocks {
    pub(super) len: usize,
    pub(super) dim: usize,
    pub(super) values: Aligned,
    pub(super) weights: Aligned,
    /// One more number per sample whose responsibility-weighted sum is wanted.
    pub(super) extra: Option<Aligned>,
}

impl Blocks {
    pub(crate) fn new(samples: &Samples<'_>, extra: Option<&[f64]>) -> Self {
        let (len, dim) = (samples.len(), samples.dim());
        let blocks = len.div_ceil(BLOCK);
        let mut values = Aligned::zeros(blocks * dim * BLOCK);
        let mut weights = Aligned::zeros(blocks * BLOCK);
        let given = samples.values().chunks(dim * BLOCK);
        for (block, given) in values.chunks_exact_mut(dim * BLOCK).zip(given) {
            for (j, feature) in block.chunks_exact_mut(BLOCK).enumerate() {
                for (out, row) in feature.iter_mut().zip(given.chunks_exact(dim)) {
                    *out = row[j];
                }
                // Padding repeats the last sample, so that it is as ordinary as its neighbours.
                let count = given.len() / dim;
                let last = feature[count - 1];
                feature[count..].fill(last);
            }
        }
        for (i, w) in weights.iter_mut().take(len).enumerate() {
            *w = samples.weight(i);
        }
        let extra = extra.map(|e| {
            let mut padded = Aligned::zeros(blocks * BLOCK);
            padded[..len].copy_from_slice(e);
            padded
        });
        Self { len, dim, values, weights, extra }
    }

    #[inline(always)]
    pub(super) fn block_count(&self) -> usize {
        self.len.div_ceil(BLOCK)
    }

    /// Groups of block `b`, the last one padded.
    #[inline(always)]
    pub(super) fn groups_in(&self, b: usize) -> usize {
        self.lanes_in(b) / LANES
    }

    /// Samples of block `b`, rounded up to whole lanes.
    #[inline(always)]
    pub(super) fn lanes_in(&self, b: usize) -> usize {
        (self.len - b * BLOCK).min(BLOCK).next_multiple_of(LANES)
    }

    #[inline(always)]
    pub(super) fn block(&self, b: usize) -> &[f64] {
        &self.values[b * self.dim * BLOCK..(b + 1) * self.dim * BLOCK]
    }

    /// Numbers per sample, padding included.
    pub(crate) fn padded(&self) -> usize {
        self.block_count() * BLOCK
    }
}
