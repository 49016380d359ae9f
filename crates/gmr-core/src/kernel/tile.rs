//! Weighted products of rows, a tile of them in registers.

use pulp::Simd;

use super::blocks::Row;
use super::{BLOCK, LANES};

/// Rows and columns per tile: sixteen sums fit the registers of AVX-512.
pub(super) const TILE: usize = 4;

/// Four rows of `[x; 1; 0 ..]` with what is subtracted from them.
pub(super) struct TileRows<'a, S: Simd> {
    rows: [&'a [S::f64s]; TILE],
    centres: [S::f64s; TILE],
}

/// Rows `first .. first + 4` of `[x; 1; 0 ..]`, the first `registers` registers of a block.
#[inline(always)]
pub(super) fn tile_rows<'a, S: Simd>(
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

/// Adds `sum r z_i z_j` over a tile of four rows and four columns to interleaved sums that lie `p` sums apart per
/// row, for the groups of samples in `active`. On the diagonal only `j <= i` is summed.
#[inline(always)]
pub(super) fn tile<S: Simd, const DIAGONAL: bool>(
    simd: S,
    sums: &mut [f64],
    p: usize,
    rows: &TileRows<'_, S>,
    columns: &TileRows<'_, S>,
    r: &[S::f64s],
    active: u32,
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
        let mut rest = active;
        while rest != 0 {
            let v = rest.trailing_zeros() as usize * per + part;
            rest &= rest - 1;
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

/// Adds `a . b` to interleaved sums.
#[inline(always)]
pub(super) fn dot<S: Simd>(simd: S, sums: &mut [f64], a: &[f64], b: &[f64]) {
    let per = LANES / S::F64_LANES;
    let (a, b) = (S::as_simd_f64s(a).0, S::as_simd_f64s(b).0);
    let sums = S::as_mut_simd_f64s(&mut sums[..LANES]).0;
    for (a, b) in a.chunks_exact(per).zip(b.chunks_exact(per)) {
        for ((s, a), b) in sums.iter_mut().zip(a).zip(b) {
            *s = simd.mul_add_f64s(*a, *b, *s);
        }
    }
}
