//! Where one repetition of an action ends: the period of a repeated motion.
//!
//! The normalised autocorrelation of the centred track, summed over its coordinates, is one at lag zero and comes back
//! towards one at each whole period. The first local maximum above a threshold is the period; a parabola through the
//! three samples around it refines it below the sampling step.

/// Finds the period of a uniformly sampled track, in samples, or `None` where nothing repeats.
///
/// `track` is `(n, D)`; lags from `min_lag` to `n / 2` are searched, so that every lag is judged on at least half of the
/// samples. `threshold` is the autocorrelation (1 = perfect repetition) below which a maximum does not count.
///
/// ```
/// let track: Vec<[f64; 1]> = (0..200).map(|i| [(core::f64::consts::TAU * f64::from(i) / 40.0).sin()]).collect();
/// let period = follow::find_period(&track, 10, 0.6).unwrap();
/// assert!((period - 40.0).abs() < 0.2);
/// ```
pub fn find_period<const D: usize>(track: &[[f64; D]], min_lag: usize, threshold: f64) -> Option<f64> {
    let n = track.len();
    let max_lag = n / 2;
    if min_lag == 0 || max_lag < min_lag + 2 {
        return None;
    }
    let mut mean = [0.0; D];
    for row in track {
        for (m, x) in mean.iter_mut().zip(row) {
            *m += x / n as f64;
        }
    }
    let correlation = |lag: usize| -> f64 {
        let (mut cross, mut head, mut tail) = (0.0, 0.0, 0.0);
        for (a, b) in track.iter().zip(&track[lag..]) {
            for ((x, y), m) in a.iter().zip(b).zip(&mean) {
                cross += (x - m) * (y - m);
                head += (x - m) * (x - m);
                tail += (y - m) * (y - m);
            }
        }
        let scale = (head * tail).sqrt();
        // A track that stays within a millionth of its unit stands still; what is left of it is rounding.
        if scale > 1e-12 * n as f64 { cross / scale } else { 0.0 }
    };
    let values: Vec<f64> = (min_lag - 1..=max_lag).map(correlation).collect();
    let best = values[1..values.len() - 1].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // The first maximum that is nearly as good as the best one: its multiples are just as good.
    let index = (1..values.len() - 1).find(|&i| {
        values[i] > threshold && values[i] > best - 0.1 && values[i] >= values[i - 1] && values[i] >= values[i + 1]
    })?;
    let (a, b, c) = (values[index - 1], values[index], values[index + 1]);
    let bend = a - 2.0 * b + c;
    let shift = if bend < 0.0 { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { 0.0 };
    Some((min_lag - 1 + index) as f64 + shift)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_has_no_period() {
        let track: Vec<[f64; 2]> = (0..200).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        assert_eq!(find_period(&track, 10, 0.6), None);
    }

    #[test]
    fn a_still_arm_has_no_period() {
        assert_eq!(find_period(&[[1.0, 2.0, 3.0]; 100], 10, 0.6), None);
    }

    #[test]
    fn the_fundamental_wins_over_its_multiples() {
        let track: Vec<[f64; 2]> = (0..600)
            .map(|i| {
                let a = core::f64::consts::TAU * f64::from(i) / 91.5;
                [a.sin() + 0.4 * (2.0 * a).cos(), a.cos()]
            })
            .collect();
        let period = find_period(&track, 20, 0.6).unwrap();
        assert!((period - 91.5).abs() < 0.3, "{period}");
    }

    #[test]
    fn too_short_a_track_is_no_evidence() {
        assert_eq!(find_period(&[[0.0]; 10], 8, 0.6), None);
        assert_eq!(find_period::<1>(&[], 1, 0.6), None);
    }
}
