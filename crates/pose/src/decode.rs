//! From the numbers of a network to people in tensor coordinates.

mod arms;
mod assemble;
mod landmarks;
mod openpose;
mod peaks;
mod proportion;

pub use openpose::{Field, MapView, OpenPoseDecoder};

pub(crate) use landmarks::{blazepose, movenet, movenet_multi};
pub use peaks::Peak;
