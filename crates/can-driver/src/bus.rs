//! What every bus offers, and what it reports beside frames.

use std::time::Duration;

use crate::{Error, Frame, Stamped};

/// What became of a frame that was to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum SendOutcome {
    /// The bus has taken it.
    Sent,
    /// The transmit queue is full. The cycle counts as missed; nobody sends the frame again,
    /// because an old setpoint is worse than none.
    Full,
}

/// A condition of the bus that is not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BusFault {
    /// The error counters have passed the warning level (96).
    Warning,
    /// The node is error-passive (a counter has passed 127).
    Passive,
    /// The node is bus-off: it neither sends nor receives until it is restarted.
    Off,
    /// The node has left bus-off.
    Restarted,
    /// Nobody acknowledges: the other side is off or the cable is open.
    NoAcknowledge,
    /// A frame could not be sent within the driver's time.
    TransmitTimeout,
    /// A frame was damaged on the wire (bit, form, stuff or CRC error).
    Protocol,
    /// Another sender won the bus.
    ArbitrationLost,
    /// The receiver was too slow and frames are lost.
    Overflow,
    /// The transceiver reports a fault of the wiring.
    Transceiver,
}

impl BusFault {
    /// Whether frames may be missing or stuck because of it, so that motion has to end.
    pub const fn ends_motion(self) -> bool {
        matches!(self, Self::Passive | Self::Off | Self::Restarted | Self::TransmitTimeout | Self::Transceiver)
    }
}

/// What a bus delivers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A frame.
    Frame(Stamped),
    /// A condition of the bus.
    Fault(BusFault),
}

impl Event {
    /// A frame that was on the bus at `at`.
    pub const fn frame(at: Duration, frame: Frame) -> Self {
        Self::Frame(Stamped { at, frame })
    }
}

/// A CAN bus. No call waits.
///
/// Time is an argument: `now` is the caller's clock, and the stamps of received frames are on the
/// same clock.
pub trait Bus {
    /// Hands a frame over for sending.
    ///
    /// # Errors
    /// The bus is down or gone. A full queue is [`SendOutcome::Full`] and not an error.
    fn send(&mut self, now: Duration, frame: &Frame) -> Result<SendOutcome, Error>;

    /// The next frame or condition; `None` when there is none at this moment.
    ///
    /// # Errors
    /// The bus is down or gone.
    fn receive(&mut self, now: Duration) -> Result<Option<Event>, Error>;

    /// Takes everything that has arrived, at most until `events` has reached its capacity, so that a
    /// flooded bus cannot hold up a cycle and the buffer never grows. `events` is cleared first.
    ///
    /// # Errors
    /// Those of [`Bus::receive`].
    fn drain(&mut self, now: Duration, events: &mut Vec<Event>) -> Result<(), Error> {
        events.clear();
        while events.len() < events.capacity() {
            match self.receive(now)? {
                Some(event) => events.push(event),
                None => break,
            }
        }
        Ok(())
    }

    /// Sends the frames of one tick in order and stops at the first that the bus does not take.
    ///
    /// # Errors
    /// Those of [`Bus::send`].
    fn transmit(&mut self, now: Duration, frames: &[Frame]) -> Result<SendOutcome, Error> {
        for frame in frames {
            if self.send(now, frame)? == SendOutcome::Full {
                return Ok(SendOutcome::Full);
            }
        }
        Ok(SendOutcome::Sent)
    }
}

impl<B: Bus + ?Sized> Bus for &mut B {
    fn send(&mut self, now: Duration, frame: &Frame) -> Result<SendOutcome, Error> {
        (**self).send(now, frame)
    }

    fn receive(&mut self, now: Duration) -> Result<Option<Event>, Error> {
        (**self).receive(now)
    }

    fn drain(&mut self, now: Duration, events: &mut Vec<Event>) -> Result<(), Error> {
        (**self).drain(now, events)
    }

    fn transmit(&mut self, now: Duration, frames: &[Frame]) -> Result<SendOutcome, Error> {
        (**self).transmit(now, frames)
    }
}

impl<B: Bus + ?Sized> Bus for Box<B> {
    fn send(&mut self, now: Duration, frame: &Frame) -> Result<SendOutcome, Error> {
        (**self).send(now, frame)
    }

    fn receive(&mut self, now: Duration) -> Result<Option<Event>, Error> {
        (**self).receive(now)
    }

    fn drain(&mut self, now: Duration, events: &mut Vec<Event>) -> Result<(), Error> {
        (**self).drain(now, events)
    }

    fn transmit(&mut self, now: Duration, frames: &[Frame]) -> Result<SendOutcome, Error> {
        (**self).transmit(now, frames)
    }
}
