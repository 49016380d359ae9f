//! Bit rate, stuffing and faults of a bus.

use std::time::Duration;

use super::bits::Stuffing;

/// How often things go wrong, as probabilities from 0 to 1, drawn per frame and receiver (errors
/// on the wire: per frame).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// The receiver misses the frame.
    pub loss: f64,
    /// The receiver gets the frame twice.
    pub duplicate: f64,
    /// The receiver gets other bytes, unnoticed by the bus.
    pub corrupt: f64,
    /// The receiver gets the frame late,
    pub delay: f64,
    /// by up to this time.
    pub delay_max: Duration,
    /// The frame is destroyed on the wire and sent again.
    pub wire_error: f64,
}

/// Settings of a [`SimBus`](super::SimBus).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimBusParams {
    /// Bits per second, 10,000 to 1,000,000.
    pub bit_rate: u32,
    /// Which stuff bits to count.
    pub stuffing: Stuffing,
    /// What goes wrong.
    pub faults: Faults,
    /// Seed of the faults: the same seed and calls give the same bus.
    pub seed: u64,
}

impl Default for SimBusParams {
    /// A faultless bus at 1 Mbit/s.
    fn default() -> Self {
        Self { bit_rate: 1_000_000, stuffing: Stuffing::Exact, faults: Faults::default(), seed: 0 }
    }
}
