//! A rapier robot arm behind the joint protocol, and a synthetic worker with a camera.

mod error;
mod scene;
mod smooth;
mod worker;

pub use error::Error;
pub use scene::{GroundTruth, Scene, SceneVariation, Visibility, default_camera};
pub use worker::{Action, BodyShape, HandPose, KEYPOINT_COUNT, Keypoint, Script, Worker, WorkerParams, WorkerPose};
