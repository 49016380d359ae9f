//! One component's share of a block in the moments.

use pulp::Simd;

use super::blocks::{Row, groups};
use super::small::Small;
use super::tile::{TILE, dot, tile, tile_rows};
use super::{BLOCK, LANES};

/// Rows of `[z; 1]`, padded to whole tiles by rows of zeros.
#[inline(always)]
pub(super) fn padded(dim: usize) -> usize {
    (dim + 1).next_multiple_of(TILE)
}

/// Zeros, ones and products of one component, for passes over all lanes of a block.
pub(super) struct Rows {
    ones: Row,
    zeros: Row,
    z: Row,
    rz: Row,
}

impl Rows {
    #[inline(always)]
    pub(super) fn new() -> Self {
        let zeros = Row([0.0; BLOCK]);
        Self { ones: Row([1.0; BLOCK]), zeros, z: zeros, rz: zeros }
    }
}

/// One component of one block: its responsibilities, weights included, of the first `lanes` samples, and the groups of
/// samples that have any.
#[derive(Clone, Copy)]
pub(super) struct Part<'a> {
    pub(super) block: &'a [f64],
    pub(super) centre: &'a [f64],
    pub(super) r: &'a [f64; BLOCK],
    pub(super) lanes: usize,
    pub(super) active: u32,
    pub(super) diagonal: bool,
}

impl Part<'_> {
    /// Adds `sum r [z; 1][z; 1]'` to interleaved sums `(p, p, LANES)`.
    #[inline(always)]
    pub(super) fn add<S: Simd>(self, simd: S, sums: &mut [f64], rows: &mut Rows) {
        match (self.diagonal, self.centre.len()) {
            (true, _) => self.add_diagonal(simd, sums, rows),
            (false, 1) => self.add_small::<S, 1, 2, 2>(simd, sums),
            (false, 2) => self.add_small::<S, 2, 3, 3>(simd, sums),
            (false, 3) => self.add_small::<S, 3, 4, 4>(simd, sums),
            (false, 4) => self.add_small::<S, 4, 5, 5>(simd, sums),
            (false, 5) => self.add_small::<S, 5, 6, 6>(simd, sums),
            (false, 6) => self.add_small::<S, 6, 7, 4>(simd, sums),
            (false, 7) => self.add_small::<S, 7, 8, 5>(simd, sums),
            (false, 8) => self.add_small::<S, 8, 9, 6>(simd, sums),
            _ => self.add_tiles(simd, sums, rows),
        }
    }

    #[inline(always)]
    fn add_small<S: Simd, const D: usize, const C: usize, const H: usize>(self, simd: S, sums: &mut [f64]) {
        let Self { block, centre, r, active, .. } = self;
        let rows = &groups(block).as_chunks::<D>().0[0];
        let centre = &centre.as_chunks::<D>().0[0];
        let (r, sums, stride) = (&groups(r)[0], sums.as_chunks_mut().0, padded(D));
        // A function of its own, which the two passes share.
        simd.vectorize(Small::<D, C, H> { rows, centre, r, active, sums, stride });
    }

    #[inline(always)]
    fn add_diagonal<S: Simd>(self, simd: S, sums: &mut [f64], rows: &mut Rows) {
        let Self { block, centre, r, lanes, .. } = self;
        let Rows { ones, z: Row(z), rz: Row(rz), .. } = rows;
        let dim = centre.len();
        let p = padded(dim);
        let r = &r[..lanes];
        for (j, (x, m)) in block.chunks_exact(BLOCK).zip(centre).enumerate() {
            for (((z, rz), x), r) in z[..lanes].iter_mut().zip(&mut *rz).zip(x).zip(r.iter()) {
                *z = x - m;
                *rz = r * *z;
            }
            dot(simd, &mut sums[(j * p + j) * LANES..], &rz[..lanes], &z[..lanes]);
            dot(simd, &mut sums[(dim * p + j) * LANES..], &rz[..lanes], &ones.0[..lanes]);
        }
        dot(simd, &mut sums[(dim * p + dim) * LANES..], r, &ones.0[..lanes]);
    }

    #[inline(always)]
    fn add_tiles<S: Simd>(self, simd: S, sums: &mut [f64], rows: &mut Rows) {
        let Self { block, centre, r, lanes, active, .. } = self;
        let Rows { ones, zeros, .. } = rows;
        let p = padded(centre.len());
        let r = S::as_simd_f64s(&r[..lanes]).0;
        for i in (0..p).step_by(TILE) {
            let rows = tile_rows::<S>(simd, block, centre, i, r.len(), ones, zeros);
            for j in (0..i).step_by(TILE) {
                let columns = tile_rows::<S>(simd, block, centre, j, r.len(), ones, zeros);
                tile::<S, false>(simd, &mut sums[(i * p + j) * LANES..], p, &rows, &columns, r, active);
            }
            tile::<S, true>(simd, &mut sums[(i * p + i) * LANES..], p, &rows, &rows, r, active);
        }
    }
}
