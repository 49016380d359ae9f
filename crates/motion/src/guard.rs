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
/// Halvings of the search interval of lambda; the rest is 2^-12 of the jerk limit.
const HALVINGS: u32 = 12;

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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WALLS: Walls = Walls { lower: -1.0, upper: 1.0, velocity: 2.0, acceleration: 10.0, jerk: 200.0 };

    /// Also between the commands the motion stays inside: it is sampled from the pieces.
    fn stays_inside(start: State, pieces: &[(f64, f64)]) -> bool {
        let mut x = start;
        for &(span, jerk) in pieces {
            for k in 0..=200 {
                let at = x.after(jerk, span * f64::from(k) / 200.0);
                if at.position_rad.abs() > 1.0 + 1e-9
                    || at.velocity_rad_s.abs() > 2.0 + 1e-9
                    || at.acceleration_rad_s2.abs() > 10.0 + 1e-9
                {
                    return false;
                }
            }
            x = x.after(jerk, span);
        }
        true
    }

    proptest! {
        #[test]
        fn pieces_that_pass_stay_inside_all_the_way(
            p in -1.0..1.0_f64,
            v in -2.0..2.0_f64,
            a in -10.0..10.0_f64,
            pieces in prop::collection::vec((0.0..0.1_f64, -200.0..200.0_f64), 1..4),
        ) {
            let start = State { position_rad: p, velocity_rad_s: v, acceleration_rad_s2: a };
            prop_assume!(viable(start, &WALLS));
            if walk(start, &pieces, &WALLS).is_some() {
                prop_assert!(stays_inside(start, &pieces));
            }
        }

        /// Judge: a brake simulated in small pieces from every state that the guard hands out.
        #[test]
        fn every_step_ends_where_a_stop_inside_the_limits_is_left(
            p in -1.0..1.0_f64,
            v in -2.0..2.0_f64,
            a in -10.0..10.0_f64,
            wanted in prop_oneof![Just(200.0), Just(-200.0), -1e4..1e4_f64],
            span_s in prop_oneof![1e-5..1e-3_f64, 1e-3..0.2_f64],
        ) {
            let start = State { position_rad: p, velocity_rad_s: v, acceleration_rad_s2: a };
            prop_assume!(viable(start, &WALLS));
            let (end, verdict) = step(start, wanted, span_s, &WALLS);
            prop_assert!(verdict != Verdict::Recovering);
            prop_assert!((end.acceleration_rad_s2 - a).abs() <= 200.0 * span_s + 1e-9);
            let brake = Brake::of(end, WALLS.acceleration, WALLS.jerk);
            let pieces: Vec<_> = brake.span_s.into_iter().zip(brake.jerk).collect();
            prop_assert!(stays_inside(end, &pieces), "{end:?}");
        }
    }

    /// Both ends are viable, but at v = 2 - a^2 / (2 J) only full jerk keeps the speed below 2.
    #[test]
    fn a_speed_above_the_limit_between_two_commands_is_seen() {
        let start = State { position_rad: -0.5, velocity_rad_s: 1.9375, acceleration_rad_s2: 5.0 };
        let end = start.after(-100.0, 0.15);
        assert!(viable(start, &WALLS) && viable(end, &WALLS));
        assert_eq!(walk(start, &[(0.15, -100.0)], &WALLS), None);
    }

    /// Both ends are viable; in between the joint would turn at 1.022.
    #[test]
    fn a_position_beyond_the_limit_between_two_commands_is_seen() {
        let start = State { position_rad: 0.97, velocity_rad_s: 0.5, acceleration_rad_s2: 0.0 };
        let pieces = [(0.2, -50.0), (0.1, 0.0)];
        let end = pieces.iter().fold(start, |x, (t, j)| x.after(*j, *t));
        assert!(viable(start, &WALLS) && viable(end, &WALLS));
        assert_eq!(walk(start, &pieces, &WALLS), None);
    }

    /// At full speed away from any wall the guard takes nothing away.
    #[test]
    fn far_from_all_limits_the_wanted_jerk_is_taken_as_it_is() {
        let start = State::at_rest(0.0);
        assert_eq!(step(start, 50.0, 0.005, &WALLS), (start.after(50.0, 0.005), Verdict::Free));
    }
}
