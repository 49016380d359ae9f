//! Following, ageing, stopping, engaging: against closed forms.

mod common;

use std::time::Duration;

use common::{LIMITS, TICK, TICK_S, following, offer, params};
use motion::{
    AccelerationSource, Error, Freshness, JointLimits, Phase, Sample, State, Synchronisation, Target, Tracker,
};

/// Offers `(p(t), v(t))` every `every` ticks for `span_s` and returns all commands.
fn follow(tracker: &mut Tracker, every: usize, span_s: f64, motion: impl Fn(f64) -> (f64, f64)) -> Vec<State> {
    let mut commands = Vec::new();
    for k in 0..(span_s / TICK_S) as usize {
        if k % every == 0 {
            offer(tracker, &[motion(k as f64 * TICK_S)]);
        }
        tracker.update(TICK).expect("a time step above zero");
        commands.push(tracker.states()[0]);
    }
    commands
}

#[test]
fn a_target_of_constant_velocity_is_followed_without_lag_and_without_stop_and_go() {
    let mut tracker = following(params(&[LIMITS], 40.0), &[-1.5]);
    let commands = follow(&mut tracker, 20, 4.0, |t| (-1.5 + 0.7 * t, 0.7));
    let settled = &commands[200..];
    for (k, x) in settled.iter().enumerate() {
        let t = (k + 201) as f64 * TICK_S;
        assert!((x.position_rad - (-1.5 + 0.7 * t)).abs() < 1e-9, "{x:?}");
        assert!((x.velocity_rad_s - 0.7).abs() < 1e-8, "{x:?}");
    }
}

/// A constant acceleration that the target states is followed exactly, too: with the reference
/// `p = a t^2 / 2` and error dynamics `(s + w)^3 e = 0`, nothing drives the error.
#[test]
fn a_given_constant_acceleration_is_followed_without_lag() {
    let mut params = params(&[LIMITS], 40.0);
    params.acceleration = AccelerationSource::Given;
    let mut tracker = following(params, &[0.0]);
    let mut worst = 0.0_f64;
    for k in 0..300 {
        let t = f64::from(k) * TICK_S;
        if k % 10 == 0 {
            let sample = Sample { position_rad: t * t / 2.0, velocity_rad_s: t, acceleration_rad_s2: Some(1.0) };
            tracker.offer(&Target::new(0.0, &[sample])).unwrap();
        }
        tracker.update(TICK).unwrap();
        if k > 150 {
            let t = t + TICK_S;
            worst = worst.max((tracker.states()[0].position_rad - t * t / 2.0).abs());
        }
    }
    assert!(worst < 1e-8, "{worst}");
}

#[test]
fn a_horizon_carries_a_sine_further_than_its_last_target() {
    let w = 6.0;
    let at = |t: f64| Sample::new(0.1 * (w * t).sin(), 0.1 * w * (w * t).cos());
    let rows: Vec<Sample> = (1..=20).map(|k| at(f64::from(k) * 0.05)).collect();
    let mut tracker = following(params(&[LIMITS], 60.0), &[0.0]);
    let target = Target { age_s: 0.0, joints: &[at(0.0)], horizon: &rows, horizon_step: Duration::from_millis(50) };
    tracker.offer(&target).unwrap();
    let mut worst = 0.0_f64;
    for k in 1..=200 {
        tracker.update(TICK).unwrap();
        if k > 60 {
            worst = worst.max((tracker.states()[0].position_rad - at(f64::from(k) * TICK_S).position_rad).abs());
        }
    }
    // Without the horizon the error is the amplitude, 0.1. The tracking law leaves
    // (w / bandwidth)^3 of it, since the horizon tells no jerk.
    assert!(worst < 0.1 * (6.0_f64 / 60.0).powi(3) * 3.0, "{worst}");
}

#[test]
fn a_step_ends_without_overshoot_soon_after_the_optimum() {
    for (step, bandwidth) in [(0.02, 40.0), (0.5, 25.0), (0.5, 45.0), (1.5, 40.0), (3.0, 60.0)] {
        let mut tracker = following(params(&[LIMITS], bandwidth), &[-1.5]);
        let commands = follow(&mut tracker, 10, 3.0, |_| (-1.5 + step, 0.0));
        let over = commands.iter().map(|x| x.position_rad + 1.5 - step).fold(0.0, f64::max);
        assert!(over < 1e-3 * step, "step {step}, bandwidth {bandwidth}: overshoot {over}");
        let late = commands.iter().rposition(|x| (x.position_rad + 1.5 - step).abs() > 0.01 * step);
        let settled_s = (late.unwrap() + 1) as f64 * TICK_S;
        let optimum_s = rest_to_rest_s(step, &LIMITS);
        // 8 / bandwidth is where (s + w)^3 has decayed to 1 %.
        assert!(settled_s < 1.3 * optimum_s + 8.4 / bandwidth, "{settled_s} s, optimum {optimum_s} s");
    }
}

/// Duration of the time-optimal jerk-limited motion from rest to rest, by bisection for the
/// largest speed `v` with `2 * v^2 / (2 A) ...` replaced by the symmetric distance `v T(v)`.
fn rest_to_rest_s(distance: f64, l: &JointLimits) -> f64 {
    let (a, j) = (l.acceleration_rad_s2, l.jerk_rad_s3);
    // Time to reach speed v from rest; the distance covered is v times half of it.
    let rise = |v: f64| if v >= a * a / j { v / a + a / j } else { 2.0 * (v / j).sqrt() };
    let (mut low, mut high) = (0.0, l.velocity_rad_s);
    for _ in 0..100 {
        let v = f64::midpoint(low, high);
        if v * rise(v) <= distance { low = v } else { high = v }
    }
    2.0 * rise(low) + (distance - low * rise(low)) / low
}

#[test]
fn when_targets_stop_the_joints_rest_on_the_line_they_were_following() {
    let mut tracker = following(params(&[LIMITS; 2], 40.0), &[0.0, 0.0]);
    for k in 0..200 {
        if k % 10 == 0 {
            let t = f64::from(k) * TICK_S;
            offer(&mut tracker, &[(0.5 * t, 0.5), (-0.2 * t, -0.2)]);
        }
        tracker.update(TICK).unwrap();
    }
    let mut fading = false;
    for _ in 0..400 {
        let report = tracker.update(TICK).unwrap();
        fading |= report.freshness == Freshness::Fading;
        let [x, y] = [tracker.states()[0].position_rad, tracker.states()[1].position_rad];
        assert!((y + 0.4 * x).abs() < 1e-9, "off the line: {x} {y}");
    }
    assert!(fading && tracker.is_at_rest());
    // Last target at t = 0.95 s; coasting 0.1 s and half of the fading 0.2 s at 0.5 rad/s.
    let end = 0.5 * (0.95 + 0.1 + 0.1);
    assert!((tracker.states()[0].position_rad - end).abs() < 1e-7);
}

#[test]
fn late_jittered_and_missing_targets_leave_the_motion_nearly_as_it_was() {
    let motion = |t: f64| (0.3 * (3.0 * t).sin(), 0.9 * (3.0 * t).cos());
    let error = |late: &dyn Fn(u32) -> Option<u32>| {
        let mut tracker = following(params(&[LIMITS], 40.0), &[0.0]);
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 0..2_000_u32 {
            for n in 0..=k / 7 {
                // Target n is sampled at tick 7 n and arrives `late` ticks later.
                if late(n).is_some_and(|d| 7 * n + d == k) {
                    let (p, v) = motion(f64::from(7 * n) * TICK_S);
                    let age_s = f64::from(k - 7 * n) * TICK_S;
                    // Overtaken targets are refused.
                    let _ = tracker.offer(&Target::new(age_s, &[Sample::new(p, v)]));
                }
            }
            tracker.update(TICK).unwrap();
            if k > 400 {
                let off = tracker.states()[0].position_rad - motion(f64::from(k + 1) * TICK_S).0;
                sum += off * off;
                count += 1.0;
            }
        }
        f64::sqrt(sum / count)
    };
    let clean = error(&|_| Some(0));
    let hash = |n: u32| n.wrapping_mul(2_654_435_761) >> 16;
    // 30 % of the targets missing; the others on time.
    let dropped = error(&|n| (hash(n) % 10 >= 3).then_some(0));
    let jittered = error(&|n| Some(hash(n) % 4));
    // A constant acceleration that is half an interval old misses a motion of jerk J over a gap
    // T by (1/6 + 1/4) J T^3, and the law, fed an acceleration J T too small, lags by 3 J T / w^2
    // and, knowing no jerk, J / w^3. Here J = 8.1 rad/s^3 and T = 35 ms; 50 ms with the latest
    // target; 105 ms where two targets in a row are missing.
    let bound = |t: f64| 8.1 * (5.0 / 12.0 * t.powi(3) + 3.0 * t / 1_600.0 + 1.0 / 64_000.0);
    assert!(clean < bound(0.035), "{clean}");
    assert!(jittered < bound(0.050), "{jittered}");
    assert!(dropped < bound(0.105), "{dropped}");
}

#[test]
fn stop_begins_from_the_last_command_takes_the_shortest_time_and_keeps_the_line() {
    let mut tracker = following(params(&[LIMITS; 2], 40.0), &[0.0, 0.0]);
    for k in 0..200 {
        let t = f64::from(k) * TICK_S;
        offer(&mut tracker, &[(1.0 * t, 1.0), (0.3 * t, 0.3)]);
        tracker.update(TICK).unwrap();
    }
    let before = tracker.states()[0];
    tracker.stop();
    assert_eq!(tracker.states()[0], before);
    let mut ticks = 0;
    while !tracker.is_at_rest() {
        tracker.update(TICK).unwrap();
        ticks += 1;
        let [x, y] = [tracker.states()[0].position_rad, tracker.states()[1].position_rad];
        assert!((y - 0.3 * x).abs() < 1e-7, "off the line: {x} {y}");
    }
    // From 1 rad/s: v / A + A / J = 0.05 + 0.04 s, 18 ticks and what rounding adds.
    assert!((18..=19).contains(&ticks), "{ticks}");
    let travelled = tracker.states()[0].position_rad - before.position_rad;
    assert!((travelled - 0.09 / 2.0).abs() < 1e-6, "{travelled}");
    // Stopped is stopped, whatever arrives.
    let rest = tracker.states().to_vec();
    for _ in 0..100 {
        offer(&mut tracker, &[(1.9, 1.0), (1.9, 1.0)]);
        tracker.update(TICK).unwrap();
        assert_eq!((tracker.states(), tracker.phase()), (&rest[..], Phase::Stopping));
    }
}

#[test]
fn engaging_starts_at_the_measured_pose_and_stays_slow_until_aligned() {
    let mut tracker = params(&[LIMITS], 40.0).validate().unwrap().start(&[State::at_rest(0.0)]).unwrap();
    offer(&mut tracker, &[(1.0, 0.0)]);
    tracker.update(TICK).unwrap();
    assert_eq!(tracker.states()[0], State::at_rest(0.0), "moves only once engaged");
    tracker.engage(&[0.004]).unwrap();
    assert_eq!(tracker.states()[0], State::at_rest(0.004));
    let (mut aligned_s, mut engaged_s) = (0.0, 0.0);
    for k in 1..=2_000 {
        let t = f64::from(k) * TICK_S;
        offer(&mut tracker, &[(1.0, 0.0)]);
        let from = tracker.states()[0].position_rad;
        tracker.update(TICK).unwrap();
        let moved = (tracker.states()[0].position_rad - from).abs();
        match tracker.phase() {
            Phase::Aligning => {
                aligned_s = t;
                assert!(moved <= 0.3 * TICK_S + 1e-12, "{moved} rad in one step");
            }
            Phase::Ramping => {
                engaged_s = t;
                let limit = 0.3 + 2.7 * (t - aligned_s).min(1.0);
                assert!(moved <= limit * TICK_S + 1e-12);
            }
            _ => {}
        }
    }
    assert_eq!(tracker.phase(), Phase::Engaged);
    assert!(aligned_s > 0.976 / 0.3, "{aligned_s}");
    assert!((engaged_s - aligned_s - 1.0).abs() < 0.011, "{engaged_s} {aligned_s}");
}

#[test]
fn engaging_far_from_the_command_or_in_motion_is_refused() {
    let plan = params(&[LIMITS], 40.0).validate().unwrap();
    let mut tracker = plan.start(&[State::at_rest(0.0)]).unwrap();
    let refused = tracker.engage(&[0.02]);
    assert_eq!(refused, Err(Error::EngageGap { joint: 0, gap_rad: 0.02, allowed_rad: 0.01 }));
    assert!(matches!(tracker.engage(&[f64::NAN]), Err(Error::NotFinite { joint: 0, .. })));
    let moving = State { velocity_rad_s: 1.0, ..State::at_rest(0.0) };
    let mut tracker = plan.start(&[moving]).unwrap();
    let refused = tracker.engage(&[0.0]);
    assert_eq!(refused, Err(Error::EngageWhileMoving { joint: 0, velocity_rad_s: 1.0 }));
    // It brakes to rest by itself, and then may engage where it is.
    for _ in 0..40 {
        tracker.update(TICK).unwrap();
    }
    tracker.engage(&[tracker.states()[0].position_rad]).unwrap();
}

#[test]
fn targets_that_are_not_finite_are_refused_and_change_nothing() {
    let mut clean = following(params(&[LIMITS; 2], 40.0), &[0.0, 0.0]);
    let mut teased = clean.clone();
    for k in 0..200 {
        let t = f64::from(k) * TICK_S;
        if k % 10 == 0 {
            offer(&mut clean, &[(0.3 * t, 0.3), (0.0, 0.0)]);
            offer(&mut teased, &[(0.3 * t, 0.3), (0.0, 0.0)]);
        }
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let good = Sample::new(0.1, 0.0);
            for sample in [
                Sample { position_rad: bad, ..good },
                Sample { velocity_rad_s: bad, ..good },
                Sample { acceleration_rad_s2: Some(bad), ..good },
            ] {
                let refused = teased.offer(&Target::new(0.0, &[good, sample]));
                assert!(matches!(refused, Err(Error::NotFinite { joint: 1, .. })));
                let (joints, horizon) = ([good; 2], [good, sample]);
                let target = Target { horizon: &horizon, horizon_step: TICK, ..Target::new(0.0, &joints) };
                assert!(matches!(teased.offer(&target), Err(Error::NotFinite { joint: 1, .. })));
            }
            let refused = teased.offer(&Target::new(bad, &[good; 2]));
            assert!(matches!(refused, Err(Error::Age { .. })));
        }
        clean.update(TICK).unwrap();
        teased.update(TICK).unwrap();
        assert_eq!(clean.states(), teased.states());
    }
}

#[test]
fn targets_that_are_overtaken_or_of_wrong_shape_are_refused() {
    let mut tracker = following(params(&[LIMITS], 40.0), &[0.0]);
    let sample = [Sample::new(0.1, 0.0)];
    tracker.offer(&Target::new(0.02, &sample)).unwrap();
    let refused = tracker.offer(&Target::new(0.03, &sample));
    assert_eq!(refused, Err(Error::OutOfOrder { age_s: 0.03, newest_age_s: 0.02 }));
    assert!(matches!(tracker.offer(&Target::new(0.0, &[])), Err(Error::Count { .. })));
    let long = [sample[0]; 21];
    let target = Target { horizon: &long, horizon_step: TICK, ..Target::new(0.0, &sample) };
    assert_eq!(tracker.offer(&target), Err(Error::HorizonTooLong { got: 21, capacity: 20 }));
    let target = Target { horizon_step: Duration::from_micros(999), horizon: &long[..2], ..target };
    assert!(matches!(tracker.offer(&target), Err(Error::InvalidParameter { field: "horizon_step", .. })));
    let mut two = following(params(&[LIMITS; 2], 40.0), &[0.0, 0.0]);
    let target = Target { horizon: &long[..3], horizon_step: TICK, ..Target::new(0.0, &long[..2]) };
    assert!(matches!(two.offer(&target), Err(Error::Count { expected: 2, got: 1, .. })));
    let plan = params(&[LIMITS; 2], 40.0).validate().unwrap();
    assert!(matches!(plan.start(&[State::at_rest(0.0)]), Err(Error::Count { expected: 2, got: 1, .. })));
    let wild = State { velocity_rad_s: f64::NAN, ..State::at_rest(0.0) };
    assert!(matches!(plan.start(&[State::at_rest(0.0), wild]), Err(Error::NotFinite { joint: 1, .. })));
    assert_eq!(tracker.update(Duration::ZERO), Err(Error::ZeroStep));
}

/// The same motion at 200 Hz, 1 kHz and with random steps: the paths agree.
#[test]
fn the_path_hardly_depends_on_the_time_steps() {
    let run = |steps: &dyn Fn(u64) -> u64| {
        let mut tracker = following(params(&[LIMITS], 30.0), &[0.0]);
        let (mut now_us, mut next_us, mut k) = (0_u64, 0_u64, 0_u64);
        let mut at = Vec::new();
        while now_us < 3_000_000 {
            if now_us >= next_us {
                let t = next_us as f64 * 1e-6;
                let sample = Sample::new(0.4 * (4.0 * t).sin(), 1.6 * (4.0 * t).cos());
                let age_s = (now_us - next_us) as f64 * 1e-6;
                tracker.offer(&Target::new(age_s, &[sample])).unwrap();
                next_us += 50_000;
            }
            let step = steps(k).min(next_us - now_us);
            tracker.update(Duration::from_micros(step)).unwrap();
            (now_us, k) = (now_us + step, k + 1);
            if now_us % 50_000 == 0 {
                at.push(tracker.states()[0].position_rad);
            }
        }
        at
    };
    let fine = run(&|_| 500);
    for coarse in [run(&|_| 5_000), run(&|_| 2_000), run(&|k| 300 + k * 7_919 % 4_700), run(&|_| 25_000)] {
        assert_eq!(coarse.len(), fine.len());
        let worst = coarse.iter().zip(&fine).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // Amplitude 0.4; the held jerk of a piece of at most 0.1 / w changes little.
        assert!(worst < 4e-3, "{worst}");
    }
}

#[test]
fn an_overlong_time_step_moves_no_further_than_the_longest_step_allows() {
    let mut tracker = following(params(&[LIMITS], 40.0), &[0.0]);
    for k in 0..100 {
        offer(&mut tracker, &[(f64::from(k) * TICK_S, 1.0)]);
        tracker.update(TICK).unwrap();
    }
    let from = tracker.states()[0].position_rad;
    let report = tracker.update(Duration::from_secs(2)).unwrap();
    assert_eq!(report.moved, Duration::from_millis(50));
    assert_eq!(report.freshness, Freshness::Stale);
    assert!((tracker.states()[0].position_rad - from).abs() <= 3.0 * 0.05);
}

#[test]
fn synchronised_joints_go_straight_at_the_pace_of_the_slowest() {
    let slow = JointLimits { velocity_rad_s: 0.5, acceleration_rad_s2: 5.0, jerk_rad_s3: 100.0, ..LIMITS };
    let mut params = params(&[LIMITS, slow], 30.0);
    params.synchronisation = Synchronisation::Straight;
    let mut tracker = following(params, &[0.0, 0.0]);
    let mut worst = 0.0_f64;
    for _ in 0..1_500 {
        offer(&mut tracker, &[(1.0, 0.0), (0.8, 0.0)]);
        tracker.update(TICK).unwrap();
        let [x, y] = [tracker.states()[0].position_rad, tracker.states()[1].position_rad];
        worst = worst.max((y - 0.8 * x).abs());
    }
    let end = tracker.states()[0].position_rad;
    assert!((end - 1.0).abs() < 1e-6, "{end}");
    assert!(worst < 5e-3, "{worst} rad off the straight line");
}

#[test]
fn limits_without_room_or_number_are_refused() {
    for (field, broken) in [
        ("velocity_rad_s", JointLimits { velocity_rad_s: 0.0, ..LIMITS }),
        ("acceleration_rad_s2", JointLimits { acceleration_rad_s2: f64::NAN, ..LIMITS }),
        ("jerk_rad_s3", JointLimits { jerk_rad_s3: f64::INFINITY, ..LIMITS }),
        ("upper_rad - lower_rad", JointLimits { lower_rad: 2.0, ..LIMITS }),
        ("lower_rad", JointLimits { lower_rad: -1e4, upper_rad: -1e4 + 1.0, ..LIMITS }),
    ] {
        match params(&[LIMITS, broken], 40.0).validate() {
            Err(Error::InvalidLimit { joint: 1, field: named, .. }) => assert_eq!(named, field),
            other => panic!("{field}: {other:?}"),
        }
    }
    assert!(matches!(params(&[], 40.0).validate(), Err(Error::Count { .. })));
    let refused = params(&[LIMITS], f64::NAN).validate();
    assert!(matches!(refused, Err(Error::InvalidParameter { field: "bandwidth_rad_s", .. })));
}

/// Judge: shape and speed of the limits themselves.
#[test]
fn the_reference_is_clipped_to_what_the_joints_may_do() {
    let mut params = params(&[LIMITS], 40.0);
    params.acceleration = AccelerationSource::Given;
    let mut tracker = following(params, &[0.0]);
    let mut reference = |position_rad: f64, velocity_rad_s: f64, acceleration_rad_s2: f64| {
        tracker.update(TICK).unwrap();
        let sample = Sample { position_rad, velocity_rad_s, acceleration_rad_s2: Some(acceleration_rad_s2) };
        tracker.offer(&Target::new(-TICK_S, &[sample])).unwrap();
        tracker.update(TICK).unwrap();
        tracker.reference()[0]
    };
    // Beyond the range and on the way out: it rests at the limit.
    let outside = reference(5.0, 2.0, 3.0);
    assert!((outside.position_rad - 2.0).abs() < 1e-9);
    assert!(outside.velocity_rad_s.abs() < 1e-12 && outside.acceleration_rad_s2.abs() < 1e-12);
    // On the way in it moves on.
    assert!((reference(5.0, -2.0, 0.0).velocity_rad_s + 2.0).abs() < 1e-12);
    let fast = reference(0.0, -10.0, 3.0);
    assert!((fast.velocity_rad_s + 3.0).abs() < 1e-9 && fast.acceleration_rad_s2.abs() < 1e-12, "{fast:?}");
    assert!((reference(0.0, 0.0, 1e3).acceleration_rad_s2 - 20.0).abs() < 1e-9);
}

/// From 6 rad/s at a limit of 3: ramping to the full braking acceleration takes A / J and 0.4 rad/s, releasing it as much
/// again, and the rest goes at A.
#[test]
fn too_high_a_speed_is_braked_to_the_limit_in_the_shortest_time() {
    let start = State { velocity_rad_s: 6.0, ..State::at_rest(-1.5) };
    let mut tracker = params(&[LIMITS], 40.0).validate().unwrap().take_over(&[start]).unwrap();
    let shortest_s = 20.0 / 500.0 + (6.0 - 3.0 - 0.4) / 20.0;
    let mut elapsed_s = 0.0;
    while tracker.states()[0].velocity_rad_s > 3.0 {
        // The target asks for more speed.
        offer(&mut tracker, &[(1.9, 3.0)]);
        let report = tracker.update(Duration::from_millis(1)).unwrap();
        elapsed_s += 0.001;
        assert!(report.recovering == 1 || elapsed_s > shortest_s - 0.041, "{report:?} after {elapsed_s} s");
        assert!(elapsed_s < shortest_s + 0.003, "{:?}", tracker.states());
    }
}

#[test]
fn engaging_needs_one_measured_value_per_joint_and_forgets_earlier_targets() {
    let mut tracker = params(&[LIMITS; 2], 40.0).validate().unwrap().start(&[State::at_rest(0.0); 2]).unwrap();
    assert!(matches!(tracker.engage(&[0.0]), Err(Error::Count { expected: 2, got: 1, .. })));
    offer(&mut tracker, &[(0.5, 0.0), (0.5, 0.0)]);
    tracker.engage(&[0.0, 0.0]).unwrap();
    for _ in 0..20 {
        assert_eq!(tracker.update(TICK).unwrap().freshness, Freshness::None);
    }
    assert_eq!(tracker.states(), [State::at_rest(0.0); 2]);
}

#[test]
fn a_stale_target_does_not_end_the_alignment() {
    let mut tracker = params(&[LIMITS], 40.0).validate().unwrap().start(&[State::at_rest(0.0)]).unwrap();
    tracker.engage(&[0.0]).unwrap();
    tracker.offer(&Target::new(1.0, &[Sample::new(0.0, 0.0)])).unwrap();
    for _ in 0..20 {
        assert_eq!(tracker.update(TICK).unwrap().phase, Phase::Aligning);
    }
    offer(&mut tracker, &[(0.0, 0.0)]);
    assert_eq!(tracker.update(TICK).unwrap().phase, Phase::Ramping);
}

#[test]
fn after_the_alignment_the_speed_limit_rises_over_the_ramp() {
    let mut tracker = params(&[LIMITS], 40.0).validate().unwrap().start(&[State::at_rest(-1.9)]).unwrap();
    tracker.engage(&[-1.9]).unwrap();
    offer(&mut tracker, &[(-1.9, 0.0)]);
    tracker.update(TICK).unwrap();
    assert_eq!(tracker.phase(), Phase::Ramping);
    // The target jumps to the other end at once.
    let mut fastest = 0.0_f64;
    for k in 1..=200 {
        offer(&mut tracker, &[(1.9, 0.0)]);
        tracker.update(TICK).unwrap();
        let speed = tracker.states()[0].velocity_rad_s;
        assert!(speed <= 0.3 + 2.7 * f64::from(k) * TICK_S, "{speed} in step {k}");
        fastest = fastest.max(speed);
    }
    assert!(fastest > 1.5, "{fastest}");
}

/// Joint 0 could stop in 90 ms; together with joint 1 it would take twice as long and need twice the way.
#[test]
fn a_stop_together_does_not_carry_a_joint_over_its_wall() {
    let start = [
        State { velocity_rad_s: 1.0, ..State::at_rest(2.0 - 0.05) },
        State { velocity_rad_s: 3.0, ..State::at_rest(-1.0) },
    ];
    let mut tracker = params(&[LIMITS; 2], 40.0).validate().unwrap().take_over(&start).unwrap();
    tracker.stop();
    for _ in 0..100 {
        tracker.update(TICK).unwrap();
        assert!(tracker.states()[0].position_rad <= 2.0, "{:?}", tracker.states());
    }
    assert!(tracker.is_at_rest());
}

/// The brake of joint 0 alone: 4 / 500 s to full acceleration, (3.1 + 256 / 1000) / 20 - 40 ms there, 40 ms of release.
#[test]
fn a_joint_that_is_too_fast_stops_in_its_own_shortest_time() {
    let start = [
        State { position_rad: -1.0, velocity_rad_s: 3.1, acceleration_rad_s2: -16.0 },
        State { velocity_rad_s: 2.9, ..State::at_rest(-1.0) },
    ];
    let lame = JointLimits { acceleration_rad_s2: 10.0, ..LIMITS };
    let mut tracker = params(&[LIMITS, lame], 40.0).validate().unwrap().take_over(&start).unwrap();
    tracker.stop();
    let shortest_s = 0.008 + (3.1 + 0.256) / 20.0 - 0.04 + 0.04;
    for _ in 0..=(shortest_s * 1e3) as u32 {
        tracker.update(Duration::from_millis(1)).unwrap();
    }
    assert!(tracker.states()[0].velocity_rad_s.abs() < 1e-9, "{:?}", tracker.states());
    assert!(tracker.states()[1].velocity_rad_s > 0.5);
}

#[test]
fn a_second_stop_changes_nothing() {
    let start = [
        State { position_rad: 0.0, velocity_rad_s: 1.0, acceleration_rad_s2: 7.0 },
        State { velocity_rad_s: -2.5, ..State::at_rest(0.0) },
    ];
    let mut once = params(&[LIMITS; 2], 40.0).validate().unwrap().take_over(&start).unwrap();
    once.stop();
    let mut again = once.clone();
    while !once.is_at_rest() {
        again.stop();
        once.update(TICK).unwrap();
        again.update(TICK).unwrap();
        assert_eq!(once.states(), again.states());
    }
}
