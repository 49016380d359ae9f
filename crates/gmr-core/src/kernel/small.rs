//! Weighted products of so few features that their sums stay in registers.

use pulp::{Simd, WithSimd};

use super::blocks::Groups;
use super::{GROUPS, LANES};

/// One component of one block of `D` features: `sum r [z; 1][z; 1]'`, `z = x - centre`, lower triangle, for `C = D + 1`
/// columns.
///
/// The first `H` rows are summed together and then the rest, if there is one (three rows): seven features have 15 and 21
/// sums.
pub(super) struct Small<'a, const D: usize, const C: usize, const H: usize> {
    pub(super) rows: &'a [Groups; D],
    pub(super) centre: &'a [f64; D],
    pub(super) r: &'a Groups,
    /// Groups of samples with any weight, one bit each.
    pub(super) active: u32,
    /// Interleaved sums, `stride` of them per row.
    pub(super) sums: &'a mut [[f64; LANES]],
    pub(super) stride: usize,
}

impl<const D: usize, const C: usize, const H: usize> WithSimd for Small<'_, D, C, H> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        self.add::<S, 0, H>(simd);
        if H < C {
            self.add::<S, H, 3>(simd);
        }
    }
}

impl<const D: usize, const C: usize, const H: usize> Small<'_, D, C, H> {
    /// Rows `FIRST .. FIRST + ROWS`. All loops have constant bounds, so that they unroll and `t` lives in registers.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "constant bounds, indices of a matrix")]
    fn add<S: Simd, const FIRST: usize, const ROWS: usize>(&mut self, simd: S) {
        let (zero, unit) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let mut centre = [zero; D];
        for j in 0..D {
            centre[j] = simd.splat_f64s(self.centre[j]);
        }
        // A group may take several registers, one after the other.
        for part in 0..LANES / S::F64_LANES {
            let mut t = [[zero; C]; ROWS];
            for i in 0..ROWS {
                for j in 0..C {
                    if j <= FIRST + i {
                        t[i][j] = S::as_simd_f64s(&self.sums[(FIRST + i) * self.stride + j]).0[part];
                    }
                }
            }
            let mut rest = self.active;
            while rest != 0 {
                let g = rest.trailing_zeros() as usize % GROUPS;
                rest &= rest - 1;
                let r = S::as_simd_f64s(&self.r[g]).0[part];
                // [z; 1], of which only what the rows need is computed.
                let mut z = [unit; C];
                for j in 0..D {
                    z[j] = simd.sub_f64s(S::as_simd_f64s(&self.rows[j][g]).0[part], centre[j]);
                }
                for i in 0..ROWS {
                    let a = if FIRST + i < D { simd.mul_f64s(z[FIRST + i], r) } else { r };
                    for j in 0..C {
                        if j <= FIRST + i {
                            t[i][j] = simd.mul_add_f64s(a, z[j], t[i][j]);
                        }
                    }
                }
            }
            for i in 0..ROWS {
                for j in 0..C {
                    if j <= FIRST + i {
                        S::as_mut_simd_f64s(&mut self.sums[(FIRST + i) * self.stride + j]).0[part] = t[i][j];
                    }
                }
            }
        }
    }
}
