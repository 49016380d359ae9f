//! A STOP is sent twice, the second time inverted, so that one damaged or lost frame costs nothing.

use std::time::Duration;

use crate::protocol::{Counted, Direction, Message};
use crate::{Frame, Protocol, StopCause};

/// Distance in time between the two copies.
const COPY_AFTER: Duration = Duration::from_millis(1);

/// The two copies of a STOP on their way out.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StopPair {
    asked: bool,
    copy: Option<(Duration, Frame)>,
}

impl StopPair {
    /// The next tick sends a STOP.
    pub(crate) fn ask(&mut self) {
        self.asked = true;
    }

    /// The copy that is due, if any.
    pub(crate) fn due(
        &mut self,
        now: Duration,
        protocol: Protocol,
        counter: u8,
        direction: Direction,
        cause: Option<StopCause>,
    ) -> Option<Frame> {
        if std::mem::take(&mut self.asked) {
            let frame = |inverted| {
                protocol.encode(&Counted { message: Message::Stop { direction, inverted, cause, joint: 0 }, counter })
            };
            self.copy = Some((now + COPY_AFTER, frame(true)));
            return Some(frame(false));
        }
        self.copy.take_if(|(due, _)| now >= *due).map(|(_, frame)| frame)
    }
}
