//! How long one update of six joints takes.

use std::time::{Duration, Instant};

use motion::{Sample, State, Target};
use rsruckig::prelude::{IgnoreErrorHandler, InputParameter, OutputParameter, Ruckig};

use crate::followers::{LIMITS, TICK_S, params};

/// Durations in microseconds.
pub(crate) struct Spread {
    pub(crate) mean: f64,
    pub(crate) p50: f64,
    pub(crate) p99: f64,
    pub(crate) max: f64,
    pub(crate) n: usize,
}

fn spread(mut us: Vec<f64>) -> Spread {
    us.sort_by(f64::total_cmp);
    let at = |share: f64| us[((us.len() - 1) as f64 * share) as usize];
    Spread { mean: us.iter().sum::<f64>() / us.len() as f64, p50: at(0.5), p99: at(0.99), max: at(1.0), n: us.len() }
}

const UPDATES: u32 = 100_000;

/// Six joints behind sines of six frequencies, near the limits, seen at 30 Hz.
fn motion(joint: usize, t: f64) -> (f64, f64) {
    let w = 4.0 + joint as f64;
    let amplitude = 12.0 / (w * w);
    (amplitude * (w * t).sin(), amplitude * w * (w * t).cos())
}

pub(crate) fn ours(bandwidth_rad_s: f64) -> Spread {
    let plan = params(vec![LIMITS; 6], bandwidth_rad_s).validate().expect("valid parameters");
    let mut tracker = plan.take_over(&[State::at_rest(0.0); 6]).expect("six states");
    let mut us = Vec::with_capacity(UPDATES as usize);
    for k in 0..UPDATES {
        let t = f64::from(k) * TICK_S;
        let samples: [Sample; 6] = std::array::from_fn(|i| {
            let (p, v) = motion(i, t);
            Sample::new(p, v)
        });
        let start = Instant::now();
        if k % 7 == 0 {
            tracker.offer(&Target::new(0.0, &samples)).expect("finite and newer");
        }
        tracker.update(Duration::from_millis(5)).expect("a time step above zero");
        us.push(start.elapsed().as_secs_f64() * 1e6);
    }
    spread(us)
}

/// State-to-state rsruckig with a new target in each cycle.
pub(crate) fn peer() -> Spread {
    let mut generator = Ruckig::<6, IgnoreErrorHandler>::new(None, TICK_S);
    let mut input = InputParameter::<6>::new(None);
    let mut output = OutputParameter::<6>::new(None);
    for i in 0..6 {
        input.max_velocity[i] = LIMITS.velocity_rad_s;
        input.max_acceleration[i] = LIMITS.acceleration_rad_s2;
        input.max_jerk[i] = LIMITS.jerk_rad_s3;
    }
    let mut us = Vec::with_capacity(UPDATES as usize);
    for k in 0..UPDATES {
        let t = f64::from(k) * TICK_S;
        let start = Instant::now();
        for i in 0..6 {
            (input.target_position[i], input.target_velocity[i]) = motion(i, t);
        }
        if generator.update(&input, &mut output).is_ok() {
            output.pass_to_input(&mut input);
        }
        us.push(start.elapsed().as_secs_f64() * 1e6);
    }
    spread(us)
}
