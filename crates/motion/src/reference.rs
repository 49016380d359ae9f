//! The moving reference between targets: the newest target, continued to the present.
//!
//! With the target `(p, v, a)` of age `t`, the reference lies at `q(w(t))`, `q(w) = p + v w +
//! a w^2 / 2`, where the warp `w(t)` equals `t` up to the coasting age and then slows to rest
//! with a smooth step, for all joints alike: the reference stops *on* the path that it was
//! following. With a horizon, `q` is the cubic Hermite curve through its points.

use crate::error::{Error, Result};
use crate::params::TrackerParams;
use crate::state::State;
use crate::target::{AccelerationSource, AgePolicy, Sample, Target};

/// Freshness of the newest target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freshness {
    /// No target has arrived since engaging.
    None,
    /// Within the coasting age.
    Fresh,
    /// Older: the reference slows down along its path.
    Fading,
    /// Older still: the reference rests.
    Stale,
}

/// Target intervals shorter than this give no acceleration estimate: noise over almost nothing.
const SHORTEST_ESTIMATE_S: f64 = 0.005;

/// Weight of the past per target in all estimates: a memory of about seven targets.
const MEMORY: f64 = 0.85;
/// Targets after which the two continuations of a motion have been compared often enough.
const JUDGED: u32 = 4;
/// A swing is believed if its squared errors are below this share of the parabola's.
const SWING_SHARE: f64 = 0.2;
/// Largest phase between two targets at which a swing is told from noise; at pi it no longer can be.
const LARGEST_PHASE: f64 = 2.2;

/// How the motion goes on after a sample.
#[derive(Debug, Clone, Copy, Default)]
struct Course {
    acceleration: f64,
    /// Angular frequency `w` of a swing, whose jerk is `-w^2 v`; zero for constant acceleration.
    frequency: f64,
}

impl Course {
    /// Position relative to the sample, velocity and acceleration after a time, from the sample's velocity.
    fn after(&self, v: f64, t: f64) -> [f64; 3] {
        let (a, w) = (self.acceleration, self.frequency);
        if w * t.abs() < 1e-4 {
            return [t * (v + a * t / 2.0), v + a * t, a];
        }
        let (sine, cosine) = (w * t).sin_cos();
        // 1 - cos without cancellation.
        let versed = 2.0 * (w * t / 2.0).sin().powi(2);
        [v / w * sine + a / (w * w) * versed, v * cosine + a / w * sine, a * cosine - v * w * sine]
    }
}

/// Two ways to continue a motion from its last targets, and which of them has lately been right.
///
/// The parabola takes a share of the last interval's acceleration: as much as one interval's acceleration is found
/// again in the next, the coefficient of a first-order autoregression. Smooth motion gives nearly 1; noise
/// nearly 0. The swing takes the jerk to be `-w^2 v`, as in every motion to and fro, with `w^2` from the same kind of
/// fit: the velocities then obey `v_{k+1} = 2 cos(w T) v_k - v_{k-1}`, whose acceleration at the newest target is
/// known and not half an interval old. Both are compared with each new target; the swing is used while it errs less.
#[derive(Debug, Clone, Copy, Default)]
struct Trend {
    /// Acceleration and length of the last interval.
    last: Option<(f64, f64)>,
    product: f64,
    square: f64,
    jerk_product: f64,
    velocity_square: f64,
    parabola: Course,
    swing: Course,
    parabola_error: f64,
    swing_error: f64,
    judged: u32,
}

impl Trend {
    /// Takes note of the interval between two targets; returns how the motion goes on after the newer one.
    fn expect_after(&mut self, old: &Sample, new: &Sample, interval_s: f64) -> Course {
        let (v0, v1, t) = (old.velocity_rad_s, new.velocity_rad_s, interval_s);
        let seen = (v1 - v0) / t;
        let Some((last, last_s)) = self.last.replace((seen, t)) else {
            return Course::default();
        };
        let moved = new.position_rad - old.position_rad;
        let miss = |course: &Course| (course.after(v0, t)[0] - moved).powi(2);
        self.parabola_error = MEMORY * self.parabola_error + miss(&self.parabola);
        self.swing_error = MEMORY * self.swing_error + miss(&self.swing);
        self.judged += 1;

        self.product = MEMORY * self.product + seen * last;
        self.square = MEMORY * self.square + last * last;
        let share = if self.square > 0.0 { (self.product / self.square).clamp(0.0, 1.0) } else { 0.0 };
        self.parabola = Course { acceleration: share * seen, frequency: 0.0 };
        self.swing = self.swing_after(v0, v1, seen - last, t, f64::midpoint(t, last_s)).unwrap_or(self.parabola);
        if !(self.square + self.velocity_square + self.parabola_error + self.swing_error).is_finite() {
            // A target beyond all measure must not spoil the estimates for ever.
            *self = Self::default();
            return Course::default();
        }
        let swings = self.judged >= JUDGED && self.swing_error < SWING_SHARE * self.parabola_error;
        if swings { self.swing } else { self.parabola }
    }

    /// The swing through the velocities `v0` and `v1`, `t` apart, if the fit of the jerks speaks of one.
    fn swing_after(&mut self, v0: f64, v1: f64, change: f64, t: f64, mean_s: f64) -> Option<Course> {
        self.jerk_product = MEMORY * self.jerk_product - change / mean_s * v0;
        self.velocity_square = MEMORY * self.velocity_square + v0 * v0;
        let cosine = 1.0 - self.jerk_product / self.velocity_square * mean_s * mean_s / 2.0;
        if !(cosine < 1.0 && cosine > LARGEST_PHASE.cos()) {
            return None;
        }
        let frequency = cosine.acos() / mean_s;
        if !(1e-3..LARGEST_PHASE).contains(&(frequency * t)) {
            return None;
        }
        let (sine, cosine) = (frequency * t).sin_cos();
        Some(Course { acceleration: frequency * (v1 * cosine - v0) / sine, frequency })
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Reference {
    samples: Vec<Sample>,
    course: Vec<Course>,
    trend: Vec<Trend>,
    horizon: Vec<Sample>,
    rows: usize,
    horizon_step_s: f64,
    age_s: f64,
    seen: bool,
    source: AccelerationSource,
    coast_s: f64,
    fade_s: f64,
}

/// Warped time with its first two derivatives.
struct Warp {
    at_s: f64,
    slope: f64,
    bend: f64,
}

impl Reference {
    pub(crate) fn new(params: &TrackerParams) -> Self {
        let joints = params.limits.len();
        let AgePolicy { coast, fade } = params.age;
        Self {
            samples: vec![Sample::new(0.0, 0.0); joints],
            course: vec![Course::default(); joints],
            trend: vec![Trend::default(); joints],
            horizon: vec![Sample::new(0.0, 0.0); joints * params.horizon_capacity],
            rows: 0,
            horizon_step_s: 0.0,
            age_s: 0.0,
            seen: false,
            source: params.acceleration,
            coast_s: coast.as_secs_f64(),
            fade_s: fade.as_secs_f64(),
        }
    }

    pub(crate) fn forget(&mut self) {
        self.seen = false;
        self.trend.fill(Trend::default());
    }

    pub(crate) fn is_present(&self) -> bool {
        self.seen
    }

    /// Lets time pass.
    pub(crate) fn grow_older(&mut self, span_s: f64) {
        self.age_s += span_s;
    }

    /// Takes over a checked target.
    pub(crate) fn accept(&mut self, target: &Target<'_>) -> Result<()> {
        let interval_s = self.age_s - target.age_s;
        if self.seen && interval_s <= 0.0 {
            return Err(Error::OutOfOrder { age_s: target.age_s, newest_age_s: self.age_s });
        }
        let comparable = self.seen && (SHORTEST_ESTIMATE_S..=self.coast_s).contains(&interval_s);
        for (joint, new) in target.joints.iter().enumerate() {
            let old = self.samples[joint];
            let course = &mut self.course[joint];
            match (self.source, new.acceleration_rad_s2) {
                (AccelerationSource::Zero, _) | (AccelerationSource::Given, None) => {
                    *course = Course::default();
                }
                (_, Some(acceleration)) => *course = Course { acceleration, frequency: 0.0 },
                (AccelerationSource::Estimated, None) if comparable => {
                    *course = self.trend[joint].expect_after(&old, new, interval_s);
                }
                // Two targets at almost one instant say nothing new about the acceleration.
                (AccelerationSource::Estimated, None) if self.seen && interval_s < self.coast_s => {}
                (AccelerationSource::Estimated, None) => {
                    *course = Course::default();
                    self.trend[joint] = Trend::default();
                }
            }
            self.samples[joint] = *new;
        }
        self.horizon[..target.horizon.len()].copy_from_slice(target.horizon);
        self.rows = target.horizon.len() / target.joints.len();
        self.horizon_step_s = target.horizon_step.as_secs_f64();
        self.age_s = target.age_s;
        self.seen = true;
        Ok(())
    }

    fn horizon_end_s(&self) -> f64 {
        self.rows as f64 * self.horizon_step_s
    }

    pub(crate) fn freshness(&self) -> Freshness {
        let coast_s = self.coast_s.max(self.horizon_end_s());
        if !self.seen {
            Freshness::None
        } else if self.age_s <= coast_s {
            Freshness::Fresh
        } else if self.age_s < coast_s + self.fade_s {
            Freshness::Fading
        } else {
            Freshness::Stale
        }
    }

    fn warp(&self) -> Warp {
        let coast_s = self.coast_s.max(self.horizon_end_s());
        let over_s = self.age_s - coast_s;
        if over_s <= 0.0 {
            return Warp { at_s: self.age_s, slope: 1.0, bend: 0.0 };
        }
        if over_s >= self.fade_s {
            return Warp { at_s: coast_s + self.fade_s / 2.0, slope: 0.0, bend: 0.0 };
        }
        let u = over_s / self.fade_s;
        Warp {
            at_s: coast_s + self.fade_s * u * (1.0 - u * u * (1.0 - u / 2.0)),
            slope: 1.0 - u * u * (3.0 - 2.0 * u),
            bend: -6.0 * u * (1.0 - u) / self.fade_s,
        }
    }

    /// Writes the present reference of every joint.
    pub(crate) fn evaluate_into(&self, out: &mut [State]) {
        let warp = self.warp();
        for (joint, state) in out.iter_mut().enumerate() {
            let [q, rate, bend] = self.path(joint, warp.at_s);
            *state = State {
                position_rad: q,
                velocity_rad_s: rate * warp.slope,
                acceleration_rad_s2: bend * warp.slope * warp.slope + rate * warp.bend,
            };
        }
    }

    /// `q`, `q'` and `q''` of one joint, `at_s` seconds after its sample.
    fn path(&self, joint: usize, at_s: f64) -> [f64; 3] {
        let joints = self.samples.len();
        let row = |k: usize| {
            if k == 0 { &self.samples[joint] } else { &self.horizon[(k - 1) * joints + joint] }
        };
        if self.rows > 0 && at_s >= 0.0 {
            let index = (at_s / self.horizon_step_s) as usize;
            if index >= self.rows {
                let last = row(self.rows);
                let over_s = at_s - self.horizon_end_s();
                return [last.position_rad + last.velocity_rad_s * over_s, last.velocity_rad_s, 0.0];
            }
            let u = at_s / self.horizon_step_s - index as f64;
            return hermite(row(index), row(index + 1), self.horizon_step_s, u);
        }
        let sample = row(0);
        // The course holds within the coasting age to either side of the sample.
        let bent_s = at_s.clamp(-self.coast_s, self.coast_s);
        let [way, rate, bend] = self.course[joint].after(sample.velocity_rad_s, bent_s);
        let inside = (at_s - bent_s).abs() <= 0.0;
        [sample.position_rad + way + (at_s - bent_s) * rate, rate, if inside { bend } else { 0.0 }]
    }
}

/// Cubic Hermite curve between two samples `step_s` apart, at `u` in [0, 1], with derivatives.
fn hermite(from: &Sample, to: &Sample, step_s: f64, u: f64) -> [f64; 3] {
    let chord = to.position_rad - from.position_rad;
    let (start, end) = (from.velocity_rad_s * step_s, to.velocity_rad_s * step_s);
    let square = 3.0 * chord - 2.0 * start - end;
    let cube = start + end - 2.0 * chord;
    [
        from.position_rad + u * (start + u * (square + u * cube)),
        (start + u * (2.0 * square + 3.0 * u * cube)) / step_s,
        (2.0 * square + 6.0 * u * cube) / (step_s * step_s),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest miss of the next target by the last `n` of a motion seen every `interval_s`.
    fn worst_miss(motion: impl Fn(f64) -> (f64, f64), interval_s: f64, targets: u32, last: u32) -> f64 {
        let sample = |k: u32| {
            let (p, v) = motion(f64::from(k) * interval_s);
            Sample::new(p, v)
        };
        let mut trend = Trend::default();
        let mut course = Course::default();
        let mut worst = 0.0_f64;
        for k in 1..targets {
            let (old, new) = (sample(k - 1), sample(k));
            if k >= targets - last {
                let reached = old.position_rad + course.after(old.velocity_rad_s, interval_s)[0];
                let miss = (reached - new.position_rad).abs();
                // A miss that is no number is the worst of all.
                worst = if miss <= worst { worst } else { miss };
            }
            course = trend.expect_after(&old, &new, interval_s);
        }
        worst
    }

    #[test]
    fn a_sine_seen_five_times_per_period_is_continued_exactly() {
        let (w, amplitude) = (std::f64::consts::TAU * 3.0, 0.02);
        let miss = worst_miss(|t| (amplitude * (w * t).sin(), amplitude * w * (w * t).cos()), 1.0 / 15.0, 30, 15);
        assert!(miss < 1e-12, "{miss}");
    }

    #[test]
    fn a_constant_acceleration_is_continued_exactly() {
        let miss = worst_miss(|t| (0.1 + 0.3 * t + 0.5 * t * t, 0.3 + t), 1.0 / 30.0, 30, 10);
        assert!(miss < 1e-12, "{miss}");
    }

    #[test]
    fn noise_is_not_taken_for_a_swing() {
        // Velocities without any connection: the guess stays near the last velocity, and none is far off.
        let noise = |t: f64| (0.0, ((t * 30.0).round() * 12.9898).sin() * 43_758.545_3 % 1.0);
        let miss = worst_miss(noise, 1.0 / 30.0, 400, 380);
        assert!(miss < 1.5 / 30.0, "{miss}");
    }

    #[test]
    fn an_absurd_target_is_forgotten() {
        let motion = |t: f64| if (0.49..0.51).contains(&t) { (1e200, -1e200) } else { (0.3 * t, 0.3) };
        assert!(worst_miss(motion, 0.1, 30, 10) < 1e-12);
    }

    #[test]
    fn a_swing_reaches_back_through_its_last_velocity() {
        let course = Course { acceleration: 0.4, frequency: 9.0 };
        let [way, rate, bend] = course.after(0.7, 0.05);
        let back = Course { acceleration: bend, frequency: 9.0 }.after(rate, -0.05);
        assert!((back[0] + way).abs() < 1e-15 && (back[1] - 0.7).abs() < 1e-14 && (back[2] - 0.4).abs() < 1e-14);
    }
}
