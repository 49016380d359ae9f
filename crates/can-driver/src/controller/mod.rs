//! The controller's end of the protocol: what a DSP28335 on the robot would run.
//!
//! A pure state machine: frames, time and measured joints go in; frames and drive setpoints come
//! out. It trusts nobody: a host that falls silent, sends old sets, jumps, or asks for more than
//! the limits gets a controlled stop.
//!
//! | time without an accepted set | what happens | state |
//! |---|---|---|
//! | up to the horizon (host's choice, usually 10 ms) | goes on at constant velocity | Active |
//! | horizon to 25 ms | slows down along the path; good sets bring it back | Coasting |
//! | 25 ms to 100 ms | the same, and the cause is recorded | Ramping |
//! | 100 ms, or a second fault | latched: rest, brake, operator reset | Latched |

mod machine;
mod motion;
mod output;
mod params;

pub use machine::Controller;
pub use motion::Setpoint;
pub use output::{ActedSet, ControllerOutput, Drive, JointState, SetCounts};
pub use params::ControllerParams;
