use std::fmt::Write as _;
use std::time::Duration;

use can_driver::{Drive, Setpoint};
use kin::{Robot, UrdfOptions};
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;

use super::{Arm, ArmParams};
use crate::error::Error;

const HOME: [f64; 6] = [0.2, 0.7, -1.3, 0.4, 0.5, -0.3];
const MS: Duration = Duration::from_millis(1);

/// A rod of `mass` with its centre 0.3 m along x from a joint about y, and another like it at its end.
fn rods(count: usize, mass: f64, effort: f64, velocity: f64, dynamics: &str) -> Robot {
    let mut urdf = String::from(r#"<robot name="rods"><link name="l0"/>"#);
    for k in 1..=count {
        let x = if k == 1 { 0.0 } else { 0.6 };
        let _ = write!(
            urdf,
            r#"<link name="l{k}"><inertial><origin xyz="0.3 0 0"/><mass value="{mass}"/>
            <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>
            <joint name="j{k}" type="revolute"><parent link="l{p}"/><child link="l{k}"/><origin xyz="{x} 0 0"/>
            <axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="{effort}" velocity="{velocity}"/>{dynamics}</joint>"#,
            p = k - 1,
        );
    }
    urdf += "</robot>";
    Robot::from_urdf_str(&urdf, &UrdfOptions::default()).unwrap()
}

fn at_rest(q: &[f64]) -> Vec<Setpoint> {
    q.iter().map(|&position_rad| Setpoint { position_rad, velocity_rad_s: 0.0 }).collect()
}

/// Height energy of all masses by kin's own transforms, J.
fn potential_j(robot: &Robot, q: &[f64]) -> f64 {
    let placed = robot.link_transforms(q).unwrap();
    robot
        .links()
        .iter()
        .zip(placed)
        .filter_map(|(link, base_from_link)| link.inertial.map(|i| 9.81 * i.mass_kg * (base_from_link * i.com_m).z))
        .sum()
}

#[test]
fn bodies_stand_where_forward_kinematics_puts_them() {
    let robot = Robot::builtin();
    let mut arm = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
    let check = |arm: &Arm, bound_m: f64| {
        let placed = robot.link_transforms(&arm.positions()).unwrap();
        for (dof, id) in robot.dofs().iter().enumerate() {
            let link = arm.servos[dof].link;
            let index = arm.world.multibody_joints.rigid_body_link(arm.base).unwrap().multibody;
            let multibody = arm.world.multibody_joints.get_multibody(index).unwrap();
            let body = &arm.world.bodies[multibody.link(link).unwrap().rigid_body_handle()];
            let t = body.translation();
            let here = Vector3::new(f64::from(t.x), f64::from(t.y), f64::from(t.z));
            let there: Isometry3<f64> = placed[robot.joints()[id.index()].child.index()];
            assert!((here - there.translation.vector).norm() < bound_m, "joint {dof}: {here} {there}");
        }
    };
    check(&arm, 1e-5);
    for (measured, start) in arm.measured().iter().zip(HOME) {
        assert!((measured.position_rad - start).abs() < 1e-6);
    }
    let goal = at_rest(&HOME.map(|q| q + 0.2));
    arm.step(Duration::from_millis(700), &goal, Drive::Servo).unwrap();
    check(&arm, 1e-4);
}

#[test]
fn weight_is_the_slope_of_the_height_energy() {
    let robot = Robot::builtin();
    let arm = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
    for (k, load) in arm.gravity_load(&HOME).into_iter().enumerate() {
        let h = 1e-5;
        let energy = |shift: f64| {
            let mut q = HOME;
            q[k] += shift;
            potential_j(&robot, &q)
        };
        let slope = (energy(h) - energy(-h)) / (2.0 * h);
        assert!((load - slope).abs() < 1e-6, "joint {k}: {load} {slope} N m");
    }
}

#[test]
fn without_compensation_the_arm_sags_by_weight_over_stiffness() {
    let robot = rods(2, 1.5, 200.0, 3.0, "");
    let start = [-0.4, 0.3];
    let params = ArmParams { gravity_compensation: 0.0, ..ArmParams::new(start.to_vec()) };
    let mut arm = Arm::new(&robot, params).unwrap();
    arm.step(Duration::from_secs(3), &at_rest(&start), Drive::Servo).unwrap();
    let rest = arm.positions();
    for (k, stiffness) in arm.stiffness().into_iter().enumerate() {
        let h = 1e-5;
        let energy = |shift: f64| {
            let mut q = rest.clone();
            q[k] += shift;
            potential_j(&robot, &q)
        };
        let weight = (energy(h) - energy(-h)) / (2.0 * h);
        let sag = start[k] - rest[k];
        let expected = weight / stiffness;
        assert!((sag - expected).abs() < 0.02 * expected.abs() + 1e-5, "joint {k}: {sag} against {expected} rad");
    }
}

/// What static friction may hold a joint off its setpoint, and 5e-5 rad for f32 torques.
fn assert_within_friction(robot: &Robot, arm: &Arm, want: &[f64]) {
    for (k, joint) in robot.dof_joints().enumerate() {
        let error = arm.measured()[k].position_rad - want[k];
        let bound = joint.friction / arm.stiffness()[k] + 5e-5;
        assert!(error.abs() < bound, "{}: {error} rad, friction explains {bound}", joint.name);
    }
}

#[test]
fn with_compensation_it_stays() {
    let robot = Robot::builtin();
    let mut arm = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
    arm.step(Duration::from_secs(2), &at_rest(&HOME), Drive::Servo).unwrap();
    assert_within_friction(&robot, &arm, &HOME);
}

/// Times at which the first joint of a free pendulum passes `centre` upwards.
fn passages(arm: &mut Arm, centre: f64, seconds: u64) -> Vec<f64> {
    let mut times = Vec::new();
    let mut before = arm.measured()[0].position_rad - centre;
    for ms in 1..=seconds * 1000 {
        arm.step(MS, &[], Drive::Braked).unwrap();
        let now = arm.measured()[0].position_rad - centre;
        if before < 0.0 && now >= 0.0 {
            times.push((ms as f64 - now / (now - before)) * 1e-3);
        }
        before = now;
    }
    times
}

#[test]
fn a_free_pendulum_swings_with_the_period_of_its_inertia() {
    // Drives of a millionth of a newton metre leave the rod to gravity. It hangs at pi / 2 about y.
    let robot = rods(1, 2.0, 1e-6, 3.0, "");
    let centre = std::f64::consts::FRAC_PI_2;
    let swing = 0.05;
    let mut arm = Arm::new(&robot, ArmParams::new(vec![centre - swing])).unwrap();
    let times = passages(&mut arm, centre, 8);
    let period = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
    let inertia = 0.03 + 2.0 * 0.3 * 0.3;
    let small: f64 = std::f64::consts::TAU * (inertia / (2.0 * 9.81 * 0.3_f64)).sqrt();
    let expected = small * (1.0 + swing * swing / 16.0);
    assert!((period / expected - 1.0).abs() < 2e-3, "{period} against {expected} s");
}

#[test]
fn a_free_double_pendulum_keeps_its_energy() {
    let robot = rods(2, 1.0, 1e-6, 50.0, "");
    let mut arm = Arm::new(&robot, ArmParams::new(vec![0.3, 0.6])).unwrap();
    let energy = |arm: &Arm| {
        // Planar: kinetic energy from the speeds of both centres of mass and rods about y.
        let q = arm.positions();
        let qd: Vec<f64> = arm.measured().iter().map(|j| j.velocity_rad_s).collect();
        let across = |angle: f64| Vector3::new(-angle.sin(), 0.0, -angle.cos());
        let (w1, w2) = (qd[0], qd[0] + qd[1]);
        let v1 = across(q[0]) * (0.3 * w1);
        let v2 = across(q[0]) * (0.6 * w1) + across(q[0] + q[1]) * (0.3 * w2);
        0.5 * (v1.norm_squared() + v2.norm_squared() + 0.03 * (w1 * w1 + w2 * w2)) + potential_j(&robot, &q)
    };
    let start = energy(&arm);
    let mut worst = 0.0_f64;
    for _ in 0..2000 {
        arm.step(MS, &[], Drive::Braked).unwrap();
        worst = worst.max((energy(&arm) - start).abs());
    }
    // The masses can fall by 2 x 0.9 m x 9.81 N; first-order integration at 1 ms drifts by a few per cent.
    assert!(worst < 0.03 * 17.7, "{worst} J");
}

#[test]
fn the_drive_never_gives_more_than_its_effort() {
    let robot = rods(1, 2.0, 0.5, 100.0, "");
    let params = ArmParams { gravity_m_s2: [0.0; 3], ..ArmParams::new(vec![0.0]) };
    let mut arm = Arm::new(&robot, params).unwrap();
    arm.step(Duration::from_millis(400), &at_rest(&[5.0]), Drive::Servo).unwrap();
    let expected = 0.5 * (0.5 / (0.03 + 2.0 * 0.09)) * 0.4 * 0.4;
    let got = arm.measured()[0].position_rad;
    assert!((got / expected - 1.0).abs() < 0.02, "{got} against {expected} rad");
}

#[test]
fn the_speed_limit_holds_for_a_far_setpoint() {
    let robot = rods(1, 2.0, 200.0, 1.5, "");
    let mut arm = Arm::new(&robot, ArmParams::new(vec![0.0])).unwrap();
    let mut fastest = 0.0_f64;
    for _ in 0..1500 {
        arm.step(MS, &at_rest(&[2.0]), Drive::Servo).unwrap();
        fastest = fastest.max(arm.measured()[0].velocity_rad_s.abs());
    }
    assert!(fastest < 1.5 * 1.005 && fastest > 1.45, "{fastest} rad/s");
    assert!((arm.measured()[0].position_rad - 2.0).abs() < 1e-3);
}

#[test]
fn viscous_damping_of_the_urdf_slows_a_free_joint() {
    let robot = rods(1, 2.0, 1e-6, 100.0, r#"<dynamics damping="0.4" friction="0"/>"#);
    let params = ArmParams { gravity_m_s2: [0.0, 0.0, -9.81], ..ArmParams::new(vec![1.4]) };
    let mut arm = Arm::new(&robot, params).unwrap();
    let centre = std::f64::consts::FRAC_PI_2;
    let mut peaks = Vec::new();
    let (mut before, mut speed) = (0.0, 0.0);
    for _ in 0..6000 {
        arm.step(MS, &[], Drive::Braked).unwrap();
        let now = arm.measured()[0];
        if speed > 0.0 && now.velocity_rad_s <= 0.0 {
            peaks.push(before - centre);
        }
        (before, speed) = (now.position_rad, now.velocity_rad_s);
    }
    // Amplitude of a damped oscillator falls by exp(-c T / 2 J) a period.
    let inertia = 0.03 + 2.0 * 0.09;
    let rate: f64 = 0.4 / (2.0 * inertia);
    let period = std::f64::consts::TAU / (2.0 * 9.81 * 0.3 / inertia - rate * rate).sqrt();
    let expected = (-rate * period).exp();
    let got: f64 = peaks[1] / peaks[0];
    assert!((got / expected - 1.0).abs() < 0.05, "{got} against {expected}");
}

#[test]
fn smooth_setpoints_are_followed_to_a_few_milliradians() {
    let robot = Robot::builtin();
    let mut arm = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
    let path = |k: usize, t: f64| {
        let rate = std::f64::consts::TAU * (0.3 + 0.05 * k as f64);
        let fade = (t / 0.5).min(1.0).powi(2) * (3.0 - 2.0 * (t / 0.5).min(1.0));
        HOME[k] + 0.3 * fade * (rate * t).sin()
    };
    let (mut worst, mut squares, mut count) = (0.0_f64, 0.0, 0);
    for ms in 0..6000 {
        let t = f64::from(ms) * 1e-3;
        let setpoints: Vec<Setpoint> = (0..6)
            .map(|k| Setpoint {
                position_rad: path(k, t),
                velocity_rad_s: (path(k, t + 1e-4) - path(k, t - 1e-4)) / 2e-4,
            })
            .collect();
        arm.step(MS, &setpoints, Drive::Servo).unwrap();
        for (k, joint) in arm.measured().iter().enumerate() {
            let error = joint.position_rad - path(k, t + 1e-3);
            worst = worst.max(error.abs());
            squares += error * error;
            count += 1;
        }
    }
    let rms = (squares / f64::from(count)).sqrt();
    assert!(worst < 5e-3 && rms < 2e-3, "worst {worst} rad, rms {rms} rad");
}

#[test]
fn brakes_hold_the_arm_where_they_closed() {
    let robot = Robot::builtin();
    let mut arm = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
    arm.step(Duration::from_secs(1), &[], Drive::Braked).unwrap();
    assert_within_friction(&robot, &arm, &HOME);
}

#[test]
fn impossible_plants_are_refused_by_name() {
    let robot = Robot::builtin();
    let refused = |params: ArmParams| Arm::new(&robot, params).err().unwrap();
    assert!(matches!(refused(ArmParams::new(vec![0.0; 5])), Error::JointCount { expected: 6, got: 5 }));
    assert!(refused(ArmParams::new(vec![9.0; 6])).to_string().contains("start position: 9 outside"));
    let params = ArmParams { servo_hz: f64::NAN, ..ArmParams::new(HOME.to_vec()) };
    assert!(refused(params).to_string().contains("servo_hz"));
    let mut arm = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
    assert!(arm.step(MS, &at_rest(&[f64::NAN; 6]), Drive::Servo).is_err());
    assert!(arm.step(MS, &at_rest(&[0.0; 3]), Drive::Servo).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn the_motion_does_not_depend_on_how_time_is_cut(cuts in prop::collection::vec(1_u64..3000, 1..8)) {
        let goal = at_rest(&HOME.map(|q| q - 0.1));
        let robot = Robot::builtin();
        let mut whole = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
        let mut parts = Arm::new(&robot, ArmParams::new(HOME.to_vec())).unwrap();
        whole.step(Duration::from_micros(cuts.iter().map(|c| c * 17).sum()), &goal, Drive::Servo).unwrap();
        for cut in cuts {
            parts.step(Duration::from_micros(17 * cut), &goal, Drive::Servo).unwrap();
        }
        prop_assert_eq!(whole.measured(), parts.measured());
    }
}
