//! What goes into a tick and what comes out.

use std::time::Duration;

use super::motion::Setpoint;
use crate::{ControllerState, FrameList, PerJoint, StopCause};

/// Measured position and velocity of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointState {
    /// Position.
    pub position_rad: f64,
    /// Velocity.
    pub velocity_rad_s: f64,
}

/// What the drives do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Brakes are on, drives are off.
    #[default]
    Braked,
    /// The drives follow the setpoints.
    Servo,
}

/// What became of the sets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SetCounts {
    /// Accepted.
    pub accepted: u64,
    /// Missing between accepted ones.
    pub lost: u64,
    /// Repeated.
    pub repeated: u64,
    /// Out of sequence, or before the sequence was established.
    pub out_of_sequence: u64,
    /// Older than allowed.
    pub stale: u64,
    /// COMMIT without its three SET frames.
    pub incomplete: u64,
    /// With an angle further away than the velocity limit allows.
    pub step_too_large: u64,
    /// Without an angle for a joint that exists.
    pub missing_value: u64,
    /// Damaged frames (not sets).
    pub corrupt_frames: u64,
}

/// What one tick of the controller gives.
#[derive(Clone, Debug, PartialEq)]
pub struct ControllerOutput {
    /// Frames to send, in this order.
    pub tx: FrameList,
    /// What the drives do.
    pub drive: Drive,
    /// Setpoint of each joint; with brakes on, where the joint stands.
    pub setpoints: PerJoint<Setpoint>,
    /// State after the tick.
    pub state: ControllerState,
    /// Why the arm is stopped or is not enabled.
    pub cause: Option<StopCause>,
    /// The newest set that began to act in this tick.
    pub acted: Option<ActedSet>,
}

/// A set whose setpoints act.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActedSet {
    /// Its counter.
    pub counter: u8,
    /// Its age on arrival, beyond the shortest transport time.
    pub age: Duration,
}
