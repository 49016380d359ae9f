//! The session's state, and one tick of it.

mod configuration;
mod rules;
mod sets;

use std::time::Duration;

use super::link::{Link, LinkReport};
use super::output::{Command, Feedback, HostOutput, HostState};
use super::params::HostParams;
use crate::limits::PARAMETERS;
use crate::protocol::{Counted, Direction, Message, Status};
use crate::receiver::Assembler;
use crate::stop::StopPair;
use crate::{Angle, Error, Event, FrameList, MAX_JOINTS, PerJoint, Protocol, SendOutcome, StopCause};

/// Cycles in a row that the bus may refuse.
const FULL_CYCLES: u8 = 3;
/// Most that the counter skips; beyond, the controller has to synchronise anew anyway.
const MOST_SKIPPED: u32 = 100;

#[derive(Clone, Copy, Debug)]
struct Pending {
    step: usize,
    sent_at: Option<Duration>,
}

/// The host's end of the protocol (see the module's head).
///
/// ```
/// use can_driver::{Command, HostParams, HostSession, HostState, JointLimits};
/// use std::time::Duration;
///
/// let limits = JointLimits { min_rad: -2.0, max_rad: 2.0, velocity_rad_s: 1.0, acceleration_rad_s2: 4.0 };
/// let mut host = HostSession::new(HostParams::standard(0, vec![limits; 6], Duration::from_millis(5)))?;
/// let out = host.tick(Duration::ZERO, &[], Command::Standby);
/// assert_eq!((out.state, out.tx.len()), (HostState::Searching, 0));
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct HostSession {
    params: HostParams,
    protocol: Protocol,
    wire_limits: [[i32; PARAMETERS as usize]; MAX_JOINTS],
    state: HostState,
    cause: Option<StopCause>,
    /// When the present state began.
    since: Option<Duration>,
    cycles_in_state: u32,
    counter: u8,
    last_tick: Option<Duration>,
    assembler: Assembler,
    feedback: Option<Feedback>,
    status: Option<(Duration, Status)>,
    link: Link,
    pending: Pending,
    config_counter: u8,
    /// The controller has acknowledged this session.
    begun: bool,
    commanded: [Angle; MAX_JOINTS],
    stop_pair: StopPair,
    full_cycles: u8,
    speed_scale: f64,
}

impl HostSession {
    /// # Errors
    /// [`Error::JointCount`], [`Error::InvalidLimit`], [`Error::InvalidParameter`].
    pub fn new(params: HostParams) -> Result<Self, Error> {
        let protocol = params.validate()?;
        let mut wire_limits = [[0; PARAMETERS as usize]; MAX_JOINTS];
        for (wire, limit) in wire_limits.iter_mut().zip(&params.limits) {
            *wire = limit.to_wire();
        }
        Ok(Self {
            params,
            protocol,
            wire_limits,
            state: HostState::Searching,
            cause: None,
            since: None,
            cycles_in_state: 0,
            counter: 0,
            last_tick: None,
            assembler: Assembler::default(),
            feedback: None,
            status: None,
            link: Link::new(),
            pending: Pending { step: 0, sent_at: None },
            config_counter: 0,
            begun: false,
            commanded: [Angle::NO_VALUE; MAX_JOINTS],
            stop_pair: StopPair::default(),
            full_cycles: 0,
            speed_scale: 0.0,
        })
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.params.limits.len()
    }

    /// Round trip and losses so far.
    pub fn link(&self) -> &LinkReport {
        &self.link.report
    }

    /// The latest STATUS with its arrival time.
    pub fn status(&self) -> Option<(Duration, Status)> {
        self.status
    }

    /// The operator ends a stop. Limits are written and read back anew afterwards.
    ///
    /// # Errors
    /// [`Error::NothingToReset`] unless the session is stopped.
    pub fn reset(&mut self) -> Result<(), Error> {
        if self.state != HostState::Stopped {
            return Err(Error::NothingToReset);
        }
        self.cause = None;
        self.enter(HostState::Resetting);
        Ok(())
    }

    /// Tells the session what the bus did with the frames of the last tick. A full queue is a
    /// missed cycle; more than three in a row stop a moving arm.
    pub fn sent(&mut self, outcome: SendOutcome) {
        match outcome {
            SendOutcome::Sent => self.full_cycles = 0,
            SendOutcome::Full => {
                self.link.report.transmit_full += 1;
                self.full_cycles = self.full_cycles.saturating_add(1);
                if self.full_cycles > FULL_CYCLES && self.is_moving() {
                    self.stop(StopCause::TransmitFull);
                }
            }
        }
    }

    /// One cycle of the session at time `now`.
    pub fn tick(&mut self, now: Duration, rx: &[Event], command: Command<'_>) -> HostOutput {
        let cycles = self.cycles_since_last(now);
        for event in rx {
            match event {
                Event::Fault(fault) => {
                    if fault.ends_motion() && self.is_moving() {
                        self.stop(StopCause::HostBusFault);
                    }
                }
                Event::Frame(stamped) => match self.protocol.decode(&stamped.frame) {
                    Ok(Some(counted)) => self.receive(stamped.at.min(now), counted),
                    Ok(None) => {}
                    Err(_) => self.link.report.corrupt_frames += 1,
                },
            }
        }
        self.watch(now);
        self.advance(now, command);
        self.command(command, cycles);

        let mut tx = FrameList::new();
        if let Some(stop) = self.stop_pair.due(now, self.protocol, self.counter, Direction::ToController, self.cause) {
            tx.push(stop);
        }
        self.send_config(now, &mut tx);
        // Never more than the four frames of a set in one cycle: the bus may queue no more.
        if self.begun && tx.is_empty() {
            self.send_set(now, cycles, &mut tx);
        }
        self.cycles_in_state = self.cycles_in_state.saturating_add(1);
        let mut commanded_rad = PerJoint::new();
        if self.commanded[..self.joints()].iter().all(|a| a.rad().is_some()) {
            self.commanded[..self.joints()].iter().filter_map(|a| a.rad()).for_each(|rad| commanded_rad.push(rad));
        }
        HostOutput { tx, state: self.state, cause: self.cause, feedback: self.feedback, commanded_rad }
    }

    /// Cycles since the last tick, from the clock: the counter moves by missed cycles too.
    fn cycles_since_last(&mut self, now: Duration) -> u32 {
        let since = self.last_tick.map_or(self.params.cycle, |last| now.saturating_sub(last));
        self.last_tick = Some(now);
        if since > self.params.stalled_after && self.is_moving() {
            self.stop(StopCause::HostStalled);
        }
        let cycles = (since.as_secs_f64() / self.params.cycle.as_secs_f64()).round();
        let cycles = cycles.clamp(1.0, f64::from(MOST_SKIPPED)) as u32;
        self.link.report.cycles_missed += u64::from(cycles - 1);
        cycles
    }

    fn is_moving(&self) -> bool {
        matches!(self.state, HostState::Enabling | HostState::Active | HostState::Disabling)
    }

    fn enter(&mut self, state: HostState) {
        if state == HostState::Searching {
            self.begun = false;
        }
        if state == HostState::Resetting {
            self.link.since_echo = 0;
        }
        self.state = state;
        self.since = None;
        self.cycles_in_state = 0;
        self.pending = Pending { step: 0, sent_at: None };
    }

    /// Stops the session; the first cause is kept.
    fn stop(&mut self, cause: StopCause) {
        if self.state != HostState::Stopped {
            self.enter(HostState::Stopped);
            self.cause = Some(cause);
            self.stop_pair.ask();
        }
    }

    fn receive(&mut self, at: Duration, counted: Counted) {
        match counted.message {
            Message::Feedback { slot, angles } => self.assembler.put(slot, counted.counter, angles),
            Message::Status(status) => self.take_status(at, counted.counter, status),
            Message::Stop { direction: Direction::ToHost, cause, .. } if self.is_moving() => {
                self.stop(cause.unwrap_or(StopCause::ControllerDisabled));
            }
            Message::Stop { direction: Direction::ToController, cause, .. } => {
                self.stop(cause.unwrap_or(StopCause::OperatorStop));
            }
            Message::Set { .. } | Message::Commit(_) | Message::Config(_) if self.is_moving() => {
                self.stop(StopCause::SecondHost);
            }
            Message::ConfigReply(stored) => self.take_reply(stored),
            _ => {}
        }
    }

    fn take_status(&mut self, at: Duration, counter: u8, status: Status) {
        if !self.link.status(counter) {
            return;
        }
        self.status = Some((at, status));
        self.link.echo(status.echo, status.echo_age, at, self.params.round_trip_limit);
        let Some(angles) = self.assembler.complete(counter) else {
            self.link.report.feedback_incomplete += 1;
            return;
        };
        let mut position_rad = PerJoint::new();
        angles[..self.joints()].iter().for_each(|a| position_rad.push(a.rad()));
        self.feedback = Some(Feedback { position_rad, at, status });
    }
}
