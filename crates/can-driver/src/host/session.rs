//! The host's rules.

use std::time::Duration;

use super::link::{Link, LinkReport};
use super::params::HostParams;
use crate::controller::STOP_COPY_AFTER;
use crate::limits::{self, KEY_BEGIN, KEY_SEAL, PARAMETERS};
use crate::protocol::{Commit, Config, Counted, Direction, Message, Mode, Status};
use crate::receiver::Assembler;
use crate::{
    ANGLE_LSB_RAD, Angle, ControllerState, Error, Event, Frame, FrameList, MAX_JOINTS, PerJoint, Protocol, SendOutcome,
    StopCause,
};

/// An unanswered CONFIG is sent again after this time.
const CONFIG_RETRY: Duration = Duration::from_millis(20);
/// Half a period of the reset flag, so that an edge that comes too early is followed by another.
const RESET_HALF_PERIOD: u32 = 8;
/// Sets without an echo that are allowed.
const UNECHOED_SETS: u32 = 3;
/// Sets without an echo after which the controller has dropped the session.
const DEAF_SETS: u32 = 40;
/// Round trips in a row that may exceed the limit.
const SLOW_TRIPS: u8 = 5;
/// Cycles in a row that the bus may refuse.
const FULL_CYCLES: u8 = 3;
/// Most that the counter skips; beyond, the controller has to synchronise anew anyway.
const MOST_SKIPPED: u32 = 100;

/// What the application wants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command<'a> {
    /// The arm is to stand still with its brakes on.
    Standby,
    /// The arm is to follow. Until the session is Active the positions are ignored and the
    /// measured ones are sent; the first ones used have to begin at
    /// [`HostOutput::commanded_rad`].
    Follow {
        /// Setpoint of each joint.
        position_rad: &'a [f64],
        /// Share of the velocity limits that may be used, 0 to 1.
        speed_scale: f64,
    },
    /// Stop now and stay stopped.
    Stop(StopCause),
}

/// State of the session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum HostState {
    /// No controller is heard.
    #[default]
    Searching,
    /// Limits are being written and read back.
    Configuring,
    /// The controller stands ready.
    Ready,
    /// The controller is asked to follow.
    Enabling,
    /// The controller follows.
    Active,
    /// The controller is asked to brake.
    Disabling,
    /// Stopped; only an operator ends this.
    Stopped,
    /// The operator has asked for the end of the stop.
    Resetting,
}

/// What the controller last said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feedback {
    /// Measured position of each joint; `None` where the controller has none.
    pub position_rad: PerJoint<Option<f64>>,
    /// When these positions arrived.
    pub at: Duration,
    /// STATUS that came with them.
    pub status: Status,
}

/// What one tick of the session gives.
#[derive(Clone, Debug, PartialEq)]
pub struct HostOutput {
    /// Frames to send, in this order.
    pub tx: FrameList,
    /// State after the tick.
    pub state: HostState,
    /// Why the session is stopped.
    pub cause: Option<StopCause>,
    /// The newest measured joints, if the controller was heard.
    pub feedback: Option<Feedback>,
    /// The setpoints in this tick's set, as the wire carries them; empty while nothing is
    /// measured.
    pub commanded_rad: PerJoint<f64>,
}

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
    stop_pending: bool,
    stop_copy: Option<(Duration, Frame)>,
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
            stop_pending: false,
            stop_copy: None,
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
        self.send_stop(now, &mut tx);
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
            self.stop_pending = true;
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

    /// Rules that end motion, or the link.
    fn watch(&mut self, now: Duration) {
        let silent = self.status.is_none_or(|(at, _)| now.saturating_sub(at) > self.params.silent_after);
        if !self.is_moving() {
            if silent && !matches!(self.state, HostState::Stopped | HostState::Resetting) {
                self.link.forget_status_counter();
                if self.state != HostState::Searching {
                    self.enter(HostState::Searching);
                }
            }
            return;
        }
        let Some((_, status)) = self.status.filter(|_| !silent) else {
            return self.stop(StopCause::ControllerSilent);
        };
        let unechoed_for = self.link.echo_at.map_or(Duration::MAX, |at| now.saturating_sub(at));
        if status.state == ControllerState::Latched {
            self.stop(status.cause.unwrap_or(StopCause::ControllerDisabled));
        } else if self.link.since_echo > UNECHOED_SETS && unechoed_for > self.params.silent_after {
            self.stop(StopCause::EchoMismatch);
        } else if self.link.slow_trips >= SLOW_TRIPS {
            self.stop(StopCause::RoundTripTooLong);
        } else if self.state == HostState::Active && !status.state.is_enabled() {
            self.stop(status.cause.unwrap_or(StopCause::ControllerDisabled));
        }
    }

    /// Moves to the next state.
    fn advance(&mut self, now: Duration, command: Command<'_>) {
        if let Command::Stop(cause) = command {
            self.stop(cause);
        }
        let since = *self.since.get_or_insert(now);
        let waited = now.saturating_sub(since);
        let controller = self.status.map(|(_, status)| status);
        let fresh = self.status.is_some_and(|(at, _)| now.saturating_sub(at) <= self.params.silent_after);
        match self.state {
            HostState::Searching if fresh => self.enter(HostState::Configuring),
            HostState::Configuring => {
                let latched = controller.is_some_and(|s| s.state == ControllerState::Latched);
                if self.begun && latched {
                    self.stop(controller.and_then(|s| s.cause).unwrap_or(StopCause::ControllerDisabled));
                } else if self.pending.step > self.last_step() {
                    if controller.is_some_and(|s| s.state == ControllerState::Ready) {
                        self.enter(HostState::Ready);
                    }
                } else if waited > self.params.configure_within {
                    self.stop(StopCause::ConfigTimeout);
                }
            }
            HostState::Ready => match controller.map(|s| s.state) {
                Some(ControllerState::Latched) => {
                    self.stop(controller.and_then(|s| s.cause).unwrap_or(StopCause::ControllerDisabled));
                }
                Some(ControllerState::Unconfigured) => self.enter(HostState::Searching),
                _ => {
                    let echoed = self.link.echo_at.is_some_and(|at| now.saturating_sub(at) <= self.params.silent_after);
                    if matches!(command, Command::Follow { .. }) && self.measured_all() && echoed {
                        self.link.slow_trips = 0;
                        self.enter(HostState::Enabling);
                    }
                }
            },
            HostState::Enabling => {
                if controller.is_some_and(|s| s.state.is_enabled()) {
                    self.enter(HostState::Active);
                } else if command == Command::Standby {
                    self.enter(HostState::Disabling);
                } else if waited > self.params.enable_within {
                    self.stop(controller.and_then(|s| s.cause).unwrap_or(StopCause::EnableTimeout));
                }
            }
            HostState::Active if command == Command::Standby => self.enter(HostState::Disabling),
            HostState::Disabling
                if self.cycles_in_state >= 3 && controller.is_some_and(|s| s.state == ControllerState::Ready) =>
            {
                self.enter(HostState::Ready);
            }
            HostState::Resetting => {
                let latched = controller.is_some_and(|s| s.state == ControllerState::Latched);
                let deaf = self.link.since_echo > DEAF_SETS;
                if !fresh || !self.begun || deaf || (self.cycles_in_state >= 3 && !latched) {
                    self.enter(HostState::Searching);
                } else if waited > self.params.configure_within {
                    self.stop(StopCause::ResetRefused);
                }
            }
            _ => {}
        }
    }

    fn measured_all(&self) -> bool {
        self.feedback.is_some_and(|f| f.position_rad.iter().all(Option::is_some))
    }

    /// Decides the angles of this tick's set.
    fn command(&mut self, command: Command<'_>, cycles: u32) {
        match (self.state, command) {
            (HostState::Active, Command::Follow { position_rad, speed_scale }) if self.cycles_in_state > 0 => {
                match self.checked(position_rad, speed_scale, cycles) {
                    Ok(angles) => {
                        self.commanded = angles;
                        self.speed_scale = speed_scale;
                    }
                    Err(cause) => self.stop(cause),
                }
            }
            (HostState::Enabling, _) if self.cycles_in_state > 0 => {}
            (HostState::Active | HostState::Disabling, _) => {}
            _ => {
                self.commanded = [Angle::NO_VALUE; MAX_JOINTS];
                if let Some(feedback) = self.feedback {
                    for (place, measured) in self.commanded.iter_mut().zip(&feedback.position_rad) {
                        *place = measured.and_then(|rad| Angle::from_rad(rad).ok()).unwrap_or(Angle::NO_VALUE);
                    }
                }
                self.speed_scale = 1.0;
            }
        }
    }

    /// The angles of a command that may leave.
    fn checked(&self, position_rad: &[f64], speed_scale: f64, cycles: u32) -> Result<[Angle; MAX_JOINTS], StopCause> {
        if position_rad.len() != self.joints() || !(0.0..=1.0).contains(&speed_scale) {
            return Err(StopCause::CommandInvalid);
        }
        let elapsed_s = (self.params.cycle * cycles).as_secs_f64();
        let mut angles = [Angle::NO_VALUE; MAX_JOINTS];
        for (i, (rad, limit)) in position_rad.iter().zip(&self.params.limits).enumerate() {
            let angle = Angle::from_rad(*rad).map_err(|_| StopCause::CommandInvalid)?;
            let before_rad = self.commanded[i].rad().ok_or(StopCause::CommandInvalid)?;
            let step_rad = limit.velocity_rad_s * elapsed_s + ANGLE_LSB_RAD;
            let inside = *rad >= limit.min_rad - ANGLE_LSB_RAD && *rad <= limit.max_rad + ANGLE_LSB_RAD;
            if !inside || !((rad - before_rad).abs() <= step_rad) {
                return Err(StopCause::CommandOutsideLimits);
            }
            angles[i] = angle;
        }
        Ok(angles)
    }

    fn send_stop(&mut self, now: Duration, tx: &mut FrameList) {
        let message =
            |inverted| Message::Stop { direction: Direction::ToController, inverted, cause: self.cause, joint: 0 };
        let counter = self.counter;
        if self.stop_pending {
            self.stop_pending = false;
            tx.push(self.protocol.encode(&Counted { message: message(false), counter }));
            let copy = self.protocol.encode(&Counted { message: message(true), counter });
            self.stop_copy = Some((now + STOP_COPY_AFTER, copy));
        } else if let Some((due, copy)) = self.stop_copy
            && now >= due
        {
            self.stop_copy = None;
            tx.push(copy);
        }
    }

    fn send_set(&mut self, now: Duration, cycles: u32, tx: &mut FrameList) {
        self.counter = self.counter.wrapping_add(cycles as u8);
        let counter = self.counter;
        for (slot, pair) in self.commanded.chunks_exact(2).enumerate() {
            let message = Message::Set { slot: slot as u8, angles: [pair[0], pair[1]] };
            tx.push(self.protocol.encode(&Counted { message, counter }));
        }
        let enable = matches!(self.state, HostState::Enabling | HostState::Active);
        let commit = Commit {
            mode: if enable { Mode::Position } else { Mode::Idle },
            enable,
            quick_stop: self.state == HostState::Stopped,
            reset: self.state == HostState::Resetting && self.cycles_in_state / RESET_HALF_PERIOD % 2 == 1,
            test: false,
            speed_scale: self.speed_scale,
            horizon: self.params.horizon,
            host_time: (now.as_micros() / 100 % 65_536) as u16,
        };
        tx.push(self.protocol.encode(&Counted { message: Message::Commit(commit), counter }));
        self.link.sent(counter, now);
    }

    /// Number of the step that seals: begin, the limits, seal.
    fn last_step(&self) -> usize {
        1 + self.joints() * usize::from(PARAMETERS)
    }

    fn config_step(&self, step: usize) -> Option<Config> {
        let last = self.last_step();
        if step == 0 {
            let cycle_us = i32::try_from(self.params.cycle.as_micros()).unwrap_or(i32::MAX);
            Some(Config { key: KEY_BEGIN, value: cycle_us })
        } else if step < last {
            let (joint, parameter) = ((step - 1) / usize::from(PARAMETERS), (step - 1) % usize::from(PARAMETERS));
            Some(Config { key: limits::limit_key(joint, parameter), value: self.wire_limits[joint][parameter] })
        } else if step == last {
            Some(Config { key: KEY_SEAL, value: limits::seal(&self.wire_limits[..self.joints()]) })
        } else {
            None
        }
    }

    fn send_config(&mut self, now: Duration, tx: &mut FrameList) {
        if self.state != HostState::Configuring
            || self.pending.sent_at.is_some_and(|at| now.saturating_sub(at) < CONFIG_RETRY)
        {
            return;
        }
        if let Some(config) = self.config_step(self.pending.step) {
            self.config_counter = self.config_counter.wrapping_add(1);
            self.pending.sent_at = Some(now);
            let counter = self.config_counter;
            tx.push(self.protocol.encode(&Counted { message: Message::Config(config), counter }));
        }
    }

    /// Compares what the controller stores with what was written.
    fn take_reply(&mut self, stored: Config) {
        if self.state != HostState::Configuring || self.pending.sent_at.is_none() {
            return;
        }
        let Some(written) = self.config_step(self.pending.step) else { return };
        if stored.key != written.key {
            return; // the late answer to an earlier, repeated write
        }
        if stored.value == written.value {
            self.pending = Pending { step: self.pending.step + 1, sent_at: None };
            self.begun = true;
        } else {
            self.stop(StopCause::LimitsMismatch);
        }
    }
}
