//! Joint log densities `ln pi_n N(x | n) = offset_n - |W_n (x - m_n)|^2 / 2` of the samples of a block.

use pulp::Simd;

use super::expectation::{Components, Scratch};
use super::{BLOCK, LANES, NEGLIGIBLE};

/// Fills `scratch.joint`, the largest value of each sample in `scratch.peak`, and in `scratch.found` the groups in
/// which each component may be worth its while; other groups of `joint` are left as they were. `hints` names for each
/// group the component to begin with, and keeps the one that was best: it changes the time that this takes, never the
/// result.
#[inline(always)]
pub(super) fn joint_densities<S: Simd>(
    simd: S,
    block: &[f64],
    lanes: usize,
    components: Components<'_>,
    hints: &mut [u16],
    scratch: &mut Scratch,
) {
    let dim = components.means.len() / components.offsets.len();
    let block = SmallBlock { block, groups: lanes / LANES, components, hints };
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
    hints: &'a mut [u16],
}

impl SmallBlock<'_> {
    #[inline(always)]
    fn of_dimension<S: Simd, const D: usize>(self, simd: S, scratch: &mut Scratch) {
        // Registers per group: fixed for a given register width, so only one arm is compiled.
        match LANES / S::F64_LANES {
            1 => self.of::<S, D, 1>(simd, scratch),
            2 => self.of::<S, D, 2>(simd, scratch),
            4 => self.of::<S, D, 4>(simd, scratch),
            _ => self.of::<S, D, LANES>(simd, scratch),
        }
    }

    /// Group by group, the component hinted at in full, which gives a bar; then of every component the first rows of
    /// `W`, which give a lower bound of the norm; then the rest of those whose bound leaves a sample above the bar,
    /// [`NEGLIGIBLE`] below the best. Rounding is monotone, so this drops nothing that the comparison of the full
    /// values would keep. The bounds are taken for all components without a branch, because branches on them could not
    /// be predicted.
    #[inline(always)]
    fn of<S: Simd, const D: usize, const P: usize>(self, simd: S, scratch: &mut Scratch) {
        let Self { block, groups, components, hints } = self;
        let Components { means, whitening, offsets, .. } = components;
        let k = offsets.len();
        let (means, rows) = (&means.as_chunks::<D>().0[..k], &whitening.as_chunks::<D>().0[..k * D]);
        let joint = &mut scratch.joint.as_chunks_mut::<BLOCK>().0[..k];
        let heads = &mut scratch.heads.as_chunks_mut::<LANES>().0[..k];
        let found = &mut scratch.found[..k];
        found.fill(0);
        let (zeros, nothing) = ([simd.splat_f64s(0.0); P], simd.splat_f64s(f64::NEG_INFINITY));
        let negligible = simd.splat_f64s(NEGLIGIBLE);
        let x: [&[S::f64s]; D] = std::array::from_fn(
            #[inline(always)]
            |j| S::as_simd_f64s(&block[j * BLOCK..(j + 1) * BLOCK]).0,
        );
        let peaks = S::as_mut_simd_f64s(&mut scratch.peak.0).0;
        for (g, hint) in hints.iter_mut().enumerate().take(groups) {
            let group = Group::<S, D, P>::load(simd, &x, g);
            let first = usize::from(*hint).min(k - 1);
            let norm = group.less(simd, &means[first]).add(simd, &rows[first * D..(first + 1) * D], 0, D, zeros);
            let q = density::<S, P>(simd, norm, offsets[first]);
            S::as_mut_simd_f64s(&mut joint[first][g * LANES..(g + 1) * LANES]).0.copy_from_slice(&q);
            found[first] |= 1 << g;
            let (mut best, mut peak, mut least) = (first, [nothing; P], [nothing; P]);
            for p in 0..P {
                peak[p] = simd.select_f64s(simd.greater_than_f64s(q[p], nothing), q[p], nothing);
                least[p] = simd.sub_f64s(peak[p], negligible);
            }
            // Components in sets of 64, one bit each.
            for (set, heads) in heads.chunks_mut(64).enumerate() {
                let start = set * 64;
                let mut reached = 0u64;
                let all = means[start..].iter().zip(rows[start * D..].chunks_exact(D)).zip(&offsets[start..]);
                for (i, (((mean, w), offset), head)) in all.zip(&mut *heads).enumerate() {
                    let norm = group.less(simd, mean).add(simd, w, 0, Self::head(D), zeros);
                    S::as_mut_simd_f64s(head).0.copy_from_slice(&norm);
                    let above = any_above::<S, P>(simd, &density::<S, P>(simd, norm, *offset), &least);
                    reached |= u64::from(above && start + i != first) << i;
                }
                while reached != 0 {
                    let i = reached.trailing_zeros() as usize;
                    let c = start + i;
                    reached &= reached - 1;
                    let mut norm = zeros;
                    norm.copy_from_slice(S::as_simd_f64s(&heads[i]).0);
                    let norm = group.less(simd, &means[c]).add(simd, &rows[c * D..(c + 1) * D], Self::head(D), D, norm);
                    let q = density::<S, P>(simd, norm, offsets[c]);
                    S::as_mut_simd_f64s(&mut joint[c][g * LANES..(g + 1) * LANES]).0.copy_from_slice(&q);
                    found[c] |= 1 << g;
                    best = if any_above::<S, P>(simd, &q, &peak) { c } else { best };
                    for p in 0..P {
                        peak[p] = simd.select_f64s(simd.greater_than_f64s(q[p], peak[p]), q[p], peak[p]);
                    }
                }
                for p in 0..P {
                    least[p] = simd.sub_f64s(peak[p], negligible);
                }
            }
            *hint = best as u16;
            peaks[g * P..(g + 1) * P].copy_from_slice(&peak);
        }
    }

    /// Rows of `W` that make the bound: less than half of the products.
    const fn head(d: usize) -> usize {
        if d > 3 { d / 2 } else { d }
    }
}

/// Eight samples in `P` registers per feature.
struct Group<S: Simd, const D: usize, const P: usize>([[S::f64s; P]; D]);

impl<S: Simd, const D: usize, const P: usize> Group<S, D, P> {
    #[inline(always)]
    fn load(simd: S, x: &[&[S::f64s]; D], g: usize) -> Self {
        let mut out = [[simd.splat_f64s(0.0); P]; D];
        for j in 0..D {
            out[j].copy_from_slice(&x[j][g * P..(g + 1) * P]);
        }
        Self(out)
    }

    #[inline(always)]
    fn less(&self, simd: S, mean: &[f64; D]) -> Self {
        let mut out = self.0;
        for j in 0..D {
            let m = simd.splat_f64s(mean[j]);
            for x in &mut out[j] {
                *x = simd.sub_f64s(*x, m);
            }
        }
        Self(out)
    }

    /// Adds the squares of rows `first .. last` of `W z`.
    #[inline(always)]
    fn add(&self, simd: S, w: &[[f64; D]], first: usize, last: usize, mut total: [S::f64s; P]) -> [S::f64s; P] {
        for i in first..last {
            let mut y = [simd.splat_f64s(0.0); P];
            for j in 0..=i {
                let w = simd.splat_f64s(w[i][j]);
                for (y, z) in y.iter_mut().zip(&self.0[j]) {
                    *y = simd.mul_add_f64s(w, *z, *y);
                }
            }
            for p in 0..P {
                total[p] = simd.mul_add_f64s(y[p], y[p], total[p]);
            }
        }
        total
    }
}

/// `offset - norm / 2`.
#[inline(always)]
fn density<S: Simd, const P: usize>(simd: S, norm: [S::f64s; P], offset: f64) -> [S::f64s; P] {
    let (half, offset) = (simd.splat_f64s(-0.5), simd.splat_f64s(offset));
    norm.map(
        #[inline(always)]
        |q| simd.mul_add_f64s(half, q, offset),
    )
}

/// Whether some `a` is above its `b`.
#[inline(always)]
fn any_above<S: Simd, const P: usize>(simd: S, a: &[S::f64s; P], b: &[S::f64s; P]) -> bool {
    let mut any = false;
    for p in 0..P {
        any |= simd.first_true_m64s(simd.greater_than_f64s(a[p], b[p])) < S::F64_LANES;
    }
    any
}

/// As [`joint_densities`], component by component, for diagonal covariances and for many features.
#[inline(always)]
fn any_dimension<S: Simd>(simd: S, block: &[f64], lanes: usize, components: Components<'_>, scratch: &mut Scratch) {
    const GROUP: usize = 8;
    let k = components.offsets.len();
    let dim = components.means.len() / k;
    let registers = lanes / S::F64_LANES;
    let Scratch { joint, z, peak, found, .. } = scratch;
    let peak = &mut peak.0;
    peak.fill(f64::NEG_INFINITY);
    found.fill(u32::MAX >> (u32::BITS as usize - lanes / LANES));
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
