//! What host and controller say to each other.

use std::time::Duration;

use super::{Angle, StopCause};

/// What COMMIT asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Nothing acts; the set only keeps the link alive.
    #[default]
    Idle,
    /// The set's angles are position setpoints.
    Position,
}

/// State of the controller, as STATUS tells it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ControllerState {
    /// Limits are not yet sealed.
    #[default]
    Unconfigured,
    /// Limits are sealed; brakes are on.
    Ready,
    /// Enable is asked for; good sets are being counted.
    Arming,
    /// Setpoints are followed.
    Active,
    /// Sets are missing: the last motion goes on within the horizon, then slows down.
    Coasting,
    /// Sets are missing for the ramp time, or the host withdrew enable: the arm is being stopped
    /// along its path.
    Ramping,
    /// Stopped until an operator resets.
    Latched,
}

impl ControllerState {
    /// All states; the position is the code on the wire.
    pub const ALL: [Self; 7] =
        [Self::Unconfigured, Self::Ready, Self::Arming, Self::Active, Self::Coasting, Self::Ramping, Self::Latched];

    /// The code on the wire.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Whether the drives follow a path of the controller.
    pub const fn is_enabled(self) -> bool {
        matches!(self, Self::Active | Self::Coasting | Self::Ramping)
    }
}

/// Contents of COMMIT.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Commit {
    /// What the set is for.
    pub mode: Mode,
    /// The host wants motion. Rises only by the operator's wish.
    pub enable: bool,
    /// Stop and latch.
    pub quick_stop: bool,
    /// A rising edge ends a latched stop.
    pub reset: bool,
    /// The set measures the link and never acts.
    pub test: bool,
    /// Share of the velocity limits that may be used, 0 to 1 in steps of 0.005.
    pub speed_scale: f64,
    /// How long the controller may go on at constant velocity, whole milliseconds to 255.
    pub horizon: Duration,
    /// Clock of the host in 100 us, modulo 2^16.
    pub host_time: u16,
}

/// Contents of STATUS.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// State of the controller.
    pub state: ControllerState,
    /// The drives are powered and the brakes open.
    pub powered: bool,
    /// Nothing moves.
    pub at_rest: bool,
    /// The controller's own limits shape the motion at present.
    pub limiting: bool,
    /// A set was refused since the last STATUS.
    pub set_dropped: bool,
    /// Why the controller is stopped, or refuses to start.
    pub cause: Option<StopCause>,
    /// Counter of the last accepted set.
    pub echo: u8,
    /// Time since that set arrived, whole milliseconds to 255.
    pub echo_age: Duration,
    /// Largest distance of setpoint and measured angle, whole milliradians to 0.255 rad.
    pub tracking_error_rad: f64,
}

/// A parameter to write, or one as stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// What is written (see the message map).
    pub key: u8,
    /// Its value in the key's unit.
    pub value: i32,
}

/// Who sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the host.
    ToController,
    /// From the controller.
    ToHost,
}

/// A message with the counter it travels under.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Counted {
    /// The message.
    pub message: Message,
    /// Sequence counter; that of a heartbeat is 0.
    pub counter: u8,
}

/// A message of the protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Stop and latch. Sent twice, the second time with all bits inverted.
    Stop {
        /// Who sends it.
        direction: Direction,
        /// Whether this is the inverted copy.
        inverted: bool,
        /// Why.
        cause: Option<StopCause>,
        /// The joint concerned, from 1; 0 if it is not about one joint.
        joint: u8,
    },
    /// Two setpoints of a set.
    Set {
        /// Pair of joints, 0 to 2.
        slot: u8,
        /// Setpoints.
        angles: [Angle; 2],
    },
    /// End of a set of setpoints.
    Commit(Commit),
    /// Two measured angles.
    Feedback {
        /// Pair of joints, 0 to 2.
        slot: u8,
        /// Measured angles.
        angles: [Angle; 2],
    },
    /// End of a set of measured angles.
    Status(Status),
    /// The host writes a parameter.
    Config(Config),
    /// The controller says what it stores.
    ConfigReply(Config),
    /// Sign of life; the state as in CANopen.
    Heartbeat {
        /// 0 boot-up, 4 stopped, 5 operational, 127 pre-operational.
        node_state: u8,
    },
}
