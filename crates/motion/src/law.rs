//! The tracking law: which jerk brings one joint onto its moving reference.
//!
//! Three nested stages, each wanting something of the next one (backstepping; Krstic,
//! Kanellakopoulos and Kokotovic, "Nonlinear and adaptive control design", 1995), with the
//! saturations of proximate time-optimal servos (Workman, 1987). For the position error
//! `e = p_r - p`, bandwidth `w` and reference velocity and acceleration `v_r`, `a_r`:
//!
//! ```text
//! wanted velocity      v_w = v_r + f(e)                      within +-V
//! wanted acceleration  a_w = dv_w/dt + g(v_w - v)            within +-A
//! wanted jerk          j   = da_w/dt + w (a_w - a)           within +-J
//! ```
//!
//! Near the reference `f(e) = w e` and `g(z) = w z`: the error obeys `(s + w)^3 e = 0`, three
//! equal real poles, without overshoot from rest and without lag behind a reference of constant
//! velocity or, with `a_r`, constant acceleration. Far from it `f` is the speed from which a
//! jerk-limited stop fits into the remaining distance and `g` the acceleration from which a
//! jerk-limited release fits into the remaining change of speed, so large errors are worked off
//! nearly time-optimally, without winding up. All derivatives are exact, nothing is differenced.

/// Share of acceleration and jerk that the approach plans with; the rest is for corrections.
/// Nearer to 1, a step is faster but ends with overshoot that the corrections cannot prevent.
const PLANNED_SHARE: f64 = 0.85;
/// Least share of the acceleration limit that the approach plans with, however much of it the
/// reference itself needs. Lower, a reference at the limit is caught up with ever more slowly;
/// higher, the approach cannot be braked in time and swings past.
const LEAST_SHARE: f64 = 0.3;

/// The approach speed `f` of one joint: linear up to `join`, then the stopping curve.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Approach {
    bandwidth: f64,
    acceleration: f64,
    jerk: f64,
    /// Distance up to which `f` is linear.
    join: f64,
    /// Shift of the stopping curve that makes value and slope continuous at `join`.
    shift: f64,
}

impl Approach {
    /// `demand` is the acceleration that the reference has lately needed for itself; what it
    /// leaves of the limit is there to brake the approach.
    pub(crate) fn new(bandwidth: f64, acceleration: f64, jerk: f64, demand: f64) -> Self {
        let jerk = PLANNED_SHARE * jerk;
        let acceleration = (PLANNED_SHARE * acceleration - demand).max(LEAST_SHARE * acceleration);
        // Distance on the stopping curve where its slope falls to the bandwidth, and its speed.
        let (distance, speed) = if jerk / bandwidth <= 1.5 * acceleration {
            (8.0 / 27.0 * jerk / bandwidth.powi(3), 4.0 / 9.0 * jerk / bandwidth.powi(2))
        } else {
            let ramp = acceleration / jerk;
            (
                acceleration / 8.0 * (4.0 / bandwidth.powi(2) - ramp * ramp),
                acceleration / 2.0 * (2.0 / bandwidth - ramp),
            )
        };
        let join = speed / bandwidth;
        Self { bandwidth, acceleration, jerk, join, shift: join - distance }
    }

    /// `f`, `f'` and `f''` at a distance >= 0.
    pub(crate) fn speed(&self, distance: f64) -> [f64; 3] {
        if distance <= self.join {
            return [self.bandwidth * distance, self.bandwidth, 0.0];
        }
        let d = distance - self.shift;
        let (a, j) = (self.acceleration, self.jerk);
        if d <= a.powi(3) / (j * j) {
            // The brake never reaches its acceleration limit: d = v^(3/2) / J^(1/2).
            let speed = (j * d * d).cbrt();
            let slope = 2.0 / 3.0 * speed / d;
            [speed, slope, -slope / (3.0 * d)]
        } else {
            // d = v^2 / (2 A) + v A / (2 J).
            let ramp = a / j;
            let root = (ramp * ramp + 8.0 * d / a).sqrt();
            [a / 2.0 * (root - ramp), 2.0 / root, -8.0 / (a * root.powi(3))]
        }
    }

    /// As [`speed`](Self::speed) for a reference that moves away at `receding` >= 0: no faster
    /// than what can be braked to that speed within the distance as it is now. Catching up
    /// with a reference that soon turns round must not count on where it would have been.
    fn chasing_speed(&self, distance: f64, receding: f64) -> [f64; 3] {
        let free = self.speed(distance);
        let a = self.acceleration;
        let total = (receding * receding + 2.0 * a * distance).sqrt();
        if receding > 0.0 && total - receding < free[0] {
            [total - receding, a / total, -a * a / total.powi(3)]
        } else {
            free
        }
    }

    /// `g` and `g'` at a velocity error >= 0.
    fn pull(&self, z: f64) -> [f64; 2] {
        let w = self.bandwidth;
        if z <= self.jerk / (w * w) {
            return [w * z, w];
        }
        let pull = (2.0 * self.jerk * (z - self.jerk / (2.0 * w * w))).sqrt();
        [pull, self.jerk / pull]
    }
}

/// Errors of one joint with respect to its reference, reference minus joint.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Errors {
    pub(crate) position: f64,
    pub(crate) velocity: f64,
    pub(crate) acceleration: f64,
}

/// A wanted quantity and its first derivatives; absent ones are zero.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Wanted {
    pub(crate) value: f64,
    pub(crate) rate: f64,
    pub(crate) rate_of_rate: f64,
}

/// Stage one: the wanted velocity relative to the reference.
pub(crate) fn relative_velocity(approach: &Approach, e: &Errors, v_reference: f64) -> Wanted {
    let sign = e.position.signum();
    let receding = (sign * v_reference).max(0.0);
    let [speed, slope, bend] = approach.chasing_speed(e.position.abs(), receding);
    Wanted {
        value: sign * speed,
        rate: slope * e.velocity,
        rate_of_rate: sign * bend * e.velocity * e.velocity + slope * e.acceleration,
    }
}

/// Adds the reference motion to stage one.
pub(crate) fn velocity(relative: &Wanted, v_reference: f64, a_reference: f64) -> Wanted {
    Wanted {
        value: v_reference + relative.value,
        rate: a_reference + relative.rate,
        rate_of_rate: relative.rate_of_rate,
    }
}

/// Stage two: the wanted acceleration and its rate, not yet limited.
///
/// Where the wanted velocity exceeds its limit, the limit is aimed at, unless the wanted
/// velocity, on its way down, already asks for less acceleration: so the brake before the target
/// begins in time although the speed limit hides it.
pub(crate) fn acceleration(approach: &Approach, wanted: &Wanted, limit: f64, v: f64, a: f64) -> Wanted {
    let free = pull_towards(approach, wanted, v, a);
    if wanted.value.abs() <= limit {
        return free;
    }
    let capped = Wanted { value: limit.copysign(wanted.value), ..Wanted::default() };
    let capped = pull_towards(approach, &capped, v, a);
    if (free.value < capped.value) == (wanted.value > 0.0) { free } else { capped }
}

fn pull_towards(approach: &Approach, wanted: &Wanted, v: f64, a: f64) -> Wanted {
    let z = wanted.value - v;
    let [pull, slope] = approach.pull(z.abs());
    Wanted {
        value: wanted.rate + pull.copysign(z),
        rate: wanted.rate_of_rate + slope * (wanted.rate - a),
        rate_of_rate: 0.0,
    }
}

/// Stage three: the wanted jerk, not yet limited.
pub(crate) fn jerk(bandwidth: f64, wanted: &Wanted, a: f64, limit: f64) -> f64 {
    if wanted.value.abs() > limit {
        return bandwidth * (limit.copysign(wanted.value) - a);
    }
    wanted.rate + bandwidth * (wanted.value - a)
}
