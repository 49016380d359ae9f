//! The joint protocol: what the frames mean.
//!
//! `docs/can.md` has the message map; `protocol/ogg-joint.dbc` is its source, from which the build
//! script makes the tables used here.

mod angle;
mod cause;
mod codec;
mod crc;
mod message;
mod tables;

pub use angle::{ANGLE_LSB_RAD, Angle};
pub use cause::StopCause;
pub use codec::{Corrupt, Protocol};
pub use crc::crc16;
pub(crate) use crc::crc32;
pub use message::{Commit, Config, ControllerState, Counted, Direction, Message, Mode, Status};

/// The DBC file of the protocol.
pub const DBC: &str = include_str!("../../protocol/ogg-joint.dbc");
/// Joints that the protocol can carry.
pub const MAX_JOINTS: usize = 6;
/// Version of the protocol; a part of every frame's data id.
pub const VERSION: u8 = 1;
