//! From a worker's arm to the joints of a robot.

mod angles;
mod follow;
mod wrist;

pub use angles::{AngleRetarget, ArmAngles, ArmPoints, JointMap, Retargeted, Unwrap, wrap_rad};
pub use follow::{FollowOptions, FollowStatus, FollowStep, SingularityLadder};
pub use wrist::{ReachStatus, ToolOrientation, WristRetarget, WristTarget};
