//! Each rule alone, on arms of 100 px that stand still or move as a whole, so that every number has a closed form.

use super::*;

const DT_MS: u64 = 33;
/// Right arm hanging down, left arm with its wrist 40 px from the right one.
const ARMS: [[(f64, f64); 3]; 2] =
    [[(100.0, 100.0), (100.0, 200.0), (100.0, 300.0)], [(260.0, 140.0), (200.0, 220.0), (140.0, 300.0)]];

fn at(arms: &[[(f64, f64); 3]; 2]) -> Person {
    person(arms, &mut Noise(1), 0.0)
}

fn moved(u_px: f64) -> [[(f64, f64); 3]; 2] {
    ARMS.map(|arm| arm.map(|(u, v)| (u + u_px, v)))
}

const fn time(picture: u64) -> Duration {
    Duration::from_millis(picture * DT_MS)
}

/// A gate that has seen the arms stand still in 30 pictures; the next is number 30.
fn settled(options: GateOptions) -> ArmGate {
    let mut gate = ArmGate::new(Side::Right, options).unwrap();
    for i in 0..30 {
        gate.update(time(i), Some(&at(&ARMS)));
    }
    gate
}

fn with_wrist(place: (f64, f64)) -> [[(f64, f64); 3]; 2] {
    let mut arms = ARMS;
    arms[0][2] = place;
    arms
}

fn without_left_wrist(mut person: Person) -> Person {
    person.keypoints[7] = None;
    person
}

fn u_px(joint: ArmJoint) -> f64 {
    joint.estimate().unwrap().u_px
}

#[test]
fn a_lone_keypoint_on_the_other_wrist_is_refused_though_it_is_near_enough() {
    let mut gate = settled(GateOptions::default());
    gate.update(time(30), Some(&without_left_wrist(at(&with_wrist((138.0, 300.0))))));
    assert_eq!(gate.refusal(Part::RightWrist), Some(Refusal::Swapped));
    // Half way it may be either: nearer to its own, it is its own.
    let mut gate = settled(GateOptions::default());
    gate.update(time(30), Some(&without_left_wrist(at(&with_wrist((115.0, 300.0))))));
    assert_eq!(gate.refusal(Part::RightWrist), None);
}

#[test]
fn wrists_closer_than_the_separation_are_never_said_to_be_swapped() {
    let mut close = ARMS;
    close[1][2] = (108.0, 300.0);
    let mut exchanged = close;
    (exchanged[0][2], exchanged[1][2]) = (close[1][2], close[0][2]);
    for person in [at(&exchanged), without_left_wrist(at(&exchanged))] {
        let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
        for i in 0..30 {
            gate.update(time(i), Some(&at(&close)));
        }
        gate.update(time(30), Some(&person));
        assert_eq!(gate.refusal(Part::RightWrist), None);
    }
}

#[test]
fn nobody_is_faster_than_the_limit_after_a_gap_however_uncertain_the_filter_is() {
    // 0.2 s at 20 reach/s are 400 px, and five times the noise 25 px.
    for (jump_px, expected) in [(300.0, None), (500.0, Some(Refusal::TooFast))] {
        let mut gate = settled(GateOptions { acceleration: 1000.0, swap_separation: 100.0, ..Default::default() });
        let gap = time(29) + Duration::from_millis(200);
        gate.update(gap, Some(&at(&moved(jump_px))));
        assert_eq!(gate.refusal(Part::RightShoulder), expected, "{jump_px}");
    }
}

#[test]
fn a_still_wrist_does_not_jump_although_an_arm_could_be_that_fast() {
    // 80 px in 33 ms are 24 reach/s less noise: below the limit with it, but ten deviations from where it stood.
    let mut gate = settled(GateOptions { swap_separation: 100.0, ..Default::default() });
    gate.update(time(30), Some(&at(&with_wrist((180.0, 300.0)))));
    assert_eq!(gate.refusal(Part::RightWrist), Some(Refusal::TooFast));
}

#[test]
fn a_wrist_is_not_measured_from_an_elbow_that_is_not_believed() {
    let mut gate = settled(GateOptions::default());
    let mut arms = ARMS;
    arms[0][1] = (700.0, 200.0);
    gate.update(time(30), Some(&at(&arms)));
    assert_eq!(gate.refusal(Part::RightElbow), Some(Refusal::TooFast));
    assert_eq!(gate.refusal(Part::RightWrist), None);
}

#[test]
fn belief_and_sigma_follow_the_calibrated_probability_and_not_the_score() {
    let mut seen = at(&ARMS);
    seen.keypoints.iter_mut().flatten().for_each(|k| k.score = 0.25);
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    let wrist = gate.update(Duration::ZERO, Some(&seen)).wrist;
    assert!(wrist.is_measured());
    let e = wrist.estimate().unwrap();
    let p = 1.0 / (1.0 + 0.5_f64.exp());
    assert!((e.probability - p).abs() < 1e-12, "{e:?}");
    assert!((e.sigma_px - 5.0 * (1.0 + 3.0 * (1.0 - p))).abs() < 1e-9, "{e:?}");
}

#[test]
fn the_reach_rises_slowly_falls_by_itself_and_ignores_what_no_limb_is() {
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    gate.update(Duration::ZERO, Some(&at(&ARMS)));
    assert!((gate.reach_px().unwrap() - 100.0).abs() < 1e-3);
    gate.update(Duration::from_secs(10), None);
    let decayed = 100.0 * (-0.5_f64).exp();
    assert!((gate.reach_px().unwrap() - decayed).abs() < 1e-3);

    let mut gate = settled(GateOptions::default());
    let before = gate.reach_px().unwrap();
    gate.update(time(30), Some(&at(&with_wrist((100.0, 330.0)))));
    assert!((gate.reach_px().unwrap() - (before + 0.2 * (130.0 - before))).abs() < 0.3);
    gate.update(time(31), Some(&at(&with_wrist((100.0, 1200.0)))));
    assert!(gate.reach_px().unwrap() < before + 6.1);

    // An arm in one point has a reach of a pixel, now and later.
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    for seconds in [0, 10] {
        gate.update(Duration::from_secs(seconds), Some(&at(&[[(100.0, 100.0); 3]; 2])));
        assert!((gate.reach_px().unwrap() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn a_joint_whose_label_lies_on_the_other_arm_does_not_follow_what_the_other_arm_keeps() {
    let mut gate = settled(GateOptions::default());
    let wrist = gate.update(time(30), Some(&at(&with_wrist((138.0, 300.0))))).wrist;
    assert_eq!((gate.refusal(Part::RightWrist), gate.refusal(Part::LeftWrist)), (Some(Refusal::Swapped), None));
    assert!(!wrist.is_measured() && (u_px(wrist) - 100.0).abs() < 1.0, "{wrist:?}");
    assert_eq!(gate.refusal(Part::Nose), Some(Refusal::NotSeen));
}

#[test]
fn time_does_not_go_back_and_a_reset_forgets_every_joint() {
    let mut gate = settled(GateOptions::default());
    let arm = gate.update(Duration::ZERO, Some(&at(&ARMS)));
    assert_eq!(arm.time, time(29));
    gate.reset();
    assert_eq!(gate.update(time(1), None).joints(), [ArmJoint::Lost; 3]);
    // Elsewhere at once, and at an earlier time.
    assert!(gate.update(time(2), Some(&at(&moved(2000.0)))).wrist.is_measured());
}

#[test]
fn a_lost_joint_is_taken_up_where_two_pictures_on_end_agree() {
    let far = |u| at(&moved(u));
    let lost = || {
        let mut gate = settled(GateOptions::default());
        assert_eq!(gate.update(time(42), None).wrist, ArmJoint::Lost);
        gate
    };
    let mut gate = lost();
    assert_eq!(gate.update(time(43), Some(&far(3000.0))).wrist, ArmJoint::Lost);
    let wrist = gate.update(time(44), Some(&far(3010.0))).wrist;
    assert!(wrist.is_measured() && (u_px(wrist) - 3110.0).abs() < 1e-6, "{wrist:?}");
    // With a picture of nobody between them they do not count.
    let mut gate = lost();
    gate.update(time(43), Some(&far(3000.0)));
    gate.update(time(44), None);
    assert_eq!(gate.update(time(45), Some(&far(3010.0))).wrist, ArmJoint::Lost);
    // Nor in two places.
    let mut gate = lost();
    gate.update(time(43), Some(&far(3000.0)));
    assert_eq!(gate.update(time(44), Some(&far(6000.0))).wrist, ArmJoint::Lost);
}

#[test]
fn labels_that_stay_exchanged_are_taken_as_they_are_after_the_longest_inference() {
    let mut apart = ARMS;
    apart[1] = [(400.0, 100.0), (400.0, 200.0), (400.0, 300.0)];
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    for i in 0..30 {
        gate.update(time(i), Some(&at(&apart)));
    }
    let exchanged = at(&[apart[1], apart[0]]);
    for i in 30..=38 {
        let wrist = gate.update(time(i), Some(&exchanged)).wrist;
        assert!(!wrist.is_measured() && (u_px(wrist) - 100.0).abs() < 1.0, "{i}: {wrist:?}");
    }
    let wrist = gate.update(time(39), Some(&exchanged)).wrist;
    assert!(wrist.is_measured() && (u_px(wrist) - 400.0).abs() < 1e-6, "{wrist:?}");
}

#[test]
fn a_coasting_arm_loses_half_its_speed_in_a_tenth_of_a_second() {
    let speed = 300.0;
    let place = |i: u64| speed * time(i).as_secs_f64();
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    for i in 0..90 {
        gate.update(time(i), Some(&at(&moved(place(i)))));
    }
    let dt_s = time(1).as_secs_f64();
    let share = 0.5_f64.powf(dt_s / 0.1);
    let mut travelled = 0.0;
    for n in 0..9 {
        // The first picture without a keypoint is not yet known to be one when the filter moves on.
        travelled += speed * dt_s * share.powi(n);
        let wrist = gate.update(time(90 + n as u64), None).wrist;
        let expected = 100.0 + place(89) + travelled;
        assert!((u_px(wrist) - expected).abs() < 0.1, "{n}: {} {expected}", u_px(wrist));
    }
}

#[test]
fn smoothing_trails_by_its_stated_lag_and_starts_anew_with_the_joint() {
    let params = OneEuroParams { min_cutoff_hz: 2.0, beta: 0.0, speed_cutoff_hz: 1.0 };
    let smooth = GateOptions { smoothing: Some(params), ..Default::default() };
    let mut gate = ArmGate::new(Side::Right, smooth).unwrap();
    let place = |i: u64| 300.0 * time(i).as_secs_f64();
    for i in 0..150 {
        gate.update(time(i), Some(&at(&moved(place(i)))));
    }
    let wrist = gate.update(time(150), Some(&at(&moved(place(150))))).wrist;
    let trail = 100.0 + place(150) - u_px(wrist);
    assert!((trail - 300.0 / (std::f64::consts::TAU * 2.0)).abs() < 0.1, "{trail}");

    let mut gate = settled(smooth);
    // Twice the same time: no step to smooth with.
    assert!((u_px(gate.update(time(29), Some(&at(&ARMS))).wrist) - 100.0).abs() < 1e-6);
    gate.update(time(42), None);
    gate.update(time(43), Some(&at(&moved(3000.0))));
    let wrist = gate.update(time(44), Some(&at(&moved(3000.0)))).wrist;
    assert!(wrist.is_measured() && (u_px(wrist) - 3100.0).abs() < 1e-6, "{wrist:?}");
}

#[test]
fn a_first_sight_too_far_from_its_elbow_is_believed_when_it_is_repeated() {
    let thrown = || at(&with_wrist((100.0, 900.0)));
    let mut without = at(&ARMS);
    without.keypoints[4] = None;
    let unseen = || {
        let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
        for i in 0..30 {
            assert_eq!(gate.update(time(i), Some(&without)).wrist, ArmJoint::Lost);
        }
        gate
    };
    let mut gate = unseen();
    assert_eq!(gate.update(time(30), Some(&thrown())).wrist, ArmJoint::Lost);
    assert_eq!(gate.refusal(Part::RightWrist), Some(Refusal::LimbTooLong));
    // Thrown once only: the true wrist is believed at once.
    assert!(gate.update(time(31), Some(&at(&ARMS))).wrist.is_measured());
    let mut gate = unseen();
    gate.update(time(30), Some(&thrown()));
    let before = gate.reach_px().unwrap();
    assert!(gate.update(time(31), Some(&thrown())).wrist.is_measured());
    // The reach believes no more of it than a limb may stretch.
    let most = 1.35 * before * (-0.05 * time(1).as_secs_f64()).exp();
    assert!((gate.reach_px().unwrap() - most).abs() < 1e-6, "{:?} {most}", gate.reach_px());
}

#[test]
fn a_wrist_is_not_measured_from_where_the_elbow_was_lost() {
    let mut gate = settled(GateOptions::default());
    // The arm moves 600 px in three seconds with the elbow covered.
    for i in 30..130 {
        let mut seen = at(&moved(6.0 * (i - 29) as f64));
        seen.keypoints[3] = None;
        let arm = gate.update(time(i), Some(&seen));
        assert!(arm.wrist.is_measured(), "picture {i}: {:?}", gate.refusal(Part::RightWrist));
    }
}

#[test]
fn a_worker_who_comes_back_larger_than_any_limb_may_stretch_is_measured_again() {
    let far = ARMS.map(|arm| arm.map(|(u, v)| (0.4 * u, 0.4 * v)));
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    for i in 0..30 {
        gate.update(time(i), Some(&at(&far)));
    }
    for i in 30..70 {
        gate.update(time(i), None);
    }
    for i in 70..220 {
        let arm = gate.update(time(i), Some(&at(&ARMS)));
        assert!(i < 150 || arm.joints().iter().all(ArmJoint::is_measured), "picture {i}: {arm:?}");
    }
    assert!((gate.reach_px().unwrap() - 100.0).abs() < 2.0, "{:?}", gate.reach_px());
}
