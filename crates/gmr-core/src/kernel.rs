//! One pass over the data: log densities, responsibilities and weighted moments.
//!
//! Samples are stored feature-major in blocks of [`BLOCK`], so that one vector register holds one
//! feature of several samples. Per block and component the pass forms `z = x - mu`,
//! `y = W z` with `W = L^-1` (one triangular product), `log N = offset - y'y / 2`, then the
//! log-sum-exp over components, then the lower triangle of `sum r [z; 1][z; 1]'`, which holds the
//! zeroth, first and second moments in one product. Moments are taken about a centre given per
//! component (its current mean), never about the origin, so that no digits cancel.
//!
//! A component whose log density lies [`NEGLIGIBLE`] below the best one for all samples of a group of [`LANES`] is left
//! out of that group: neither its exponentials nor its moments are formed.
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
/// Groups of [`LANES`] samples per block.
const GROUPS: usize = BLOCK / LANES;
/// Responsibilities below `exp(-100) = 4e-44` are zero where a whole group of samples has them. A component keeps at
/// least 1e-10 of the mass, so what this leaves out of its moments is 1e-33 of them, far below rounding.
const NEGLIGIBLE: f64 = 100.0;
/// Blocks per unit of parallel work: 4096 samples, some hundred microseconds.
const CHUNK_BLOCKS: usize = 32;

/// Doubles that begin on a cache line, so that no register load straddles two.
#[derive(Debug)]
struct Aligned {
    storage: Vec<f64>,
    offset: usize,
    len: usize,
}

impl Aligned {
    fn zeros(len: usize) -> Self {
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
struct Row([f64; BLOCK]);

/// Samples in feature-major blocks, padded to whole lanes with weight zero.
#[derive(Debug)]
pub(crate) struct Blocks {
    len: usize,
    dim: usize,
    values: Aligned,
    weights: Aligned,
    /// One more number per sample whose responsibility-weighted sum is wanted.
    extra: Option<Aligned>,
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
    fn block_count(&self) -> usize {
        self.len.div_ceil(BLOCK)
    }

    /// Samples of block `b`, rounded up to whole lanes.
    #[inline(always)]
    fn lanes_in(&self, b: usize) -> usize {
        (self.len - b * BLOCK).min(BLOCK).next_multiple_of(LANES)
    }

    #[inline(always)]
    fn block(&self, b: usize) -> &[f64] {
        &self.values[b * self.dim * BLOCK..(b + 1) * self.dim * BLOCK]
    }

    /// Numbers per sample, padding included.
    pub(crate) fn padded(&self) -> usize {
        self.block_count() * BLOCK
    }

    /// The smaller of `distances` and the squared distance of each sample to `centre`, and the weighted sum of that;
    /// both slices have [`Self::padded`] entries.
    pub(crate) fn closer(&self, centre: &[f64], distances: &[f64], out: &mut [f64]) -> f64 {
        Arch::new().dispatch(Closer { blocks: self, centre, distances, out })
    }

    /// Squared distance of each sample to its nearest centre and the index of that centre, for
    /// `centres: (k, d)`; `labels` and `distances` have one entry per sample.
    pub(crate) fn nearest(&self, centres: &[f64], labels: &mut [u32], distances: &mut [f64]) {
        Arch::new().dispatch(Nearest { blocks: self, centres, labels, distances });
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
    labels: &'a mut [u32],
    distances: &'a mut [f64],
}

impl WithSimd for Nearest<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self.blocks.dim {
            1 => self.of::<S, 1>(simd),
            2 => self.of::<S, 2>(simd),
            3 => self.of::<S, 3>(simd),
            4 => self.of::<S, 4>(simd),
            5 => self.of::<S, 5>(simd),
            6 => self.of::<S, 6>(simd),
            7 => self.of::<S, 7>(simd),
            8 => self.of::<S, 8>(simd),
            _ => self.of_any_dimension(),
        }
    }
}

impl Nearest<'_> {
    /// A group of samples in registers, then all centres.
    #[inline(always)]
    fn of<S: Simd, const D: usize>(self, simd: S) {
        let Self { blocks, centres, labels, distances } = self;
        let centres = centres.as_chunks::<D>().0;
        let zero = simd.splat_f64s(0.0);
        for b in 0..blocks.block_count() {
            let block = blocks.block(b);
            let range = b * BLOCK..blocks.len.min((b + 1) * BLOCK);
            let (Row(mut best), Row(mut label)) = (Row([0.0; BLOCK]), Row([0.0; BLOCK]));
            let rows: [&[S::f64s]; D] = std::array::from_fn(
                #[inline(always)]
                |j| S::as_simd_f64s(&block[j * BLOCK..(j + 1) * BLOCK]).0,
            );
            let bests = S::as_mut_simd_f64s(&mut best).0;
            let found = S::as_mut_simd_f64s(&mut label).0;
            let registers = range.len().next_multiple_of(LANES) / S::F64_LANES;
            for (v, (best, label)) in bests.iter_mut().zip(found).take(registers).enumerate() {
                let mut x = [zero; D];
                for j in 0..D {
                    x[j] = rows[j][v];
                }
                let mut least = simd.splat_f64s(f64::INFINITY);
                let mut at = zero;
                for (k, centre) in centres.iter().enumerate() {
                    let mut d = zero;
                    for j in 0..D {
                        let z = simd.sub_f64s(x[j], simd.splat_f64s(centre[j]));
                        d = simd.mul_add_f64s(z, z, d);
                    }
                    let closer = simd.less_than_f64s(d, least);
                    at = simd.select_f64s(closer, simd.splat_f64s(k as f64), at);
                    least = simd.select_f64s(closer, d, least);
                }
                (*best, *label) = (least, at);
            }
            let n = range.len();
            distances[range.clone()].copy_from_slice(&best[..n]);
            for (out, l) in labels[range].iter_mut().zip(&label) {
                // 2^52 + l has l in its low bits; a plain cast would saturate, which vectors cannot do.
                *out = (l + 4_503_599_627_370_496.0).to_bits() as u32;
            }
        }
    }

    #[inline(always)]
    fn of_any_dimension(self) {
        let Self { blocks, centres, labels, distances } = self;
        for b in 0..blocks.block_count() {
            let block = blocks.block(b);
            let mut best = [f64::INFINITY; BLOCK];
            let mut label = [0.0; BLOCK];
            for (k, centre) in centres.chunks_exact(blocks.dim).enumerate() {
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
            let range = b * BLOCK..blocks.len.min((b + 1) * BLOCK);
            let n = range.len();
            distances[range.clone()].copy_from_slice(&best[..n]);
            for (out, l) in labels[range].iter_mut().zip(&label) {
                *out = *l as u32;
            }
        }
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

/// `sum w ln p(x)`.
pub(crate) fn log_likelihood(blocks: &Blocks, components: Components<'_>) -> f64 {
    let (densities, _) = densities(blocks, components, false);
    let weighted = densities.iter().zip(blocks.weights.iter()).filter(|(_, w)| **w > 0.0);
    weighted.map(|(d, w)| w * d).sum()
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
    joint: Aligned,
    /// Centred samples `(d, BLOCK)`, for dimensions beyond the registers.
    z: Aligned,
    /// Log density per sample.
    density: Row,
    /// Groups of samples that each component takes part in.
    active: Vec<Active>,
}

/// Some of the groups of a block, in ascending order.
#[derive(Debug, Clone, Copy)]
struct Active {
    groups: [u8; GROUPS],
    count: usize,
}

impl Active {
    const NONE: Self = Self { groups: [0; GROUPS], count: 0 };

    const ALL: Self = {
        let mut groups = [0; GROUPS];
        let mut g = 0;
        while g < GROUPS {
            groups[g] = g as u8;
            g += 1;
        }
        Self { groups, count: GROUPS }
    };

    #[inline(always)]
    fn list(&self) -> &[u8] {
        &self.groups[..self.count]
    }
}

impl Scratch {
    fn new(k: usize, d: usize) -> Self {
        Self {
            joint: Aligned::zeros(k * BLOCK),
            z: Aligned::zeros(d * BLOCK),
            density: Row([0.0; BLOCK]),
            active: vec![Active::NONE; k],
        }
    }
}

/// `|W (x - m)|^2` of one block for a small dimension, everything in registers; `G` registers of samples share
/// each load of `W`.
#[inline(always)]
fn small_norms<S: Simd, const D: usize>(simd: S, block: &[f64], mean: &[f64], w: &[f64], out: &mut [f64]) {
    const G: usize = 2;
    let out = S::as_mut_simd_f64s(out).0;
    let x: [&[S::f64s]; D] = std::array::from_fn(
        #[inline(always)]
        |j| &S::as_simd_f64s(&block[j * BLOCK..(j + 1) * BLOCK]).0[..out.len()],
    );
    let mean: &[f64; D] = mean.try_into().expect("one mean per dimension");
    let mut first = 0;
    // Lane counts divide eight and blocks are whole groups of eight samples, so with fewer than eight lanes the
    // registers come in pairs; with eight, one may be left over.
    while first + G <= out.len() {
        let q = norms_of::<S, D, G>(simd, &x, first, mean, w);
        out[first..first + G].copy_from_slice(&q);
        first += G;
    }
    if first < out.len() {
        out[first] = norms_of::<S, D, 1>(simd, &x, first, mean, w)[0];
    }
}

#[inline(always)]
fn norms_of<S: Simd, const D: usize, const G: usize>(
    simd: S,
    x: &[&[S::f64s]; D],
    first: usize,
    mean: &[f64; D],
    w: &[f64],
) -> [S::f64s; G] {
    let zero = simd.splat_f64s(0.0);
    let mut z = [[zero; G]; D];
    for j in 0..D {
        let m = simd.splat_f64s(mean[j]);
        let x = &x[j][first..first + G];
        for g in 0..G {
            z[j][g] = simd.sub_f64s(x[g], m);
        }
    }
    let mut total = [zero; G];
    for i in 0..D {
        let row = &w[i * D..(i + 1) * D];
        let mut y = [zero; G];
        for j in 0..=i {
            let w = simd.splat_f64s(row[j]);
            for g in 0..G {
                y[g] = simd.mul_add_f64s(w, z[j][g], y[g]);
            }
        }
        for g in 0..G {
            total[g] = simd.mul_add_f64s(y[g], y[g], total[g]);
        }
    }
    total
}

/// `total[g] += |W z|^2` for `G` consecutive registers of samples.
#[inline(always)]
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
fn expectation<S: Simd>(simd: S, block: &[f64], lanes: usize, components: Components<'_>, scratch: &mut Scratch) {
    const GROUP: usize = 8;
    let k = components.offsets.len();
    let dim = components.means.len() / k;
    let registers = lanes / S::F64_LANES;
    let Scratch { joint, z, density: Row(density), active } = scratch;
    let Row(mut peak) = Row([f64::NEG_INFINITY; BLOCK]);
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
            let w = &components.whitening[c * dim * dim..(c + 1) * dim * dim];
            match dim {
                1 => small_norms::<S, 1>(simd, block, mean, w, joint),
                2 => small_norms::<S, 2>(simd, block, mean, w, joint),
                3 => small_norms::<S, 3>(simd, block, mean, w, joint),
                4 => small_norms::<S, 4>(simd, block, mean, w, joint),
                5 => small_norms::<S, 5>(simd, block, mean, w, joint),
                6 => small_norms::<S, 6>(simd, block, mean, w, joint),
                7 => small_norms::<S, 7>(simd, block, mean, w, joint),
                8 => small_norms::<S, 8>(simd, block, mean, w, joint),
                _ => {
                    for ((x, m), z) in block.chunks_exact(BLOCK).zip(mean).zip(z.chunks_exact_mut(BLOCK)) {
                        for (z, x) in z[..lanes].iter_mut().zip(x) {
                            *z = x - m;
                        }
                    }
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
            }
        }
        for (q, m) in joint.iter_mut().zip(&mut peak) {
            *q = (-0.5f64).mul_add(*q, offset);
            *m = if *q > *m { *q } else { *m };
        }
    }
    // A sample that no component reaches keeps density -inf and responsibilities zero.
    for m in &mut peak {
        *m = if *m == f64::NEG_INFINITY { 0.0 } else { *m };
    }
    let Row(mut least) = Row(peak);
    for m in &mut least {
        *m -= NEGLIGIBLE;
    }
    let Row(mut sum) = Row([0.0; BLOCK]);
    let Row(mut exponent) = Row([0.0; BLOCK]);
    let peaks = peak.as_chunks::<LANES>().0;
    let leasts = least.as_chunks::<LANES>().0;
    for (joint, active) in joint.chunks_exact_mut(BLOCK).zip(active.iter_mut()) {
        let packed = exponent.as_chunks_mut::<LANES>().0;
        let groups = joint[..lanes].as_chunks_mut::<LANES>().0;
        let mut found = 0u32;
        for (g, (q, least)) in groups.iter().zip(leasts).enumerate() {
            found |= u32::from(any_above(simd, q, least)) << g;
        }
        if found == (1u32 << groups.len()) - 1 {
            // Every group takes part: in place.
            *active = Active::ALL;
            active.count = groups.len();
            for (q, m) in joint[..lanes].iter_mut().zip(&peak) {
                *q = exp_nonpositive(*q - m);
            }
            for (s, q) in sum[..lanes].iter_mut().zip(&joint[..lanes]) {
                *s += q;
            }
            continue;
        }
        active.count = 0;
        while found != 0 {
            let g = found.trailing_zeros() as usize;
            found &= found - 1;
            let (q, m) = (S::as_simd_f64s(&groups[g]).0, S::as_simd_f64s(&peaks[g]).0);
            let e = S::as_mut_simd_f64s(&mut packed[active.count]).0;
            for ((e, q), m) in e.iter_mut().zip(q).zip(m) {
                *e = simd.sub_f64s(*q, *m);
            }
            active.groups[active.count] = g as u8;
            active.count += 1;
        }
        groups.fill([0.0; LANES]);
        for e in &mut exponent[..active.count * LANES] {
            *e = exp_nonpositive(*e);
        }
        let sums = sum.as_chunks_mut::<LANES>().0;
        for (packed, g) in exponent.as_chunks::<LANES>().0.iter().zip(active.list()) {
            let g = usize::from(*g);
            groups[g] = *packed;
            for (s, v) in S::as_mut_simd_f64s(&mut sums[g]).0.iter_mut().zip(S::as_simd_f64s(packed).0) {
                *s = simd.add_f64s(*s, *v);
            }
        }
    }
    for ((d, s), m) in density[..lanes].iter_mut().zip(&sum).zip(&peak) {
        *d = if *s > 0.0 { m + ln_positive(*s) } else { f64::NEG_INFINITY };
    }
    for s in &mut sum[..lanes] {
        *s = if *s > 0.0 { 1.0 / *s } else { 0.0 };
    }
    let sums = sum.as_chunks::<LANES>().0;
    for (joint, active) in joint.chunks_exact_mut(BLOCK).zip(active.iter()) {
        let groups = joint.as_chunks_mut::<LANES>().0;
        for g in active.list() {
            let (q, s) = (&mut groups[usize::from(*g)], &sums[usize::from(*g)]);
            for (q, s) in S::as_mut_simd_f64s(q).0.iter_mut().zip(S::as_simd_f64s(s).0) {
                *q = simd.mul_f64s(*q, *s);
            }
        }
    }
}

/// Whether some `a` is above its `b`.
#[inline(always)]
fn any_above<S: Simd>(simd: S, a: &[f64; LANES], b: &[f64; LANES]) -> bool {
    let mut any = false;
    for (a, b) in S::as_simd_f64s(a).0.iter().zip(S::as_simd_f64s(b).0) {
        any |= simd.first_true_m64s(simd.greater_than_f64s(*a, *b)) < S::F64_LANES;
    }
    any
}

/// Adds `a . b` to interleaved sums.
#[inline(always)]
fn dot<S: Simd>(simd: S, sums: &mut [f64], a: &[f64], b: &[f64]) {
    let per = LANES / S::F64_LANES;
    let (a, b) = (S::as_simd_f64s(a).0, S::as_simd_f64s(b).0);
    let sums = S::as_mut_simd_f64s(&mut sums[..LANES]).0;
    for (a, b) in a.chunks_exact(per).zip(b.chunks_exact(per)) {
        for ((s, a), b) in sums.iter_mut().zip(a).zip(b) {
            *s = simd.mul_add_f64s(*a, *b, *s);
        }
    }
}

/// Four rows of `[x; 1; 0 ..]` with what is subtracted from them.
struct TileRows<'a, S: Simd> {
    rows: [&'a [S::f64s]; TILE],
    centres: [S::f64s; TILE],
}

/// Adds `sum r z_i z_j` over a tile of four rows and four columns to interleaved sums that lie `p` sums apart per
/// row, for the groups of samples listed. On the diagonal only `j <= i` is summed.
#[inline(always)]
fn tile<S: Simd, const DIAGONAL: bool>(
    simd: S,
    sums: &mut [f64],
    p: usize,
    rows: &TileRows<'_, S>,
    columns: &TileRows<'_, S>,
    r: &[S::f64s],
    groups: &[u8],
) {
    let per = LANES / S::F64_LANES;
    let sums = S::as_mut_simd_f64s(sums).0;
    let zero = simd.splat_f64s(0.0);
    for part in 0..per {
        let mut t = [[zero; TILE]; TILE];
        for i in 0..TILE {
            for j in 0..TILE {
                if !DIAGONAL || j <= i {
                    t[i][j] = sums[(i * p + j) * per + part];
                }
            }
        }
        for group in groups {
            let v = usize::from(*group) * per + part;
            let mut a = [zero; TILE];
            let mut b = [zero; TILE];
            for i in 0..TILE {
                a[i] = simd.sub_f64s(rows.rows[i][v], rows.centres[i]);
                b[i] = if DIAGONAL { a[i] } else { simd.sub_f64s(columns.rows[i][v], columns.centres[i]) };
            }
            for i in 0..TILE {
                let a = simd.mul_f64s(a[i], r[v]);
                for j in 0..TILE {
                    if !DIAGONAL || j <= i {
                        t[i][j] = simd.mul_add_f64s(a, b[j], t[i][j]);
                    }
                }
            }
        }
        for i in 0..TILE {
            for j in 0..TILE {
                if !DIAGONAL || j <= i {
                    sums[(i * p + j) * per + part] = t[i][j];
                }
            }
        }
    }
}

/// Natural logarithm of each, for positive normal numbers.
pub(crate) fn ln_all(values: &mut [f64]) {
    struct LnAll<'a>(&'a mut [f64]);
    impl WithSimd for LnAll<'_> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            for v in self.0 {
                *v = ln_positive(*v);
            }
        }
    }
    Arch::new().dispatch(LnAll(values));
}

/// Sum of interleaved partial sums, in one fixed order.
fn fold(lanes: &[f64]) -> f64 {
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}

/// Rows and columns per tile: sixteen sums fit the registers of AVX-512.
const TILE: usize = 4;

/// Rows `first .. first + 4` of `[x; 1; 0 ..]`, the first `registers` registers of a block.
#[inline(always)]
fn tile_rows<'a, S: Simd>(
    simd: S,
    block: &'a [f64],
    centre: &[f64],
    first: usize,
    registers: usize,
    ones: &'a Row,
    zeros: &'a Row,
) -> TileRows<'a, S> {
    let dim = centre.len();
    let mut rows = [&S::as_simd_f64s(&zeros.0).0[..registers]; TILE];
    let mut centres = [simd.splat_f64s(0.0); TILE];
    for t in 0..TILE {
        let i = first + t;
        if i < dim {
            rows[t] = &S::as_simd_f64s(&block[i * BLOCK..(i + 1) * BLOCK]).0[..registers];
            centres[t] = simd.splat_f64s(centre[i]);
        } else if i == dim {
            rows[t] = &S::as_simd_f64s(&ones.0).0[..registers];
        }
    }
    TileRows { rows, centres }
}

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
        let mut scratch = Scratch::new(k, dim);
        let mut sums = Aligned::zeros(k * p * p * LANES);
        let mut extra = Aligned::zeros(k * LANES);
        let mut likelihood = [0.0; LANES];
        let (ones, zeros) = (Row([1.0; BLOCK]), Row([0.0; BLOCK]));
        let (Row(mut z), Row(mut rz)) = (zeros, zeros);
        for b in range {
            let lanes = blocks.lanes_in(b);
            let block = blocks.block(b);
            let weights = &blocks.weights[b * BLOCK..(b + 1) * BLOCK];
            expectation(simd, block, lanes, components, &mut scratch);
            for (d, w) in scratch.density.0[..lanes].chunks_exact(LANES).zip(weights.chunks_exact(LANES)) {
                for ((l, d), w) in likelihood.iter_mut().zip(d).zip(w) {
                    *l += if *w > 0.0 { w * d } else { 0.0 };
                }
            }
            for c in 0..k {
                let groups = &scratch.active[c];
                if groups.count == 0 {
                    continue;
                }
                let r = &mut scratch.joint[c * BLOCK..c * BLOCK + lanes];
                for (r, w) in r.iter_mut().zip(weights) {
                    *r *= w;
                }
                let centre = &centres[c * dim..(c + 1) * dim];
                let sums = &mut sums[c * p * p * LANES..(c + 1) * p * p * LANES];
                if components.diagonal {
                    for (j, (x, m)) in block.chunks_exact(BLOCK).zip(centre).enumerate() {
                        for (((z, rz), x), r) in z[..lanes].iter_mut().zip(&mut rz).zip(x).zip(r.iter()) {
                            *z = x - m;
                            *rz = r * *z;
                        }
                        dot(simd, &mut sums[(j * p + j) * LANES..], &rz[..lanes], &z[..lanes]);
                        dot(simd, &mut sums[(dim * p + j) * LANES..], &rz[..lanes], &ones.0[..lanes]);
                    }
                    dot(simd, &mut sums[(dim * p + dim) * LANES..], r, &ones.0[..lanes]);
                } else {
                    let r = S::as_simd_f64s(r).0;
                    for i in (0..p).step_by(TILE) {
                        let rows = tile_rows::<S>(simd, block, centre, i, r.len(), &ones, &zeros);
                        for j in (0..i).step_by(TILE) {
                            let columns = tile_rows::<S>(simd, block, centre, j, r.len(), &ones, &zeros);
                            tile::<S, false>(
                                simd,
                                &mut sums[(i * p + j) * LANES..],
                                p,
                                &rows,
                                &columns,
                                r,
                                groups.list(),
                            );
                        }
                        tile::<S, true>(simd, &mut sums[(i * p + i) * LANES..], p, &rows, &rows, r, groups.list());
                    }
                }
                if let Some(e) = &blocks.extra {
                    let r = &scratch.joint[c * BLOCK..c * BLOCK + lanes];
                    dot(simd, &mut extra[c * LANES..(c + 1) * LANES], r, &e[b * BLOCK..b * BLOCK + lanes]);
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
            densities.extend_from_slice(&scratch.density.0[..n]);
            if want_responsibilities {
                for lane in 0..n {
                    responsibilities.extend((0..k).map(|c| scratch.joint[c * BLOCK + lane]));
                }
            }
        }
        (densities, responsibilities)
    }
}
