//! Log densities and responsibilities of samples.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::blocks::Blocks;
use super::expectation::{Components, Scratch, expectation};
use super::{BLOCK, CHUNK_BLOCKS};

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
        let ones = [1.0; BLOCK];
        let mut densities = Vec::new();
        let mut responsibilities = Vec::new();
        for b in range {
            expectation(simd, blocks.block(b), &ones[..blocks.lanes_in(b)], components, &mut scratch);
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
