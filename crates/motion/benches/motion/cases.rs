//! Millions of short motions, judged from the published commands alone.

use std::time::Duration;

use motion::{JointLimits, Sample, State, Synchronisation, Target, Tracker};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::followers::params;
use crate::judge::{Excess, Judge, TOLERANCE};

/// What a batch of cases came to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tally {
    pub(crate) cases: u64,
    pub(crate) updates: u64,
    /// Cases with any excess beyond the tolerance.
    pub(crate) violations: u64,
    pub(crate) worst: Excess,
}

impl Tally {
    const EMPTY: Self = Self {
        cases: 0,
        updates: 0,
        violations: 0,
        worst: Excess {
            position: f64::NEG_INFINITY,
            velocity: f64::NEG_INFINITY,
            acceleration: f64::NEG_INFINITY,
            jerk: f64::NEG_INFINITY,
            consistency: f64::NEG_INFINITY,
        },
    };

    fn merge(&mut self, other: &Self) {
        self.cases += other.cases;
        self.updates += other.updates;
        self.violations += other.violations;
        self.worst = worse(&self.worst, &other.worst);
    }
}

fn worse(a: &Excess, b: &Excess) -> Excess {
    Excess {
        position: a.position.max(b.position),
        velocity: a.velocity.max(b.velocity),
        acceleration: a.acceleration.max(b.acceleration),
        jerk: a.jerk.max(b.jerk),
        consistency: a.consistency.max(b.consistency),
    }
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    Random,
    Hostile,
}

/// Runs `cases` cases on all cores; the same seed gives the same cases.
pub(crate) fn run(kind: Kind, cases: u64, seed: u64) -> Tally {
    const CHUNKS: u64 = 64;
    let workers = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let work = |worker: u64| {
        let mut tally = Tally::EMPTY;
        for chunk in (worker..CHUNKS).step_by(workers as usize) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(chunk + if kind == Kind::Hostile { CHUNKS } else { 0 });
            let share = cases / CHUNKS + u64::from(chunk < cases % CHUNKS);
            for _ in 0..share {
                tally.merge(&case(kind, &mut rng));
            }
        }
        tally
    };
    std::thread::scope(|scope| {
        let handles: Vec<_> = (0..workers).map(|w| scope.spawn(move || work(w))).collect();
        let mut tally = Tally::EMPTY;
        for handle in handles {
            tally.merge(&handle.join().expect("a worker does not panic"));
        }
        tally
    })
}

fn log_uniform(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    (rng.random_range(low.ln()..high.ln())).exp()
}

fn limits(rng: &mut ChaCha8Rng) -> JointLimits {
    let lower_rad = rng.random_range(-3.0..1.0);
    JointLimits {
        lower_rad,
        upper_rad: lower_rad + log_uniform(rng, 1e-3, 6.0),
        velocity_rad_s: log_uniform(rng, 0.01, 10.0),
        acceleration_rad_s2: log_uniform(rng, 0.1, 100.0),
        jerk_rad_s3: log_uniform(rng, 1.0, 5000.0),
    }
}

/// A random state that surely has room to stop: halved until a crude bound on the way to rest
/// fits between the limits.
fn start(rng: &mut ChaCha8Rng, l: &JointLimits) -> State {
    let mut v = rng.random_range(-1.0..1.0) * l.velocity_rad_s;
    let mut a = rng.random_range(-1.0..1.0) * l.acceleration_rad_s2;
    loop {
        let speed = v.abs() + a * a / (2.0 * l.jerk_rad_s3);
        let time =
            speed / l.acceleration_rad_s2 + 2.0 * l.acceleration_rad_s2 / l.jerk_rad_s3 + 2.0 * a.abs() / l.jerk_rad_s3;
        let way = speed * time;
        if speed <= l.velocity_rad_s && 2.0 * way < l.upper_rad - l.lower_rad {
            return State {
                position_rad: rng.random_range(l.lower_rad + way..l.upper_rad - way),
                velocity_rad_s: v,
                acceleration_rad_s2: a,
            };
        }
        (v, a) = (v / 2.0, a / 2.0);
    }
}

fn step(rng: &mut ChaCha8Rng) -> Duration {
    let micros = match rng.random_range(0..10) {
        0..3 => 5_000,
        3..6 => rng.random_range(1_000..5_000),
        6..9 => rng.random_range(10..1_000),
        _ => rng.random_range(5_000..50_000),
    };
    Duration::from_micros(micros)
}

fn random_target(rng: &mut ChaCha8Rng, l: &JointLimits) -> Sample {
    let width = l.upper_rad - l.lower_rad;
    let position = l.lower_rad + width * rng.random_range(-0.5..1.5);
    let mut sample = Sample::new(position, l.velocity_rad_s * rng.random_range(-1.5..1.5));
    if rng.random_bool(0.3) {
        sample.acceleration_rad_s2 = Some(l.acceleration_rad_s2 * rng.random_range(-1.5..1.5));
    }
    sample
}

/// Targets 1e-18 to 1e-3 from the state, at a limit with full speed, or jumping from side to side.
fn hostile_target(rng: &mut ChaCha8Rng, l: &JointLimits, x: &State, flip: bool) -> Sample {
    let sign = |rng: &mut ChaCha8Rng| if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    match rng.random_range(0..4) {
        0 => {
            let gap = sign(rng) * 10_f64.powf(rng.random_range(-18.0..-3.0));
            Sample::new(x.position_rad + gap, x.velocity_rad_s + gap)
        }
        1 => {
            let at = if rng.random_bool(0.5) { l.upper_rad } else { l.lower_rad };
            Sample::new(at, sign(rng) * l.velocity_rad_s)
        }
        2 => Sample::new(x.position_rad, 0.0),
        _ => {
            let side = if flip { 1.0 } else { -1.0 };
            Sample {
                position_rad: side * 10.0,
                velocity_rad_s: -side * 2.0 * l.velocity_rad_s,
                acceleration_rad_s2: Some(side * 1e6),
            }
        }
    }
}

fn case(kind: Kind, rng: &mut ChaCha8Rng) -> Tally {
    let joints = if kind == Kind::Hostile && rng.random_bool(0.3) { 2 } else { 1 };
    let ticks = if kind == Kind::Hostile { 16 } else { 8 };
    let limits: Vec<JointLimits> = (0..joints).map(|_| limits(rng)).collect();
    let starts: Vec<State> = limits.iter().map(|l| start(rng, l)).collect();
    let mut params = params(limits.clone(), log_uniform(rng, 5.0, 80.0));
    if joints > 1 {
        params.synchronisation = Synchronisation::Straight;
    }
    let plan = params.validate().expect("limits in range");
    let mut tracker = plan.take_over(&starts).expect("finite states");
    let mut judges: Vec<Judge> = limits.iter().zip(&starts).map(|(l, x)| Judge::new(*l, *x)).collect();
    let mut tally = Tally { cases: 1, ..Tally::EMPTY };
    for k in 0..ticks {
        if kind == Kind::Hostile || k == 0 || rng.random_bool(0.3) {
            retarget(kind, rng, &limits, &mut tracker, k % 2 == 0);
        }
        let dt = step(rng);
        tracker.update(dt).expect("a time step above zero");
        tally.updates += 1;
        for (judge, x) in judges.iter_mut().zip(tracker.states()) {
            let excess = judge.see(*x, dt.as_secs_f64());
            tally.worst = worse(&tally.worst, &excess);
            tally.violations |= u64::from(excess.worst() > TOLERANCE);
        }
    }
    tally
}

fn retarget(kind: Kind, rng: &mut ChaCha8Rng, limits: &[JointLimits], tracker: &mut Tracker, flip: bool) {
    let mut samples = [Sample::new(0.0, 0.0); 2];
    for ((sample, l), x) in samples.iter_mut().zip(limits).zip(tracker.states()) {
        *sample = match kind {
            Kind::Random => random_target(rng, l),
            Kind::Hostile => hostile_target(rng, l, x, flip),
        };
    }
    tracker.offer(&Target::new(0.0, &samples[..limits.len()])).expect("finite and newer");
}
