//! What the controller says: angles and its status.

use std::time::Duration;

use super::Controller;
use crate::controller::output::{Drive, JointState};
use crate::protocol::{Counted, Message, Status};
use crate::{Angle, ControllerState, FrameList, MAX_JOINTS, StopCause};

impl Controller {
    pub(super) fn report(&mut self, now: Duration, measured: &[JointState], tx: &mut FrameList) {
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
