//! What the application asks for and what it gets.

use std::time::Duration;

use crate::protocol::Status;
use crate::{FrameList, PerJoint, StopCause};

/// What the application wants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command<'a> {
    /// The arm is to stand still with its brakes on.
    Standby,
    /// The arm is to follow. Until the session is Active the positions are ignored and the
    /// measured ones are sent; the first ones used have to begin at
    /// [`HostOutput::commanded_rad`].
    Follow {
        /// Setpoint of each joint.
        position_rad: &'a [f64],
        /// Share of the velocity limits that may be used, 0 to 1.
        speed_scale: f64,
    },
    /// Stop now and stay stopped.
    Stop(StopCause),
}

/// State of the session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum HostState {
    /// No controller is heard.
    #[default]
    Searching,
    /// Limits are being written and read back.
    Configuring,
    /// The controller stands ready.
    Ready,
    /// The controller is asked to follow.
    Enabling,
    /// The controller follows.
    Active,
    /// The controller is asked to brake.
    Disabling,
    /// Stopped; only an operator ends this.
    Stopped,
    /// The operator has asked for the end of the stop.
    Resetting,
}

/// What the controller last said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feedback {
    /// Measured position of each joint; `None` where the controller has none.
    pub position_rad: PerJoint<Option<f64>>,
    /// When these positions arrived.
    pub at: Duration,
    /// STATUS that came with them.
    pub status: Status,
}

/// What one tick of the session gives.
#[derive(Clone, Debug, PartialEq)]
pub struct HostOutput {
    /// Frames to send, in this order.
    pub tx: FrameList,
    /// State after the tick.
    pub state: HostState,
    /// Why the session is stopped.
    pub cause: Option<StopCause>,
    /// The newest measured joints, if the controller was heard.
    pub feedback: Option<Feedback>,
    /// The setpoints in this tick's set, as the wire carries them; empty while nothing is
    /// measured.
    pub commanded_rad: PerJoint<f64>,
}
