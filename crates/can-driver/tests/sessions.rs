//! Host and controller against each other on ideal wires: the rules of enabling, following,
//! stopping and resetting.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::time::Duration;

use can_driver::{Command, ControllerState, Drive, Event, HostState, StopCause};
use common::{LIMITS, Rig};

const MS: Duration = Duration::from_millis(1);

#[test]
fn configures_enables_and_follows() {
    let mut rig = Rig::new(6);
    rig.activate();
    assert_eq!(rig.controller_state(), ControllerState::Active);
    let synchronising = rig.host.link().sets_unechoed;
    rig.swing(2000 * MS, 0.3, 2.0);
    assert_eq!((rig.host_state(), rig.controller_state()), (HostState::Active, ControllerState::Active));
    for (reached, wanted) in rig.positions().iter().zip(rig.commanded()) {
        // Velocity 0.6 rad/s, one cycle of host delay at most.
        assert!((reached - wanted).abs() < 0.004, "{reached} {wanted}");
    }
    let link = rig.host.link();
    assert_eq!((link.sets_unechoed, link.status_lost, link.feedback_incomplete), (synchronising, 0, 0));
}

#[test]
fn first_sets_equal_the_measured_angles() {
    let mut rig = Rig::new(6);
    rig.until(HostState::Ready, Command::Standby);
    // The application asks for something far away at once: it is not sent before Active.
    rig.until(HostState::Enabling, Command::Follow { position_rad: &[1.5; 6], speed_scale: 1.0 });
    for q in rig.commanded() {
        assert!((q - 0.25).abs() <= can_driver::ANGLE_LSB_RAD, "{q}");
    }
}

#[test]
fn a_command_that_steps_too_far_stops_before_it_is_sent() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.run(20 * MS, Command::Follow { position_rad: &[0.30; 6], speed_scale: 1.0 });
    assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::CommandOutsideLimits));
    rig.run(20 * MS, Command::Standby);
    assert_eq!(rig.controller_out.as_ref().unwrap().cause, Some(StopCause::CommandOutsideLimits));
    assert!((rig.positions()[0] - 0.25).abs() < 1e-4);
}

#[test]
fn a_dead_host_means_rest_within_ramp_time_and_braking_distance() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.swing(500 * MS, 0.3, 2.0);
    let speed_rad_s = rig.joints[0].velocity_rad_s.abs();
    assert!(speed_rad_s > 0.3, "{speed_rad_s}");
    rig.host_alive = false;
    let dead_at = rig.now;
    let mut rest_at = None;
    for _ in 0..1000 {
        rig.step(Command::Standby, &mut |_| {});
        if rest_at.is_none() && rig.joints.iter().all(|j| j.velocity_rad_s.abs() < 1.3e-5) {
            rest_at = Some(rig.now);
        }
    }
    let allowed = 25.0e-3 + speed_rad_s / LIMITS.acceleration_rad_s2 + 5.0e-3;
    let took = (rest_at.unwrap() - dead_at).as_secs_f64();
    assert!(took <= allowed, "{took} s, allowed {allowed} s");
    let out = rig.controller_out.as_ref().unwrap();
    assert_eq!(
        (out.state, out.cause, out.drive),
        (ControllerState::Latched, Some(StopCause::HostSilent), Drive::Braked)
    );
}

#[test]
fn a_latched_stop_ends_only_by_reset() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.host_alive = false;
    rig.run(200 * MS, Command::Standby);
    assert_eq!(rig.controller_state(), ControllerState::Latched);
    rig.host_alive = true;
    let here = rig.positions();
    rig.run(2000 * MS, Command::Follow { position_rad: &here, speed_scale: 1.0 });
    assert_eq!((rig.host_state(), rig.controller_state()), (HostState::Stopped, ControllerState::Latched));
    rig.host.reset().unwrap();
    rig.until(HostState::Ready, Command::Standby);
    assert_eq!(rig.controller_state(), ControllerState::Ready);
    rig.activate();
}

#[test]
fn standby_brakes_without_latching() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.swing(500 * MS, 0.3, 2.0);
    rig.until(HostState::Ready, Command::Standby);
    assert_eq!(rig.controller_out.as_ref().unwrap().drive, Drive::Braked);
    rig.activate();
}

#[test]
fn one_lost_set_leaves_the_controller_active_and_four_are_bridged() {
    for lost in [1, 4] {
        let mut rig = Rig::new(6);
        rig.activate();
        rig.swing(300 * MS, 0.3, 2.0);
        let begin = rig.now;
        let start = rig.commanded();
        while rig.now < begin + 300 * MS {
            let since = rig.now - begin;
            let wanted: Vec<f64> = start.iter().map(|q| q + 0.3 * since.as_secs_f64()).collect();
            let gone = since < 5 * MS * lost;
            rig.step(Command::Follow { position_rad: &wanted, speed_scale: 1.0 }, &mut |rx: &mut Vec<Event>| {
                if gone {
                    rx.clear();
                }
            });
            assert_ne!(rig.controller_state(), ControllerState::Latched);
        }
        assert_eq!((rig.host_state(), rig.controller_state()), (HostState::Active, ControllerState::Active));
        assert_eq!(rig.controller.counts().lost, u64::from(lost));
    }
}

#[test]
fn fewer_joints_leave_the_other_places_without_a_value() {
    let mut rig = Rig::new(3);
    rig.activate();
    let protocol = can_driver::Protocol::new(0).unwrap();
    let out = rig.host_out.clone().unwrap();
    let set = out.tx.iter().find(|f| f.id().raw() == 0x101).unwrap();
    let can_driver::Message::Set { angles, .. } = protocol.decode(set).unwrap().unwrap().message else { panic!() };
    assert!(angles[0].rad().is_some());
    assert_eq!(angles[1], can_driver::Angle::NO_VALUE);
}
