//! The live threads: control and plant on absolute deadlines, vision as fast as pictures come; and what they share.

mod control;
mod shared;
mod vision;

use std::time::Duration;

pub use control::{ControlReport, control, plant};
pub use shared::{Shared, Stopping};
pub use vision::{VisionReport, vision};

/// Measured joints on their way from control to vision: time, joints, whether the arm was following.
pub type Measured = (Duration, Vec<f64>, bool);
