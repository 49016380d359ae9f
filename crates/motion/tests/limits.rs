//! No sequence of targets and time steps takes a command over a limit.

mod judge;

use std::time::Duration;

use judge::{Judge, TOLERANCE};
use motion::{
    AccelerationSource, AgePolicy, EngageParams, JointLimits, Sample, State, Synchronisation, Target, TrackerParams,
};
use proptest::prelude::*;

fn params(limits: Vec<JointLimits>, bandwidth: f64, synchronisation: Synchronisation) -> TrackerParams {
    TrackerParams {
        limits,
        bandwidth_rad_s: bandwidth,
        synchronisation,
        acceleration: AccelerationSource::Estimated,
        age: AgePolicy { coast: Duration::from_millis(100), fade: Duration::from_millis(200) },
        max_step: Duration::from_millis(50),
        horizon_capacity: 0,
        engage: EngageParams { velocity_rad_s: 0.3, tolerance_rad: 0.02, gap_rad: 0.01, ramp: Duration::from_secs(1) },
    }
}

prop_compose! {
    fn limits()(
        lower in -3.0..0.0_f64,
        width in prop_oneof![1e-3..0.1_f64, 0.1..6.0_f64],
        velocity in prop_oneof![0.01..1.0_f64, 1.0..10.0_f64],
        acceleration in 0.1..100.0_f64,
        jerk in 1.0..5000.0_f64,
    ) -> JointLimits {
        JointLimits {
            lower_rad: lower,
            upper_rad: lower + width,
            velocity_rad_s: velocity,
            acceleration_rad_s2: acceleration,
            jerk_rad_s3: jerk,
        }
    }
}

/// One tick: time step, and perhaps a target (position as a share of the range, velocity as a
/// share of the limit).
fn tick() -> impl Strategy<Value = (u64, Option<(f64, f64)>)> {
    let dt = prop_oneof![Just(5_000_u64), 1_000..5_000_u64, 10..1_000_u64, 5_000..50_000_u64];
    let position = prop_oneof![0.0..1.0, -1.0..2.0, Just(0.0), Just(1.0)];
    let velocity = prop_oneof![-1.0..1.0, -3.0..3.0, Just(0.0)];
    (dt, prop::option::of((position, velocity)))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, ..ProptestConfig::default() })]

    #[test]
    fn commands_stay_inside_all_limits_for_any_targets_and_time_steps(
        limits in limits(),
        start in 0.0..1.0_f64,
        bandwidth in 5.0..60.0_f64,
        together in any::<bool>(),
        ticks in prop::collection::vec(tick(), 1..200),
    ) {
        let synchronisation =
            if together { Synchronisation::Straight } else { Synchronisation::None };
        let width = limits.upper_rad - limits.lower_rad;
        let start = State::at_rest(limits.lower_rad + start * width);
        let other = JointLimits { velocity_rad_s: 1.0, ..limits };
        let plan = params(vec![limits, other], bandwidth, synchronisation).validate().unwrap();
        let mut tracker = plan.take_over(&[start; 2]).unwrap();
        let mut judges = [Judge::new(limits, start), Judge::new(other, start)];
        for (micros, target) in ticks {
            if let Some((position, velocity)) = target {
                let sample = Sample::new(
                    limits.lower_rad + position * width,
                    velocity * limits.velocity_rad_s,
                );
                tracker.offer(&Target::new(0.0, &[sample, sample])).unwrap();
            }
            let dt = Duration::from_micros(micros);
            tracker.update(dt).unwrap();
            for (judge, x) in judges.iter_mut().zip(tracker.states()) {
                let excess = judge.see(*x, dt.as_secs_f64());
                prop_assert!(excess.worst() <= TOLERANCE, "{excess:?}");
            }
        }
    }
}
