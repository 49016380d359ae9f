//! One pass over the data: log densities, responsibilities and weighted moments.
//!
//! Samples are stored feature-major in blocks of [`BLOCK`], so that one vector register holds one
//! feature of several samples. Per block and component the pass forms `z = x - mu`,
//! `y = W z` with `W = L^-1` (one triangular product), `log N = offset - y'y / 2`, then the
//! log-sum-exp over components, then the lower triangle of `sum r [z; 1][z; 1]'`, which holds the
//! zeroth, first and second moments in one product. Moments are taken about a centre given per
//! component (its current mean), never about the origin, so that no digits cancel.
//!
//! A responsibility below `exp(-`[`NEGLIGIBLE`]`)` is zero, and a group of [`LANES`] samples whose responsibilities are all
//! zero is left out of the moments of a component.
//!
//! Every sum is kept in [`LANES`] interleaved partial sums whatever the register width, chunks
//! of [`CHUNK_BLOCKS`] blocks are independent, and their results are added in order: the bytes do
//! not depend on the instruction set or on the number of threads.

/// Calls `$this.of::<S, D, P>(simd)` for up to eight features, with registers per group `P` fixed by the register width,
/// or `$this.of_any_dimension(simd)`.
macro_rules! by_dimension {
    ($this:ident, $simd:ident, $dim:expr) => {
        match $dim {
            1 => by_dimension!($this, $simd, of 1),
            2 => by_dimension!($this, $simd, of 2),
            3 => by_dimension!($this, $simd, of 3),
            4 => by_dimension!($this, $simd, of 4),
            5 => by_dimension!($this, $simd, of 5),
            6 => by_dimension!($this, $simd, of 6),
            7 => by_dimension!($this, $simd, of 7),
            8 => by_dimension!($this, $simd, of 8),
            _ => $this.of_any_dimension($simd),
        }
    };
    ($this:ident, $simd:ident, of $d:literal) => {
        $crate::wide::in_registers!($this.of<S, $d>($simd))
    };
}

mod blocks;
mod densities;
mod expectation;
mod label_sums;
mod labels;
mod moments;
mod nearest;
mod norms;
mod part;
mod small;
mod tile;
mod variance;

use pulp::{Arch, Simd, WithSimd};

pub(crate) use blocks::Blocks;
pub(crate) use densities::densities;
pub(crate) use expectation::Components;
pub(crate) use label_sums::LabelLanes;
pub(crate) use labels::label_moments;
pub(crate) use moments::{Moments, Workspace, log_likelihood, moments};

use crate::scalar::ln_positive;
use crate::wide::LANES;

/// Samples per block: the working set of a seven-dimensional block (14 KiB) stays in a 32 KiB L1.
const BLOCK: usize = 128;
/// Groups of [`LANES`] samples per block.
const GROUPS: usize = BLOCK / LANES;
/// Responsibilities below `exp(-70) = 4e-31` are zero. A component keeps at least 1e-10 of the mass, so what this leaves
/// out of its moments is 1e-20 of them, far below rounding.
const NEGLIGIBLE: f64 = 70.0;
/// Blocks per unit of parallel work: 4096 samples, some hundred microseconds.
const CHUNK_BLOCKS: usize = 32;

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
#[inline(always)]
fn fold(lanes: &[f64; LANES]) -> f64 {
    ((lanes[0] + lanes[4]) + (lanes[2] + lanes[6])) + ((lanes[1] + lanes[5]) + (lanes[3] + lanes[7]))
}
