//! Samples as the kernels read them: feature-major blocks on cache lines.

use super::{BLOCK, LANES};
use crate::samples::Samples;

/// Doubles that begin on a cache line, so that no register load straddles two.
#[derive(Debug)]
pub(super) struct Aligned {
    storage: Vec<f64>,
    offset: usize,
    pub(super) len: usize,
}

impl Aligned {
    pub(super) fn zeros(len: usize) -> Self {
        let storage = vec![0.0; len + LANES];
        // The allocator aligns to eight bytes at least, so at most seven doubles are skipped.
        let offset = storage.as_ptr().align_offset(64).min(LANES);
        Self { storage, offset, len }
    }
}

impl std::ops::Deref for Aligned {
    type Target = [f64];

    fn deref(&self) -> &[f64] {
        &self.storage[self.offset..self.offset + self.len]
    }
}

impl std::ops::DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f64] {
        &mut self.storage[self.offset..self.offset + self.len]
    }
}

/// One number per sample of a block.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Row(pub(super) [f64; BLOCK]);

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
        for (b, block) in values.chunks_exact_mut(dim * BLOCK).enumerate() {
            for lane in 0..BLOCK {
                // Padding repeats the last sample, so that it is as ordinary as its neighbours.
                let row = samples.row((b * BLOCK + lane).min(len - 1));
                for (j, &v) in row.iter().enumerate() {
                    block[j * BLOCK + lane] = v;
                }
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
