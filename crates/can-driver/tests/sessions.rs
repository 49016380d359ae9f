//! Sessions of a host with a controller: configured, enabled, followed, put into standby.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::time::Duration;

use can_driver::{
    Angle, Command, Config, ControllerState, Counted, Drive, Event, HostParams, HostState, JointLimits, Message, Mode,
    Protocol, StopCause,
};
use common::{LIMITS, Rig, forge};

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
fn a_first_set_away_from_the_measured_angles_does_not_enable() {
    let mut rig = Rig::new(6);
    rig.until(HostState::Ready, Command::Standby);
    for _ in 0..100 {
        rig.step(Command::Follow { position_rad: &[0.25; 6], speed_scale: 1.0 }, &mut |rx: &mut Vec<Event>| {
            forge(rx, |message| {
                if let Message::Set { slot: 1, angles } = message {
                    angles[0] = Angle::from_rad(0.30).unwrap();
                }
            });
        });
        assert!(!rig.controller_state().is_enabled());
    }
    assert_eq!(rig.controller_out.as_ref().unwrap().cause, Some(StopCause::NotAtMeasured));
}

#[test]
fn an_enable_that_was_never_low_does_not_enable() {
    let mut rig = Rig::new(6);
    for _ in 0..1000 {
        rig.step(Command::Standby, &mut |rx: &mut Vec<Event>| {
            forge(rx, |message| {
                if let Message::Commit(commit) = message {
                    (commit.enable, commit.mode) = (true, Mode::Position);
                }
            });
        });
        assert!(!rig.controller_state().is_enabled());
    }
    assert_eq!(rig.controller_state(), ControllerState::Ready);
}

#[test]
fn an_arm_outside_its_limits_is_not_enabled() {
    let mut rig = Rig::new(6);
    rig.joints[3].position_rad = LIMITS.max_rad + 0.01;
    rig.until(HostState::Ready, Command::Standby);
    let here = rig.positions();
    for _ in 0..100 {
        rig.step(Command::Follow { position_rad: &here, speed_scale: 1.0 }, &mut |_| {});
        assert!(!rig.controller_state().is_enabled());
    }
    assert_eq!(rig.controller_out.as_ref().unwrap().cause, Some(StopCause::OutsideLimits));
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
fn limits_wider_than_the_controllers_own_are_refused() {
    let wide = JointLimits { velocity_rad_s: 1.5, ..LIMITS };
    let mut rig = Rig::with(HostParams::standard(0, vec![wide; 6], common::CYCLE), 6);
    rig.run(1000 * MS, Command::Standby);
    assert_eq!(rig.host_out.as_ref().unwrap().cause, Some(StopCause::LimitsMismatch));
    assert_ne!(rig.controller_state(), ControllerState::Ready);
}

#[test]
fn limits_are_sealed_only_when_all_are_written_and_the_sum_is_right() {
    const KEY_BEGIN: u8 = 240;
    const KEY_SEAL: u8 = 241;
    // The sum arrives changed.
    let mut rig = Rig::new(6);
    for _ in 0..1000 {
        rig.step(Command::Standby, &mut |rx: &mut Vec<Event>| {
            forge(rx, |message| {
                if let Message::Config(config) = message
                    && config.key == KEY_SEAL
                {
                    config.value ^= 1;
                }
            });
        });
        assert_eq!(rig.controller_state(), ControllerState::Unconfigured);
    }
    // The sum is right, but it is that of the limits of the session before.
    let mut rig = Rig::new(6);
    rig.until(HostState::Ready, Command::Standby);
    assert_eq!(rig.controller_state(), ControllerState::Ready);
    let protocol = Protocol::new(0).unwrap();
    let mut write = |key, value| {
        let message = Message::Config(Config { key, value });
        let frame = protocol.encode(&Counted { message, counter: 1 });
        rig.now += 5 * MS;
        let out = rig.controller.tick(rig.now, &[Event::frame(rig.now, frame)], &rig.joints);
        let reply = out.tx.iter().find_map(|f| match protocol.decode(f) {
            Ok(Some(Counted { message: Message::ConfigReply(stored), .. })) => Some(stored.value),
            _ => None,
        });
        (reply.unwrap(), out.state)
    };
    write(KEY_BEGIN, 5_000);
    let (sum, _) = write(KEY_SEAL, 0);
    assert_eq!(write(KEY_SEAL, sum), (sum, ControllerState::Unconfigured));
}

#[test]
fn a_host_with_fewer_joints_than_the_controller_never_gets_ready() {
    let mut rig = Rig::with(HostParams::standard(0, vec![LIMITS; 5], common::CYCLE), 6);
    rig.run(4000 * MS, Command::Standby);
    assert!(rig.host_out.as_ref().unwrap().cause.is_some());
    assert_eq!(rig.controller_state(), ControllerState::Latched);
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
