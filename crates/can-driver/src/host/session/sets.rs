//! The sets that leave: which angles, with which flags.

use std::time::Duration;

use super::HostSession;
use crate::host::output::{Command, HostState};
use crate::protocol::{Commit, Counted, Message, Mode};
use crate::{ANGLE_LSB_RAD, Angle, FrameList, MAX_JOINTS, StopCause};

/// Half a period of the reset flag, so that an edge that comes too early is followed by another.
const RESET_HALF_PERIOD: u32 = 8;

impl HostSession {
    /// Decides the angles of this tick's set.
    pub(super) fn command(&mut self, command: Command<'_>, cycles: u32) {
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

    pub(super) fn send_set(&mut self, now: Duration, cycles: u32, tx: &mut FrameList) {
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
}
