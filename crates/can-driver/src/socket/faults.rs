//! What the kernel's error frames say.

use socketcan::{CanError, ErrorCause};

use crate::BusFault;

/// Faults decoded from one error frame at most.
pub(super) const PENDING_FAULTS: usize = 8;

/// The conditions that one error frame names.
pub(super) fn faults_of(error: &CanError) -> [Option<BusFault>; PENDING_FAULTS] {
    let mut out = [None; PENDING_FAULTS];
    let mut free = out.iter_mut();
    for cause in error {
        let fault = match cause {
            ErrorCause::TransmitTimeout => BusFault::TransmitTimeout,
            ErrorCause::LostArbitration(_) => BusFault::ArbitrationLost,
            ErrorCause::Controller(problems) => {
                use socketcan::errors::ControllerProblems as P;
                if problems.intersects(P::RX_PASSIVE | P::TX_PASSIVE) {
                    BusFault::Passive
                } else if problems.intersects(P::RX_OVERFLOW | P::TX_OVERFLOW) {
                    BusFault::Overflow
                } else if problems.intersects(P::RX_WARNING | P::TX_WARNING) {
                    BusFault::Warning
                } else {
                    continue; // back to error-active
                }
            }
            ErrorCause::Transceiver { .. } => BusFault::Transceiver,
            ErrorCause::NoAck => BusFault::NoAcknowledge,
            ErrorCause::BusOff => BusFault::Off,
            ErrorCause::Restarted => BusFault::Restarted,
            ErrorCause::Counters { .. } => continue,
            _ => BusFault::Protocol,
        };
        if let Some(place) = free.next() {
            *place = Some(fault);
        }
    }
    out
}
