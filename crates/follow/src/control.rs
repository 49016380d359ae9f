//! One control tick: from the newest plan and the measured joints to a verdict. A pure function of its inputs and the loop's
//! own state; no clock, no bus, no allocation.
//!
//! ```text
//! Waiting ──enabled, measured──▶ Ready ──fresh plan──▶ Aligning ──aligned──▶ Following
//!                                  ▲                       │                    │
//!                                  │ re-engage             └── sample too old, ─┴─▶ Braking ──at rest──▶ Resting
//!                                  └──────────────────────────── or told to rest                           │
//!                                  └─────────────────────────────────────────────────────────────────────◀─┘
//! any ── measured and commanded differ too long ──▶ Stopped (latched; only an operator resets)
//! ```
//!
//! A brake starts from the last *command*, so that a tracking error does not become a step; after a tracking-error stop it is
//! the reverse, and the next start is from the measured joints.

use core::time::Duration;

use motion::{Phase as TrackerPhase, State, Tracker, TrackerParams, TrackerPlan};

use crate::error::Error;
use crate::plan::JointPlan;

/// Settings of the control loop.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlParams {
    /// Limits, bandwidth, age policy and engagement.
    pub tracker: TrackerParams,
    /// Age of the newest plan at which the arm brakes to rest.
    pub frame_hard: Duration,
    /// Largest difference between command and measurement, rad ...
    pub tracking_error_rad: f64,
    /// ... for this long.
    pub tracking_error_for: Duration,
    /// Whether a rest after lost vision ends by itself when plans come back.
    pub reengage_automatically: bool,
}

/// Why the arm rests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum RestCause {
    /// No plan younger than `frame_hard`.
    VisionLost,
    /// The program was told to.
    Requested,
}

/// Why the arm is stopped and stays so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum StopCause {
    /// Measured and commanded joints differed too much for too long.
    TrackingError,
    /// The tracker refused its input: a broken invariant upstream.
    Refused,
}

/// What the loop is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The bus is not enabled, or nothing was measured yet.
    Waiting,
    /// Enabled and at rest, until there is something to follow.
    Ready,
    /// Moving slowly to where the worker's arm is.
    Aligning,
    /// Following.
    Following,
    /// Slowing down to rest along its path.
    Braking(RestCause),
    /// At rest, until an operator (or the configuration) lets it go on.
    Resting(RestCause),
    /// Stopped; latched.
    Stopped(StopCause),
}

/// What goes to the bus this tick. Joint values are in [`ControlLoop::command`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing: there is no arm to command yet.
    Wait,
    /// Send the command; it moves.
    Command,
    /// Send the command; it stays where it is.
    Hold,
    /// Tell the controller to stop.
    Stop(StopCause),
}

/// What a tick is told.
#[derive(Debug, Clone, Copy)]
pub struct TickInput<'a> {
    /// Time of this tick.
    pub now: Duration,
    /// Time since the last tick.
    pub dt: Duration,
    /// Whether the controller accepts setpoints.
    pub enabled: bool,
    /// Measured joints, rad; `None` when none are fresh.
    pub measured_rad: Option<&'a [f64]>,
    /// The newest plan.
    pub plan: Option<&'a JointPlan>,
    /// Whether the arm shall come to rest and stay there.
    pub rest: bool,
    /// Whether an operator has allowed a new start.
    pub reset: bool,
}

/// The control loop.
#[derive(Debug, Clone)]
pub struct ControlLoop {
    params: ControlParams,
    checked: TrackerPlan,
    tracker: Option<Tracker>,
    phase: Phase,
    offered: Option<Duration>,
    error_for: Duration,
}

impl ControlLoop {
    /// A loop that waits for its arm.
    ///
    /// # Errors
    /// [`Error::Motion`] for limits or settings out of range, [`Error::Parameter`] for a tracking-error limit that is none.
    pub fn new(params: ControlParams) -> Result<Self, Error> {
        if !(params.tracking_error_rad > 0.0 && params.tracking_error_rad.is_finite()) {
            let expected = "positive and finite".to_owned();
            return Err(Error::Parameter { name: "tracking_error_rad", value: params.tracking_error_rad, expected });
        }
        let checked = params.tracker.clone().validate()?;
        Ok(Self { params, checked, tracker: None, phase: Phase::Waiting, offered: None, error_for: Duration::ZERO })
    }

    /// What the loop is doing.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// The command of the last tick: position, velocity and acceleration per joint; `None` before the arm was measured.
    pub fn command(&self) -> Option<&[State]> {
        self.tracker.as_ref().map(Tracker::states)
    }

    /// Whether the command rests.
    pub fn is_at_rest(&self) -> bool {
        self.tracker.as_ref().is_none_or(Tracker::is_at_rest)
    }

    /// One tick.
    pub fn tick(&mut self, input: &TickInput<'_>) -> Verdict {
        if let Phase::Stopped(cause) = self.phase {
            if !(input.reset && input.enabled) {
                return Verdict::Stop(cause);
            }
            self.phase = Phase::Waiting;
        }
        if !input.enabled {
            // The controller ended it: the next start is from what is measured then.
            self.tracker = None;
            self.phase = Phase::Waiting;
        }
        let Some(measured) = input.measured_rad.filter(|_| input.enabled) else {
            return if self.tracker.is_some() { self.advance(input, None) } else { Verdict::Wait };
        };
        if self.tracker.is_none() && !self.begin(measured) {
            return Verdict::Wait;
        }
        self.advance(input, Some(measured))
    }

    /// First command: the measured joints, at rest.
    fn begin(&mut self, measured: &[f64]) -> bool {
        let at_rest: Vec<State> = measured.iter().map(|&q| State::at_rest(q)).collect();
        // Joints that are not finite, or outside what a tracker can start from, are nothing to move from.
        let Ok(tracker) = self.checked.start(&at_rest) else {
            self.phase = Phase::Stopped(StopCause::Refused);
            return false;
        };
        self.tracker = Some(tracker);
        self.phase = Phase::Ready;
        self.offered = None;
        self.error_for = Duration::ZERO;
        true
    }

    fn advance(&mut self, input: &TickInput<'_>, measured: Option<&[f64]>) -> Verdict {
        let fresh = input.plan.filter(|plan| input.now.saturating_sub(plan.captured) <= self.params.frame_hard);
        let Some(tracker) = &mut self.tracker else { return Verdict::Wait };

        if let (true, Some(plan)) = (self.offered != input.plan.map(|p| p.captured), input.plan) {
            self.offered = Some(plan.captured);
            if tracker.offer(&plan.target(input.now)).is_err() {
                return self.stop(StopCause::Refused);
            }
        }
        match self.phase {
            Phase::Ready if !input.rest => {
                if let (Some(measured), Some(plan)) = (measured, fresh) {
                    if tracker.engage(measured).is_err() || tracker.offer(&plan.target(input.now)).is_err() {
                        return self.stop(StopCause::Refused);
                    }
                    self.phase = Phase::Aligning;
                }
            }
            Phase::Aligning | Phase::Following if input.rest || fresh.is_none() => {
                tracker.stop();
                self.phase = Phase::Braking(if input.rest { RestCause::Requested } else { RestCause::VisionLost });
            }
            Phase::Braking(cause) if tracker.is_at_rest() => self.phase = Phase::Resting(cause),
            Phase::Resting(RestCause::VisionLost)
                if fresh.is_some() && (self.params.reengage_automatically || input.reset) =>
            {
                self.phase = Phase::Ready;
            }
            Phase::Resting(RestCause::Requested) if !input.rest => self.phase = Phase::Ready,
            _ => {}
        }
        let Some(tracker) = &mut self.tracker else { return Verdict::Wait };
        match tracker.update(input.dt) {
            Err(_) => return self.stop(StopCause::Refused),
            Ok(report) => {
                if self.phase == Phase::Aligning && report.phase != TrackerPhase::Aligning {
                    self.phase = Phase::Following;
                }
            }
        }
        let states = tracker.states();
        if let Some(measured) = measured {
            let off = |(state, q): (&State, &f64)| {
                let gap = (state.position_rad - q).abs();
                !(gap <= self.params.tracking_error_rad)
            };
            self.error_for =
                if states.iter().zip(measured).any(off) { self.error_for + input.dt } else { Duration::ZERO };
            if self.error_for > self.params.tracking_error_for {
                return self.stop(StopCause::TrackingError);
            }
        }
        if tracker.is_at_rest() { Verdict::Hold } else { Verdict::Command }
    }

    fn stop(&mut self, cause: StopCause) -> Verdict {
        self.phase = Phase::Stopped(cause);
        self.tracker = None;
        Verdict::Stop(cause)
    }
}
