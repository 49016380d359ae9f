//! Small dense factorisations on row-major slices.
//!
//! Everything that needs a covariance goes through its Cholesky factor `A = L L'`; nothing is
//! ever inverted through a determinant. Dimensions here are those of joint vectors (a few to a few
//! dozen), where plain loops over contiguous rows beat a general library's set-up cost.

/// Row and value of the Cholesky pivot that was not positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BadPivot {
    pub(crate) row: usize,
    pub(crate) value: f64,
}

/// Replaces the symmetric `a` (`d x d`, lower triangle read) by its lower Cholesky factor; the
/// strict upper triangle becomes zero.
pub(crate) fn cholesky(a: &mut [f64], d: usize) -> Result<(), BadPivot> {
    // One copy of the loops per small dimension, so that they unroll.
    match d {
        1 => cholesky_of(a, 1),
        2 => cholesky_of(a, 2),
        3 => cholesky_of(a, 3),
        4 => cholesky_of(a, 4),
        5 => cholesky_of(a, 5),
        6 => cholesky_of(a, 6),
        7 => cholesky_of(a, 7),
        8 => cholesky_of(a, 8),
        d => cholesky_of(a, d),
    }
}

/// Column by column: what remains of the matrix is updated at once, so that few operations wait for each other.
#[inline(always)]
fn cholesky_of(a: &mut [f64], d: usize) -> Result<(), BadPivot> {
    let a = &mut a[..d * d];
    for j in 0..d {
        let pivot = a[j * d + j];
        // A pivot below the smallest normal number has lost its relative accuracy.
        if !(f64::MIN_POSITIVE..f64::INFINITY).contains(&pivot) {
            return Err(BadPivot { row: j, value: pivot });
        }
        let root = pivot.sqrt();
        let reciprocal = 1.0 / root;
        a[j * d + j] = root;
        for i in j + 1..d {
            a[i * d + j] *= reciprocal;
            a[j * d + i] = 0.0;
        }
        for i in j + 1..d {
            let factor = a[i * d + j];
            for k in j + 1..=i {
                a[i * d + k] -= factor * a[k * d + j];
            }
        }
    }
    Ok(())
}

/// Inverse of a lower triangular matrix, written to `out` (`d x d`, upper triangle zero).
pub(crate) fn invert_lower(l: &[f64], d: usize, out: &mut [f64]) {
    match d {
        1 => invert_lower_of(l, 1, out),
        2 => invert_lower_of(l, 2, out),
        3 => invert_lower_of(l, 3, out),
        4 => invert_lower_of(l, 4, out),
        5 => invert_lower_of(l, 5, out),
        6 => invert_lower_of(l, 6, out),
        7 => invert_lower_of(l, 7, out),
        8 => invert_lower_of(l, 8, out),
        d => invert_lower_of(l, d, out),
    }
}

#[inline(always)]
fn invert_lower_of(l: &[f64], d: usize, out: &mut [f64]) {
    let (l, out) = (&l[..d * d], &mut out[..d * d]);
    out.fill(0.0);
    for j in 0..d {
        out[j * d + j] = 1.0 / l[j * d + j];
    }
    for j in 0..d {
        for i in j + 1..d {
            let mut sum = 0.0;
            for k in j..i {
                sum += l[i * d + k] * out[k * d + j];
            }
            out[i * d + j] = -sum * out[i * d + i];
        }
    }
}

/// Solves `L y = b` in place.
pub(crate) fn solve_lower(l: &[f64], d: usize, b: &mut [f64]) {
    for i in 0..d {
        let mut sum = b[i];
        for k in 0..i {
            sum -= l[i * d + k] * b[k];
        }
        b[i] = sum / l[i * d + i];
    }
}

/// Solves `L' x = b` in place.
pub(crate) fn solve_lower_transpose(l: &[f64], d: usize, b: &mut [f64]) {
    for i in (0..d).rev() {
        let mut sum = b[i];
        for k in i + 1..d {
            sum -= l[k * d + i] * b[k];
        }
        b[i] = sum / l[i * d + i];
    }
}

/// Eigenvalues (ascending order not guaranteed) and eigenvectors (columns of `vectors`) of a
/// symmetric matrix by cyclic Jacobi rotations; `a` is destroyed.
///
/// Jacobi is chosen for its small relative error on tiny eigenvalues of graded matrices.
pub(crate) fn symmetric_eigen(a: &mut [f64], d: usize, vectors: &mut [f64]) -> Vec<f64> {
    vectors[..d * d].fill(0.0);
    for i in 0..d {
        vectors[i * d + i] = 1.0;
    }
    // Thirty sweeps are several times what quadratic convergence needs from any start.
    for _ in 0..30 {
        let mut off = 0.0;
        let mut diagonal = 0.0;
        for i in 0..d {
            diagonal += a[i * d + i] * a[i * d + i];
            for j in 0..i {
                off += a[i * d + j] * a[i * d + j];
            }
        }
        if off <= f64::EPSILON * f64::EPSILON * diagonal {
            break;
        }
        for p in 0..d {
            for q in p + 1..d {
                let apq = a[q * d + p];
                if apq == 0.0 {
                    continue;
                }
                let theta = (a[q * d + q] - a[p * d + p]) / (2.0 * apq);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for k in 0..d {
                    let (akp, akq) = (a[k * d + p], a[k * d + q]);
                    a[k * d + p] = c * akp - s * akq;
                    a[k * d + q] = s * akp + c * akq;
                }
                for k in 0..d {
                    let (apk, aqk) = (a[p * d + k], a[q * d + k]);
                    a[p * d + k] = c * apk - s * aqk;
                    a[q * d + k] = s * apk + c * aqk;
                    let (vkp, vkq) = (vectors[k * d + p], vectors[k * d + q]);
                    vectors[k * d + p] = c * vkp - s * vkq;
                    vectors[k * d + q] = s * vkp + c * vkq;
                }
            }
        }
    }
    (0..d).map(|i| a[i * d + i]).collect()
}

/// Raises every eigenvalue of the symmetric `a` to at least `floor`.
///
/// Returns the smallest eigenvalue found when something was raised, `None` when `a` was above the
/// floor already (checked by one Cholesky of `a - floor I`). This clipping is the exact
/// maximiser of the Gaussian likelihood under the constraint `Sigma >= floor I`, so EM stays
/// monotone with it.
pub(crate) fn clip_eigenvalues(a: &mut [f64], d: usize, floor: f64) -> Option<f64> {
    let mut shifted = a.to_vec();
    for i in 0..d {
        shifted[i * d + i] -= floor;
    }
    if cholesky(&mut shifted, d).is_ok() {
        return None;
    }
    let mut vectors = vec![0.0; d * d];
    let mut work = a.to_vec();
    let values = symmetric_eigen(&mut work, d, &mut vectors);
    let smallest = values.iter().copied().fold(f64::INFINITY, f64::min);
    // The eigenvalue may sit above the floor by rounding although the Cholesky refused.
    let lifted: Vec<f64> = values.iter().map(|v| v.max(floor)).collect();
    for i in 0..d {
        for j in 0..=i {
            let sum: f64 = (0..d).map(|k| vectors[i * d + k] * lifted[k] * vectors[j * d + k]).sum();
            a[i * d + j] = sum;
            a[j * d + i] = sum;
        }
    }
    Some(smallest)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these results are exact")]
    use super::*;

    #[test]
    fn cholesky_of_a_known_matrix_matches_the_hand_computed_factor() {
        // [[4, 2], [2, 10]] = L L' with L = [[2, 0], [1, 3]].
        let mut a = [4.0, 2.0, 2.0, 10.0];
        cholesky(&mut a, 2).unwrap();
        assert_eq!(a, [2.0, 0.0, 1.0, 3.0]);
        let mut inverse = [0.0; 4];
        invert_lower(&a, 2, &mut inverse);
        assert_eq!(inverse, [0.5, 0.0, -1.0 / 6.0, 1.0 / 3.0]);
        let mut b = [2.0, 7.0];
        solve_lower(&a, 2, &mut b);
        assert_eq!(b, [1.0, 2.0]);
        solve_lower_transpose(&a, 2, &mut b);
        assert!((b[1] - 2.0 / 3.0).abs() < 1e-15 && (b[0] - 1.0 / 6.0).abs() < 1e-15);
    }

    #[test]
    fn indefinite_and_nan_matrices_are_refused_with_the_pivot() {
        let mut a = [1.0, 2.0, 2.0, 1.0];
        assert_eq!(cholesky(&mut a, 2), Err(BadPivot { row: 1, value: -3.0 }));
        // Neither a number, nor one, nor one with all its digits.
        for pivot in [f64::NAN, f64::INFINITY, 0.0, 1e-310] {
            assert_eq!(cholesky(&mut [1.0, 0.0, 0.0, pivot], 2).unwrap_err().row, 1, "{pivot}");
        }
        assert!(cholesky(&mut [f64::MIN_POSITIVE], 1).is_ok());
    }

    #[test]
    fn eigenvalues_and_vectors_give_the_matrix_back() {
        let wave = |i: usize| (i as f64 * 1.7).sin();
        let mut cases: Vec<(usize, Vec<f64>)> =
            (2..9).map(|d| (d, (0..d * d).map(|i| wave(i + d)).collect())).collect();
        // Equal diagonals with zeros beside them, and magnitudes far apart.
        cases.push((3, vec![2.0, 0.0, 1.0, 0.0, 2.0, 0.0, 1.0, 0.0, 2.0]));
        cases.push((3, vec![1e12, 1e3, 1.0, 1e3, 1.0, 1e-3, 1.0, 1e-3, 1e-6]));
        for (d, mut a) in cases {
            for i in 0..d {
                for j in 0..i {
                    a[j * d + i] = a[i * d + j];
                }
            }
            let (mut work, mut v) = (a.clone(), vec![0.0; d * d]);
            let values = symmetric_eigen(&mut work, d, &mut v);
            let scale = values.iter().fold(0.0f64, |m, l| m.max(l.abs()));
            for i in 0..d {
                for j in 0..d {
                    let back: f64 = (0..d).map(|k| v[i * d + k] * values[k] * v[j * d + k]).sum();
                    assert!((back - a[i * d + j]).abs() < 1e-14 * d as f64 * scale, "{d}: {back} {}", a[i * d + j]);
                    let dot: f64 = (0..d).map(|k| v[k * d + i] * v[k * d + j]).sum();
                    assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-14 * d as f64, "{d}: {dot}");
                }
            }
        }
    }

    #[test]
    fn clipping_raises_only_the_eigenvalues_below_the_floor() {
        // Eigenvalues 3 and -1 along (1, 1) and (1, -1).
        let mut a = [1.0, 2.0, 2.0, 1.0];
        let smallest = clip_eigenvalues(&mut a, 2, 0.5).unwrap();
        assert!((smallest + 1.0).abs() < 1e-14);
        assert!((a[0] - 1.75).abs() < 1e-14 && (a[1] - 1.25).abs() < 1e-14);
        assert_eq!(clip_eigenvalues(&mut a, 2, 0.25), None);
        // Positive definite already, but below the floor: eigenvalues 0.1, 0.2 and 3.
        let mut c = [0.2, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 3.0];
        assert!((clip_eigenvalues(&mut c, 3, 0.15).unwrap() - 0.1).abs() < 1e-15);
        assert!((c[0] - 0.2).abs() < 1e-15 && (c[4] - 0.15).abs() < 1e-15 && (c[8] - 3.0).abs() < 1e-14);
    }
}
