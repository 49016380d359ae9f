//! Dynamic time warping (Sakoe and Chiba 1978): demonstrations onto one clock.

use crate::error::{Error, Result, check_len};
use crate::trajectory::Trajectory;

/// How two demonstrations may be matched.
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// let params = gmr_core::DtwParams { column_weights: vec![4.0], ..Default::default() };
/// let a = gmr_core::Trajectory::new(vec![0.0], vec![1.0], 1)?;
/// let b = gmr_core::Trajectory::new(vec![0.0], vec![2.0], 1)?;
/// assert_eq!(gmr_core::dtw(&a, &b, &params)?.cost, 4.0);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct DtwParams {
    /// Largest distance between matched samples, as a share of the longer demonstration (Sakoe-Chiba
    /// band), in `(0, 1]`. It is widened to what different lengths need.
    pub band: f64,
    /// Weight of each column in the distance, for instance one over its variance; empty for all one.
    pub column_weights: Vec<f64>,
}

impl Default for DtwParams {
    /// A band of a fifth, all columns alike.
    fn default() -> Self {
        Self { band: 0.2, column_weights: Vec::new() }
    }
}

/// A cheapest match of two demonstrations.
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// let motion = gmr_core::Trajectory::new(vec![5.0, 6.0, 7.5], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2)?;
/// let itself = gmr_core::dtw(&motion, &motion, &gmr_core::DtwParams::default())?;
/// assert_eq!((itself.cost, itself.path.len()), (0.0, 3));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Sum of weighted squared distances along the path.
    pub cost: f64,
    /// Matched indices `(i, j)` from `(0, 0)` to the ends; each step raises `i`, `j` or both by one.
    pub path: Vec<(usize, usize)>,
}

/// The cheapest monotone match of `a` and `b`.
///
/// Costs `n m` distances and as many bytes. Of equal paths the one with more diagonal steps is taken.
///
/// ```
/// use gmr_core::{DtwParams, Trajectory, dtw};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let a = Trajectory::new(vec![0.0, 1.0, 2.0], vec![0.0, 1.0, 2.0], 1)?;
/// let b = Trajectory::new(vec![0.0, 1.0, 2.0, 3.0], vec![0.0, 0.0, 1.0, 2.0], 1)?;
/// let match_ = dtw(&a, &b, &DtwParams { band: 1.0, ..DtwParams::default() })?;
/// assert_eq!(match_.cost, 0.0);
/// assert_eq!(match_.path, [(0, 0), (0, 1), (1, 2), (2, 3)]);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// Different dimensions, a band or weight outside its interval, or weights so large that distances overflow.
pub fn dtw(a: &Trajectory, b: &Trajectory, params: &DtwParams) -> Result<Alignment> {
    check_len("demonstration dimension", a.dim(), b.dim())?;
    if !(params.band > 0.0 && params.band <= 1.0) {
        return Err(Error::InvalidParameter { name: "band", allowed: "(0, 1]", value: params.band });
    }
    if !params.column_weights.is_empty() {
        check_len("column weights", a.dim(), params.column_weights.len())?;
        for &value in &params.column_weights {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::InvalidParameter { name: "column weight", allowed: "[0, inf)", value });
            }
        }
    }
    let (n, m) = (a.len(), b.len());
    // Distance from the straight match of the ends, in samples of b.
    let slope = if n > 1 { (m - 1) as f64 / (n - 1) as f64 } else { 0.0 };
    let half = (params.band * n.max(m) as f64).max(slope).max(1.0);
    let distance = |i: usize, j: usize| -> f64 {
        let pairs = a.row(i).iter().zip(b.row(j));
        if params.column_weights.is_empty() {
            pairs.map(|(x, y)| (x - y) * (x - y)).sum()
        } else {
            pairs.zip(&params.column_weights).map(|((x, y), w)| w * (x - y) * (x - y)).sum()
        }
    };
    let mut previous = vec![f64::INFINITY; m];
    let mut current = vec![f64::INFINITY; m];
    // 0: both advance, 1: i advances, 2: j advances.
    let mut steps = vec![0u8; n * m];
    for i in 0..n {
        current.fill(f64::INFINITY);
        let centre = if n > 1 { slope * i as f64 } else { 0.0 };
        for j in 0..m {
            if n > 1 && (j as f64 - centre).abs() > half {
                continue;
            }
            let (from, step) = if i == 0 && j == 0 {
                (0.0, 0)
            } else {
                let both = if i > 0 && j > 0 { previous[j - 1] } else { f64::INFINITY };
                let first = if i > 0 { previous[j] } else { f64::INFINITY };
                let second = if j > 0 { current[j - 1] } else { f64::INFINITY };
                if both <= first && both <= second {
                    (both, 0)
                } else if first <= second {
                    (first, 1)
                } else {
                    (second, 2)
                }
            };
            current[j] = from + distance(i, j);
            steps[i * m + j] = step;
        }
        std::mem::swap(&mut previous, &mut current);
    }
    let cost = previous[m - 1];
    if !cost.is_finite() {
        let what = "weighted squared distances along the path";
        return Err(Error::OutOfRange { what, index: 0, value: cost, limit: f64::MAX });
    }
    let mut path = vec![(n - 1, m - 1)];
    let (mut i, mut j) = (n - 1, m - 1);
    while (i, j) != (0, 0) {
        match steps[i * m + j] {
            0 => {
                i -= 1;
                j -= 1;
            }
            1 => i -= 1,
            _ => j -= 1,
        }
        path.push((i, j));
    }
    path.reverse();
    Ok(Alignment { cost, path })
}

/// Brings `demonstration` onto the clock of `reference`.
///
/// Each reference time gets the mean of the samples matched to it; the result has the reference's
/// times and the demonstration's values.
///
/// ```
/// use gmr_core::{DtwParams, Trajectory, align};
/// # fn main() -> Result<(), gmr_core::Error> {
/// let reference = Trajectory::new(vec![0.0, 1.0, 2.0], vec![0.0, 1.0, 2.0], 1)?;
/// let late = Trajectory::new(vec![0.0, 1.0, 2.0, 3.0], vec![0.0, 0.0, 1.0, 2.0], 1)?;
/// let (aligned, _) = align(&reference, &late, &DtwParams { band: 1.0, ..DtwParams::default() })?;
/// assert_eq!(aligned.values(), [0.0, 1.0, 2.0]);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// As [`dtw`].
pub fn align(
    reference: &Trajectory,
    demonstration: &Trajectory,
    params: &DtwParams,
) -> Result<(Trajectory, Alignment)> {
    let alignment = dtw(reference, demonstration, params)?;
    let d = reference.dim();
    let mut values = vec![0.0; reference.len() * d];
    let mut counts = vec![0usize; reference.len()];
    for &(i, j) in &alignment.path {
        counts[i] += 1;
        for (v, x) in values[i * d..(i + 1) * d].iter_mut().zip(demonstration.row(j)) {
            *v += x;
        }
    }
    for (row, count) in values.chunks_exact_mut(d).zip(&counts) {
        row.iter_mut().for_each(|v| *v /= *count as f64);
    }
    Ok((Trajectory::new(reference.times_s().to_vec(), values, d)?, alignment))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(values: &[f64]) -> Trajectory {
        Trajectory::new((0..values.len()).map(|i| i as f64).collect(), values.to_vec(), 1).unwrap()
    }

    /// Cheapest path by trying them all.
    fn brute(a: &[f64], b: &[f64]) -> f64 {
        let here = (a[0] - b[0]).powi(2);
        match (a.len(), b.len()) {
            (1, 1) => here,
            (1, _) => here + brute(a, &b[1..]),
            (_, 1) => here + brute(&a[1..], b),
            _ => here + brute(&a[1..], &b[1..]).min(brute(&a[1..], b)).min(brute(a, &b[1..])),
        }
    }

    #[test]
    fn cost_equals_the_exhaustive_search() {
        let full = DtwParams { band: 1.0, ..DtwParams::default() };
        for seed in 0..40 {
            let value = |i: usize| ((seed * 31 + i * 17) as f64 * 0.71).sin();
            let a: Vec<f64> = (0..=seed % 6).map(value).collect();
            let b: Vec<f64> = (0..=seed % 7).map(|i| value(i + 50)).collect();
            let found = dtw(&line(&a), &line(&b), &full).unwrap();
            assert!((found.cost - brute(&a, &b)).abs() < 1e-12);
            let along: f64 = found.path.iter().map(|&(i, j)| (a[i] - b[j]).powi(2)).sum();
            assert!((along - found.cost).abs() < 1e-12);
        }
    }

    #[test]
    fn a_warped_copy_comes_back_to_the_reference() {
        let shape = |s: f64| (6.0 * s).sin() + s;
        let reference = line(&(0..=200).map(|i| shape(f64::from(i) / 200.0)).collect::<Vec<_>>());
        let warped = line(&(0..=240).map(|i| shape((f64::from(i) / 240.0).powf(1.3))).collect::<Vec<_>>());
        let (aligned, _) = align(&reference, &warped, &DtwParams::default()).unwrap();
        let worst = |t: &Trajectory| (0..=200).map(|i| (t.row(i)[0] - reference.row(i)[0]).abs()).fold(0.0, f64::max);
        // One reference sample is at most 0.035 high; matching cannot be finer than that.
        assert!(worst(&aligned) < 0.04 && worst(&warped) > 0.2);
    }

    #[test]
    fn very_different_lengths_still_reach_the_end() {
        let (a, b) = (line(&[0.0, 1.0]), line(&(0..50).map(f64::from).collect::<Vec<_>>()));
        let narrow = DtwParams { band: 0.01, ..DtwParams::default() };
        assert!(dtw(&a, &b, &narrow).unwrap().cost.is_finite());
        assert!(dtw(&b, &a, &narrow).unwrap().cost.is_finite());
        assert!(dtw(&line(&[1.0]), &b, &narrow).unwrap().cost.is_finite());
    }
}
