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
    for (joint, active) in joint.as_chunks_mut::<BLOCK>().0.iter_mut().zip(active.iter_mut()) {
        for (q, m) in joint[..lanes].iter_mut().zip(&peak[..lanes]) {
            *q = exp_above(-NEGLIGIBLE, *q - *m);
        }
        *active = add_up(simd, &groups(joint)[0], &mut groups_mut(&mut sum)[0], lanes / LANES);
    }
    for ((d, s), m) in density[..lanes].iter_mut().zip(&sum).zip(&*peak) {
        *d = if *s > 0.0 { m + ln_positive(*s) } else { f64::NEG_INFINITY };
    }
    for (s, w) in sum.iter_mut().zip(weights) {
        *s = if *s > 0.0 { w / *s } else { 0.0 };
    }
    for joint in joint.chunks_exact_mut(BLOCK) {
        for (q, s) in joint[..lanes].iter_mut().zip(&sum) {
            *q *= s;
        }
    }
}

/// Adds `count` groups to the sums, and tells which of them hold anything, one bit each.
#[inline(always)]
fn add_up<S: Simd>(simd: S, values: &Groups, sums: &mut Groups, count: usize) -> u32 {
    let zero = simd.splat_f64s(0.0);
    let mut active = 0;
    for g in 0..count.min(GROUPS) {
        let mut any = false;
        for part in 0..LANES / S::F64_LANES {
            let value = S::as_simd_f64s(&values[g]).0[part];
            let sum = &mut S::as_mut_simd_f64s(&mut sums[g]).0[part];
            *sum = simd.add_f64s(*sum, value);
            any |= simd.first_true_m64s(simd.greater_than_f64s(value, zero)) < S::F64_LANES;
        }
        active |= u32::from(any) << g;
    }
    active
}
