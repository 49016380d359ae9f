//! No sequence of targets and time steps takes a command over a limit.

mod common;

use std::time::Duration;

use common::judge::{Judge, TOLERANCE};
use common::{LIMITS, TICK, TICK_S, following, offer, params};
use motion::{JointLimits, Sample, State, Synchronisation, Target};
use proptest::prelude::*;

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

fn step_us() -> impl Strategy<Value = u64> {
    prop_oneof![Just(5_000_u64), 1_000..5_000_u64, 10..1_000_u64, 5_000..50_000_u64]
}

/// One tick: time step, and perhaps a target (position as a share of the range, velocity as a
/// share of the limit).
fn tick() -> impl Strategy<Value = (u64, Option<(f64, f64)>)> {
    let position = prop_oneof![0.0..1.0, -1.0..2.0, Just(0.0), Just(1.0)];
    let velocity = prop_oneof![-1.0..1.0, -3.0..3.0, Just(0.0)];
    (step_us(), prop::option::of((position, velocity)))
}

/// A target close to the state, or at a limit, or on the other side of everything.
#[derive(Debug, Clone, Copy)]
enum Hostile {
    Near { exponent: f64, up: bool },
    Limit { upper: bool, outwards: bool },
    Flip,
}

fn hostile() -> impl Strategy<Value = (u64, Hostile)> {
    let target = prop_oneof![
        (-18.0..-3.0_f64, any::<bool>()).prop_map(|(exponent, up)| Hostile::Near { exponent, up }),
        (any::<bool>(), any::<bool>()).prop_map(|(upper, outwards)| Hostile::Limit { upper, outwards }),
        Just(Hostile::Flip),
    ];
    (step_us(), target)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

    #[test]
    fn commands_stay_inside_all_limits_for_any_targets_and_time_steps(
        limits in limits(),
        start in 0.0..1.0_f64,
        bandwidth in 5.0..100.0_f64,
        together in any::<bool>(),
        ticks in prop::collection::vec(tick(), 1..200),
    ) {
        let other = JointLimits { velocity_rad_s: 1.0, ..limits };
        let mut params = params(&[limits, other], bandwidth);
        if together {
            params.synchronisation = Synchronisation::Straight;
        }
        let width = limits.upper_rad - limits.lower_rad;
        let start = limits.lower_rad + start * width;
        let mut tracker = following(params, &[start; 2]);
        let mut judges = [limits, other].map(|l| Judge::new(l, State::at_rest(start)));
        for (micros, target) in ticks {
            if let Some((position, velocity)) = target {
                let sample = (limits.lower_rad + position * width, velocity * limits.velocity_rad_s);
                offer(&mut tracker, &[sample; 2]);
            }
            let dt = Duration::from_micros(micros);
            tracker.update(dt).unwrap();
            for (judge, x) in judges.iter_mut().zip(tracker.states()) {
                let excess = judge.see(*x, dt.as_secs_f64());
                prop_assert!(excess.worst() <= TOLERANCE, "{excess:?}");
            }
        }
    }

    #[test]
    fn commands_stay_inside_all_limits_for_hostile_targets_in_each_cycle(
        limits in limits(),
        bandwidth in 5.0..200.0_f64,
        ticks in prop::collection::vec(hostile(), 50..200),
    ) {
        let middle = f64::midpoint(limits.lower_rad, limits.upper_rad);
        let mut tracker = following(params(&[limits], bandwidth), &[middle]);
        let mut judge = Judge::new(limits, State::at_rest(middle));
        let mut side = 1.0;
        for (micros, hostile) in ticks {
            let x = tracker.states()[0];
            let v = limits.velocity_rad_s;
            let target = match hostile {
                Hostile::Near { exponent, up } => {
                    let gap = if up { 10_f64.powf(exponent) } else { -(10_f64.powf(exponent)) };
                    (x.position_rad + gap, x.velocity_rad_s + gap)
                }
                Hostile::Limit { upper, outwards } => (
                    if upper { limits.upper_rad } else { limits.lower_rad },
                    if upper == outwards { v } else { -v },
                ),
                Hostile::Flip => {
                    side = -side;
                    (middle + side * 10.0, side * v * 2.0)
                }
            };
            offer(&mut tracker, &[target]);
            let dt = Duration::from_micros(micros);
            tracker.update(dt).unwrap();
            let excess = judge.see(tracker.states()[0], dt.as_secs_f64());
            prop_assert!(excess.worst() <= TOLERANCE, "{excess:?}");
        }
    }

    #[test]
    fn horizons_of_any_shape_keep_commands_inside_all_limits(
        points in prop::collection::vec((-4.0..4.0_f64, -9.0..9.0_f64), 2..20),
        step_ms in 1..200_u64,
        age_s in -0.5..0.5_f64,
    ) {
        let mut tracker = following(params(&[LIMITS], 40.0), &[0.0]);
        let mut judge = Judge::new(LIMITS, State::at_rest(0.0));
        let samples: Vec<Sample> = points.iter().map(|(p, v)| Sample::new(*p, *v)).collect();
        let target = Target {
            age_s,
            joints: &samples[..1],
            horizon: &samples[1..],
            horizon_step: Duration::from_millis(step_ms),
        };
        tracker.offer(&target).unwrap();
        for _ in 0..300 {
            tracker.update(TICK).unwrap();
            let excess = judge.see(tracker.states()[0], TICK_S);
            prop_assert!(excess.worst() <= TOLERANCE, "{excess:?}");
        }
    }

    /// From outside a limit the joint comes back, meanwhile within the jerk limit, and then stays.
    #[test]
    fn states_outside_the_limits_are_brought_back_inside(
        position in -4.0..4.0_f64,
        velocity in -9.0..9.0_f64,
        acceleration in -60.0..60.0_f64,
        target in -2.0..2.0_f64,
        micros in 1_000..20_000_u64,
    ) {
        let start = State {
            position_rad: position,
            velocity_rad_s: velocity,
            acceleration_rad_s2: acceleration,
        };
        let mut tracker = params(&[LIMITS], 40.0).validate().unwrap().take_over(&[start]).unwrap();
        let wide = JointLimits {
            lower_rad: -100.0,
            upper_rad: 100.0,
            velocity_rad_s: 1e3,
            acceleration_rad_s2: 60.0 + TOLERANCE,
            ..LIMITS
        };
        let mut outside = Judge::new(wide, start);
        offer(&mut tracker, &[(target, 0.0)]);
        let dt = Duration::from_micros(micros);
        let mut elapsed_s = 0.0;
        while elapsed_s < 6.0 {
            tracker.update(dt).unwrap();
            elapsed_s += dt.as_secs_f64();
            let excess = outside.see(tracker.states()[0], dt.as_secs_f64());
            prop_assert!(excess.worst() <= TOLERANCE, "{excess:?}");
        }
        let mut inside = Judge::new(LIMITS, tracker.states()[0]);
        tracker.update(dt).unwrap();
        let excess = inside.see(tracker.states()[0], dt.as_secs_f64());
        prop_assert!(excess.worst() <= TOLERANCE, "{excess:?}");
        prop_assert!((tracker.states()[0].position_rad - target).abs() < 1e-6);
    }
}

/// Full speed at the wall, held there for long: neither does the joint cross nor does it shake.
#[test]
fn a_target_beyond_the_range_is_approached_to_the_limit_and_not_past_it() {
    let mut tracker = following(params(&[LIMITS], 40.0), &[-1.9]);
    let mut judge = Judge::new(LIMITS, State::at_rest(-1.9));
    for _ in 0..4_000 {
        offer(&mut tracker, &[(1e6, 1e6)]);
        tracker.update(Duration::from_millis(1)).unwrap();
        assert!(judge.see(tracker.states()[0], 0.001).worst() <= TOLERANCE);
        // Not even by rounding.
        assert!(tracker.states()[0].position_rad <= LIMITS.upper_rad);
    }
    let x = tracker.states()[0];
    assert!(LIMITS.upper_rad - x.position_rad < 1e-6, "{x:?}");
    assert!(x.acceleration_rad_s2.abs() < 1e-3, "{x:?}");
}
