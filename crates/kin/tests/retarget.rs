//! Arm angles and retargeting against geometry done by hand.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::disallowed_methods,
    reason = "tests: a panic is a failure, exact values are meant"
)]

use kin::{
    AngleRetarget, ArmAngles, ArmPoints, Error, JointMap, ReachStatus, Robot, ToolOrientation, Unwrap, WristRetarget,
    wrap_rad,
};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// An arm in the vertical plane that faces `azimuth`, bent upwards at the elbow.
fn arm(azimuth: f64, elevation: f64, flexion: f64) -> ArmPoints {
    let direction = |angle: f64| Vector3::new(angle.cos() * azimuth.cos(), angle.cos() * azimuth.sin(), angle.sin());
    let shoulder_m = Point3::new(0.3, -0.2, 1.1);
    let elbow_m = shoulder_m + direction(elevation) * 0.29;
    ArmPoints { shoulder_m, elbow_m, wrist_m: elbow_m + direction(elevation + flexion) * 0.26 }
}

proptest! {
    #[test]
    fn angles_do_not_depend_on_where_the_worker_faces(
        azimuth in -PI..PI, elevation in -1.5..0.5f64, flexion in 0.0..1.0f64
    ) {
        let angles = arm(azimuth, elevation, flexion).angles().unwrap();
        prop_assert!((angles.upper_arm_elevation_rad - elevation).abs() < 1e-9);
        prop_assert!((angles.elbow_flexion_rad - flexion).abs() < 1e-7);
        prop_assert!((angles.forearm_inclination_rad - (elevation + flexion)).abs() < 1e-9);
    }

    #[test]
    fn angles_move_little_when_the_arm_moves_little(
        azimuth in -PI..PI, elevation in -1.57..1.57f64, flexion in 0.01..3.1f64, nudge in prop::array::uniform3(-1e-6..1e-6f64)
    ) {
        let one = arm(azimuth, elevation, flexion);
        let two = ArmPoints { elbow_m: one.elbow_m + Vector3::from(nudge), ..one };
        let (a, b) = (one.angles().unwrap().to_array(), two.angles().unwrap().to_array());
        for (a, b) in a.iter().zip(b) {
            // 1e-6 m over 0.26 m twice.
            prop_assert!((a - b).abs() < 2e-5, "{a} {b}");
        }
    }

    #[test]
    fn wrapping_lands_in_the_half_open_circle(angle in -1e4..1e4f64) {
        let wrapped = wrap_rad(angle);
        prop_assert!(wrapped > -PI && wrapped <= PI);
        let turns = (angle - wrapped) / TAU;
        prop_assert!((turns - turns.round()).abs() < 1e-9);
    }

    #[test]
    fn unwrapping_restores_a_slow_stream(start in -10.0..10.0f64, steps in prop::collection::vec(-3.0..3.0f64, 1..50)) {
        let mut unwrap = Unwrap::default();
        let mut truth = start;
        let first = unwrap.next(wrap_rad(truth)).unwrap();
        for step in steps {
            truth += step;
            let got = unwrap.next(wrap_rad(truth)).unwrap();
            prop_assert!(((got - first) - (truth - start)).abs() < 1e-9);
        }
    }

    #[test]
    fn retargeted_joints_stay_within_limits(angles in prop::array::uniform3(-PI..PI)) {
        let chain = Robot::builtin().chain("base_link", "tool0").unwrap();
        let map = AngleRetarget::for_builtin_arm(&chain).unwrap();
        let mut q = [0.0; 6];
        let result = map.apply_to(&ArmAngles::from_array(angles), &mut q);
        for (i, value) in map.indices().into_iter().zip(result.values_rad) {
            prop_assert!(q[i] == value && value >= chain.limits()[i].lower && value <= chain.limits()[i].upper);
        }
    }
}

#[test]
fn points_that_coincide_or_are_missing_have_no_angles() {
    let mut points = arm(0.0, -1.0, 0.5);
    points.wrist_m = points.elbow_m + Vector3::new(0.001, 0.0, 0.0);
    assert!(points.angles().is_none());
    points.wrist_m.x = f64::NAN;
    assert!(points.angles().is_none());
    points.wrist_m.x = f64::INFINITY;
    assert!(points.angles().is_none());
}

#[test]
fn the_built_in_retarget_reaches_out_when_the_worker_does_and_keeps_the_tool_down() {
    let chain = Robot::builtin().chain("base_link", "tool0").unwrap();
    let map = AngleRetarget::for_builtin_arm(&chain).unwrap();
    let pose = |elevation: f64, flexion: f64| {
        let mut q = [0.0; 6];
        let result = map.apply_to(&arm(0.3, elevation, flexion).angles().unwrap(), &mut q);
        assert_eq!(result.clamped, [false; 3]);
        chain.fk(&q)
    };
    let rest = pose(-FRAC_PI_2 + 0.1, FRAC_PI_2 - 0.1);
    let reaching = pose(-0.6, 0.7);
    assert!(reaching.translation.x > rest.translation.x + 0.1);
    for tool in [rest, reaching] {
        assert!((tool.rotation * Vector3::z() + Vector3::z()).norm() < 1e-7);
    }
}

fn retarget(orientation: ToolOrientation) -> WristRetarget {
    // The bench is turned by 90 degrees against the robot.
    let base_from_world = Isometry3::rotation(Vector3::z() * FRAC_PI_2);
    WristRetarget::by_arm_length(base_from_world, Point3::new(0.0, 0.0, 0.14), 0.55, 0.25, 0.8, orientation).unwrap()
}

#[test]
fn the_wrist_is_scaled_by_arm_length_and_clamped_to_reach() {
    let map = retarget(ToolOrientation::Fixed(UnitQuaternion::identity()));
    let with_wrist = |x: f64| ArmPoints {
        shoulder_m: Point3::new(5.0, 5.0, 1.0),
        elbow_m: Point3::new(5.1, 5.0, 0.8),
        wrist_m: Point3::new(5.0 + x, 5.0, 1.0),
    };
    let target = map.apply(&with_wrist(0.275)).unwrap();
    // World x is base y; half an arm length is half the reach.
    assert!((target.base_from_tool.translation.vector - Vector3::new(0.0, 0.4, 0.14)).norm() < 1e-12);
    assert_eq!(target.reach, ReachStatus::Within);
    let far = map.apply(&with_wrist(1.1)).unwrap();
    assert!((far.base_from_tool.translation.vector - Vector3::new(0.0, 0.8, 0.14)).norm() < 1e-12);
    assert!(matches!(far.reach, ReachStatus::TooFar { by_m } if (by_m - 0.8).abs() < 1e-12));
    let near = map.apply(&with_wrist(0.055)).unwrap();
    assert!((near.base_from_tool.translation.vector - Vector3::new(0.0, 0.25, 0.14)).norm() < 1e-12);
    assert!(matches!(near.reach, ReachStatus::TooNear { .. }));
    // A wrist on the shoulder has no direction; x is as good as any.
    let none = map.apply(&with_wrist(0.0)).unwrap();
    assert!((none.base_from_tool.translation.vector - Vector3::new(0.25, 0.0, 0.14)).norm() < 1e-12);
    assert!(map.apply(&with_wrist(f64::NAN)).is_none());
}

#[test]
fn the_tool_points_where_the_policy_says() {
    let arm = arm(0.4, -1.0, 0.8);
    let down = retarget(ToolOrientation::Down).apply(&arm).unwrap().base_from_tool;
    assert!((down.rotation * Vector3::z() + Vector3::z()).norm() < 1e-12);
    let along = retarget(ToolOrientation::AlongForearm).apply(&arm).unwrap().base_from_tool;
    let forearm = Isometry3::rotation(Vector3::z() * FRAC_PI_2) * (arm.wrist_m - arm.elbow_m).normalize();
    assert!((along.rotation * Vector3::z() - forearm).norm() < 1e-12);
    // x is level.
    assert!((along.rotation * Vector3::x()).z.abs() < 1e-12);
}

#[test]
fn impossible_arm_lengths_and_reaches_are_refused() {
    let build = |arm_length_m: f64, least: f64, largest: f64| {
        WristRetarget::by_arm_length(
            Isometry3::identity(),
            Point3::origin(),
            arm_length_m,
            least,
            largest,
            ToolOrientation::Down,
        )
    };
    assert!(build(0.55, 0.2, 0.8).is_ok());
    for (arm_length_m, least, largest) in
        [(0.0, 0.2, 0.8), (f64::NAN, 0.2, 0.8), (0.55, -0.1, 0.8), (0.55, 0.8, 0.8), (0.55, 0.2, f64::INFINITY)]
    {
        assert!(build(arm_length_m, least, largest).is_err());
    }
}

#[test]
fn what_is_no_number_is_refused_and_changes_nothing() {
    let chain = Robot::builtin().chain("base_link", "tool0").unwrap();
    let map = |joint: &str, scale: f64, offset_rad: f64| JointMap { joint: joint.to_owned(), scale, offset_rad };
    let build = |scale: f64, offset_rad: f64| {
        AngleRetarget::new(&chain, [map("joint2", 1.0, 0.0), map("joint3", scale, offset_rad), map("joint4", 1.0, 0.0)])
    };
    assert!(build(-1.0, 0.5).is_ok());
    assert!(matches!(build(f64::NAN, 0.5), Err(Error::Domain { .. })));
    assert!(matches!(build(-1.0, f64::INFINITY), Err(Error::Domain { .. })));
    let mut unwrap = Unwrap::default();
    assert_eq!((unwrap.next(3.0), unwrap.next(f64::NAN), unwrap.next(f64::INFINITY)), (Some(3.0), None, None));
    assert!((unwrap.next(-3.0).unwrap() - (TAU - 3.0)).abs() < 1e-12);
}
