//! The last word on every command: the wanted jerk, reduced until the joint can still stop.
//!
//! Invariant: after each step the state is viable, that is, its [`Brake`] stays inside position,
//! velocity and acceleration limits. The brake itself is always a permitted motion, so the guard
//! looks for the largest share `lambda` of the wanted jerk in
//! `(1 - lambda) * brake + lambda * wanted` whose whole step stays inside and whose end is
//! viable. Jerk stays inside its limit because it is an average of two permitted ones.
//! `lambda = 0` needs no search, hence a command exists in bounded time. Nothing here
//! depends on the length of the next step.
//!
//! From a state outside the limits the brake is followed as long as velocity or acceleration is
//! outside, and a position limit is widened to what the brake cannot avoid, never further.

use crate::brake::{Brake, coasting_velocity, velocity_roots};
use crate::state::State;

/// The limits in force during a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walls {
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    pub(crate) velocity: f64,
    pub(crate) acceleration: f64,
    pub(crate) jerk: f64,
}

/// What the guard did to the wanted jerk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Taken as it is.
    Free,
    /// Mixed with the brake.
    Reduced,
    /// Velocity or acceleration is outside its limit: brake at full rate.
    Recovering,
}

/// Share of a limit that counts as rounding, not as a violation to recover from.
const ROUNDING: f64 = 1e-12;
/// Halvings of the search interval of lambda; the rest, 2^-20 of the jerk limit, is invisible.
const HALVINGS: u32 = 20;

/// One step of `span_s` seconds from `x` towards the jerk `wanted`.
pub(crate) fn step(x: State, wanted: f64, span_s: f64, walls: &Walls) -> (State, Verdict) {
    let brake = Brake::of(x, walls.acceleration, walls.jerk);
    let coasting = coasting_velocity(x.velocity_rad_s, x.acceleration_rad_s2, walls.jerk);
    let speed = x.velocity_rad_s.abs().max(coasting.abs());
    let pull = x.acceleration_rad_s2.abs();
    if speed > walls.velocity * (1.0 + ROUNDING) || pull > walls.acceleration * (1.0 + ROUNDING) {
        return (brake.state_after(x, span_s), Verdict::Recovering);
    }
    let (low, high) = brake.extent(x);
    let walls = Walls {
        lower: walls.lower.min(low),
        upper: walls.upper.max(high),
        velocity: walls.velocity.max(speed),
        acceleration: walls.acceleration.max(pull),
        jerk: walls.jerk,
    };
    let most = ((walls.acceleration - x.acceleration_rad_s2) / span_s).min(walls.jerk);
    let least = ((-walls.acceleration - x.acceleration_rad_s2) / span_s).max(-walls.jerk);
    let wanted = wanted.min(most).max(least);
    if let Some(end) = walk(x, &[(span_s, wanted)], &walls) {
        return (end, Verdict::Free);
    }
    let pieces = within(&brake, span_s);
    let blend = |share: f64| pieces.map(|(span, jerk)| (span, jerk + share * (wanted - jerk)));
    let (mut inside, mut outside) = (0.0, 1.0);
    let mut best = None;
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(inside, outside);
        if let Some(end) = walk(x, &blend(middle), &walls) {
            inside = middle;
            best = Some(end);
        } else {
            outside = middle;
        }
    }
    let end = best.unwrap_or_else(|| brake.state_after(x, span_s));
    (end, Verdict::Reduced)
}

/// The first `span_s` seconds of a brake as four pieces, the last one at rest.
fn within(brake: &Brake, span_s: f64) -> [(f64, f64); 4] {
    let mut left = span_s;
    let mut pieces = [(0.0, 0.0); 4];
    for ((piece, span), jerk) in pieces.iter_mut().zip(brake.span_s).zip(brake.jerk) {
        let used = span.min(left);
        *piece = (used, jerk);
        left -= used;
    }
    pieces[3].0 = left.max(0.0);
    pieces
}

/// Follows the pieces; `None` if a limit is crossed on the way or the end is not viable.
fn walk(start: State, pieces: &[(f64, f64)], walls: &Walls) -> Option<State> {
    let mut x = start;
    for &(span, jerk) in pieces {
        if span <= 0.0 {
            continue;
        }
        let next = x.after(jerk, span);
        if next.acceleration_rad_s2.abs() > walls.acceleration {
            return None;
        }
        // The velocity peaks where the acceleration changes sign.
        if x.acceleration_rad_s2 * next.acceleration_rad_s2 < 0.0 {
            let peak = x.after(jerk, -x.acceleration_rad_s2 / jerk).velocity_rad_s;
            if peak.abs() > walls.velocity {
                return None;
            }
        }
        // The position peaks where the velocity changes sign; only near a wall does it matter.
        let reach = walls.velocity * span;
        if x.position_rad + reach > walls.upper || x.position_rad - reach < walls.lower {
            for t in velocity_roots(x, jerk) {
                if t > 0.0 && t < span {
                    let peak = x.after(jerk, t).position_rad;
                    if peak > walls.upper || peak < walls.lower {
                        return None;
                    }
                }
            }
        }
        x = next;
    }
    viable(x, walls).then_some(x)
}

/// Whether the brake of `x` stays inside all limits.
pub(crate) fn viable(x: State, walls: &Walls) -> bool {
    let coasting = coasting_velocity(x.velocity_rad_s, x.acceleration_rad_s2, walls.jerk);
    if !(x.velocity_rad_s.abs() <= walls.velocity && coasting.abs() <= walls.velocity) {
        return false;
    }
    let (low, high) = Brake::of(x, walls.acceleration, walls.jerk).extent(x);
    low >= walls.lower && high <= walls.upper
}
