//! What the controller notices by itself: a silent host, an arm that is not where it should be.

use std::time::Duration;

use super::Controller;
use crate::controller::motion::Setpoint;
use crate::controller::output::JointState;
use crate::{ControllerState, StopCause};

impl Controller {
    pub(super) fn watch_silence(&mut self, now: Duration) {
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

    pub(super) fn tracking_error_rad(&self, measured: &[JointState]) -> f64 {
        measured
            .iter()
            .zip(self.generator.joints())
            .map(|(j, s)| (j.position_rad - s.position_rad).abs())
            .fold(0.0, f64::max)
    }

    pub(super) fn watch_tracking(&mut self, now: Duration, measured: &[JointState]) {
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
}
