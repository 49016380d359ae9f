//! Lag, overshoot, jerk and error of one follower behind one signal.

use crate::followers::{Follower, TICK_S};
use crate::signals::Signal;

#[derive(Debug, Clone, Copy)]
pub(crate) struct Figures {
    /// Shift in time at which the output fits the true motion best, ms.
    pub(crate) lag_ms: f64,
    /// Largest excursion beyond the final position, for a step or ramp, rad.
    pub(crate) overshoot_rad: f64,
    /// Root mean square of the jerk averaged over each period, rad/s^3.
    pub(crate) jerk_rms: f64,
    /// Root mean square of output minus true motion, rad.
    pub(crate) error_rms_rad: f64,
    /// Time from which the error stays below 1 % of the step, ms.
    pub(crate) settled_ms: f64,
}

/// Follows `signal`, seen at `rate_hz`.
pub(crate) fn follow(follower: &mut dyn Follower, signal: &Signal, rate_hz: f64) -> Figures {
    let ticks = (signal.duration_s / TICK_S) as usize;
    let per_target = 1.0 / (rate_hz * TICK_S);
    let mut outputs = Vec::with_capacity(ticks);
    let mut next_target = 0.0;
    let mut last_acceleration = 0.0;
    let (mut jerk_squares, mut jerks) = (0.0, 0.0);
    for k in 0..ticks {
        if k as f64 >= next_target {
            let t = k as f64 * TICK_S;
            follower.offer(signal.position(t), signal.velocity(t));
            next_target += per_target;
        }
        let x = follower.tick();
        let t = (k + 1) as f64 * TICK_S;
        outputs.push((t, x.position_rad));
        if t >= signal.settled_s {
            let jerk = (x.acceleration_rad_s2 - last_acceleration) / TICK_S;
            jerk_squares += jerk * jerk;
            jerks += 1.0;
        }
        last_acceleration = x.acceleration_rad_s2;
    }
    let settled: Vec<_> = outputs.iter().copied().filter(|(t, _)| *t >= signal.settled_s).collect();
    let error = |shift: f64| {
        let sum: f64 = settled.iter().map(|(t, p)| (p - signal.position(t - shift)).powi(2)).sum();
        (sum / settled.len() as f64).sqrt()
    };
    let end = signal.position(signal.duration_s);
    let start = signal.position(0.0);
    let direction = (end - start).signum();
    Figures {
        lag_ms: 1000.0 * best_shift(error),
        overshoot_rad: outputs.iter().map(|(_, p)| direction * (p - end)).fold(0.0, f64::max),
        jerk_rms: f64::sqrt(jerk_squares / jerks),
        error_rms_rad: error(0.0),
        settled_ms: outputs
            .iter()
            .rev()
            .find(|(t, p)| (p - signal.position(*t)).abs() > 0.01 * (end - start).abs())
            .map_or(0.0, |(t, _)| 1000.0 * t),
    }
}

/// The shift in [-100, 200] ms with the least error: a grid, then golden section around it.
fn best_shift(error: impl Fn(f64) -> f64) -> f64 {
    let grid = (-50..=100).map(|k| f64::from(k) * 0.002);
    let coarse = grid.min_by(|a, b| error(*a).total_cmp(&error(*b))).unwrap_or(0.0);
    let (mut low, mut high) = (coarse - 0.002, coarse + 0.002);
    for _ in 0..20 {
        let (a, b) = (low + 0.382 * (high - low), low + 0.618 * (high - low));
        if error(a) < error(b) {
            high = b;
        } else {
            low = a;
        }
    }
    f64::midpoint(low, high)
}
