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

/// How much of one interval's acceleration is found again in the next: the coefficient of a
/// first-order autoregression, fitted on the way with fading memory. Smooth motion gives
/// nearly 1; noise, or motion too fast for the rate of the targets, gives nearly 0.
#[derive(Debug, Clone, Copy, Default)]
struct Trend {
    last: Option<f64>,
    product: f64,
    square: f64,
}

impl Trend {
    /// Weight of the past per target: a memory of about seven targets.
    const MEMORY: f64 = 0.85;

    /// Takes note of the acceleration of the last interval; returns the one to expect next.
    fn expect_after(&mut self, seen: f64) -> f64 {
        let Some(last) = self.last.replace(seen) else {
            return 0.0;
        };
        self.product = Self::MEMORY * self.product + seen * last;
        self.square = Self::MEMORY * self.square + last * last;
        if self.square > 0.0 { (self.product / self.square).clamp(0.0, 1.0) * seen } else { 0.0 }
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Reference {
    samples: Vec<Sample>,
    acceleration: Vec<f64>,
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
            acceleration: vec![0.0; joints],
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
            let acceleration = &mut self.acceleration[joint];
            match (self.source, new.acceleration_rad_s2) {
                (AccelerationSource::Zero, _) | (AccelerationSource::Given, None) => {
                    *acceleration = 0.0;
                }
                (_, Some(given)) => *acceleration = given,
                (AccelerationSource::Estimated, None) if comparable => {
                    let seen = (new.velocity_rad_s - old.velocity_rad_s) / interval_s;
                    *acceleration = self.trend[joint].expect_after(seen);
                }
                // Two targets at almost one instant say nothing new about the acceleration.
                (AccelerationSource::Estimated, None) if self.seen && interval_s < self.coast_s => {}
                (AccelerationSource::Estimated, None) => {
                    *acceleration = 0.0;
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
        let acceleration = self.acceleration[joint];
        // The acceleration acts within the coasting age to either side of the sample.
        let bent_s = at_s.clamp(-self.coast_s, self.coast_s);
        let rate = sample.velocity_rad_s + acceleration * bent_s;
        let q = sample.position_rad
            + bent_s * (sample.velocity_rad_s + acceleration * bent_s / 2.0)
            + (at_s - bent_s) * rate;
        let inside = (at_s - bent_s).abs() <= 0.0;
        [q, rate, if inside { acceleration } else { 0.0 }]
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
