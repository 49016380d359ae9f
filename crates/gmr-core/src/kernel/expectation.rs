//! The E step of one block: log densities and responsibilities.

use pulp::Simd;

use super::blocks::{Groups, Row, groups, groups_mut};
use super::norms::joint_densities;
use super::{BLOCK, GROUPS, LANES, NEGLIGIBLE};
use crate::scalar::{exp_above, ln_positive};
use crate::wide::Aligned;

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

/// Buffers of one chunk.
#[derive(Debug)]
pub(super) struct Scratch {
    /// Log densities, then responsibilities: `(k, BLOCK)`.
    pub(super) joint: Aligned,
    /// Centred samples `(d, BLOCK)`, for dimensions beyond the registers.
    pub(super) z: Aligned,
    /// Largest joint log density per sample.
    pub(super) peak: Row,
    /// Log density per sample.
    pub(super) density: Row,
    /// Groups of samples, one bit each, in which each component has responsibilities.
    pub(super) active: Vec<u32>,
}

impl Scratch {
    pub(super) fn new(k: usize, d: usize) -> Self {
        Self {
            joint: Aligned::zeros(k * BLOCK),
            z: Aligned::zeros(d * BLOCK),
            peak: Row([0.0; BLOCK]),
            density: Row([0.0; BLOCK]),
            active: vec![0; k],
        }
    }
}

/// Fills `scratch.joint` with responsibilities, which sum to the weight of the sample over components, and
/// `scratch.density` with log densities, for one block of as many samples as there are weights.
#[inline(always)]
pub(super) fn expectation<S: Simd>(
    simd: S,
    block: &[f64],
    weights: &[f64],
    components: Components<'_>,
    scratch: &mut Scratch,
) {
    let lanes = weights.len();
    joint_densities(simd, block, lanes, components, scratch);
    let Scratch { joint, peak: Row(peak), density: Row(density), active, .. } = scratch;
    // A sample that no component reaches keeps density -inf and responsibilities zero.
    for m in &mut peak[..lanes] {
        *m = if *m == f64::NEG_INFINITY { 0.0 } else { *m };
    }
    let Row(mut sum) = Row([0.0; BLOCK]);
    let Row(mut packed) = Row([0.0; BLOCK]);
    let count = (lanes / LANES).min(GROUPS);
    for (joint, active) in groups_mut(joint).iter_mut().zip(active.iter_mut()) {
        // The groups that matter, side by side, without a branch on each: none could be predicted.
        let (listed, list) = pack(simd, joint, &groups(peak)[0], count, &mut groups_mut(&mut packed)[0]);
        for e in &mut packed[..listed * LANES] {
            *e = exp_above(-NEGLIGIBLE, *e);
        }
        joint.fill([0.0; LANES]);
        *active = 0;
        for (values, g) in groups(&packed)[0].iter().zip(&list).take(listed) {
            let g = usize::from(*g) % GROUPS;
            joint[g] = *values;
            for part in 0..LANES / S::F64_LANES {
                let sum = &mut S::as_mut_simd_f64s(&mut groups_mut(&mut sum)[0][g]).0[part];
                *sum = simd.add_f64s(*sum, S::as_simd_f64s(values).0[part]);
            }
            *active |= 1 << g;
        }
    }
    for ((d, s), m) in density[..lanes].iter_mut().zip(&sum).zip(&*peak) {
        *d = if *s > 0.0 { m + ln_positive(*s) } else { f64::NEG_INFINITY };
    }
    for (s, w) in sum.iter_mut().zip(weights) {
        *s = if *s > 0.0 { w / *s } else { 0.0 };
    }
    for (joint, active) in groups_mut(joint).iter_mut().zip(active.iter()) {
        let mut rest = *active;
        while rest != 0 {
            let g = rest.trailing_zeros() as usize % GROUPS;
            rest &= rest - 1;
            for part in 0..LANES / S::F64_LANES {
                let scale = S::as_simd_f64s(&groups(&sum)[0][g]).0[part];
                let value = &mut S::as_mut_simd_f64s(&mut joint[g]).0[part];
                *value = simd.mul_f64s(*value, scale);
            }
        }
    }
}

/// Writes how far the first `count` groups lie below the peaks, one after the other, those left out in which all samples are
/// negligible; returns how many there are, and which.
#[inline(always)]
fn pack<S: Simd>(simd: S, joint: &Groups, peaks: &Groups, count: usize, packed: &mut Groups) -> (usize, [u8; GROUPS]) {
    let bar = simd.splat_f64s(-NEGLIGIBLE);
    let (mut listed, mut list) = (0, [0; GROUPS]);
    for g in 0..count {
        let mut any = false;
        let at = listed % GROUPS;
        for part in 0..LANES / S::F64_LANES {
            let below = simd.sub_f64s(S::as_simd_f64s(&joint[g]).0[part], S::as_simd_f64s(&peaks[g]).0[part]);
            S::as_mut_simd_f64s(&mut packed[at]).0[part] = below;
            any |= simd.first_true_m64s(simd.greater_than_f64s(below, bar)) < S::F64_LANES;
        }
        list[at] = g as u8;
        listed += usize::from(any);
    }
    (listed, list)
}
