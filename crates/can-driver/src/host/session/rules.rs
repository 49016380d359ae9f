//! What ends motion or the link, and what leads to the next state.

use std::time::Duration;

use super::HostSession;
use crate::host::output::{Command, HostState};
use crate::{ControllerState, StopCause};

/// Sets without an echo that are allowed.
const UNECHOED_SETS: u32 = 3;
/// Sets without an echo after which the controller has dropped the session.
const DEAF_SETS: u32 = 40;
/// Round trips in a row that may exceed the limit.
const SLOW_TRIPS: u8 = 5;

impl HostSession {
    /// Rules that end motion, or the link.
    pub(super) fn watch(&mut self, now: Duration) {
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
    pub(super) fn advance(&mut self, now: Duration, command: Command<'_>) {
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
}
