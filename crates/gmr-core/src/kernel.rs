//! One pass over the data: log densities, responsibilities and weighted moments.
//!
//! Samples are stored feature-major in blocks of [`BLOCK`], so that one vector register holds one
//! feature of several samples. Per block and component the pass forms `z = x - mu`,
//! `y = W z` with `W = L^-1` (one triangular product), `log N = offset - y'y / 2`, then the
//! log-sum-exp over components, then the lower triangle of `sum r [z; 1][z; 1]'`, which holds the
//! zeroth, first and second moments in one product. Moments are taken about a centre given per
//! component (its current mean), never about the origin, so that no digits cancel.
//!
//! Every sum is kept in [`LANES`] interleaved partial sums whatever the register width, chunks
//! of [`CHUNK_BLOCKS`] blocks are independent, and their results are added in order: the bytes do
//! not depend on the instruction set or on the number of threads.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::samples::Samples;
use crate::scalar::{exp_nonpositive, ln_positive};

/// Interleaved partial sums; the widest register in use (AVX-512) has eight lanes.
const LANES: usize = 8;
/// Samples per block: the working set of a seven-dimensional block (14 KiB) stays in a 32 KiB L1.
const BLOCK: usize = 128;
/// Blocks per unit of parallel work: 4096 samples, some hundred microseconds.
const CHUNK_BLOCKS: usize = 32;

/// Samples in feature-major blocks, padded to whole lanes with weight zero.
#[derive(Debug)]
pub(crate) struct Blocks {
    len: usize,
    dim: usize,
    values: Vec<f64>,
    weights: Vec<f64>,
    /// One more number per sample whose responsibility-weighted sum is wanted.
    extra: Option<Vec<f64>>,
}

impl Blocks {
    pub(crate) fn new(samples: &Samples<'_>, extra: Option<&[f64]>) -> Self {
        let (len, dim) = (samples.len(), samples.dim());
        let blocks = len.div_ceil(BLOCK);
        let mut values = vec![0.0; blocks * dim * BLOCK];
        let mut weights = vec![0.0; blocks * BLOCK];
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
            let mut padded = e.to_vec();
            padded.resize(blocks * BLOCK, 0.0);
            padded
        });
        Self { len, dim, values, weights, extra }
    }

    fn block_count(&self) -> usize {
        self.len.div_ceil(BLOCK)
    }

    /// Samples of block `b`, rounded up to whole lanes.
    fn lanes_in(&self, b: usize) -> usize {
        (self.len - b * BLOCK).min(BLOCK).next_multiple_of(LANES)
    }

    fn block(&self, b: usize) -> &[f64] {
        &self.values[b * self.dim * BLOCK..(b + 1) * self.dim * BLOCK]
    }

    /// Squared distance of each sample to its nearest centre and the index of that centre, for
    /// `centres: (k, d)`; `labels` and `distances` have one entry per sample.
    pub(crate) fn nearest(&self, centres: &[f64], labels: &mut [u32], distances: &mut [f64]) {
        let dim = self.dim;
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for b in 0..self.block_count() {
                    let block = self.block(b);
                    let mut best = [f64::INFINITY; BLOCK];
                    let mut label = [0.0; BLOCK];
                    for (k, centre) in centres.chunks_exact(dim).enumerate() {
                        let mut distance = [0.0; BLOCK];
                        for (x, c) in block.chunks_exact(BLOCK).zip(centre) {
                            for (d, v) in distance.iter_mut().zip(x) {
                                let z = v - c;
                                *d = z.mul_add(z, *d);
                            }
                        }
                        let index = k as f64;
                        for ((d, l), best) in distance.iter().zip(&mut label).zip(&mut best) {
                            let closer = *d < *best;
                            *l = if closer { index } else { *l };
                            *best = if closer { *d } else { *best };
                        }
                    }
                    let range = b * BLOCK..self.len.min((b + 1) * BLOCK);
                    let n = range.len();
                    distances[range.clone()].copy_from_slice(&best[..n]);
                    for (out, l) in labels[range].iter_mut().zip(&label) {
                        *out = *l as u32;
                    }
                }
            },
        );
    }

    /// Sum of the samples of each label, with weights: `k` rows of `[weight, sum_1 .. sum_d]`.
    pub(crate) fn label_sums(&self, labels: &[u32], k: usize) -> Vec<f64> {
        let stride = self.dim + 1;
        let mut sums = vec![0.0; k * stride];
        for (i, &label) in labels.iter().enumerate() {
            let (b, lane) = (i / BLOCK, i % BLOCK);
            let block = self.block(b);
            let w = self.weights[i];
            let out = &mut sums[label as usize * stride..][..stride];
            out[0] += w;
            for (j, o) in out[1..].iter_mut().enumerate() {
                *o += w * block[j * BLOCK + lane];
            }
        }
        sums
    }
}

/// What the pass needs of a mixture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Components<'a> {
    /// `(k, d)`.
    pub(crate) means: &'a [f64],
    /// `W = L^-1`, `(k, d, d)` row-major lower; or reciprocal deviations `(k, d)` if `diagonal`.
    pub(crate) whitening: &'a [f64],
    /// `ln pi + ln det W - d/2 ln 2 pi`, `(k)`.
    pub(crate) offsets: &'a [f64],
    pub(crate) diagonal: bool,
}

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

/// Moments of all samples about `centres: (k, d)` under the posterior of `components`.
pub(crate) fn moments(blocks: &Blocks, components: Components<'_>, centres: &[f64]) -> Moments {
    let chunk = |c: usize| {
        let range = c * CHUNK_BLOCKS..((c + 1) * CHUNK_BLOCKS).min(blocks.block_count());
        Arch::new().dispatch(MomentsOf { blocks, range, components, centres })
    };
    let chunks = blocks.block_count().div_ceil(CHUNK_BLOCKS);
    if chunks == 1 {
        return chunk(0);
    }
    let parts: Vec<Moments> = (0..chunks).into_par_iter().map(chunk).collect();
    let mut parts = parts.into_iter();
    let mut total = parts.next().unwrap_or_else(|| Moments::zero(components.offsets.len(), blocks.dim));
    for part in parts {
        total.add(&part);
    }
    total
}

/// Log density of each sample, `(n)`, and, if wanted, the responsibilities, `(n, k)`.
pub(crate) fn densities(
    blocks: &Blocks,
    components: Components<'_>,
    want_responsibilities: bool,
) -> (Vec<f64>, Vec<f64>) {
    let k = components.offsets.len();
    let chunks = blocks.block_count().div_ceil(CHUNK_BLOCKS);
    let parts: Vec<(Vec<f64>, Vec<f64>)> = (0..chunks)
        .into_par_iter()
        .map(|c| {
            let range = c * CHUNK_BLOCKS..((c + 1) * CHUNK_BLOCKS).min(blocks.block_count());
            Arch::new().dispatch(DensitiesOf { blocks, range, components, want_responsibilities })
        })
        .collect();
    let mut log_density = Vec::with_capacity(blocks.len);
    let mut responsibilities = Vec::with_capacity(if want_responsibilities { blocks.len * k } else { 0 });
    for (d, r) in parts {
        log_density.extend_from_slice(&d);
        responsibilities.extend_from_slice(&r);
    }
    (log_density, responsibilities)
}

/// Buffers of one chunk.
struct Scratch {
    /// Log densities, then responsibilities: `(k, BLOCK)`.
    joint: Vec<f64>,
    /// Centred samples with a row of ones, padded to whole tiles: `(p, BLOCK)`.
    z: Vec<f64>,
    /// The same, times responsibility.
    rz: Vec<f64>,
    /// Log density per sample.
    density: [f64; BLOCK],
}

impl Scratch {
    fn new(k: usize, p: usize) -> Self {
        Self { joint: vec![0.0; k * BLOCK], z: vec![0.0; p * BLOCK], rz: vec![0.0; p * BLOCK], density: [0.0; BLOCK] }
    }
}

/// `total[g] += |W z|^2` for `G` consecutive registers of samples.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must be compiled inside the caller's target features")]
fn squared_norm<S: Simd, const G: usize>(simd: S, z: &[S::f64s], first: usize, w: &[f64], dim: usize) -> [S::f64s; G] {
    let registers = BLOCK / S::F64_LANES;
    let zero = simd.splat_f64s(0.0);
    let mut total = [zero; G];
    for i in 0..dim {
        let row = &w[i * dim..=i * dim + i];
        let mut y = [zero; G];
        for (w, z) in row.iter().zip(z.chunks_exact(registers)) {
            let w = simd.splat_f64s(*w);
            let z = &z[first..first + G];
            for g in 0..G {
                y[g] = simd.mul_add_f64s(w, z[g], y[g]);
            }
        }
        for g in 0..G {
            total[g] = simd.mul_add_f64s(y[g], y[g], total[g]);
        }
    }
    total
}

/// Fills `scratch.joint` with responsibilities (they sum to one over components)
/// and `scratch.density` with log densities, for one block.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must be compiled inside the caller's target features")]
fn expectation<S: Simd>(simd: S, block: &[f64], lanes: usize, components: Components<'_>, scratch: &mut Scratch) {
    const GROUP: usize = 8;
    let k = components.offsets.len();
    let dim = components.means.len() / k;
    let registers = lanes / S::F64_LANES;
    let Scratch { joint, z, density, .. } = scratch;
    for (c, joint) in joint.chunks_exact_mut(BLOCK).enumerate() {
        let mean = &components.means[c * dim..(c + 1) * dim];
        let joint = &mut joint[..lanes];
        let offset = components.offsets[c];
        if components.diagonal {
            let reciprocal = &components.whitening[c * dim..(c + 1) * dim];
            joint.fill(0.0);
            for ((x, m), s) in block.chunks_exact(BLOCK).zip(mean).zip(reciprocal) {
                for (q, x) in joint.iter_mut().zip(x) {
                    let y = (x - m) * s;
                    *q = y.mul_add(y, *q);
                }
            }
        } else {
            for ((x, m), z) in block.chunks_exact(BLOCK).zip(mean).zip(z.chunks_exact_mut(BLOCK)) {
                for (z, x) in z[..lanes].iter_mut().zip(x) {
                    *z = x - m;
                }
            }
            let w = &components.whitening[c * dim * dim..(c + 1) * dim * dim];
            let z = S::as_simd_f64s(&z[..dim * BLOCK]).0;
            let q = S::as_mut_simd_f64s(joint).0;
            let mut first = 0;
            while first + GROUP <= registers {
                q[first..first + GROUP].copy_from_slice(&squared_norm::<S, GROUP>(simd, z, first, w, dim));
                first += GROUP;
            }
            while first < registers {
                q[first] = squared_norm::<S, 1>(simd, z, first, w, dim)[0];
                first += 1;
            }
        }
        for q in joint.iter_mut() {
            *q = (-0.5f64).mul_add(*q, offset);
        }
    }
    let mut peak = [f64::NEG_INFINITY; BLOCK];
    for joint in joint.chunks_exact(BLOCK) {
        for (m, q) in peak.iter_mut().zip(&joint[..lanes]) {
            *m = if *q > *m { *q } else { *m };
        }
    }
    // A sample that no component reaches keeps density -inf and responsibilities zero.
    for m in &mut peak {
        *m = if *m == f64::NEG_INFINITY { 0.0 } else { *m };
    }
    let mut sum = [0.0; BLOCK];
    for joint in joint.chunks_exact_mut(BLOCK) {
        for ((q, m), s) in joint[..lanes].iter_mut().zip(&peak).zip(&mut sum) {
            *q = exp_nonpositive(*q - m);
            *s += *q;
        }
    }
    for ((d, s), m) in density.iter_mut().zip(&sum).zip(&peak) {
        *d = if *s > 0.0 { m + ln_positive(*s) } else { f64::NEG_INFINITY };
    }
    for s in &mut sum {
        *s = if *s > 0.0 { 1.0 / *s } else { 0.0 };
    }
    for joint in joint.chunks_exact_mut(BLOCK) {
        for (q, s) in joint[..lanes].iter_mut().zip(&sum) {
            *q *= s;
        }
    }
}

/// Adds `a_i . b_j` for `R` rows of `a` and `C` rows of `b` to interleaved sums `(R, C, LANES)`
/// that lie `stride` sums apart per row.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must be compiled inside the caller's target features")]
fn products<S: Simd, const R: usize, const C: usize>(
    simd: S,
    sums: &mut [f64],
    stride: usize,
    a: &[f64],
    b: &[f64],
    lanes: usize,
) {
    let per = LANES / S::F64_LANES;
    let a: [&[S::f64s]; R] = std::array::from_fn(|r| S::as_simd_f64s(&a[r * BLOCK..r * BLOCK + lanes]).0);
    let b: [&[S::f64s]; C] = std::array::from_fn(|c| S::as_simd_f64s(&b[c * BLOCK..c * BLOCK + lanes]).0);
    let sums = S::as_mut_simd_f64s(sums).0;
    for part in 0..per {
        let mut t: [[S::f64s; C]; R] =
            std::array::from_fn(|r| std::array::from_fn(|c| sums[(r * stride + c) * per + part]));
        let mut v = part;
        while v < lanes / S::F64_LANES {
            let bv: [S::f64s; C] = std::array::from_fn(|c| b[c][v]);
            for r in 0..R {
                let av = a[r][v];
                for c in 0..C {
                    t[r][c] = simd.mul_add_f64s(av, bv[c], t[r][c]);
                }
            }
            v += per;
        }
        for r in 0..R {
            for c in 0..C {
                sums[(r * stride + c) * per + part] = t[r][c];
            }
        }
    }
}

/// Sum of interleaved partial sums, in one fixed order.
fn fold(lanes: &[f64]) -> f64 {
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}

const TILE: usize = 4;

struct MomentsOf<'a> {
    blocks: &'a Blocks,
    range: Range<usize>,
    components: Components<'a>,
    centres: &'a [f64],
}

impl WithSimd for MomentsOf<'_> {
    type Output = Moments;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Moments {
        let Self { blocks, range, components, centres } = self;
        let (k, dim) = (components.offsets.len(), blocks.dim);
        // Rows of [z; 1], padded to whole tiles by rows of zeros.
        let p = (dim + 1).next_multiple_of(TILE);
        let mut scratch = Scratch::new(k, p);
        scratch.z[dim * BLOCK..(dim + 1) * BLOCK].fill(1.0);
        let mut sums = vec![0.0; k * p * p * LANES];
        let mut extra = vec![0.0; k * LANES];
        let mut likelihood = [0.0; LANES];
        for b in range {
            let lanes = blocks.lanes_in(b);
            let block = blocks.block(b);
            let weights = &blocks.weights[b * BLOCK..(b + 1) * BLOCK];
            expectation(simd, block, lanes, components, &mut scratch);
            for (d, w) in scratch.density[..lanes].chunks_exact(LANES).zip(weights.chunks_exact(LANES)) {
                for ((l, d), w) in likelihood.iter_mut().zip(d).zip(w) {
                    *l += if *w > 0.0 { w * d } else { 0.0 };
                }
            }
            for c in 0..k {
                let Scratch { joint, z, rz, .. } = &mut scratch;
                let r = &mut joint[c * BLOCK..c * BLOCK + lanes];
                for (r, w) in r.iter_mut().zip(weights) {
                    *r *= w;
                }
                let centre = &centres[c * dim..(c + 1) * dim];
                for (((x, m), z), rz) in
                    block.chunks_exact(BLOCK).zip(centre).zip(z.chunks_exact_mut(BLOCK)).zip(rz.chunks_exact_mut(BLOCK))
                {
                    for (((z, rz), x), r) in z[..lanes].iter_mut().zip(&mut rz[..lanes]).zip(x).zip(r.iter()) {
                        *z = x - m;
                        *rz = r * *z;
                    }
                }
                rz[dim * BLOCK..dim * BLOCK + lanes].copy_from_slice(r);
                let sums = &mut sums[c * p * p * LANES..(c + 1) * p * p * LANES];
                if components.diagonal {
                    let ones = &z[dim * BLOCK..];
                    for j in 0..dim {
                        let row = &rz[j * BLOCK..];
                        products::<S, 1, 1>(simd, &mut sums[(j * p + j) * LANES..], p, row, &z[j * BLOCK..], lanes);
                        products::<S, 1, 1>(simd, &mut sums[(dim * p + j) * LANES..], p, row, ones, lanes);
                    }
                    let row = &rz[dim * BLOCK..];
                    products::<S, 1, 1>(simd, &mut sums[(dim * p + dim) * LANES..], p, row, ones, lanes);
                } else {
                    for i in (0..p).step_by(TILE) {
                        let row = &rz[i * BLOCK..(i + TILE) * BLOCK];
                        for j in (0..=i).step_by(TILE) {
                            let column = &z[j * BLOCK..(j + TILE) * BLOCK];
                            let out = (i * p + j) * LANES;
                            if S::REGISTER_COUNT >= 32 {
                                products::<S, 4, 4>(simd, &mut sums[out..], p, row, column, lanes);
                            } else {
                                products::<S, 4, 2>(simd, &mut sums[out..], p, row, column, lanes);
                                products::<S, 4, 2>(
                                    simd,
                                    &mut sums[out + 2 * LANES..],
                                    p,
                                    row,
                                    &column[2 * BLOCK..],
                                    lanes,
                                );
                            }
                        }
                    }
                }
                if let Some(e) = &blocks.extra {
                    let e = &e[b * BLOCK..(b + 1) * BLOCK];
                    products::<S, 1, 1>(simd, &mut extra[c * LANES..(c + 1) * LANES], 1, &rz[dim * BLOCK..], e, lanes);
                }
            }
        }
        let mut out = Moments::zero(k, dim);
        out.log_likelihood = fold(&likelihood);
        for c in 0..k {
            let sum = |i: usize, j: usize| fold(&sums[((c * p + i) * p + j) * LANES..][..LANES]);
            out.mass[c] = sum(dim, dim);
            out.extra[c] = fold(&extra[c * LANES..(c + 1) * LANES]);
            for i in 0..dim {
                out.first[c * dim + i] = sum(dim, i);
                for j in 0..=i {
                    out.second[(c * dim + i) * dim + j] = sum(i, j);
                }
            }
        }
        out
    }
}

struct DensitiesOf<'a> {
    blocks: &'a Blocks,
    range: Range<usize>,
    components: Components<'a>,
    want_responsibilities: bool,
}

impl WithSimd for DensitiesOf<'_> {
    type Output = (Vec<f64>, Vec<f64>);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { blocks, range, components, want_responsibilities } = self;
        let k = components.offsets.len();
        let mut scratch = Scratch::new(k, blocks.dim);
        let mut densities = Vec::new();
        let mut responsibilities = Vec::new();
        for b in range {
            expectation(simd, blocks.block(b), blocks.lanes_in(b), components, &mut scratch);
            let n = BLOCK.min(blocks.len - b * BLOCK);
            densities.extend_from_slice(&scratch.density[..n]);
            if want_responsibilities {
                for lane in 0..n {
                    responsibilities.extend((0..k).map(|c| scratch.joint[c * BLOCK + lane]));
                }
            }
        }
        (densities, responsibilities)
    }
}
