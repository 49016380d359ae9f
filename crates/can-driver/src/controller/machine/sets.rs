//! Sets of setpoints: which count, what their flags ask for, and how the third good one arms.

use std::time::Duration;

use super::{Acted, Controller};
use crate::controller::motion::Setpoint;
use crate::controller::output::JointState;
use crate::protocol::{Commit, Counted, Direction, Message, Mode};
use crate::receiver::{Judgement, SYNC_SETS};
use crate::{ANGLE_LSB_RAD, ControllerState, FrameList, MAX_JOINTS, StopCause};

/// Configuration frames answered in one tick; the host sends one per cycle.
const REPLIES_PER_TICK: usize = 4;
/// Share of the arrival jitter that moves the reference's clock.
const CLOCK_GAIN: f64 = 0.1;

impl Controller {
    /// Takes one message; gives the age of a set that acts.
    pub(super) fn receive(
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
}
