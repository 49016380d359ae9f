#![doc = include_str!("../README.md")]

mod arm;
mod error;
mod node;
mod scene;
mod smooth;
mod worker;

pub use arm::{Arm, ArmParams};
pub use error::Error;
pub use node::ControllerNode;
pub use scene::{GroundTruth, Scene, SceneVariation, Visibility, default_camera};
pub use worker::{Action, BodyShape, HandPose, KEYPOINT_COUNT, Keypoint, Script, Worker, WorkerParams, WorkerPose};
