//! Judges published commands against limits, from the commands alone.
//!
//! Two commands `(p, v, a)` a time `T` apart can be joined by a motion with jerk within `+-J`
//! exactly if `|a1 - a0| <= J T`, `v1 - v0` differs from the trapezium `(a0 + a1) T / 2` by at
//! most `(J T^2 - (a1 - a0)^2 / J) / 4`, and the position lies in a range that is bounded from
//! either end by `J T^3 / 6` about the ballistic one. Divided differences of the positions alone
//! are averages of velocity, acceleration and jerk, hence bounded by the same limits.

use motion::{JointLimits, State};

/// Violations up to this are rounding.
pub(crate) const TOLERANCE: f64 = 1e-9;

#[derive(Debug, Clone)]
pub(crate) struct Judge {
    limits: JointLimits,
    /// The last four positions with their times, newest last.
    past: [(f64, f64); 4],
    known: usize,
    last: State,
}

/// Largest amount by which each quantity exceeded its limit (negative: room left).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Excess {
    pub(crate) position: f64,
    pub(crate) velocity: f64,
    pub(crate) acceleration: f64,
    pub(crate) jerk: f64,
    pub(crate) consistency: f64,
}

impl Excess {
    pub(crate) fn worst(&self) -> f64 {
        self.position.max(self.velocity).max(self.acceleration).max(self.jerk).max(self.consistency)
    }
}

impl Judge {
    pub(crate) fn new(limits: JointLimits, start: State) -> Self {
        Self { limits, past: [(0.0, start.position_rad); 4], known: 1, last: start }
    }

    /// Judges the next command, `dt` seconds after the last one.
    pub(crate) fn see(&mut self, x: State, dt: f64) -> Excess {
        let l = self.limits;
        let y = self.last;
        self.last = x;
        let all = x.position_rad + x.velocity_rad_s + x.acceleration_rad_s2;
        if !all.is_finite() {
            let inf = f64::INFINITY;
            return Excess { position: inf, velocity: inf, acceleration: inf, jerk: inf, consistency: inf };
        }
        let change = x.acceleration_rad_s2 - y.acceleration_rad_s2;
        let speed_gap =
            x.velocity_rad_s - y.velocity_rad_s - (x.acceleration_rad_s2 + y.acceleration_rad_s2) * dt / 2.0;
        let moved = x.position_rad - y.position_rad;
        let ahead = moved - dt * (y.velocity_rad_s + dt * y.acceleration_rad_s2 / 2.0);
        let behind = moved - dt * (x.velocity_rad_s - dt * x.acceleration_rad_s2 / 2.0);
        let cube = l.jerk_rad_s3 * dt.powi(3) / 6.0;
        let consistency = (speed_gap.abs() - (l.jerk_rad_s3 * dt * dt - change * change / l.jerk_rad_s3) / 4.0)
            .max(ahead.abs() - cube)
            .max(behind.abs() - cube);

        self.past.rotate_left(1);
        self.past[3] = (self.past[2].0 + dt, x.position_rad);
        self.known = (self.known + 1).min(4);
        let [first, second, third] = self.differences();
        Excess {
            position: (x.position_rad - l.upper_rad).max(l.lower_rad - x.position_rad),
            velocity: (x.velocity_rad_s.abs()).max(first) - l.velocity_rad_s,
            acceleration: (x.acceleration_rad_s2.abs()).max(second) - l.acceleration_rad_s2,
            jerk: (change.abs() - l.jerk_rad_s3 * dt).max(third - l.jerk_rad_s3),
            consistency,
        }
    }

    /// `k!` times the divided differences of orders 1 to 3, in magnitude, less the most that
    /// rounding of the positions can add; 0 where too few positions are known.
    fn differences(&self) -> [f64; 3] {
        let mut table = self.past.map(|(_, p)| p);
        let unit = f64::EPSILON * self.past.iter().fold(0.0_f64, |m, (_, p)| m.max(p.abs()));
        // Rounding error of each entry, carried through the same recursion.
        let mut error = [unit; 4];
        let mut out = [0.0; 3];
        let mut factorial = 1.0;
        for order in 1..4 {
            factorial *= order as f64;
            for k in (order..4).rev() {
                let width = self.past[k].0 - self.past[k - order].0;
                table[k] = (table[k] - table[k - 1]) / width;
                error[k] =
                    (error[k] + error[k - 1]) / width + f64::EPSILON * table[k].abs() * 8.0 * self.past[k].0 / width;
            }
            if self.known > order {
                out[order - 1] = factorial * (table[3].abs() - error[3]);
            }
        }
        out
    }
}
