#![doc = include_str!("../README.md")]

mod bus;
mod candump;
mod controller;
mod dbc;
mod error;
mod frame;
mod host;
mod limits;
mod local;
mod model;
mod protocol;
mod receiver;
#[cfg(target_os = "linux")]
mod socket;
mod stop;

pub use bus::{Bus, BusFault, Event, SendOutcome};
pub use candump::{CandumpLine, write_candump};
pub use controller::{
    ActedSet, Controller, ControllerOutput, ControllerParams, Drive, JointState, SetCounts, Setpoint,
};
pub use dbc::{Dbc, DbcError, DbcMessage, DbcSignal};
pub use error::Error;
pub use frame::{FixedList, Frame, FrameList, Id, PerJoint, Stamped};
pub use host::{Command, Feedback, HostOutput, HostParams, HostSession, HostState, LinkReport};
pub use limits::JointLimits;
pub use local::{LocalBus, LocalEndpoint};
pub use model::{BusLoad, Faults, SimBus, SimBusParams, SimNode, Stuffing, frame_bits};
pub use protocol::{
    ANGLE_LSB_RAD, Angle, Commit, Config, ControllerState, Corrupt, Counted, DBC, Direction, MAX_JOINTS, Message, Mode,
    Protocol, Status, StopCause, VERSION, crc16,
};
#[cfg(target_os = "linux")]
pub use socket::{FdFrame, Filter, SocketCan, SocketCounts, SocketEvent};
