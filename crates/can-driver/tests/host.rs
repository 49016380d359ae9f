//! What the host makes of a controller that says one thing and does another: its STATUS and FB
//! frames are changed on their way, each with a right checksum, so that one rule alone can notice.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::cell::Cell;
use std::time::Duration;

use can_driver::{
    Angle, Command, ControllerState, Event, HostParams, HostState, Message, Protocol, SendOutcome, Status, StopCause,
};
use common::{CYCLE, LIMITS, Rig, forge};

const MS: Duration = Duration::from_millis(1);
const HOLD: Command<'_> = Command::Follow { position_rad: &[0.25; 6], speed_scale: 1.0 };

/// An active pair that has held still for 0.1 s.
fn active(params: HostParams) -> Rig {
    let mut rig = Rig::with(params, 6);
    rig.activate();
    rig.run(100 * MS, HOLD);
    assert_eq!(rig.host_state(), HostState::Active);
    rig
}

fn standard() -> HostParams {
    HostParams::standard(0, vec![LIMITS; 6], CYCLE)
}

/// Lets an active host hear changed STATUS frames; gives the time until it stops, if it does within half a
/// second, and why.
fn hears(change: impl Fn(&mut Status)) -> Option<(Duration, Option<StopCause>)> {
    let mut rig = active(standard());
    let begin = rig.now;
    for _ in 0..500 {
        rig.step_over(HOLD, &mut |_| {}, &mut |frames: &mut Vec<Event>| {
            forge(frames, |message| {
                if let Message::Status(status) = message {
                    change(status);
                }
            });
        });
        if rig.host_state() == HostState::Stopped {
            return Some((rig.now - begin, rig.host_out.as_ref().unwrap().cause));
        }
    }
    assert_eq!(rig.host_state(), HostState::Active);
    None
}

#[test]
fn an_unchanged_status_stops_nothing() {
    assert_eq!(hears(|_| {}), None);
}

#[test]
fn a_status_that_says_latched_stops_the_host_for_the_same_cause() {
    let (after, cause) = hears(|status| {
        status.state = ControllerState::Latched;
        status.cause = Some(StopCause::TrackingError);
    })
    .unwrap();
    assert_eq!(cause, Some(StopCause::TrackingError));
    assert!(after <= 2 * CYCLE, "{after:?}");
}

#[test]
fn a_controller_that_latches_while_it_is_to_enable_or_to_brake_stops_the_host_at_once() {
    let latched = |frames: &mut Vec<Event>| {
        forge(frames, |message| {
            if let Message::Status(status) = message {
                status.state = ControllerState::Latched;
                status.cause = Some(StopCause::TrackingError);
            }
        });
    };
    for (state, wanted, command) in
        [(HostState::Ready, HostState::Enabling, HOLD), (HostState::Active, HostState::Disabling, Command::Standby)]
    {
        let mut rig = Rig::new(6);
        rig.until(HostState::Ready, Command::Standby);
        rig.until(state, if state == HostState::Active { HOLD } else { Command::Standby });
        rig.until(wanted, command);
        for _ in 0..10 {
            rig.step_over(command, &mut |_| {}, &mut { latched });
        }
        let out = rig.host_out.as_ref().unwrap();
        assert_eq!((out.state, out.cause), (HostState::Stopped, Some(StopCause::TrackingError)), "from {wanted:?}");
    }
}

#[test]
fn a_controller_that_is_no_longer_enabled_stops_the_host() {
    let (after, cause) = hears(|status| status.state = ControllerState::Ready).unwrap();
    assert_eq!(cause, Some(StopCause::ControllerDisabled));
    assert!(after <= 2 * CYCLE, "{after:?}");
}

#[test]
fn an_echo_that_stands_still_stops_the_host() {
    let first = Cell::new(None);
    let (after, cause) = hears(|status| {
        status.echo = first.get().unwrap_or(status.echo);
        first.set(Some(status.echo));
    })
    .unwrap();
    assert_eq!(cause, Some(StopCause::EchoMismatch));
    // STATUS still comes, so that silence is not what was noticed.
    assert!(after > 25 * MS && after <= 25 * MS + 3 * CYCLE, "{after:?}");
}

#[test]
fn an_echo_of_sets_that_were_never_sent_stops_the_host() {
    let (after, cause) = hears(|status| status.echo = status.echo.wrapping_add(128)).unwrap();
    assert_eq!(cause, Some(StopCause::EchoMismatch));
    assert!(after <= 25 * MS + 3 * CYCLE, "{after:?}");
}

/// Delivers what the controller sends after `delay`, for half a second.
fn delayed_by(delay: Duration) -> (HostState, Option<StopCause>, u64) {
    let mut rig = active(HostParams { round_trip_limit: 10 * MS, silent_after: 50 * MS, ..standard() });
    let mut on_the_way: Vec<(Duration, Event)> = Vec::new();
    let before = rig.host.link().status_received;
    for _ in 0..500 {
        let now = rig.now + MS;
        rig.step_over(HOLD, &mut |_| {}, &mut |frames: &mut Vec<Event>| {
            on_the_way.extend(frames.drain(..).map(|event| (now + delay, event)));
            while on_the_way.first().is_some_and(|(due, _)| *due <= now) {
                let Event::Frame(stamped) = on_the_way.remove(0).1 else { continue };
                frames.push(Event::frame(now, stamped.frame));
            }
        });
        if rig.host_state() == HostState::Stopped {
            break;
        }
    }
    (rig.host_state(), rig.host_out.as_ref().unwrap().cause, rig.host.link().status_received - before)
}

#[test]
fn five_round_trips_in_a_row_above_the_limit_stop_the_host() {
    // The host looks every fifth millisecond, and what the controller held back is taken off.
    assert_eq!(delayed_by(4 * MS).0, HostState::Active);
    let (state, cause, heard) = delayed_by(30 * MS);
    assert_eq!((state, cause), (HostState::Stopped, Some(StopCause::RoundTripTooLong)));
    assert!((5..=8).contains(&heard), "stopped after {heard} STATUS frames");
}

#[test]
fn nothing_is_enabled_while_a_joint_is_not_measured() {
    let mut rig = Rig::new(6);
    rig.until(HostState::Ready, Command::Standby);
    let silent = |frames: &mut Vec<Event>| {
        forge(frames, |message| {
            if let Message::Feedback { slot: 2, angles } = message {
                angles[1] = Angle::NO_VALUE;
            }
        });
    };
    for _ in 0..10 {
        rig.step_over(Command::Standby, &mut |_| {}, &mut { silent });
    }
    for _ in 0..300 {
        let mut enabled = false;
        rig.step_over(
            HOLD,
            &mut |frames: &mut Vec<Event>| {
                let protocol = Protocol::new(0).unwrap();
                for event in frames {
                    let Event::Frame(stamped) = event else { continue };
                    if let Ok(Some(counted)) = protocol.decode(&stamped.frame)
                        && let Message::Commit(commit) = counted.message
                    {
                        enabled |= commit.enable;
                    }
                }
            },
            &mut { silent },
        );
        assert_eq!((rig.host_state(), enabled), (HostState::Ready, false));
    }
    let feedback = rig.host_out.as_ref().unwrap().feedback.unwrap();
    assert_eq!(feedback.position_rad.iter().filter(|q| q.is_none()).count(), 1);
    // It is only that joint's value that was waited for.
    rig.until(HostState::Active, HOLD);
}

/// Runs with changed messages to the host until it is in `state`, at most `time`; gives the time it took.
fn until_told(
    rig: &mut Rig,
    state: HostState,
    time: Duration,
    command: Command<'_>,
    change: impl Fn(&mut Message) + Copy,
) -> Duration {
    let begin = rig.now;
    while rig.host_state() != state {
        assert!(rig.now < begin + time, "{state:?} not reached within {time:?}: {:?}", rig.host_out);
        rig.step_over(command, &mut |_| {}, &mut |frames: &mut Vec<Event>| forge(frames, change));
    }
    rig.now - begin
}

fn told(state: ControllerState) -> impl Fn(&mut Message) + Copy {
    move |message| {
        if let Message::Status(status) = message {
            status.state = state;
        }
    }
}

fn cause(rig: &Rig) -> Option<StopCause> {
    rig.host_out.as_ref().unwrap().cause
}

#[test]
fn a_bus_that_takes_no_frames_four_cycles_in_a_row_stops_a_moving_arm() {
    let mut rig = active(standard());
    for outcome in [SendOutcome::Full, SendOutcome::Full, SendOutcome::Full, SendOutcome::Sent].repeat(5) {
        rig.host.sent(outcome);
        rig.run(CYCLE, HOLD);
        assert_eq!(rig.host_state(), HostState::Active);
    }
    for _ in 0..4 {
        rig.host.sent(SendOutcome::Full);
    }
    rig.run(CYCLE, HOLD);
    assert_eq!((rig.host_state(), cause(&rig)), (HostState::Stopped, Some(StopCause::TransmitFull)));
    assert_eq!(rig.host.link().transmit_full, 19);
}

#[test]
fn a_controller_that_answers_no_configuration_is_given_three_seconds() {
    let mut rig = Rig::new(6);
    for _ in 0..4000 {
        rig.step_over(Command::Standby, &mut |_| {}, &mut |frames: &mut Vec<Event>| {
            forge(frames, |message| {
                if let Message::ConfigReply(stored) = message {
                    stored.key = 0xEE;
                }
            });
        });
        if rig.host_state() == HostState::Stopped {
            break;
        }
    }
    assert_eq!(cause(&rig), Some(StopCause::ConfigTimeout));
    assert!(rig.now > 3000 * MS && rig.now < 3300 * MS, "{:?}", rig.now);
}

#[test]
fn a_late_second_answer_to_a_write_is_passed_over() {
    let mut rig = Rig::new(6);
    let mut copies: Vec<(Duration, Event)> = Vec::new();
    let protocol = Protocol::new(0).unwrap();
    for _ in 0..1500 {
        let now = rig.now + MS;
        rig.step_over(Command::Standby, &mut |_| {}, &mut |frames: &mut Vec<Event>| {
            let answers: Vec<Event> = frames
                .iter()
                .filter(|event| {
                    let Event::Frame(stamped) = event else { return false };
                    matches!(protocol.decode(&stamped.frame), Ok(Some(c)) if matches!(c.message, Message::ConfigReply(_)))
                })
                .copied()
                .collect();
            while copies.first().is_some_and(|(due, _)| *due <= now) {
                frames.push(copies.remove(0).1);
            }
            copies.extend(answers.into_iter().map(|event| (now + CYCLE, event)));
        });
        if rig.host_state() == HostState::Ready {
            return;
        }
    }
    panic!("{:?}", rig.host_out);
}

#[test]
fn a_ready_host_believes_a_controller_that_says_latched_or_unconfigured() {
    let mut rig = Rig::new(6);
    rig.until(HostState::Ready, Command::Standby);
    let took = until_told(&mut rig, HostState::Stopped, 100 * MS, Command::Standby, told(ControllerState::Latched));
    assert!(took <= 2 * CYCLE, "{took:?}");
    assert_eq!(cause(&rig), Some(StopCause::ControllerDisabled));

    let mut rig = Rig::new(6);
    rig.until(HostState::Ready, Command::Standby);
    let took =
        until_told(&mut rig, HostState::Configuring, 100 * MS, Command::Standby, told(ControllerState::Unconfigured));
    assert!(took <= 4 * CYCLE, "{took:?}");
}

#[test]
fn a_controller_that_stays_ready_is_given_half_a_second_to_enable() {
    let mut rig = Rig::new(6);
    rig.until(HostState::Ready, Command::Standby);
    until_told(&mut rig, HostState::Enabling, 100 * MS, HOLD, told(ControllerState::Ready));
    let took = until_told(&mut rig, HostState::Stopped, 1000 * MS, HOLD, told(ControllerState::Ready));
    assert_eq!(cause(&rig), Some(StopCause::EnableTimeout));
    assert!(took >= 490 * MS && took <= 520 * MS, "{took:?}");
}

/// A pair that was stopped, has come to rest, and is to be reset.
fn reset() -> Rig {
    let mut rig = active(standard());
    rig.run(CYCLE, Command::Stop(StopCause::OperatorStop));
    rig.run(500 * MS, HOLD);
    rig.host.reset().unwrap();
    rig
}

#[test]
fn a_reset_that_the_controller_does_not_take_is_refused_after_three_seconds() {
    let mut rig = reset();
    until_told(&mut rig, HostState::Resetting, 2 * CYCLE, HOLD, told(ControllerState::Latched));
    let took = until_told(&mut rig, HostState::Stopped, 4000 * MS, HOLD, told(ControllerState::Latched));
    assert_eq!(cause(&rig), Some(StopCause::ResetRefused));
    assert!(took > 2900 * MS && took < 3100 * MS, "{took:?}");
}

#[test]
fn a_reset_begins_anew_with_a_controller_that_has_forgotten_the_session() {
    let mut rig = reset();
    let forgotten = |message: &mut Message| {
        if let Message::Status(status) = message {
            status.state = ControllerState::Latched;
            status.echo = 0xAA;
        }
    };
    until_told(&mut rig, HostState::Resetting, 2 * CYCLE, HOLD, forgotten);
    let took = until_told(&mut rig, HostState::Configuring, 1000 * MS, HOLD, forgotten);
    assert!(took < 300 * MS, "{took:?}");
}

#[test]
fn a_speed_scale_outside_zero_to_one_stops_before_it_is_sent() {
    for (speed_scale, fine) in [(0.0, true), (1.0, true), (-0.01, false), (1.01, false), (f64::NAN, false)] {
        let mut rig = active(standard());
        rig.run(2 * CYCLE, Command::Follow { position_rad: &[0.25; 6], speed_scale });
        assert_eq!(rig.host_state() == HostState::Active, fine, "{speed_scale}");
        assert_eq!(cause(&rig), (!fine).then_some(StopCause::CommandInvalid), "{speed_scale}");
    }
}

#[test]
fn a_host_that_paused_for_less_than_its_limit_does_not_blame_the_echo() {
    let mut rig = active(standard());
    rig.host_alive = false;
    rig.run(40 * MS, HOLD);
    rig.host_alive = true;
    rig.run(200 * MS, HOLD);
    assert_eq!((rig.host_state(), cause(&rig)), (HostState::Active, None));
}

#[test]
fn every_set_of_a_stopped_host_asks_for_a_quick_stop() {
    let mut rig = active(standard());
    rig.run(CYCLE, Command::Stop(StopCause::OperatorStop));
    let protocol = Protocol::new(0).unwrap();
    let mut sets = 0;
    for _ in 0..100 {
        rig.step(HOLD, &mut |frames: &mut Vec<Event>| {
            for event in frames {
                let Event::Frame(stamped) = event else { continue };
                if let Ok(Some(counted)) = protocol.decode(&stamped.frame)
                    && let Message::Commit(commit) = counted.message
                {
                    assert!(commit.quick_stop && !commit.enable, "{commit:?}");
                    sets += 1;
                }
            }
        });
    }
    assert!(sets >= 18, "{sets}");
}
