use proptest::prelude::*;

use super::*;
use crate::{Calibration, OneEuroParams, Skeleton};

mod rules;

struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn gauss(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// Both arms of a worker at a machine, px; each hand on a path of its own with strokes of up to 0.4 m at up to 1.2 m/s
/// where the upper arm of 0.3 m is 100 px. Right arm first.
fn worker(t: f64, phase: f64) -> [[(f64, f64); 3]; 2] {
    let stroke = |f: f64, p: f64| (std::f64::consts::TAU * f * t + p + phase).sin();
    let right = (260.0 + 60.0 * stroke(0.4, 0.0) + 12.0 * stroke(1.7, 1.0), 330.0 + 40.0 * stroke(0.5, 2.0));
    let left = (420.0 + 50.0 * stroke(0.35, 4.0) + 10.0 * stroke(1.3, 0.5), 330.0 + 45.0 * stroke(0.45, 1.0));
    let arm = |shoulder: (f64, f64), wrist: (f64, f64), out: f64| {
        let middle = (f64::midpoint(shoulder.0, wrist.0), f64::midpoint(shoulder.1, wrist.1));
        [shoulder, (middle.0 + out, middle.1 + 10.0), wrist]
    };
    [arm((290.0, 180.0), right, -35.0), arm((400.0, 180.0), left, 35.0)]
}

fn person(arms: &[[(f64, f64); 3]; 2], noise: &mut Noise, sigma_px: f64) -> Person {
    let mut keypoints = vec![None; 8];
    for (arm, first) in arms.iter().zip([2, 5]) {
        for (j, (u, v)) in arm.iter().enumerate() {
            keypoints[first + j] = Some(Keypoint {
                u_px: (u + sigma_px * noise.gauss()) as f32,
                v_px: (v + sigma_px * noise.gauss()) as f32,
                score: 0.85,
            });
        }
    }
    Person { skeleton: Skeleton::UpperLimb8, keypoints, score: 0.85 }
}

fn swap_sides(person: &mut Person, parts: std::ops::Range<usize>) {
    for j in parts {
        person.keypoints.swap(2 + j, 5 + j);
    }
}

/// F6 of the fault table: swaps of one to three pictures, whole arms or wrists alone, at 30 Hz.
#[test]
fn injected_swaps_are_refused_and_good_pictures_are_not() {
    let (mut swapped, mut caught, mut good, mut refused) = (0, 0, 0, 0);
    let mut errors_px = Vec::new();
    for seed in 0..60 {
        let mut noise = Noise(seed * 104_729 + 3);
        let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
        let phase = 6.3 * noise.uniform();
        let mut left_to_swap = 0;
        let mut parts = 0..3;
        for i in 0..900 {
            let time = Duration::from_micros(i * 33_333);
            let truth = worker(time.as_secs_f64(), phase);
            let mut seen = person(&truth, &mut noise, 4.0);
            if left_to_swap == 0 && i > 15 && noise.uniform() < 0.03 {
                left_to_swap = 1 + (noise.uniform() * 3.0) as usize;
                parts = if noise.uniform() < 0.5 { 0..3 } else { 2..3 };
            }
            let is_swapped = left_to_swap > 0;
            if is_swapped {
                swap_sides(&mut seen, parts.clone());
                left_to_swap -= 1;
            }
            let arm = gate.update(time, Some(&seen));
            if is_swapped {
                swapped += 1;
                caught += i32::from(!arm.wrist.is_measured());
            } else if i > 15 {
                good += 1;
                refused += i32::from(!arm.wrist.is_measured());
            }
            if i > 15 {
                let Some(e) = arm.wrist.estimate() else {
                    panic!("seed {seed} picture {i}: {:?} {:?} {:?}", gate.refusal(Part::RightWrist), arm, truth[0]);
                };
                let error = (e.u_px - truth[0][2].0).hypot(e.v_px - truth[0][2].1);
                if is_swapped {
                    errors_px.push(error);
                }
            }
        }
    }
    let share = |n: i32, of: i32| f64::from(n) / f64::from(of);
    let (caught_share, refused_share) = (share(caught, swapped), share(refused, good));
    eprintln!("swaps refused {caught_share:.4} of {swapped}, good pictures refused {refused_share:.5} of {good}");
    assert!(swapped > 2000 && caught_share >= 0.995, "caught {caught} of {swapped}");
    assert!(refused_share <= 0.005, "refused {refused} of {good}");
    errors_px.sort_by(f64::total_cmp);
    // 20 mm are 6.7 px here; keypoints alone are 4 px in each coordinate off.
    let (median, most) = (errors_px[errors_px.len() / 2], errors_px[errors_px.len() * 995 / 1000]);
    assert!(median < 6.7 && most < 20.0, "{median} {most} px");
}

#[test]
fn a_thrown_wrist_is_refused_and_the_filter_stays() {
    let mut noise = Noise(5);
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    for i in 0..30 {
        let time = Duration::from_millis(i * 33);
        gate.update(time, Some(&person(&worker(0.0, 0.0), &mut noise, 1.0)));
    }
    let mut thrown = person(&worker(0.0, 0.0), &mut noise, 1.0);
    thrown.keypoints[4] = Some(Keypoint { u_px: 900.0, v_px: 20.0, score: 0.99 });
    let arm = gate.update(Duration::from_millis(990), Some(&thrown));
    assert!(matches!(arm.wrist, ArmJoint::Inferred(_)));
    assert_eq!(gate.refusal(Part::RightWrist), Some(Refusal::TooFast));
    assert_eq!(gate.refusal(Part::RightElbow), None);
    let truth = worker(0.0, 0.0)[0][2];
    let e = arm.wrist.estimate().unwrap();
    assert!((e.u_px - truth.0).hypot(e.v_px - truth.1) < 5.0);
}

#[test]
fn a_limb_that_is_too_long_is_refused() {
    let mut noise = Noise(9);
    let mut options = GateOptions { max_speed: 1e6, acceleration: 1e6, ..Default::default() };
    options.swap_separation = 1e6;
    let mut gate = ArmGate::new(Side::Right, options).unwrap();
    for i in 0..10 {
        gate.update(Duration::from_millis(i * 33), Some(&person(&worker(0.0, 0.0), &mut noise, 0.5)));
    }
    let reach_px = gate.reach_px().unwrap();
    let mut long = person(&worker(0.0, 0.0), &mut noise, 0.5);
    let elbow = long.keypoints[3].unwrap();
    long.keypoints[4] = Some(Keypoint { v_px: elbow.v_px + (1.5 * reach_px) as f32, ..elbow });
    gate.update(Duration::from_millis(330), Some(&long));
    assert_eq!(gate.refusal(Part::RightWrist), Some(Refusal::LimbTooLong));
}

#[test]
fn a_covered_joint_is_inferred_with_growing_doubt_then_lost_then_taken_up_again() {
    let mut noise = Noise(2);
    let mut gate = ArmGate::new(Side::Left, GateOptions::default()).unwrap();
    let arms = worker(0.0, 0.0);
    for i in 0..10 {
        gate.update(Duration::from_millis(i * 33), Some(&person(&arms, &mut noise, 1.0)));
    }
    let mut covered = person(&arms, &mut noise, 1.0);
    covered.keypoints[7] = None;
    let mut before = (0.0, 1.0);
    for i in 10..19 {
        let arm = gate.update(Duration::from_millis(i * 33), Some(&covered));
        let ArmJoint::Inferred(e) = arm.wrist else { panic!("{:?} at {i}", arm.wrist) };
        assert!(e.sigma_px > before.0 && e.probability < before.1);
        before = (e.sigma_px, e.probability);
        assert!(arm.elbow.is_measured());
    }
    assert_eq!(gate.update(Duration::from_millis(640), Some(&covered)).wrist, ArmJoint::Lost);
    // Far from where it was lost: one picture is not enough, two are.
    let mut elsewhere = arms;
    elsewhere[1][2].0 += 90.0;
    elsewhere[1][2].1 -= 70.0;
    let first = gate.update(Duration::from_millis(660), Some(&person(&elsewhere, &mut noise, 1.0)));
    let second = gate.update(Duration::from_millis(693), Some(&person(&elsewhere, &mut noise, 1.0)));
    assert!(second.wrist.is_measured(), "{first:?} {second:?}");
}

#[test]
fn the_other_arm_is_reported_for_the_other_side_and_weak_keypoints_are_not_believed() {
    let mut noise = Noise(2);
    let arms = worker(0.0, 0.0);
    let mut gate = ArmGate::new(Side::Left, GateOptions::default()).unwrap();
    let mut seen = person(&arms, &mut noise, 0.1);
    for k in seen.keypoints.iter_mut().flatten().skip(4) {
        k.score = 0.01;
    }
    let arm = gate.update(Duration::ZERO, Some(&seen));
    let shoulder = arm.shoulder.estimate().unwrap();
    assert!((shoulder.u_px - 400.0).abs() < 1.0);
    assert_eq!(gate.refusal(Part::LeftWrist), Some(Refusal::Weak));
    assert_eq!(arm.wrist, ArmJoint::Lost);
}

proptest! {
    /// Whatever a network says, the answer is finite or lost.
    #[test]
    fn no_nan_comes_out(
        values in proptest::collection::vec(
            prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(f32::NEG_INFINITY), -1e6..1e6_f32], 24),
        steps in proptest::collection::vec(0..400_u64, 6),
    ) {
        let mut gate = ArmGate::new(Side::Right, GateOptions { smoothing: Some(OneEuroParams::default()), ..Default::default() }).unwrap();
        let mut time = 0;
        for (i, step) in steps.iter().enumerate() {
            time += step;
            let keypoints = (0..8).map(|j| {
                let v = |k: usize| values[(i * 7 + j * 3 + k) % 24];
                Some(Keypoint { u_px: v(0), v_px: v(1), score: v(2) })
            }).collect();
            let person = Person { skeleton: Skeleton::UpperLimb8, keypoints, score: 0.5 };
            let arm = gate.update(Duration::from_millis(time), Some(&person));
            for e in arm.joints().iter().filter_map(ArmJoint::estimate) {
                prop_assert!(e.u_px.is_finite() && e.v_px.is_finite() && e.sigma_px.is_finite());
                prop_assert!((0.0..=1.0).contains(&e.probability));
            }
        }
    }
}

#[test]
fn nan_options_are_refused() {
    let o = GateOptions::default();
    for bad in [
        GateOptions { noise: f64::NAN, ..o },
        GateOptions { max_speed: 0.0, ..o },
        GateOptions { max_stretch: 0.9, ..o },
        GateOptions { min_probability: f64::NAN, ..o },
        GateOptions { acceleration: f64::INFINITY, ..o },
        GateOptions { swap_separation: -1.0, ..o },
        GateOptions { max_stretch: f64::NAN, ..o },
        GateOptions { calibration: Calibration { slope: 0.0, ..o.calibration }, ..o },
        GateOptions { calibration: Calibration { intercept: f64::NAN, ..o.calibration }, ..o },
        GateOptions { smoothing: Some(OneEuroParams { beta: f64::NAN, ..Default::default() }), ..o },
    ] {
        assert!(ArmGate::new(Side::Right, bad).is_err(), "{bad:?}");
    }
}
