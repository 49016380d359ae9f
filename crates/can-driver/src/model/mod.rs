//! A classic CAN bus in virtual time: arbitration, bit times, error counters, and faults drawn
//! from a seed.
//!
//! What it models: the lowest identifier among the nodes' oldest frames wins when the bus falls
//! idle; a frame lasts its bits with or without its actual stuff bits; an error on the wire
//! destroys the frame, costs an error frame, moves the error counters (+8 for the sender, +1 for
//! receivers, -1 for each success) and is followed by a retransmission; a node is error-passive
//! at 128 and bus-off at 256; without any other node nobody acknowledges, and the sender stops at
//! error-passive. What it does not: bit-level arbitration inside a frame, the pause of
//! error-passive senders, and clock tolerance.

mod bits;
mod bus;
mod params;
mod wire;

pub use bits::{Stuffing, frame_bits};
pub use bus::{SimBus, SimNode};
pub use params::{Faults, SimBusParams};
pub use wire::BusLoad;
