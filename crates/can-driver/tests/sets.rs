//! Sets that are lost, repeated or wrong.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::time::Duration;

use can_driver::{Angle, Command, ControllerState, Event, HostParams, HostState, Message, SetCounts};
use common::{LIMITS, Rig, forge};

const MS: Duration = Duration::from_millis(1);

#[test]
fn one_lost_set_leaves_the_controller_active_and_four_are_bridged() {
    for lost in [1, 4] {
        let mut rig = Rig::new(6);
        rig.activate();
        rig.swing(300 * MS, 0.3, 2.0);
        let begin = rig.now;
        let start = rig.commanded();
        while rig.now < begin + 300 * MS {
            let since = rig.now.saturating_sub(begin);
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
fn a_set_that_comes_twice_acts_once() {
    let run = |copies: usize| {
        let mut rig = Rig::new(6);
        rig.activate();
        let before = rig.controller.counts();
        let start = rig.commanded();
        let mut path = Vec::new();
        for ms in 0..400_u32 {
            let wanted: Vec<f64> = start.iter().map(|q| q + 0.3e-3 * f64::from(ms)).collect();
            rig.step(Command::Follow { position_rad: &wanted, speed_scale: 1.0 }, &mut |rx: &mut Vec<Event>| {
                *rx = rx.repeat(copies);
            });
            path.push(rig.positions());
        }
        let counts = rig.controller.counts();
        (path, counts.accepted - before.accepted, counts.repeated - before.repeated)
    };
    let (once, accepted, _) = run(1);
    assert_eq!(accepted, 80);
    assert_eq!(run(2), (once, accepted, accepted));
}

#[test]
fn after_five_lost_sets_the_third_in_a_row_is_the_first_to_act() {
    // What a host sends that hears nothing of the losses.
    let mut sent = Vec::new();
    let mut rig = Rig::new(6);
    rig.activate();
    for _ in 0..100 {
        rig.step(Command::Follow { position_rad: &[0.25; 6], speed_scale: 1.0 }, &mut |rx: &mut Vec<Event>| {
            sent.push(rx.clone());
        });
    }
    let mut rig = Rig::new(6);
    rig.activate();
    rig.host_alive = false;
    let before = rig.controller.counts();
    let mut acted = Vec::new();
    for (i, rx) in sent.iter().filter(|rx| !rx.is_empty()).enumerate() {
        for _ in 1..5 {
            rig.step(Command::Standby, &mut |_| {});
        }
        rig.step(Command::Standby, &mut |to_controller: &mut Vec<Event>| {
            if !(2..7).contains(&i) {
                to_controller.clone_from(rx);
            }
        });
        acted.push(rig.controller_out.as_ref().unwrap().acted.is_some());
    }
    assert_eq!(acted[..11], [true, true, false, false, false, false, false, false, false, true, true]);
    assert_eq!(rig.controller.counts().out_of_sequence - before.out_of_sequence, 2);
    assert_eq!(rig.controller_state(), ControllerState::Active);
}

/// Sends one forged set to an active arm and gives what the controller counted, the way it was moved, and what it said.
fn with_one_forged_set(change: impl Fn(&mut Message)) -> (SetCounts, f64, ControllerState) {
    let mut rig = Rig::new(6);
    rig.activate();
    rig.run(100 * MS, Command::Follow { position_rad: &[0.25; 6], speed_scale: 1.0 });
    let before = rig.positions()[0];
    let mut forged = false;
    let mut furthest = 0.0_f64;
    for _ in 0..100 {
        rig.step(Command::Follow { position_rad: &[0.25; 6], speed_scale: 1.0 }, &mut |rx: &mut Vec<Event>| {
            if !forged && !rx.is_empty() {
                forge(rx, &change);
                forged = true;
            }
        });
        furthest = furthest.max((rig.positions()[0] - before).abs());
    }
    (rig.controller.counts(), furthest, rig.controller_state())
}

#[test]
fn an_angle_further_away_than_the_velocity_limit_allows_never_acts() {
    let jump = |by_rad: f64| {
        with_one_forged_set(move |message| {
            if let Message::Set { slot: 0, angles } = message {
                angles[0] = Angle::from_rad(0.25 + by_rad).unwrap();
            }
        })
    };
    // 1 rad/s for 5 ms is 5 mrad.
    let (counts, furthest, state) = jump(0.0052);
    assert_eq!((counts.step_too_large, state), (1, ControllerState::Active));
    assert!(furthest < 1e-5, "{furthest}");
    let (counts, furthest, _) = jump(0.0048);
    // It acts, though 4 rad/s^2 allow little way before the next set calls the arm back.
    assert_eq!(counts.step_too_large, 0);
    assert!(furthest > 5e-5, "{furthest}");
}

#[test]
fn a_set_without_a_value_for_a_joint_that_exists_never_acts() {
    let (counts, furthest, state) = with_one_forged_set(|message| {
        if let Message::Set { slot: 2, angles } = message {
            angles[1] = Angle::NO_VALUE;
        }
    });
    assert_eq!((counts.missing_value, state), (1, ControllerState::Active));
    assert!(furthest < 1e-5, "{furthest}");
}

#[test]
fn another_robots_frames_are_damaged_frames() {
    let mut params = HostParams::standard(1, vec![LIMITS; 6], common::CYCLE);
    params.robot = 1;
    let mut rig = Rig::with(params, 6);
    rig.run(500 * MS, Command::Standby);
    assert_eq!(rig.host_state(), HostState::Searching);
    assert!(rig.host.link().corrupt_frames > 100);
}
