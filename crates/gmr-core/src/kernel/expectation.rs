//! The E step of one block: log densities and responsibilities.

use pulp::Simd;

use super::blocks::{Aligned, Row};
use super::norms::joint_densities;
use super::{BLOCK, GROUPS, LANES, NEGLIGIBLE};
use crate::scalar::{exp_nonpositive, ln_positive};

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
    /// Squared norms of the first rows, `(k, LANES)`.
    pub(super) heads: Aligned,
    /// Largest joint log density per sample.
    pub(super) peak: Row,
    /// Log density per sample.
    pub(super) density: Row,
    /// Groups of samples, one bit each, that each component may take part in.
    pub(super) found: Vec<u32>,
    /// Groups of samples that each component takes part in.
    pub(super) active: Vec<Active>,
}

/// Some of the groups of a block, in ascending order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Active {
    groups: [u8; GROUPS],
    count: usize,
}

impl Active {
    const NONE: Self = Self { groups: [0; GROUPS], count: 0 };

    #[inline(always)]
    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Appends `group` if `wanted`, without a branch.
    #[inline(always)]
    pub(super) fn push_if(&mut self, group: usize, wanted: bool) {
        self.groups[self.count] = group as u8;
        self.count += usize::from(wanted);
    }

    #[inline(always)]
    pub(super) fn list(&self) -> &[u8] {
        &self.groups[..self.count]
    }
}

impl Scratch {
    pub(super) fn new(k: usize, d: usize) -> Self {
        Self {
            joint: Aligned::zeros(k * BLOCK),
            z: Aligned::zeros(d * BLOCK),
            heads: Aligned::zeros(k * LANES),
            peak: Row([0.0; BLOCK]),
            density: Row([0.0; BLOCK]),
            found: vec![0; k],
            active: vec![Active::NONE; k],
        }
    }
}

/// Fills `scratch.joint` with responsibilities, which sum to the weight of the sample over components, and
/// `scratch.density` with log densities, for one block of as many samples as there are weights; `hints` as in
/// [`joint_densities`].
#[inline(always)]
pub(super) fn expectation<S: Simd>(
    simd: S,
    block: &[f64],
    weights: &[f64],
    components: Components<'_>,
    hints: &mut [u16],
    scratch: &mut Scratch,
) {
    let lanes = weights.len();
    joint_densities(simd, block, lanes, components, hints, scratch);
    let Scratch { joint, peak: Row(peak), density: Row(density), found, active, .. } = scratch;
    // A sample that no component reaches keeps density -inf and responsibilities zero.
    for m in &mut peak[..lanes] {
        *m = if *m == f64::NEG_INFINITY { 0.0 } else { *m };
    }
    let Row(mut sum) = Row([0.0; BLOCK]);
    let Row(mut exponent) = Row([0.0; BLOCK]);
    let peaks = peak.as_chunks::<LANES>().0;
    let negligible = simd.splat_f64s(NEGLIGIBLE);
    for ((joint, active), found) in joint.chunks_exact_mut(BLOCK).zip(active.iter_mut()).zip(found.iter()) {
        let packed = exponent.as_chunks_mut::<LANES>().0;
        let groups = joint[..lanes].as_chunks_mut::<LANES>().0;
        active.clear();
        let mut rest = *found;
        while rest != 0 {
            let g = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let (q, m) = (S::as_simd_f64s(&groups[g]).0, S::as_simd_f64s(&peaks[g]).0);
            let e = S::as_mut_simd_f64s(&mut packed[active.count]).0;
            let mut wanted = false;
            for ((e, q), m) in e.iter_mut().zip(q).zip(m) {
                *e = simd.sub_f64s(*q, *m);
                let above = simd.greater_than_f64s(*q, simd.sub_f64s(*m, negligible));
                wanted |= simd.first_true_m64s(above) < S::F64_LANES;
            }
            active.push_if(g, wanted);
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
    for ((d, s), m) in density[..lanes].iter_mut().zip(&sum).zip(&*peak) {
        *d = if *s > 0.0 { m + ln_positive(*s) } else { f64::NEG_INFINITY };
    }
    for (s, w) in sum.iter_mut().zip(weights) {
        *s = if *s > 0.0 { w / *s } else { 0.0 };
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
