//! The controller's rules.

use std::time::Duration;

use super::motion::{Generator, Setpoint};
use super::params::ControllerParams;
use crate::limits::{self, JointLimits, KEY_BEGIN, KEY_SEAL, PARAMETERS};
use crate::protocol::{Commit, Config, Counted, Direction, Message, Mode, Status};
use crate::receiver::{Assembler, Judgement, Receiver, SYNC_SETS};
use crate::{
    ANGLE_LSB_RAD, Angle, ControllerState, Error, Event, Frame, FrameList, MAX_JOINTS, PerJoint, Protocol, StopCause,
};

/// Longest time that one tick moves the path: after a stall the path goes on, it never catches up.
const LONGEST_TICK: Duration = Duration::from_millis(20);
const HEARTBEAT_PERIOD: Duration = Duration::from_millis(100);
/// Distance in time between the two copies of a STOP.
pub(crate) const STOP_COPY_AFTER: Duration = Duration::from_millis(1);
/// Configuration frames answered in one tick; the host sends one per cycle.
const REPLIES_PER_TICK: usize = 4;
/// Share of the arrival jitter that moves the reference's clock.
const CLOCK_GAIN: f64 = 0.1;
/// Cycles that a host may have.
const CYCLES_US: std::ops::RangeInclusive<i32> = 1_000..=20_000;

/// Measured position and velocity of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointState {
    /// Position.
    pub position_rad: f64,
    /// Velocity.
    pub velocity_rad_s: f64,
}

/// What the drives do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Brakes are on, drives are off.
    #[default]
    Braked,
    /// The drives follow the setpoints.
    Servo,
}

/// What became of the sets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SetCounts {
    /// Accepted.
    pub accepted: u64,
    /// Missing between accepted ones.
    pub lost: u64,
    /// Repeated.
    pub repeated: u64,
    /// Out of sequence, or before the sequence was established.
    pub out_of_sequence: u64,
    /// Older than allowed.
    pub stale: u64,
    /// COMMIT without its three SET frames.
    pub incomplete: u64,
    /// With an angle further away than the velocity limit allows.
    pub step_too_large: u64,
    /// Without an angle for a joint that exists.
    pub missing_value: u64,
    /// Damaged frames (not sets).
    pub corrupt_frames: u64,
}

/// What one tick of the controller gives.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerOutput {
    /// Frames to send, in this order.
    pub tx: FrameList,
    /// What the drives do.
    pub drive: Drive,
    /// Setpoint of each joint; with brakes on, where the joint stands.
    pub setpoints: PerJoint<Setpoint>,
    /// State after the tick.
    pub state: ControllerState,
    /// Why the arm is stopped or is not enabled.
    pub cause: Option<StopCause>,
    /// The newest set that began to act in this tick.
    pub acted: Option<ActedSet>,
}

/// A set whose setpoints act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActedSet {
    /// Its counter.
    pub counter: u8,
    /// Its age on arrival, beyond the shortest transport time.
    pub age: Duration,
}

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
    stop_copy: Option<(Duration, Frame)>,
    stop_pending: bool,
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
            stop_copy: None,
            stop_pending: false,
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
        self.send_stop(now, &mut tx);
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

    /// Takes one message; gives the age of a set that acts.
    fn receive(
        &mut self,
        at: Duration,
        counted: Counted,
        measured: &[JointState],
        tx: &mut FrameList,
    ) -> Option<Duration> {
        match counted.message {
            Message::Stop { direction: Direction::ToController, cause, .. } => {
                self.latch(cause.unwrap_or(StopCause::OperatorStop));
            }
            Message::Set { slot, angles } => self.assembler.put(slot, counted.counter, angles),
            Message::Commit(commit) => return self.commit(at, counted.counter, commit, measured),
            Message::Config(config) => {
                let answered = tx.len();
                if answered < REPLIES_PER_TICK
                    && let Some(stored) = self.configure(config)
                {
                    let message = Message::ConfigReply(stored);
                    tx.push(self.protocol.encode(&Counted { message, counter: counted.counter }));
                }
            }
            _ => {}
        }
        None
    }

    fn commit(&mut self, at: Duration, counter: u8, commit: Commit, measured: &[JointState]) -> Option<Duration> {
        let Some(angles) = self.assembler.complete(counter) else {
            self.counts.incomplete += 1;
            self.reject(StopCause::IncompleteSets);
            return None;
        };
        let (resynchronised, lost, age) = match self.receiver.judge(at, counter, commit.host_time) {
            Judgement::Accept { resynchronised, lost, age } => (resynchronised, lost, age),
            Judgement::Repeat => {
                self.counts.repeated += 1;
                return None;
            }
            Judgement::Stale => {
                self.counts.stale += 1;
                self.reject(StopCause::StaleSetpoints);
                return None;
            }
            Judgement::Synchronising | Judgement::WrongSequence => {
                self.counts.out_of_sequence += 1;
                self.reject(StopCause::WrongSequence);
                return None;
            }
        };
        let acting = commit.mode == Mode::Position && commit.enable && !commit.test;
        let joints = self.joints();
        let mut positions_rad = [0.0; MAX_JOINTS];
        let mut complete = true;
        for (position, angle) in positions_rad.iter_mut().zip(&angles[..joints]) {
            match angle.rad() {
                Some(rad) => *position = rad,
                None => complete = false,
            }
        }
        if acting && !complete {
            self.counts.missing_value += 1;
            self.reject(StopCause::MissingValue);
            return None;
        }
        let before = self.acted;
        if acting && self.state.is_enabled() && !self.step_is_small(before, at, counter, resynchronised, &positions_rad)
        {
            self.counts.step_too_large += 1;
            self.reject(StopCause::StepTooLarge);
            return None;
        }
        self.counts.accepted += 1;
        self.counts.lost += u64::from(lost);
        self.rejection = None;
        self.acted = Some(Acted { counter, at, positions_rad: complete.then_some(positions_rad) });
        self.flags(commit, acting, measured, &positions_rad);
        if !acting || !self.state.is_enabled() || self.withdrawn {
            return None;
        }
        self.horizon = commit.horizon;
        self.speed_scale = commit.speed_scale;
        self.follow(before, at.saturating_sub(age), counter, resynchronised, positions_rad);
        Some(age)
    }

    /// Each joint may move by at most its velocity limit times the cycles since the last set; two
    /// steps of the wire are rounding.
    fn step_is_small(
        &self,
        before: Option<Acted>,
        at: Duration,
        counter: u8,
        resynchronised: bool,
        positions_rad: &[f64; MAX_JOINTS],
    ) -> bool {
        let Some(before) = before else { return false };
        let cycles = counter.wrapping_sub(before.counter);
        let elapsed_s =
            if resynchronised { at.saturating_sub(before.at) } else { self.cycle * u32::from(cycles) }.as_secs_f64();
        let Some(from_rad) = before.positions_rad else { return false };
        positions_rad
            .iter()
            .zip(&from_rad)
            .zip(&self.limits[..self.joints()])
            .all(|((to, from), limit)| (to - from).abs() <= limit.velocity_rad_s * elapsed_s + 2.0 * ANGLE_LSB_RAD)
    }

    /// Enable, quick stop and reset of an accepted COMMIT.
    fn flags(&mut self, commit: Commit, acting: bool, measured: &[JointState], positions_rad: &[f64; MAX_JOINTS]) {
        if commit.quick_stop && self.state != ControllerState::Latched {
            self.latch(StopCause::OperatorStop);
        }
        let reset_edge = commit.reset && self.reset_was_low;
        self.reset_was_low = !commit.reset;
        if !commit.enable {
            self.enable_was_low = true;
            self.refusal = None;
        }
        match self.state {
            ControllerState::Latched if reset_edge && !commit.enable && !commit.quick_stop && self.may_reset() => {
                self.cause = None;
                self.forget_limits();
                self.state = ControllerState::Unconfigured;
            }
            ControllerState::Unconfigured if commit.enable => self.refusal = Some(StopCause::LimitsNotSealed),
            ControllerState::Ready if acting && self.enable_was_low => {
                self.arming_run = 0;
                self.state = ControllerState::Arming;
                self.arm(measured, positions_rad);
            }
            ControllerState::Arming if acting => self.arm(measured, positions_rad),
            ControllerState::Arming => self.state = ControllerState::Ready,
            ControllerState::Active | ControllerState::Coasting | ControllerState::Ramping if !commit.enable => {
                self.withdrawn = true;
                self.state = ControllerState::Ramping;
                let joints = self.joints();
                self.generator.stop(&self.limits[..joints]);
            }
            _ => {}
        }
    }

    fn may_reset(&self) -> bool {
        self.generator.at_rest() && self.measured_ok
    }

    /// Counts good first sets; the third makes the arm active.
    fn arm(&mut self, measured: &[JointState], positions_rad: &[f64; MAX_JOINTS]) {
        let limits = &self.limits[..self.joints()];
        let inside = measured.iter().zip(limits).all(|(j, l)| (l.min_rad..=l.max_rad).contains(&j.position_rad));
        let near = measured
            .iter()
            .zip(positions_rad)
            .all(|(j, q)| (q - j.position_rad).abs() <= self.params.engage_tolerance_rad);
        if !self.measured_ok || !inside || !near {
            self.arming_run = 0;
            self.refusal = Some(if !self.measured_ok {
                StopCause::MeasurementInvalid
            } else if inside {
                StopCause::NotAtMeasured
            } else {
                StopCause::OutsideLimits
            });
            return;
        }
        self.refusal = None;
        self.arming_run += 1;
        if self.arming_run >= SYNC_SETS {
            self.generator.rest_at(measured.iter().map(|j| j.position_rad));
            self.enable_was_low = false;
            self.tracking_since = None;
            self.withdrawn = false;
            self.state = ControllerState::Active;
        }
    }

    /// Hands a set over to the path generator. Its reference runs on the host's clock, of which
    /// the arrival times give a noisy view.
    fn follow(
        &mut self,
        before: Option<Acted>,
        sent_at: Duration,
        counter: u8,
        resynchronised: bool,
        positions_rad: [f64; MAX_JOINTS],
    ) {
        let cycles = before.map_or(1, |b| u32::from(counter.wrapping_sub(b.counter))).max(1);
        let step = self.cycle * cycles;
        let expected = self.reference_at + step;
        let ahead_s = sent_at.as_secs_f64() - expected.as_secs_f64();
        self.reference_at = if resynchronised || ahead_s.abs() > self.cycle.as_secs_f64() {
            sent_at
        } else {
            Duration::try_from_secs_f64(expected.as_secs_f64() + CLOCK_GAIN * ahead_s).unwrap_or(expected)
        };
        let from_rad = before.filter(|_| !resynchronised).and_then(|b| b.positions_rad).unwrap_or(positions_rad);
        let mut reference = [Setpoint::default(); MAX_JOINTS];
        for (i, place) in reference.iter_mut().enumerate() {
            *place = Setpoint {
                position_rad: positions_rad[i],
                velocity_rad_s: (positions_rad[i] - from_rad[i]) / step.as_secs_f64(),
            };
        }
        self.generator.follow(reference, self.reference_at);
        self.state = ControllerState::Active;
    }

    /// Stores one parameter; gives what is stored, or nothing if it must not be answered.
    fn configure(&mut self, config: Config) -> Option<Config> {
        if self.moving() || self.state == ControllerState::Arming {
            self.latch(StopCause::HostRestarted);
            return None;
        }
        let joints = self.joints();
        let value = match config.key {
            KEY_BEGIN => {
                let cycle_us = config.value.clamp(*CYCLES_US.start(), *CYCLES_US.end());
                self.cycle = Duration::from_micros(u64::from(cycle_us.unsigned_abs()));
                self.receiver.restart();
                self.acted = None;
                self.enable_was_low = false;
                self.reset_was_low = false;
                self.forget_limits();
                cycle_us
            }
            KEY_SEAL => {
                let own = limits::seal(&self.stored[..joints]);
                let all_written = self.written == (1 << (joints * usize::from(PARAMETERS))) - 1;
                if config.value == own
                    && all_written
                    && self.adopt_limits()
                    && self.state == ControllerState::Unconfigured
                {
                    self.state = ControllerState::Ready;
                }
                own
            }
            key => {
                let (joint, parameter) = limits::split_key(key).filter(|(joint, _)| *joint < joints)?;
                if self.state == ControllerState::Ready {
                    self.state = ControllerState::Unconfigured;
                }
                let own = self.params.limits[joint].to_wire()[parameter];
                let stored = if parameter == 0 { config.value.max(own) } else { config.value.min(own) };
                self.stored[joint][parameter] = stored;
                self.written |= 1 << (joint * usize::from(PARAMETERS) + parameter);
                stored
            }
        };
        Some(Config { key: config.key, value })
    }

    fn adopt_limits(&mut self) -> bool {
        let joints = self.joints();
        let mut adopted = [JointLimits::default(); MAX_JOINTS];
        for (place, wire) in adopted.iter_mut().zip(&self.stored[..joints]) {
            *place = JointLimits::from_wire(*wire);
        }
        let valid = limits::validate(&adopted[..joints]).is_ok();
        if valid {
            self.limits = adopted;
        }
        valid
    }

    fn forget_limits(&mut self) {
        self.written = 0;
        if self.state == ControllerState::Ready {
            self.state = ControllerState::Unconfigured;
        }
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
        self.stop_pending = true;
    }

    fn watch_silence(&mut self, now: Duration) {
        let gap = self.acted.map_or(Duration::MAX, |acted| now.saturating_sub(acted.at));
        if self.state == ControllerState::Arming && gap >= self.params.latch_after {
            self.state = ControllerState::Ready;
        }
        if !self.state.is_enabled() {
            return;
        }
        let cause = self.rejection.unwrap_or(StopCause::HostSilent);
        if gap >= self.params.latch_after {
            self.latch(cause);
        } else if gap > self.horizon.min(self.params.ramp_after) && !self.withdrawn {
            let joints = self.joints();
            self.generator.stop(&self.limits[..joints]);
            self.state =
                if gap >= self.params.ramp_after { ControllerState::Ramping } else { ControllerState::Coasting };
        }
    }

    fn tracking_error_rad(&self, measured: &[JointState]) -> f64 {
        measured
            .iter()
            .zip(self.generator.joints())
            .map(|(j, s)| (j.position_rad - s.position_rad).abs())
            .fold(0.0, f64::max)
    }

    fn watch_tracking(&mut self, now: Duration, measured: &[JointState]) {
        if !self.state.is_enabled() || self.tracking_error_rad(measured) <= self.params.tracking_limit_rad {
            self.tracking_since = None;
            return;
        }
        let since = *self.tracking_since.get_or_insert(now);
        if now.saturating_sub(since) >= self.params.tracking_time {
            // The commanded path is not where the arm is: stop from where it is.
            let limits = self.limits;
            self.generator.anchor(measured.iter().zip(&limits).map(|(j, l)| Setpoint {
                position_rad: j.position_rad,
                velocity_rad_s: j.velocity_rad_s.clamp(-l.velocity_rad_s, l.velocity_rad_s),
            }));
            self.latch(StopCause::TrackingError);
        }
    }

    fn send_stop(&mut self, now: Duration, tx: &mut FrameList) {
        let message = |inverted| Message::Stop { direction: Direction::ToHost, inverted, cause: self.cause, joint: 0 };
        if self.stop_pending {
            self.stop_pending = false;
            let counter = self.report_counter;
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

    fn report(&mut self, now: Duration, measured: &[JointState], tx: &mut FrameList) {
        self.report_counter = self.report_counter.wrapping_add(1);
        let counter = self.report_counter;
        let mut angles = [Angle::NO_VALUE; MAX_JOINTS];
        for (place, joint) in angles.iter_mut().zip(measured) {
            *place = Angle::from_rad(joint.position_rad).unwrap_or(Angle::NO_VALUE);
        }
        for (slot, pair) in angles.chunks_exact(2).enumerate() {
            let message = Message::Feedback { slot: slot as u8, angles: [pair[0], pair[1]] };
            tx.push(self.protocol.encode(&Counted { message, counter }));
        }
        let status = Status {
            state: self.state,
            powered: self.drive() == Drive::Servo,
            at_rest: self.generator.at_rest(),
            limiting: self.generator.limiting(),
            set_dropped: std::mem::take(&mut self.rejected_since_report),
            cause: self.cause.or(self.refusal).or_else(|| {
                (self.state == ControllerState::Ramping && !self.withdrawn)
                    .then(|| self.rejection.unwrap_or(StopCause::HostSilent))
            }),
            echo: self.acted.map_or(0, |acted| acted.counter),
            echo_age: self.acted.map_or(Duration::MAX, |acted| now.saturating_sub(acted.at)),
            tracking_error_rad: if self.measured_ok { self.tracking_error_rad(measured) } else { 0.255 },
        };
        tx.push(self.protocol.encode(&Counted { message: Message::Status(status), counter }));
    }
}

fn is_plausible(joint: &JointState) -> bool {
    Angle::from_rad(joint.position_rad).is_ok() && joint.velocity_rad_s.is_finite()
}
