//! Limits from the host: stored, tightened, sealed and forgotten.

use std::time::Duration;

use super::Controller;
use crate::limits::{self, JointLimits, KEY_BEGIN, KEY_SEAL, PARAMETERS};
use crate::protocol::Config;
use crate::{ControllerState, MAX_JOINTS, StopCause};

/// Cycles that a host may have.
const CYCLES_US: std::ops::RangeInclusive<i32> = 1_000..=20_000;

impl Controller {
    /// Stores one parameter; gives what is stored, or nothing if it must not be answered.
    pub(super) fn configure(&mut self, config: Config) -> Option<Config> {
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

    pub(super) fn forget_limits(&mut self) {
        self.written = 0;
        if self.state == ControllerState::Ready {
            self.state = ControllerState::Unconfigured;
        }
    }
}
