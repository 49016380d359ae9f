//! The host's end of the bus: control loop and protocol session, joined for one tick.
//!
//! The same code runs live, on the clock of the control thread, and offline, on the time of a recording.

use std::time::Duration;

use can_driver::{Bus, Command, Event, HostOutput, HostParams, HostSession, HostState};
use follow::{ControlLoop, ControlParams, JointPlan, Phase, StopCause, TickInput, Verdict};
use motion::State;

use crate::error::Error;

/// Frames and faults that may wait for a tick; a cycle has at most a dozen.
const EVENTS: usize = 256;

/// What the application wants of the arm.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Wish {
    /// Follow, or come to rest.
    pub follow: bool,
    /// Put the brakes on once at rest.
    pub standby: bool,
    /// An operator has allowed a new start.
    pub reset: bool,
}

/// What one tick did.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// What the control loop is doing.
    pub phase: Phase,
    /// State of the protocol session.
    pub session: HostState,
    /// Why the session is stopped.
    pub cause: Option<can_driver::StopCause>,
    /// Measured joints, and when they arrived.
    pub measured: Option<(Duration, Vec<f64>)>,
    /// Command of the control loop.
    pub command: Option<Vec<State>>,
    /// Setpoints as the wire carries them; empty while nothing is measured.
    pub setpoints_rad: Vec<f64>,
}

/// The host's end.
#[derive(Debug)]
pub struct Link<B> {
    bus: B,
    session: HostSession,
    control: ControlLoop,
    events: Vec<Event>,
    output: Option<HostOutput>,
    feedback_limit: Duration,
    last: Option<Duration>,
    period: Duration,
}

impl<B: Bus> Link<B> {
    /// A session and a control loop on a bus.
    ///
    /// # Errors
    /// [`Error::Bus`] or [`Error::Follow`] for limits or settings out of range.
    pub fn new(bus: B, host: HostParams, control: ControlParams, feedback_limit: Duration) -> Result<Self, Error> {
        let period = host.cycle;
        Ok(Self {
            bus,
            session: HostSession::new(host)?,
            control: ControlLoop::new(control)?,
            events: Vec::with_capacity(EVENTS),
            output: None,
            feedback_limit,
            last: None,
            period,
        })
    }

    /// Round trip and losses so far.
    pub fn report(&self) -> &can_driver::LinkReport {
        self.session.link()
    }

    /// Whether the command rests.
    pub fn is_at_rest(&self) -> bool {
        self.control.is_at_rest()
    }

    /// One tick at time `now`.
    ///
    /// # Errors
    /// [`Error::Bus`] when the bus is down or gone.
    pub fn tick(&mut self, now: Duration, plan: Option<&JointPlan>, wish: Wish) -> Result<Tick, Error> {
        let dt = self.last.map_or(self.period, |last| now.saturating_sub(last)).max(Duration::from_micros(1));
        self.last = Some(now);
        self.bus.drain(now, &mut self.events)?;

        let active = self.output.as_ref().is_some_and(|out| out.state == HostState::Active);
        let measured = self.measured(now);
        // The first command has to begin where the session stands, which is what was measured, as the wire carries it.
        let starting = self.control.command().is_none();
        let commanded: Option<Vec<f64>> = self
            .output
            .as_ref()
            .filter(|out| active && !out.commanded_rad.is_empty())
            .map(|out| out.commanded_rad.iter().copied().collect());
        let seen = if starting { commanded.as_deref() } else { measured.as_ref().map(|(_, q)| q.as_slice()) };
        let verdict = self.control.tick(&TickInput {
            now,
            dt,
            enabled: active,
            measured_rad: seen,
            plan,
            rest: !wish.follow,
            reset: wish.reset,
        });
        if wish.reset && self.output.as_ref().is_some_and(|out| out.state == HostState::Stopped) {
            self.session.reset()?;
        }

        let positions: Vec<f64> = match self.control.command() {
            Some(states) => states.iter().map(|s| s.position_rad).collect(),
            None => vec![0.0; self.session.joints()],
        };
        let command = match verdict {
            Verdict::Stop(cause) => Command::Stop(wire_cause(cause)),
            _ if wish.standby && self.control.is_at_rest() => Command::Standby,
            // Until the session is active it sends what was measured, whatever stands here.
            _ => Command::Follow { position_rad: &positions, speed_scale: 1.0 },
        };
        let output = self.session.tick(now, &self.events, command);
        let sent = self.bus.transmit(now, &output.tx)?;
        self.session.sent(sent);
        let tick = Tick {
            phase: self.control.phase(),
            session: output.state,
            cause: output.cause,
            measured,
            command: self.control.command().map(<[State]>::to_vec),
            setpoints_rad: output.commanded_rad.iter().copied().collect(),
        };
        self.output = Some(output);
        Ok(tick)
    }

    /// The measured joints, if they are fresh and whole.
    fn measured(&self, now: Duration) -> Option<(Duration, Vec<f64>)> {
        let feedback = self.output.as_ref()?.feedback?;
        if now.saturating_sub(feedback.at) > self.feedback_limit {
            return None;
        }
        let joints: Option<Vec<f64>> = feedback.position_rad.iter().copied().collect();
        Some((feedback.at, joints?))
    }
}

fn wire_cause(cause: StopCause) -> can_driver::StopCause {
    match cause {
        StopCause::TrackingError => can_driver::StopCause::TrackingError,
        StopCause::Refused => can_driver::StopCause::CommandInvalid,
    }
}
