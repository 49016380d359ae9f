//! Parameters that the tests share.
#![allow(dead_code, reason = "each test binary uses its own part")]

pub(crate) mod judge;

use std::time::Duration;

use motion::{
    AccelerationSource, AgePolicy, EngageParams, JointLimits, Sample, State, Synchronisation, Target, Tracker,
    TrackerParams,
};

pub(crate) const LIMITS: JointLimits =
    JointLimits { lower_rad: -2.0, upper_rad: 2.0, velocity_rad_s: 3.0, acceleration_rad_s2: 20.0, jerk_rad_s3: 500.0 };

pub(crate) fn params(limits: &[JointLimits], bandwidth_rad_s: f64) -> TrackerParams {
    TrackerParams {
        limits: limits.to_vec(),
        bandwidth_rad_s,
        synchronisation: Synchronisation::None,
        acceleration: AccelerationSource::Estimated,
        age: AgePolicy { coast: Duration::from_millis(100), fade: Duration::from_millis(200) },
        max_step: Duration::from_millis(50),
        horizon_capacity: 20,
        engage: EngageParams { velocity_rad_s: 0.3, tolerance_rad: 0.02, gap_rad: 0.01, ramp: Duration::from_secs(1) },
    }
}

/// A tracker that follows at full limits from rest.
pub(crate) fn following(params: TrackerParams, start_rad: &[f64]) -> Tracker {
    let states: Vec<State> = start_rad.iter().map(|p| State::at_rest(*p)).collect();
    params.validate().expect("valid parameters").take_over(&states).expect("finite states")
}

pub(crate) const TICK_S: f64 = 0.005;
pub(crate) const TICK: Duration = Duration::from_millis(5);

/// Offers one sample for each joint, of age zero.
pub(crate) fn offer(tracker: &mut Tracker, samples: &[(f64, f64)]) {
    let samples: Vec<Sample> = samples.iter().map(|(p, v)| Sample::new(*p, *v)).collect();
    tracker.offer(&Target::new(0.0, &samples)).expect("finite and newer");
}
