#![doc = include_str!("../README.md")]

mod calibration;
mod card;
mod decode;
mod error;
mod estimator;
mod eval;
mod filter;
mod gate;
mod image;
mod network;
mod person;
pub mod preprocess;
mod runtime;
mod skeleton;
mod targets;
mod worker;

pub use calibration::{Calibration, ReliabilityBin, reliability};
pub use card::{
    About, BUILTIN_CARDS, BlazePoseSpec, ColourOrder, ElementType, InputSpec, Layout, Limb, MapSpec, Model, ModelCard,
    MoveNetSpec, OpenPoseSpec, OutputKind, Region, Weights,
};
pub use decode::{Field, MapView, OpenPoseDecoder, Peak};
pub use error::{Error, Result};
pub use estimator::{Estimator, RegionOptions, Stage};
pub use eval::{COCO_17_SIGMAS, DetectedPose, LabelledPose, OksParams, OksSummary, PckCounts, Subset, pck};
pub use filter::{Hampel, Kalman, OneEuro, OneEuroParams};
pub use gate::{ArmGate, ArmJoint, ArmKeypoints, GateOptions, JointEstimate, Refusal};
pub use image::ImageView;
pub use person::{Bounds, Keypoint, Person};
pub use preprocess::{CropMap, Preprocessor, TensorData};
pub use runtime::{
    Attempt, Backend, ExecutionProvider, LibraryCandidate, LibraryChoice, LibraryOrigin, LibrarySearch,
    ONNXRUNTIME_LIBRARY, Runtime, RuntimeInfo, RuntimeOptions, onnxruntime_candidates, python_site_packages,
};
pub use skeleton::{Part, Side, Skeleton, Source};
pub use targets::{JointState, Labels, Maps, TargetParams, TargetPlan};
pub use worker::{WorkerChoice, WorkerOptions, WorkerTracker, WorkerUpdate};
