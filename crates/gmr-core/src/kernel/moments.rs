//! The statistics of the M step.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::blocks::Blocks;
use super::expectation::{Components, Scratch, expectation};
use super::part::{Part, Rows, padded};
use super::tile::dot;
use super::{BLOCK, CHUNK_BLOCKS, LANES, fold};
use crate::wide::Aligned;

/// Responsibility-weighted moments of each component about its centre, and the log-likelihood.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Moments {
    pub(crate) dim: usize,
    /// `sum w ln p(x)`.
    pub(crate) log_likelihood: f64,
    /// `sum w r`, `(k)`.
    pub(crate) mass: Vec<f64>,
    /// `sum w r z`, `(k, d)`.
    pub(crate) first: Vec<f64>,
    /// `sum w r z z'`, `(k, d, d)` lower triangle (diagonal only for diagonal passes).
    pub(crate) second: Vec<f64>,
    /// `sum w r e`, `(k)`, zero without an extra column.
    pub(crate) extra: Vec<f64>,
}

impl Moments {
    pub(crate) fn zero(k: usize, dim: usize) -> Self {
        Self {
            dim,
            log_likelihood: 0.0,
            mass: vec![0.0; k],
            first: vec![0.0; k * dim],
            second: vec![0.0; k * dim * dim],
            extra: vec![0.0; k],
        }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.log_likelihood += other.log_likelihood;
        for (mine, theirs) in [
            (&mut self.mass, &other.mass),
            (&mut self.first, &other.first),
            (&mut self.second, &other.second),
            (&mut self.extra, &other.extra),
        ] {
            for (a, b) in mine.iter_mut().zip(theirs) {
                *a += b;
            }
        }
    }
}

/// What one fit keeps from pass to pass, so that a pass over few samples allocates nothing.
#[derive(Debug)]
pub(crate) struct Workspace {
    /// Buffers of the first chunk.
    pub(super) buffers: Buffers,
}

impl Workspace {
    pub(crate) fn new(blocks: &Blocks, k: usize) -> Self {
        Self { buffers: Buffers::new(k, blocks.dim) }
    }
}

/// Buffers of one chunk.
#[derive(Debug)]
pub(super) struct Buffers {
    pub(super) scratch: Scratch,
    /// Interleaved partial sums of `[z; 1][z; 1]'`, `(k, p, p, LANES)`.
    pub(super) sums: Aligned,
    /// The same of the extra column, `(k, LANES)`.
    extra: Aligned,
}

impl Buffers {
    fn new(k: usize, dim: usize) -> Self {
        let p = padded(dim);
        Self {
            scratch: Scratch::new(k, dim),
            sums: Aligned::zeros(k * p * p * LANES),
            extra: Aligned::zeros(k * LANES),
        }
    }

    pub(super) fn clear(&mut self) {
        self.sums.fill(0.0);
        self.extra.fill(0.0);
    }

    /// The sums of all lanes.
    pub(super) fn fold_into(&self, out: &mut Moments) {
        let dim = out.dim;
        let p = padded(dim);
        let sums = self.sums.as_chunks::<LANES>().0;
        for (c, sums) in sums.chunks_exact(p * p).enumerate() {
            for (i, row) in sums.chunks_exact(p).take(dim).enumerate() {
                for (out, sum) in out.second[(c * dim + i) * dim..][..=i].iter_mut().zip(row) {
                    *out = fold(sum);
                }
            }
            let last = &sums[dim * p..];
            for (out, sum) in out.first[c * dim..(c + 1) * dim].iter_mut().zip(last) {
                *out = fold(sum);
            }
            out.mass[c] = fold(&last[dim]);
        }
        for (out, sum) in out.extra.iter_mut().zip(self.extra.as_chunks::<LANES>().0) {
            *out = fold(sum);
        }
    }
}

/// Moments of all samples about `centres: (k, d)` under the posterior of `components`.
pub(crate) fn moments(
    blocks: &Blocks,
    components: Components<'_>,
    centres: &[f64],
    workspace: &mut Workspace,
    out: &mut Moments,
) {
    let pass = |c: usize, buffers: &mut Buffers, out: &mut Moments| {
        let range = chunk(blocks, c);
        let centres = Some(centres);
        out.log_likelihood = Arch::new().dispatch(MomentsOf { blocks, range, components, centres, buffers });
        buffers.fold_into(out);
    };
    if blocks.block_count() <= CHUNK_BLOCKS {
        pass(0, &mut workspace.buffers, out);
        return;
    }
    let k = components.offsets.len();
    let parts: Vec<Moments> = (0..blocks.block_count().div_ceil(CHUNK_BLOCKS))
        .into_par_iter()
        .map_init(
            || Buffers::new(k, blocks.dim),
            |buffers, c| {
                let mut out = Moments::zero(k, blocks.dim);
                pass(c, buffers, &mut out);
                out
            },
        )
        .collect();
    let mut parts = parts.into_iter();
    if let Some(first) = parts.next() {
        *out = first;
    }
    for part in parts {
        out.add(&part);
    }
}

/// `sum w ln p(x)`.
pub(crate) fn log_likelihood(blocks: &Blocks, components: Components<'_>, workspace: &mut Workspace) -> f64 {
    let pass = |c: usize, buffers: &mut Buffers| {
        let range = chunk(blocks, c);
        Arch::new().dispatch(MomentsOf { blocks, range, components, centres: None, buffers })
    };
    if blocks.block_count() <= CHUNK_BLOCKS {
        return pass(0, &mut workspace.buffers);
    }
    let k = components.offsets.len();
    let parts: Vec<f64> = (0..blocks.block_count().div_ceil(CHUNK_BLOCKS))
        .into_par_iter()
        .map_init(|| Buffers::new(k, blocks.dim), |buffers, c| pass(c, buffers))
        .collect();
    parts.iter().sum()
}

/// Blocks of chunk `c`.
fn chunk(blocks: &Blocks, c: usize) -> Range<usize> {
    c * CHUNK_BLOCKS..((c + 1) * CHUNK_BLOCKS).min(blocks.block_count())
}

struct MomentsOf<'a> {
    blocks: &'a Blocks,
    range: Range<usize>,
    components: Components<'a>,
    /// Where to take moments about; without, there is only the log-likelihood.
    centres: Option<&'a [f64]>,
    buffers: &'a mut Buffers,
}

impl WithSimd for MomentsOf<'_> {
    type Output = f64;

    /// Leaves the sums in the buffers and returns the log-likelihood.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { blocks, range, components, centres, buffers } = self;
        buffers.clear();
        let Buffers { scratch, sums, extra } = buffers;
        let dim = blocks.dim;
        let p = padded(dim);
        let mut likelihood = [0.0; LANES];
        let mut rows = Rows::new();
        for b in range {
            let lanes = blocks.lanes_in(b);
            let block = blocks.block(b);
            let weights = &blocks.weights[b * BLOCK..b * BLOCK + lanes];
            expectation(simd, block, weights, components, scratch);
            for (d, w) in scratch.density.0[..lanes].chunks_exact(LANES).zip(weights.chunks_exact(LANES)) {
                for ((l, d), w) in likelihood.iter_mut().zip(d).zip(w) {
                    *l += if *w > 0.0 { w * d } else { 0.0 };
                }
            }
            let Some(centres) = centres else { continue };
            let diagonal = components.diagonal;
            let responsibilities = scratch.joint.as_chunks::<BLOCK>().0.iter().zip(&scratch.active);
            for (c, (sums, (r, &active))) in sums.chunks_exact_mut(p * p * LANES).zip(responsibilities).enumerate() {
                if active == 0 {
                    continue;
                }
                let centre = &centres[c * dim..(c + 1) * dim];
                Part { block, centre, r, lanes, active, diagonal }.add(simd, sums, &mut rows);
                if let Some(e) = &blocks.extra {
                    dot(simd, &mut extra[c * LANES..(c + 1) * LANES], &r[..lanes], &e[b * BLOCK..b * BLOCK + lanes]);
                }
            }
        }
        fold(&likelihood)
    }
}
