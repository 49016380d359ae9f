//! Inverse Cholesky factors of small covariances, eight of them side by side.
//!
//! Square roots and divisions wait for each other; with eight matrices in lanes, eight of each are under way. The
//! operations and their order are those of [`crate::linalg`], so the bytes are the same.

use pulp::{Arch, Simd, WithSimd};

use crate::wide::{LANES, Wide, in_registers};

/// Largest dimension that is small.
const MOST: usize = 8;

/// Writes `L^-1` of each of `covariances: (k, d, d)`, `L L'` the covariance, to `whitening`. False, with `whitening`
/// unspecified, where one has no factor or `d` is not small.
pub(super) fn whiten(covariances: &[f64], d: usize, whitening: &mut [f64]) -> bool {
    d <= MOST && Arch::new().dispatch(Whiten { covariances, d, whitening })
}

struct Whiten<'a> {
    covariances: &'a [f64],
    d: usize,
    whitening: &'a mut [f64],
}

impl WithSimd for Whiten<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        in_registers!(self.in_registers<S>(simd))
    }
}

/// Eight matrices of up to eight rows.
type Matrices = [[[f64; LANES]; MOST]; MOST];

impl Whiten<'_> {
    #[inline(always)]
    fn in_registers<S: Simd, const P: usize>(self, simd: S) -> bool {
        let Self { covariances, d, whitening } = self;
        let size = d * d;
        let mut a = [[[0.0; LANES]; MOST]; MOST];
        let mut w = a;
        for (given, out) in covariances.chunks(LANES * size).zip(whitening.chunks_mut(LANES * size)) {
            let count = given.len() / size;
            for (i, row) in a.iter_mut().enumerate().take(d) {
                for (j, a) in row.iter_mut().enumerate().take(i + 1) {
                    for (l, a) in a.iter_mut().enumerate() {
                        // Lanes to spare repeat the last matrix.
                        *a = given[l.min(count - 1) * size + i * d + j];
                    }
                }
            }
            if !factor::<S, P>(simd, &mut a, d, &mut w) {
                return false;
            }
            invert::<S, P>(simd, &a, d, &mut w);
            for (l, out) in out.chunks_exact_mut(size).enumerate() {
                for (out, row) in out.chunks_exact_mut(d).zip(&w) {
                    for (out, w) in out.iter_mut().zip(row) {
                        *out = w[l];
                    }
                }
            }
        }
        true
    }
}

/// Leaves `L` in `a` and the reciprocals of its diagonal on that of `w`.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "indices of matrices")]
fn factor<S: Simd, const P: usize>(simd: S, a: &mut Matrices, d: usize, w: &mut Matrices) -> bool {
    let unit = Wide::<S, P>::splat(simd, 1.0);
    for j in 0..d.min(MOST) {
        let pivot = Wide::<S, P>::load(simd, &a[j][j]);
        if !pivot.all_in(f64::MIN_POSITIVE, f64::INFINITY) {
            return false;
        }
        let root = pivot.square_root();
        let reciprocal = unit / root;
        root.store(&mut a[j][j]);
        reciprocal.store(&mut w[j][j]);
        for i in j + 1..d.min(MOST) {
            (Wide::load(simd, &a[i][j]) * reciprocal).store(&mut a[i][j]);
        }
        for i in j + 1..d.min(MOST) {
            let factor = Wide::<S, P>::load(simd, &a[i][j]);
            for k in j + 1..=i {
                (Wide::load(simd, &a[i][k]) - factor * Wide::load(simd, &a[k][j])).store(&mut a[i][k]);
            }
        }
    }
    true
}

/// The rest of `L^-1` below the diagonal of `w`.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "indices of matrices")]
fn invert<S: Simd, const P: usize>(simd: S, l: &Matrices, d: usize, w: &mut Matrices) {
    let zero = Wide::<S, P>::splat(simd, 0.0);
    for i in 1..d.min(MOST) {
        let minus = zero - Wide::load(simd, &w[i][i]);
        for j in 0..i {
            let mut sum = zero;
            for k in j..i {
                sum = sum + Wide::load(simd, &l[i][k]) * Wide::load(simd, &w[k][j]);
            }
            (sum * minus).store(&mut w[i][j]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::{cholesky, invert_lower};

    #[test]
    fn matrices_side_by_side_have_the_factors_they_have_alone() {
        for (d, k) in [(1, 1), (2, 8), (3, 9), (7, 10), (8, 17)] {
            // A'A + I of a full matrix A.
            let root = |c: usize, i: usize, j: usize| ((c * 31 + i * 7 + j * 3) as f64).sin() * (1.0 + c as f64);
            let entry = |c: usize, i: usize, j: usize| {
                (0..d).map(|l| root(c, l, i) * root(c, l, j)).sum::<f64>() + f64::from(u8::from(i == j))
            };
            let covariances: Vec<f64> = (0..k * d * d).map(|i| entry(i / (d * d), i / d % d, i % d)).collect();
            let mut whitening = vec![f64::NAN; k * d * d];
            assert!(whiten(&covariances, d, &mut whitening));
            for (covariance, w) in covariances.chunks_exact(d * d).zip(whitening.chunks_exact(d * d)) {
                let (mut factor, mut alone) = (covariance.to_vec(), vec![0.0; d * d]);
                cholesky(&mut factor, d).unwrap();
                invert_lower(&factor, d, &mut alone);
                assert_eq!(w, alone);
            }
        }
    }

    #[test]
    fn one_matrix_without_a_factor_is_noticed_among_others() {
        let mut covariances = [1.0; 10];
        let mut whitening = [0.0; 10];
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            covariances[9] = bad;
            assert!(!whiten(&covariances, 1, &mut whitening), "{bad}");
        }
        assert!(!whiten(&[1.0; 81], 9, &mut [0.0; 81]));
    }
}
