//! What stops the arm, on either side, and what ends a stop.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::time::Duration;

use can_driver::{
    BusFault, Command, Config, ControllerState, Counted, Drive, Event, HostState, JointState, Message, Protocol,
    StopCause,
};
use common::{LIMITS, Rig, forge};

const MS: Duration = Duration::from_millis(1);

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
fn a_command_that_creeps_over_a_limit_stops_before_it_is_sent() {
    let mut rig = Rig::new(6);
    for joint in &mut rig.joints {
        joint.position_rad = LIMITS.max_rad - 0.01;
    }
    rig.activate();
    for k in 0..20 {
        let wanted = [LIMITS.max_rad - 0.01 + 0.002 * f64::from(k); 6];
        rig.run(5 * MS, Command::Follow { position_rad: &wanted, speed_scale: 1.0 });
        assert!(rig.commanded().iter().all(|q| *q <= LIMITS.max_rad + 2.0 * can_driver::ANGLE_LSB_RAD));
    }
    assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::CommandOutsideLimits));
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
    let took = rest_at.unwrap().as_secs_f64() - dead_at.as_secs_f64();
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
fn calm_sets_alone_do_not_end_a_latched_stop() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.host_alive = false;
    rig.run(200 * MS, Command::Standby);
    rig.host_alive = true;
    let mut seen = std::collections::BTreeSet::new();
    for (reset, state) in [(false, ControllerState::Latched), (true, ControllerState::Unconfigured)] {
        for _ in 0..500 {
            rig.step(Command::Standby, &mut |rx: &mut Vec<Event>| {
                forge(rx, |message| {
                    if let Message::Commit(commit) = message {
                        (commit.quick_stop, commit.enable, commit.reset) = (false, false, reset);
                    }
                });
            });
            seen.insert(format!("{:?}", rig.controller_state()));
        }
        assert_eq!(rig.controller_state(), state, "{seen:?}");
    }
}

#[test]
fn a_reset_waits_until_the_arm_is_at_rest() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.swing(750 * MS, 0.3, 2.0);
    assert!(rig.joints[0].velocity_rad_s > 0.5, "{:?}", rig.joints[0]);
    rig.run(5 * MS, Command::Stop(StopCause::OperatorStop));
    rig.host.reset().unwrap();
    let mut speed_rad_s = rig.joints[0].velocity_rad_s;
    for _ in 0..1000 {
        rig.step(Command::Standby, &mut |_| {});
        let change = (rig.joints[0].velocity_rad_s - speed_rad_s).abs();
        assert!(change <= LIMITS.acceleration_rad_s2 * 1e-3 + 1e-9, "{change} rad/s in a millisecond");
        speed_rad_s = rig.joints[0].velocity_rad_s;
    }
    assert_eq!(rig.controller_state(), ControllerState::Ready);
}

#[test]
fn a_new_session_of_a_restarted_host_latches_a_moving_arm() {
    for dead_for in [0, 10, 40, 90, 200] {
        let mut rig = Rig::new(6);
        rig.activate();
        rig.swing(500 * MS, 0.3, 2.0);
        rig.host_alive = false;
        rig.run(dead_for * MS, Command::Standby);
        rig.replace_host();
        let far: Vec<f64> = rig.positions().iter().map(|q| q + 0.5).collect();
        rig.run(1500 * MS, Command::Follow { position_rad: &far, speed_scale: 1.0 });
        assert_eq!(rig.controller_state(), ControllerState::Latched, "dead for {dead_for} ms");
        assert_eq!(rig.host_state(), HostState::Stopped);
        let cause = rig.controller_out.as_ref().unwrap().cause.unwrap();
        assert!(matches!(cause, StopCause::HostRestarted | StopCause::HostSilent), "{cause}");
        let rest = rig.positions();
        rig.run(2000 * MS, Command::Follow { position_rad: &far, speed_scale: 1.0 });
        assert_eq!(rest, rig.positions());
        // The operator's reset makes the new session good.
        rig.host.reset().unwrap();
        rig.activate();
    }
}

#[test]
fn a_measured_angle_that_is_not_a_number_stops_the_arm() {
    for bad in [f64::NAN, f64::INFINITY, 7.0] {
        let mut rig = Rig::new(6);
        rig.activate();
        rig.joints[2].position_rad = bad;
        rig.run(20 * MS, Command::Standby);
        let cause = rig.controller_out.as_ref().unwrap().cause;
        assert_eq!((rig.controller_state(), cause), (ControllerState::Latched, Some(StopCause::MeasurementInvalid)));
    }
}

#[test]
fn a_command_that_is_not_a_number_never_reaches_the_wire() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -f64::NAN] {
        let mut rig = Rig::new(6);
        rig.activate();
        let mut command = rig.positions();
        command[3] = bad;
        rig.run(10 * MS, Command::Follow { position_rad: &command, speed_scale: 1.0 });
        assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::CommandInvalid));
    }
    let mut rig = Rig::new(6);
    rig.activate();
    rig.run(10 * MS, Command::Follow { position_rad: &[0.25; 5], speed_scale: 1.0 });
    assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::CommandInvalid));
}

#[test]
fn an_arm_that_does_not_follow_is_stopped_where_it_is() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.swing(300 * MS, 0.3, 2.0);
    let stuck_rad = rig.joints[1].position_rad;
    let begin = rig.now;
    let start = rig.commanded();
    while rig.now < begin + 800 * MS {
        let t = rig.now.saturating_sub(begin).as_secs_f64();
        let wanted: Vec<f64> = start.iter().map(|q| q + 0.4 * t).collect();
        rig.step(Command::Follow { position_rad: &wanted, speed_scale: 1.0 }, &mut |_| {});
        rig.joints[1] = JointState { position_rad: stuck_rad, velocity_rad_s: 0.0 };
    }
    let out = rig.controller_out.as_ref().unwrap();
    assert_eq!((out.state, out.cause), (ControllerState::Latched, Some(StopCause::TrackingError)));
    assert!((out.setpoints[1].position_rad - stuck_rad).abs() < 1e-9, "{:?}", out.setpoints[1]);
}

#[test]
fn a_tick_that_comes_too_late_stops_either_side() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.now += 150 * MS;
    rig.step(Command::Standby, &mut |_| {});
    assert_eq!(rig.controller_out.as_ref().unwrap().cause, Some(StopCause::ControllerStalled));
    let mut rig = Rig::new(6);
    rig.activate();
    rig.now += 149 * MS;
    rig.controller_alive = false;
    let here = rig.positions();
    rig.run(5 * MS, Command::Follow { position_rad: &here, speed_scale: 1.0 });
    assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::HostStalled));
}

#[test]
fn a_silent_controller_stops_the_host_within_25_ms_and_two_cycles() {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.controller_alive = false;
    let died = rig.now;
    let here = rig.positions();
    while rig.host_state() != HostState::Stopped {
        rig.step(Command::Follow { position_rad: &here, speed_scale: 1.0 }, &mut |_| {});
        assert!(rig.now < died + 40 * MS);
    }
    assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::ControllerSilent));
}

#[test]
fn a_second_host_on_the_bus_is_noticed() {
    let mut rig = Rig::new(6);
    rig.activate();
    let protocol = can_driver::Protocol::new(0).unwrap();
    let message = can_driver::Message::Commit(can_driver::Commit::default());
    rig.inject_to_host(protocol.encode(&can_driver::Counted { message, counter: 9 }));
    let here = rig.positions();
    rig.run(10 * MS, Command::Follow { position_rad: &here, speed_scale: 1.0 });
    assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::SecondHost));
}

#[test]
fn a_bus_that_may_lose_frames_ends_motion_on_either_side() {
    use BusFault::{
        ArbitrationLost, NoAcknowledge, Off, Overflow, Passive, Protocol, Restarted, Transceiver, TransmitTimeout,
        Warning,
    };
    let hold = Command::Follow { position_rad: &[0.25; 6], speed_scale: 1.0 };
    for (faults, ends) in [
        (vec![Passive, Off, Restarted, TransmitTimeout, Transceiver], true),
        (vec![Warning, NoAcknowledge, Protocol, ArbitrationLost, Overflow], false),
    ] {
        for fault in faults {
            let mut rig = Rig::new(6);
            rig.activate();
            let mut once = Some(Event::Fault(fault));
            rig.step(hold, &mut |rx: &mut Vec<Event>| rx.extend(once.take()));
            let cause = rig.controller_out.as_ref().unwrap().cause;
            assert_eq!(cause, ends.then_some(StopCause::ControllerBusFault), "{fault:?}");

            let mut rig = Rig::new(6);
            rig.activate();
            rig.fault_to_host(fault);
            rig.run(5 * MS, hold);
            let cause = rig.host_out.as_ref().unwrap().cause;
            assert_eq!(cause, ends.then_some(StopCause::HostBusFault), "{fault:?}");
        }
    }
}

#[test]
fn limits_written_while_the_arm_is_enabled_stop_it_unanswered() {
    let mut rig = Rig::new(6);
    rig.activate();
    let message = Message::Config(Config { key: 0, value: 0 });
    let frame = Protocol::new(0).unwrap().encode(&Counted { message, counter: 1 });
    let mut once = Some(Event::frame(rig.now, frame));
    let hold = Command::Follow { position_rad: &[0.25; 6], speed_scale: 1.0 };
    rig.step(hold, &mut |rx: &mut Vec<Event>| rx.extend(once.take()));
    let out = rig.controller_out.as_ref().unwrap();
    assert_eq!((out.state, out.cause), (ControllerState::Latched, Some(StopCause::HostRestarted)));
    let protocol = Protocol::new(0).unwrap();
    let answered =
        out.tx.iter().any(|f| matches!(protocol.decode(f), Ok(Some(Counted { message: Message::ConfigReply(_), .. }))));
    assert!(!answered);
}

#[test]
fn either_copy_of_a_stop_is_enough() {
    let protocol = can_driver::Protocol::new(0).unwrap();
    for inverted in [false, true] {
        let mut rig = Rig::new(6);
        rig.activate();
        let message = can_driver::Message::Stop {
            direction: can_driver::Direction::ToController,
            inverted,
            cause: Some(StopCause::Application(200)),
            joint: 0,
        };
        let stop = protocol.encode(&can_driver::Counted { message, counter: 0 });
        let now = rig.now;
        rig.step(Command::Standby, &mut |rx| rx.push(Event::frame(now, stop)));
        assert_eq!(rig.controller_out.as_ref().unwrap().cause, Some(StopCause::Application(200)));
    }
}

#[test]
fn a_stop_is_sent_twice_the_second_time_inverted() {
    let mut rig = Rig::new(6);
    rig.activate();
    let mut sent = Vec::new();
    for _ in 0..20 {
        rig.step(Command::Stop(StopCause::OperatorStop), &mut |rx| {
            sent.extend(rx.iter().filter_map(|e| match e {
                Event::Frame(s) if s.frame.id().raw() < 0x100 => Some(s.frame),
                _ => None,
            }));
        });
    }
    assert_eq!(sent.iter().map(|f| f.id().raw()).collect::<Vec<_>>(), [0x080, 0x081]);
    // The checksums differ: each copy has a data id of its own.
    for (plain, inverted) in sent[0].data().iter().zip(sent[1].data()).take(6) {
        assert_eq!(plain ^ inverted, 0xFF);
    }
}
