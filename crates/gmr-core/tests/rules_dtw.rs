//! Matching of demonstrations: the band, the weights of the columns, who may wait, and what comes out on whose clock.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{DtwParams, Error, Trajectory, align, dtw};

fn line(values: &[f64]) -> Trajectory {
    Trajectory::new((0..values.len()).map(|i| i as f64).collect(), values.to_vec(), 1).unwrap()
}

fn banded(band: f64) -> DtwParams {
    DtwParams { band, ..DtwParams::default() }
}

/// Cheapest path within the band by trying them all: the band is a share of the longer demonstration about the straight
/// match of the ends, never narrower than one sample or than one step of that match.
fn brute(a: &[f64], b: &[f64], band: f64) -> f64 {
    fn walk(a: &[f64], b: &[f64], i: usize, j: usize, inside: &dyn Fn(usize, usize) -> bool) -> f64 {
        if !inside(i, j) {
            return f64::INFINITY;
        }
        let here = (a[i] - b[j]).powi(2);
        if (i, j) == (a.len() - 1, b.len() - 1) {
            return here;
        }
        let mut best = f64::INFINITY;
        for (di, dj) in [(1, 1), (1, 0), (0, 1)] {
            if i + di < a.len() && j + dj < b.len() {
                best = best.min(walk(a, b, i + di, j + dj, inside));
            }
        }
        here + best
    }
    let (n, m) = (a.len(), b.len());
    let slope = if n > 1 { (m - 1) as f64 / (n - 1) as f64 } else { 0.0 };
    let half = (band * n.max(m) as f64).max(slope).max(1.0);
    walk(a, b, 0, 0, &|i, j| n == 1 || (j as f64 - slope * i as f64).abs() <= half)
}

#[test]
fn the_cost_is_the_cheapest_within_the_band_whatever_its_width() {
    let value = |s: usize, i: usize| ((s * 31 + i * 17) as f64 * 0.71).sin() + 0.2 * i as f64;
    let mut narrower = 0;
    for seed in 0..60 {
        let a: Vec<f64> = (0..=seed % 7).map(|i| value(seed, i)).collect();
        let b: Vec<f64> = (0..=(seed * 5) % 8).map(|i| value(seed, i + 40)).collect();
        let full = dtw(&line(&a), &line(&b), &banded(1.0)).unwrap();
        for band in [1e-9, 0.1, 0.25, 0.4, 1.0] {
            let found = dtw(&line(&a), &line(&b), &banded(band)).unwrap();
            assert!((found.cost - brute(&a, &b, band)).abs() < 1e-12, "{seed} {band}");
            let along: f64 = found.path.iter().map(|&(i, j)| (a[i] - b[j]).powi(2)).sum();
            assert!((along - found.cost).abs() < 1e-12);
            narrower += usize::from(found.cost > full.cost + 1e-9);
            assert_eq!(found.path[0], (0, 0));
            assert_eq!(found.path[found.path.len() - 1], (a.len() - 1, b.len() - 1));
            for step in found.path.windows(2) {
                let (di, dj) = (step[1].0 - step[0].0, step[1].1 - step[0].1);
                assert!(di <= 1 && dj <= 1 && di + dj >= 1, "{:?}", found.path);
            }
        }
    }
    assert!(narrower > 10, "the band never mattered");
}

#[test]
fn either_demonstration_may_wait_for_the_other() {
    let (fast, slow) = (line(&[0.0, 1.0, 2.0]), line(&[0.0, 0.0, 0.0, 1.0, 2.0, 2.0]));
    assert!(dtw(&fast, &slow, &banded(1.0)).unwrap().cost.abs() < 1e-15);
    assert!(dtw(&slow, &fast, &banded(1.0)).unwrap().cost.abs() < 1e-15);
    // Of equal paths the one with more diagonal steps.
    let still = line(&[1.0; 5]);
    let path = dtw(&still, &still, &banded(1.0)).unwrap().path;
    assert_eq!(path, (0..5).map(|i| (i, i)).collect::<Vec<_>>());
}

#[test]
fn column_weights_scale_the_distance_of_their_column() {
    let two = |rows: &[[f64; 2]]| {
        Trajectory::new((0..rows.len()).map(|i| i as f64).collect(), rows.iter().flatten().copied().collect(), 2)
            .unwrap()
    };
    let (a, b) = (two(&[[0.0, 0.0], [1.0, 5.0]]), two(&[[0.0, 1.0], [3.0, 5.0]]));
    let cost = |column_weights: Vec<f64>| dtw(&a, &b, &DtwParams { band: 1.0, column_weights }).unwrap().cost;
    assert!((cost(vec![]) - 5.0).abs() < 1e-15);
    assert!((cost(vec![1.0, 1.0]) - 5.0).abs() < 1e-15);
    assert!((cost(vec![0.5, 3.0]) - 5.0).abs() < 1e-15);
    assert!((cost(vec![0.25, 0.0]) - 1.0).abs() < 1e-15);
}

#[test]
fn an_aligned_demonstration_has_the_clock_of_the_reference_and_the_mean_of_what_was_matched() {
    let reference = Trajectory::new(vec![10.0, 10.5, 12.0], vec![0.0, 10.0, 20.0], 1).unwrap();
    let late = Trajectory::new(vec![0.0, 1.0, 2.0, 3.0], vec![0.0, 9.0, 12.0, 20.0], 1).unwrap();
    let (aligned, alignment) = align(&reference, &late, &banded(1.0)).unwrap();
    assert_eq!(alignment.path, [(0, 0), (1, 1), (1, 2), (2, 3)]);
    assert_eq!(aligned.times_s(), [10.0, 10.5, 12.0]);
    assert_eq!(aligned.values(), [0.0, 10.5, 20.0]);
}

#[test]
fn a_distance_beyond_every_number_is_refused_and_not_followed() {
    // Each value is allowed; weighted, their distance is not a number that paths could be compared by.
    let (a, b) = (line(&[1e140, -1e140, 1e140]), line(&[-1e140, 1e140, -1e140]));
    let huge = DtwParams { band: 1.0, column_weights: vec![1e200] };
    assert!(matches!(dtw(&a, &b, &huge), Err(Error::OutOfRange { .. })));
    assert!(matches!(align(&a, &b, &huge), Err(Error::OutOfRange { .. })));
    assert!(dtw(&a, &b, &banded(1.0)).unwrap().cost.is_finite());
}
