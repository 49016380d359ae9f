//! The controller's state, and one tick of it.

mod configuration;
mod report;
mod sets;
mod watch;

use std::time::Duration;

use super::motion::Generator;
use super::output::{ActedSet, ControllerOutput, Drive, JointState, SetCounts};
use super::params::ControllerParams;
use crate::limits::{JointLimits, PARAMETERS};
use crate::protocol::{Counted, Direction, Message};
use crate::receiver::{Assembler, Receiver};
use crate::stop::StopPair;
use crate::{Angle, ControllerState, Error, Event, FrameList, MAX_JOINTS, PerJoint, Protocol, StopCause};

/// Longest time that one tick moves the path: after a stall the path goes on, it never catches up.
const LONGEST_TICK: Duration = Duration::from_millis(20);
const HEARTBEAT_PERIOD: Duration = Duration::from_millis(100);

/// The last set that acted or kept the link alive.
#[derive(Clone, Copy, Debug)]
struct Acted {
    counter: u8,
    at: Duration,
    positions_rad: Option<[f64; MAX_JOINTS]>,
}

/// The controller's end of the protocol (see the module's head).
///
/// Ticks of 1 to 5 ms serve any host; a tick costs a few microseconds and allocates nothing.
///
/// ```
/// use can_driver::{Controller, ControllerParams, ControllerState, Drive, JointLimits, JointState};
/// use std::time::Duration;
///
/// let limits = JointLimits { min_rad: -2.0, max_rad: 2.0, velocity_rad_s: 1.0, acceleration_rad_s2: 4.0 };
/// let mut controller = Controller::new(ControllerParams::standard(0, vec![limits; 6]))?;
/// let measured = [JointState { position_rad: 0.3, velocity_rad_s: 0.0 }; 6];
/// let out = controller.tick(Duration::from_millis(5), &[], &measured);
/// assert_eq!((out.state, out.drive), (ControllerState::Unconfigured, Drive::Braked));
/// assert_eq!(out.tx.len(), 5); // three FB, STATUS, heartbeat
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Controller {
    params: ControllerParams,
    protocol: Protocol,
    state: ControllerState,
    cause: Option<StopCause>,
    /// Why motion was refused, while nothing is latched.
    refusal: Option<StopCause>,
    generator: Generator,
    receiver: Receiver,
    assembler: Assembler,
    acted: Option<Acted>,
    /// The host's clock as the controller sees it, for the reference.
    reference_at: Duration,
    cycle: Duration,
    horizon: Duration,
    speed_scale: f64,
    /// Enable was seen low since the last stop.
    enable_was_low: bool,
    reset_was_low: bool,
    arming_run: u8,
    withdrawn: bool,
    /// Why the sets since the last good one were refused.
    rejection: Option<StopCause>,
    rejected_since_report: bool,
    stored: [[i32; PARAMETERS as usize]; MAX_JOINTS],
    written: u32,
    limits: [JointLimits; MAX_JOINTS],
    last_tick: Option<Duration>,
    last_report: Option<Duration>,
    last_heartbeat: Option<Duration>,
    report_counter: u8,
    tracking_since: Option<Duration>,
    stop_pair: StopPair,
    counts: SetCounts,
    measured_ok: bool,
}

impl Controller {
    /// # Errors
    /// [`Error::JointCount`], [`Error::InvalidLimit`], [`Error::InvalidParameter`].
    pub fn new(params: ControllerParams) -> Result<Self, Error> {
        let protocol = params.validate()?;
        Ok(Self {
            protocol,
            state: ControllerState::Unconfigured,
            cause: None,
            refusal: None,
            generator: Generator::new(),
            receiver: Receiver::new(params.stale_after, params.latch_after),
            assembler: Assembler::default(),
            acted: None,
            reference_at: Duration::ZERO,
            cycle: Duration::from_millis(5),
            horizon: Duration::ZERO,
            speed_scale: 0.0,
            enable_was_low: false,
            reset_was_low: false,
            arming_run: 0,
            withdrawn: false,
            rejection: None,
            rejected_since_report: false,
            stored: [[0; PARAMETERS as usize]; MAX_JOINTS],
            written: 0,
            limits: [JointLimits::default(); MAX_JOINTS],
            last_tick: None,
            last_report: None,
            last_heartbeat: None,
            report_counter: 0,
            tracking_since: None,
            stop_pair: StopPair::default(),
            counts: SetCounts::default(),
            measured_ok: false,
            params,
        })
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.params.limits.len()
    }

    /// What became of the sets so far.
    pub fn counts(&self) -> SetCounts {
        self.counts
    }

    /// One cycle of the controller at time `now`. `measured` has one entry per joint; a number
    /// that is not finite, or a wrong count, is a fault of the measurement and stops the arm.
    pub fn tick(&mut self, now: Duration, rx: &[Event], measured: &[JointState]) -> ControllerOutput {
        let mut tx = FrameList::new();
        let mut acted = None;
        let mut report = false;
        self.measured_ok = measured.len() == self.joints() && measured.iter().all(is_plausible);
        let since_tick = self.last_tick.map_or(Duration::ZERO, |last| now.saturating_sub(last));
        self.last_tick = Some(now);

        if self.state.is_enabled() && since_tick > self.params.latch_after {
            self.latch(StopCause::ControllerStalled);
        }
        if !self.measured_ok && (self.state.is_enabled() || self.state == ControllerState::Arming) {
            self.latch(StopCause::MeasurementInvalid);
        }
        if !self.moving() && self.measured_ok {
            self.generator.rest_at(measured.iter().map(|j| j.position_rad));
        }

        for event in rx {
            match event {
                Event::Fault(fault) => {
                    if fault.ends_motion() && self.state.is_enabled() {
                        self.latch(StopCause::ControllerBusFault);
                    }
                }
                Event::Frame(stamped) => match self.protocol.decode(&stamped.frame) {
                    Ok(Some(counted)) => {
                        report |= matches!(counted.message, Message::Commit(_));
                        let age = self.receive(stamped.at.min(now), counted, measured, &mut tx);
                        acted = age.map(|age| ActedSet { counter: counted.counter, age }).or(acted);
                    }
                    Ok(None) => {}
                    Err(_) => {
                        self.counts.corrupt_frames += 1;
                        self.reject(StopCause::CorruptFrames);
                    }
                },
            }
        }

        self.watch_silence(now);
        self.watch_tracking(now, measured);
        if self.moving() {
            let joints = self.joints();
            self.generator.advance(now, since_tick.min(LONGEST_TICK), &self.limits[..joints], self.speed_scale);
        }
        if self.withdrawn && self.state == ControllerState::Ramping && self.generator.at_rest() {
            self.withdrawn = false;
            self.state = ControllerState::Ready;
        }
        if let Some(stop) = self.stop_pair.due(now, self.protocol, self.report_counter, Direction::ToHost, self.cause) {
            tx.push(stop);
        }
        let unasked_after = self.params.report_period.max(self.cycle * 3 / 2);
        if report || self.last_report.is_none_or(|last| now.saturating_sub(last) >= unasked_after) {
            self.last_report = Some(now);
            self.report(now, measured, &mut tx);
        }
        if self.last_heartbeat.is_none_or(|last| now.saturating_sub(last) >= HEARTBEAT_PERIOD) {
            self.last_heartbeat = Some(now);
            let node_state = match self.state {
                ControllerState::Unconfigured => 127,
                ControllerState::Latched => 4,
                _ => 5,
            };
            tx.push(self.protocol.encode(&Counted { message: Message::Heartbeat { node_state }, counter: 0 }));
        }
        let mut setpoints = PerJoint::with_len(self.joints());
        setpoints.as_mut_slice().copy_from_slice(&self.generator.joints()[..self.joints()]);
        ControllerOutput {
            tx,
            drive: self.drive(),
            setpoints,
            state: self.state,
            cause: self.cause.or(self.refusal),
            acted,
        }
    }

    /// Whether the path generator, and not the brake, decides where the arm is.
    fn moving(&self) -> bool {
        self.state.is_enabled() || (self.state == ControllerState::Latched && !self.generator.at_rest())
    }

    fn drive(&self) -> Drive {
        if self.moving() { Drive::Servo } else { Drive::Braked }
    }

    fn reject(&mut self, cause: StopCause) {
        self.rejected_since_report = true;
        self.rejection.get_or_insert(cause);
    }

    /// Stops, and stays stopped. The first cause is kept.
    fn latch(&mut self, cause: StopCause) {
        if self.state == ControllerState::Latched {
            return;
        }
        let joints = self.joints();
        if self.state.is_enabled() {
            self.generator.stop(&self.limits[..joints]);
        }
        self.state = ControllerState::Latched;
        self.cause = Some(cause);
        self.refusal = None;
        self.enable_was_low = false;
        self.withdrawn = false;
        self.stop_pair.ask();
    }
}

fn is_plausible(joint: &JointState) -> bool {
    Angle::from_rad(joint.position_rad).is_ok() && joint.velocity_rad_s.is_finite()
}
