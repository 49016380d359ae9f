//! Distances to centres and sums over labels, for the start of a fit.

use pulp::{Arch, Simd, WithSimd};

use super::blocks::{Aligned, Blocks};
use super::{BLOCK, LANES, fold};

impl Blocks {
    /// The smaller of `distances` and the squared distance of each sample to `centre`, and the weighted sum of that;
    /// both slices have [`Self::padded`] entries.
    pub(crate) fn closer(&self, centre: &[f64], distances: &[f64], out: &mut [f64]) -> f64 {
        Arch::new().dispatch(Closer { blocks: self, centre, distances, out })
    }

    /// The index of the nearest of `centres: (k, d)` for each sample, and the squared distance to it; both slices have
    /// [`Self::padded`] entries.
    pub(crate) fn nearest(&self, centres: &[f64], labels: &mut [f64], distances: &mut [f64]) {
        Arch::new().dispatch(Nearest { blocks: self, centres, labels, distances });
    }

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
    labels: &'a mut [f64],
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
    /// A register of samples per feature, then all centres.
    #[inline(always)]
    fn of<S: Simd, const D: usize>(self, simd: S) {
        let Self { blocks, centres, labels, distances } = self;
        let centres = centres.as_chunks::<D>().0;
        let zero = simd.splat_f64s(0.0);
        for b in 0..blocks.block_count() {
            let block = blocks.block(b);
            let range = b * BLOCK..b * BLOCK + blocks.lanes_in(b);
            let rows: [&[S::f64s]; D] = std::array::from_fn(
                #[inline(always)]
                |j| S::as_simd_f64s(&block[j * BLOCK..(j + 1) * BLOCK]).0,
            );
            let bests = S::as_mut_simd_f64s(&mut distances[range.clone()]).0;
            let found = S::as_mut_simd_f64s(&mut labels[range]).0;
            for (v, (best, label)) in bests.iter_mut().zip(found).enumerate() {
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
        }
    }

    #[inline(always)]
    fn of_any_dimension(self) {
        let Self { blocks, centres, labels, distances } = self;
        for b in 0..blocks.block_count() {
            let block = blocks.block(b);
            let range = b * BLOCK..b * BLOCK + blocks.lanes_in(b);
            let (best, label) = (&mut distances[range.clone()], &mut labels[range]);
            best.fill(f64::INFINITY);
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
                for ((d, l), best) in distance.iter().zip(&mut *label).zip(&mut *best) {
                    let closer = *d < *best;
                    *l = if closer { index } else { *l };
                    *best = if closer { *d } else { *best };
                }
            }
        }
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
