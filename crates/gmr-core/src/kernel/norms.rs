//! Joint log densities `ln pi_n N(x | n) = offset_n - |W_n (x - m_n)|^2 / 2` of the samples of a block.

use pulp::Simd;

use super::blocks::{groups, groups_mut};
use super::expectation::{Components, Scratch};
use super::{BLOCK, GROUPS, LANES};
use crate::wide::{Wide, in_registers};

/// Fills `scratch.joint` and the largest value of each sample in `scratch.peak`.
#[inline(always)]
pub(super) fn joint_densities<S: Simd>(
    simd: S,
    block: &[f64],
    lanes: usize,
    components: Components<'_>,
    scratch: &mut Scratch,
) {
    let dim = components.means.len() / components.offsets.len();
    let block = SmallBlock { block, groups: lanes / LANES, components };
    match (components.diagonal, dim) {
        (false, 1) => block.of_dimension::<S, 1>(simd, scratch),
        (false, 2) => block.of_dimension::<S, 2>(simd, scratch),
        (false, 3) => block.of_dimension::<S, 3>(simd, scratch),
        (false, 4) => block.of_dimension::<S, 4>(simd, scratch),
        (false, 5) => block.of_dimension::<S, 5>(simd, scratch),
        (false, 6) => block.of_dimension::<S, 6>(simd, scratch),
        (false, 7) => block.of_dimension::<S, 7>(simd, scratch),
        (false, 8) => block.of_dimension::<S, 8>(simd, scratch),
        _ => any_dimension(simd, block.block, lanes, components, scratch),
    }
}

/// A block with so few features that a group of its samples fits the registers.
struct SmallBlock<'a> {
    block: &'a [f64],
    groups: usize,
    components: Components<'a>,
}

impl SmallBlock<'_> {
    #[inline(always)]
    fn of_dimension<S: Simd, const D: usize>(self, simd: S, scratch: &mut Scratch) {
        in_registers!(self.of < S, D > (simd, scratch));
    }

    /// Component by component, every group in full: leaving a component out of the groups it does not reach takes a
    /// branch that nothing predicts, which costs more than the products. Two groups at a time and `W` column by column,
    /// so that a product never waits for the one before it.
    #[inline(always)]
    fn of<S: Simd, const D: usize, const P: usize>(self, simd: S, scratch: &mut Scratch) {
        let Self { block, groups: count, components } = self;
        let Components { means, whitening, offsets, .. } = components;
        let rows = groups(block).as_chunks::<D>().0[0].each_ref().map(|row| row.as_chunks::<TWO>().0);
        let whitening = whitening.as_chunks::<D>().0.as_chunks::<D>().0;
        let pairs = count.div_ceil(TWO).min(GROUPS / TWO);
        let peaks = groups_mut(&mut scratch.peak.0)[0].as_chunks_mut::<TWO>().0;
        peaks.fill([[f64::NEG_INFINITY; LANES]; TWO]);
        let (zero, half) = (Wide::<S, P>::splat(simd, 0.0), Wide::splat(simd, -0.5));
        let joint = groups_mut(&mut scratch.joint);
        for (((joint, mean), w), offset) in joint.iter_mut().zip(means.as_chunks::<D>().0).zip(whitening).zip(offsets) {
            let joint = joint.as_chunks_mut::<TWO>().0;
            let offset = Wide::splat(simd, *offset);
            for pair in 0..pairs {
                let mut y = [[zero; TWO]; D];
                let mut norm = [zero; TWO];
                for j in 0..D {
                    let centre = Wide::splat(simd, mean[j]);
                    for t in 0..TWO {
                        let z = Wide::load(simd, &rows[j][pair][t]) - centre;
                        for i in 0..D {
                            if i >= j {
                                y[i][t] = Wide::splat(simd, w[i][j]).mul_add(z, y[i][t]);
                            }
                        }
                        norm[t] = y[j][t].mul_add(y[j][t], norm[t]);
                    }
                }
                for t in 0..TWO {
                    let q = half.mul_add(norm[t], offset);
                    q.store(&mut joint[pair][t]);
                    q.larger(Wide::load(simd, &peaks[pair][t])).store(&mut peaks[pair][t]);
                }
            }
        }
    }
}

/// Groups that are worked on together.
const TWO: usize = 2;

/// As [`joint_densities`], component by component, for diagonal covariances and for many features.
#[inline(always)]
fn any_dimension<S: Simd>(simd: S, block: &[f64], lanes: usize, components: Components<'_>, scratch: &mut Scratch) {
    const GROUP: usize = 8;
    let k = components.offsets.len();
    let dim = components.means.len() / k;
    let registers = lanes / S::F64_LANES;
    let Scratch { joint, z, peak, .. } = scratch;
    let peak = &mut peak.0;
    peak.fill(f64::NEG_INFINITY);
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
        for (q, m) in joint.iter_mut().zip(&mut *peak) {
            *q = (-0.5f64).mul_add(*q, offset);
            *m = if *q > *m { *q } else { *m };
        }
    }
}

/// `|W z|^2` for `G` consecutive registers of samples.
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
