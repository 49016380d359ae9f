#![doc = include_str!("../README.md")]

mod card;
mod decode;
mod error;
mod estimator;
mod image;
mod network;
mod person;
pub mod preprocess;
mod runtime;
mod skeleton;

pub use card::{
    About, BUILTIN_CARDS, BlazePoseSpec, ColourOrder, ElementType, InputSpec, Layout, Limb, MapSpec, Model, ModelCard,
    MoveNetSpec, OpenPoseSpec, OutputKind, Region, Weights,
};
pub use decode::{Field, MapView, OpenPoseDecoder, Peak};
pub use error::{Error, Result};
pub use estimator::{Estimator, RegionOptions};
pub use image::ImageView;
pub use person::{Bounds, Keypoint, Person};
pub use preprocess::{CropMap, Preprocessor, TensorData};
pub use runtime::{
    Attempt, Backend, ExecutionProvider, LibraryCandidate, LibraryChoice, LibraryOrigin, LibrarySearch,
    ONNXRUNTIME_LIBRARY, Runtime, RuntimeInfo, RuntimeOptions, onnxruntime_candidates, python_site_packages,
};
pub use skeleton::{Part, Side, Skeleton, Source};
