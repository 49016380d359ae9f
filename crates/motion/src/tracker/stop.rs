//! Braking to rest with a share of the limits, so that all joints take the same time.

use crate::brake::{Brake, coasting_velocity};
use crate::guard::{self, Walls};
use crate::state::State;

/// The brake with a share of acceleration and jerk limit.
pub(super) fn full_brake(x: State, walls: &Walls, share: f64) -> Brake {
    Brake::of(x, share * walls.acceleration, share * walls.jerk)
}

/// Share of the limits with which a joint takes `duration_s` to rest, if it can do so without
/// turning round or leaving its limits; otherwise 1.
pub(super) fn stop_share(x: State, walls: &Walls, duration_s: f64) -> f64 {
    let (v, a) = (x.velocity_rad_s, x.acceleration_rad_s2);
    if a.abs() > walls.acceleration || !guard::viable(x, walls) {
        return 1.0;
    }
    let fits = |share: f64| {
        let jerk = share * walls.jerk;
        let peak = coasting_velocity(v, a, jerk);
        let (low, high) = full_brake(x, walls, share).extent(x);
        a.abs() <= share * walls.acceleration
            && peak.abs() <= walls.velocity
            && peak * coasting_velocity(v, a, walls.jerk) >= 0.0
            && low >= walls.lower
            && high <= walls.upper
    };
    let (mut slow, mut fast) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = f64::midpoint(slow, fast);
        if fits(middle) && full_brake(x, walls, middle).duration_s() <= duration_s {
            fast = middle;
        } else {
            slow = middle;
        }
    }
    fast
}
