//! The statistics of the M step.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::blocks::{Blocks, Row, groups};
use super::expectation::{Components, Scratch, expectation};
use super::small::Small;
use super::tile::{TILE, dot, tile, tile_rows};
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
    buffers: Buffers,
}

impl Workspace {
    pub(crate) fn new(blocks: &Blocks, k: usize) -> Self {
        Self { buffers: Buffers::new(k, blocks.dim) }
    }
}

/// Buffers of one chunk.
#[derive(Debug)]
struct Buffers {
    scratch: Scratch,
    /// Interleaved partial sums of `[z; 1][z; 1]'`, `(k, p, p, LANES)`.
    sums: Aligned,
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

    fn clear(&mut self) {
        self.sums.fill(0.0);
        self.extra.fill(0.0);
    }

    /// The sums of all lanes.
    fn fold_into(&self, out: &mut Moments) {
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

/// Rows of `[z; 1]`, padded to whole tiles by rows of zeros.
#[inline(always)]
fn padded(dim: usize) -> usize {
    (dim + 1).next_multiple_of(TILE)
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

/// Moments of a hard assignment about `centres: (k, d)`; `labels` has one entry per padded sample.
pub(crate) fn label_moments(
    blocks: &Blocks,
    labels: &[f64],
    diagonal: bool,
    centres: &[f64],
    workspace: &mut Workspace,
    out: &mut Moments,
) {
    let buffers = &mut workspace.buffers;
    Arch::new().dispatch(LabelMomentsOf { blocks, labels, diagonal, centres, buffers });
    buffers.fold_into(out);
    out.log_likelihood = 0.0;
}

/// Zeros, ones and products of one component, for passes over all lanes of a block.
struct Rows {
    ones: Row,
    zeros: Row,
    z: Row,
    rz: Row,
}

impl Rows {
    #[inline(always)]
    fn new() -> Self {
        let zeros = Row([0.0; BLOCK]);
        Self { ones: Row([1.0; BLOCK]), zeros, z: zeros, rz: zeros }
    }
}

/// One component of one block: its responsibilities, weights included, of the first `lanes` samples, and the groups of
/// samples that have any.
#[derive(Clone, Copy)]
struct Part<'a> {
    block: &'a [f64],
    centre: &'a [f64],
    r: &'a [f64; BLOCK],
    lanes: usize,
    active: u32,
    diagonal: bool,
}

impl Part<'_> {
    /// Adds `sum r [z; 1][z; 1]'` to interleaved sums `(p, p, LANES)`.
    #[inline(always)]
    fn add<S: Simd>(self, simd: S, sums: &mut [f64], rows: &mut Rows) {
        match (self.diagonal, self.centre.len()) {
            (true, _) => self.add_diagonal(simd, sums, rows),
            (false, 1) => self.add_small::<S, 1, 2, 2>(simd, sums),
            (false, 2) => self.add_small::<S, 2, 3, 3>(simd, sums),
            (false, 3) => self.add_small::<S, 3, 4, 4>(simd, sums),
            (false, 4) => self.add_small::<S, 4, 5, 5>(simd, sums),
            (false, 5) => self.add_small::<S, 5, 6, 6>(simd, sums),
            (false, 6) => self.add_small::<S, 6, 7, 4>(simd, sums),
            (false, 7) => self.add_small::<S, 7, 8, 5>(simd, sums),
            (false, 8) => self.add_small::<S, 8, 9, 6>(simd, sums),
            _ => self.add_tiles(simd, sums, rows),
        }
    }

    #[inline(always)]
    fn add_small<S: Simd, const D: usize, const C: usize, const H: usize>(self, simd: S, sums: &mut [f64]) {
        let Self { block, centre, r, active, .. } = self;
        let rows = &groups(block).as_chunks::<D>().0[0];
        let centre = &centre.as_chunks::<D>().0[0];
        let (r, sums, stride) = (&groups(r)[0], sums.as_chunks_mut().0, padded(D));
        // A function of its own, which the two passes share.
        simd.vectorize(Small::<D, C, H> { rows, centre, r, active, sums, stride });
    }

    #[inline(always)]
    fn add_diagonal<S: Simd>(self, simd: S, sums: &mut [f64], rows: &mut Rows) {
        let Self { block, centre, r, lanes, .. } = self;
        let Rows { ones, z: Row(z), rz: Row(rz), .. } = rows;
        let dim = centre.len();
        let p = padded(dim);
        let r = &r[..lanes];
        for (j, (x, m)) in block.chunks_exact(BLOCK).zip(centre).enumerate() {
            for (((z, rz), x), r) in z[..lanes].iter_mut().zip(&mut *rz).zip(x).zip(r.iter()) {
                *z = x - m;
                *rz = r * *z;
            }
            dot(simd, &mut sums[(j * p + j) * LANES..], &rz[..lanes], &z[..lanes]);
            dot(simd, &mut sums[(dim * p + j) * LANES..], &rz[..lanes], &ones.0[..lanes]);
        }
        dot(simd, &mut sums[(dim * p + dim) * LANES..], r, &ones.0[..lanes]);
    }

    #[inline(always)]
    fn add_tiles<S: Simd>(self, simd: S, sums: &mut [f64], rows: &mut Rows) {
        let Self { block, centre, r, lanes, active, .. } = self;
        let Rows { ones, zeros, .. } = rows;
        let p = padded(centre.len());
        let r = S::as_simd_f64s(&r[..lanes]).0;
        for i in (0..p).step_by(TILE) {
            let rows = tile_rows::<S>(simd, block, centre, i, r.len(), ones, zeros);
            for j in (0..i).step_by(TILE) {
                let columns = tile_rows::<S>(simd, block, centre, j, r.len(), ones, zeros);
                tile::<S, false>(simd, &mut sums[(i * p + j) * LANES..], p, &rows, &columns, r, active);
            }
            tile::<S, true>(simd, &mut sums[(i * p + i) * LANES..], p, &rows, &rows, r, active);
        }
    }
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

struct LabelMomentsOf<'a> {
    blocks: &'a Blocks,
    labels: &'a [f64],
    diagonal: bool,
    centres: &'a [f64],
    buffers: &'a mut Buffers,
}

impl WithSimd for LabelMomentsOf<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { blocks, labels, diagonal, centres, buffers } = self;
        buffers.clear();
        let Buffers { scratch, sums, .. } = buffers;
        let dim = blocks.dim;
        let p = padded(dim);
        let mut rows = Rows::new();
        for b in 0..blocks.block_count() {
            let range = b * BLOCK..b * BLOCK + blocks.lanes_in(b);
            let block = blocks.block(b);
            let lanes = range.len();
            let (weights, labels) = (&blocks.weights[range.clone()], &labels[range]);
            for (c, sums) in sums.chunks_exact_mut(p * p * LANES).enumerate() {
                let r = &mut scratch.joint.as_chunks_mut::<BLOCK>().0[0];
                let active = weights_of_label(simd, c, labels, weights, r);
                if active != 0 {
                    let centre = &centres[c * dim..(c + 1) * dim];
                    Part { block, centre, r, lanes, active, diagonal }.add(simd, sums, &mut rows);
                }
            }
        }
    }
}

/// The weights of the samples with label `c`, zero for others, and the groups that have any.
#[inline(always)]
fn weights_of_label<S: Simd>(simd: S, c: usize, labels: &[f64], weights: &[f64], r: &mut [f64; BLOCK]) -> u32 {
    let label = simd.splat_f64s(c as f64);
    let given = labels.as_chunks::<LANES>().0.iter().zip(weights.as_chunks::<LANES>().0);
    let mut active = 0;
    for ((g, r), (labels, weights)) in r.as_chunks_mut::<LANES>().0.iter_mut().enumerate().zip(given) {
        let given = S::as_simd_f64s(labels).0.iter().zip(S::as_simd_f64s(weights).0);
        let mut any = false;
        for (r, (l, w)) in S::as_mut_simd_f64s(r).0.iter_mut().zip(given) {
            let mine = simd.equal_f64s(*l, label);
            *r = simd.select_f64s(mine, *w, simd.splat_f64s(0.0));
            any |= simd.first_true_m64s(mine) < S::F64_LANES;
        }
        active |= u32::from(any) << g;
    }
    active
}
