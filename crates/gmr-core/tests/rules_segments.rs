//! Where motions are cut, and which samples belong to a piece.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    ChangePointParams, Error, MotionElement, RestParams, Trajectory, segment_at_rest, segment_change_points,
    segment_fixed,
};

fn sampled(n: usize, start_s: f64, step_s: f64, value: impl Fn(f64) -> f64) -> Trajectory {
    let times: Vec<f64> = (0..n).map(|i| start_s + i as f64 * step_s).collect();
    let values = times.iter().map(|t| value(t - start_s)).collect();
    Trajectory::new(times, values, 1).unwrap()
}

fn ends(elements: &[MotionElement]) -> Vec<f64> {
    elements.iter().map(|e| e.end_s).collect()
}

fn close(a: &[f64], b: &[f64], tolerance: f64) {
    assert!(a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < tolerance), "{a:?} is not {b:?}");
}

#[test]
fn a_remainder_of_half_a_period_becomes_an_element_and_a_shorter_one_joins_the_last() {
    for (duration_s, expected) in [
        (0.3, vec![0.3]),
        (1.4, vec![1.4]),
        (1.6, vec![1.0, 1.6]),
        (2.4, vec![1.0, 2.4]),
        (2.6, vec![1.0, 2.0, 2.6]),
        (3.0, vec![1.0, 2.0, 3.0]),
    ] {
        // On a clock that does not begin at zero.
        let motion = Trajectory::new(vec![7.0, 7.1, 7.2, 7.0 + duration_s], vec![0.0; 4], 1).unwrap();
        let elements = segment_fixed(&motion, 1.0).unwrap();
        close(&ends(&elements), &expected.iter().map(|e| 7.0 + e).collect::<Vec<_>>(), 1e-12);
        assert!((elements[0].start_s - 7.0).abs() < 1e-15);
    }
}

#[test]
fn more_elements_than_intervals_between_samples_are_refused() {
    let motion = sampled(11, 0.0, 0.1, |t| t);
    assert_eq!(segment_fixed(&motion, 0.1).unwrap().len(), 10);
    for period_s in [0.05, 1e-9, f64::MIN_POSITIVE] {
        let refused = segment_fixed(&motion, period_s);
        assert!(matches!(refused, Err(Error::TooFewSamples { got: 11, .. })), "{period_s}: {refused:?}");
    }
}

#[test]
fn an_element_has_the_samples_between_its_ends_and_its_margin_on_its_own_clock() {
    let motion = sampled(21, 3.0, 0.1, |t| 10.0 * t);
    // Ends that differ from the samples' times by rounding only still have them.
    let element = MotionElement { start_s: 3.0 + 5.0 * 0.1 + 1e-10, end_s: 3.0 + 9.0 * 0.1 - 1e-10 };
    assert_eq!(element.range(&motion, 0.0), 5..10);
    assert_eq!(element.range(&motion, 0.2), 3..12);
    assert_eq!(element.range(&motion, 0.15), 4..11);
    let rows = element.samples(&motion, 0.1);
    assert_eq!(rows.len(), 14);
    close(&rows[..2], &[-0.1, 4.0], 1e-9);
    close(&rows[12..], &[0.5, 10.0], 1e-9);
    // An element turned around has none.
    let backward = MotionElement { start_s: 4.0, end_s: 3.5 };
    assert_eq!(backward.range(&motion, 0.0), 10..10);
    assert!(backward.samples(&motion, 0.0).is_empty());
}

/// Speed by pieces: (until, speed), integrated.
fn pieces(speeds: &[(f64, f64)], n: usize) -> Trajectory {
    sampled(n, 0.0, 0.1, |t| {
        let (mut from, mut at) = (0.0, 0.0);
        for (until, speed) in speeds {
            at += (t.min(*until) - from).max(0.0) * speed;
            from = *until;
        }
        at
    })
}

fn rest(speed: f64, shortest_s: f64) -> RestParams {
    RestParams { speed, shortest_s }
}

#[test]
fn a_rest_is_cut_in_its_middle_unless_it_lies_at_an_end() {
    // Rests of 1 s at the beginning, from 3 s to 5 s, and at the end.
    let motion = pieces(&[(1.0, 0.0), (3.0, 1.0), (5.0, 0.0), (8.0, 1.0), (9.0, 0.0)], 91);
    let elements = segment_at_rest(&motion, &rest(0.1, 0.3)).unwrap();
    close(&ends(&elements), &[4.0, 9.0], 1e-9);
    // The speed of the threshold itself is no rest.
    let creeping = pieces(&[(3.0, 1.0), (5.0, 0.25), (9.0, 1.0)], 91);
    assert_eq!(segment_at_rest(&creeping, &rest(0.25 - 1e-9, 0.5)).unwrap().len(), 1);
    assert_eq!(segment_at_rest(&creeping, &rest(0.25 + 1e-9, 0.5)).unwrap().len(), 2);
    let exact = Trajectory::new((0..9).map(f64::from).collect(), (0..9).map(|i| 0.5 * f64::from(i)).collect(), 1);
    assert_eq!(segment_at_rest(&exact.unwrap(), &rest(0.5, 0.5)).unwrap().len(), 1);
}

#[test]
fn a_rest_that_would_leave_a_short_element_does_not_cut() {
    // Rests in the middle of 1, 2 and 5 s of a motion of 6 s.
    let moves = [(0.8, 1.0), (1.2, 0.0), (1.8, 1.0), (2.2, 0.0), (4.8, 1.0), (5.2, 0.0), (6.0, 1.0)];
    let motion = pieces(&moves, 61);
    let cut = |shortest_s| ends(&segment_at_rest(&motion, &rest(0.1, shortest_s)).unwrap());
    close(&cut(0.5), &[1.0, 2.0, 5.0, 6.0], 1e-9);
    close(&cut(0.9999), &[1.0, 2.0, 5.0, 6.0], 1e-9);
    // 2 s lies too near the cut at 1 s only if that is made: with 1.5 s it is not, and the end is too near 5 s.
    close(&cut(1.5), &[2.0, 6.0], 1e-9);
    close(&cut(3.5), &[6.0], 1e-9);
    // Two cuts 1 s apart: measured from the cut before, not from the beginning.
    close(&cut(1.0 + 1e-6), &[2.0, 6.0], 1e-9);
    let pair = pieces(&[(1.8, 1.0), (2.2, 0.0), (2.8, 1.0), (3.2, 0.0), (6.0, 1.0)], 61);
    close(&ends(&segment_at_rest(&pair, &rest(0.1, 1.5)).unwrap()), &[2.0, 6.0], 1e-9);
}

/// Squared residual of a straight line over samples `from .. to`, summed over columns, by the textbook.
fn straight(motion: &Trajectory, from: usize, to: usize) -> f64 {
    let t = &motion.times_s()[from..to];
    let n = t.len() as f64;
    let mean = t.iter().sum::<f64>() / n;
    let spread: f64 = t.iter().map(|t| (t - mean) * (t - mean)).sum();
    (0..motion.dim())
        .map(|c| {
            let y: Vec<f64> = (from..to).map(|i| motion.row(i)[c]).collect();
            let middle = y.iter().sum::<f64>() / n;
            let slope = t.iter().zip(&y).map(|(t, y)| (t - mean) * (y - middle)).sum::<f64>() / spread;
            t.iter().zip(&y).map(|(t, y)| (y - middle - slope * (t - mean)).powi(2)).sum::<f64>()
        })
        .sum()
}

/// The cheapest cuts by dynamic programming without pruning: O(n^2) over every pair.
fn cheapest(motion: &Trajectory, sigma: f64, penalty: f64, shortest: usize) -> Vec<usize> {
    let n = motion.len();
    let mut best = vec![(f64::INFINITY, 0); n + 1];
    best[0].0 = -penalty;
    for to in shortest..=n {
        for from in 0..=to - shortest {
            let cost = best[from].0 + straight(motion, from, to) / (sigma * sigma) + penalty;
            if cost < best[to].0 {
                best[to] = (cost, from);
            }
        }
    }
    let (mut cuts, mut to) = (Vec::new(), n);
    while best[to].1 > 0 {
        to = best[to].1;
        cuts.push(to);
    }
    cuts.reverse();
    cuts
}

#[test]
fn change_points_equal_the_search_without_pruning_for_any_penalty_and_shortest_element() {
    let mut cut_somewhere = 0;
    for seed in 0..12u32 {
        // Two columns with corners at other places, high above zero and late on the clock.
        let noise = |i: f64, s: f64| 0.05 * ((i * 12.9898 + s + f64::from(seed)).sin() * 43758.5453).fract();
        let n = 40;
        let times: Vec<f64> = (0..n).map(|i| 1000.0 + 0.1 * f64::from(i)).collect();
        let values = (0..n).map(f64::from).flat_map(|i| {
            let bend = f64::from(seed % 5) * 3.0 + 9.0;
            [50.0 + 0.1 * (i - bend).abs() + noise(i, 0.0), -20.0 + 0.08 * (i - 27.0).max(0.0) + noise(i, 5.0)]
        });
        let motion = Trajectory::new(times, values.collect(), 2).unwrap();
        for (sigma, penalty, shortest) in [(0.03, None, 3), (0.03, Some(4.0), 3), (0.03, Some(4.0), 6), (0.2, None, 11)]
        {
            let found = segment_change_points(&motion, &ChangePointParams { sigma, penalty, shortest }).unwrap();
            // Schwarz: two numbers per column and the place of the cut.
            let expected = cheapest(&motion, sigma, penalty.unwrap_or(5.0 * 40f64.ln()), shortest);
            let mut at: Vec<f64> =
                expected.iter().map(|&i| 0.5 * (motion.times_s()[i - 1] + motion.times_s()[i])).collect();
            at.push(motion.end_s());
            close(&ends(&found), &at, 1e-9);
            cut_somewhere += expected.len();
            let samples: Vec<usize> = found.iter().map(|e| e.range(&motion, 0.0).len()).collect();
            assert!(samples.iter().all(|s| *s >= shortest), "{samples:?}");
        }
    }
    assert!(cut_somewhere > 30);
}

#[test]
fn the_shortest_motion_is_one_element_and_a_noise_too_small_to_square_is_refused() {
    let motion = sampled(5, 0.0, 0.1, |t| (7.0 * t).sin());
    let params = ChangePointParams { sigma: 0.1, penalty: None, shortest: 5 };
    assert_eq!(segment_change_points(&motion, &params).unwrap().len(), 1);
    let tiny = ChangePointParams { sigma: 1e-200, shortest: 3, ..params };
    assert!(matches!(segment_change_points(&motion, &tiny), Err(Error::InvalidParameter { name: "sigma", .. })));
    // An exactly straight motion far from zero leaves rounding only: never a cost below zero, never a cut.
    let line = sampled(60, 5e4, 0.01, |t| 1e6 + 3e3 * t);
    let params = ChangePointParams { sigma: 1e-3, penalty: Some(1.0), shortest: 3 };
    assert_eq!(segment_change_points(&line, &params).unwrap().len(), 1);
}
