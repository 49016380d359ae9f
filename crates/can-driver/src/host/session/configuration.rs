//! Limits written to the controller and read back.

use std::time::Duration;

use super::{HostSession, Pending};
use crate::host::output::HostState;
use crate::limits::{self, KEY_BEGIN, KEY_SEAL, PARAMETERS};
use crate::protocol::{Config, Counted, Message};
use crate::{FrameList, StopCause};

/// An unanswered CONFIG is sent again after this time.
const CONFIG_RETRY: Duration = Duration::from_millis(20);

impl HostSession {
    /// Number of the step that seals: begin, the limits, seal.
    pub(super) fn last_step(&self) -> usize {
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

    pub(super) fn send_config(&mut self, now: Duration, tx: &mut FrameList) {
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
    pub(super) fn take_reply(&mut self, stored: Config) {
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
