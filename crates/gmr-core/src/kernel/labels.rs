//! Moments of a hard assignment.

use pulp::{Arch, Simd, WithSimd};

use super::blocks::Blocks;
use super::moments::{Buffers, Moments, Workspace};
use super::part::{Part, Rows, padded};
use super::{BLOCK, LANES};

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
