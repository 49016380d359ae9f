//! The recording of a run: one MCAP file that Foxglove and Rerun open, and a reader for our own use.
//!
//! The loops put plain [`Sample`]s into a [`RecordSink`], which never waits; a thread of its own encodes, writes and flushes. Pictures are given up first
//! when disk or processor cannot keep up, and everything given up is counted. A chunk ends every 200 ms, so that a killed
//! process loses no more than that. Topics and schemas: `docs/recording.md`.

mod encode;
mod error;
mod queue;
mod reader;
mod recorder;
mod sample;
mod schema;
mod writer;

pub use encode::{camera_frame, camera_topic};
pub use error::Error;
pub use reader::{JointRecord, KeypointRecord, Recording, Topic, open};
pub use recorder::{RecordSink, Recorder, RecorderOptions, RecorderStatus, RunInfo};
pub use sample::{
    CameraInfo, FramePose, JointStream, JointValue, KeypointState, Level, Metric, PixelPoint, Sample, Skeleton,
    SpacePoint,
};
pub use writer::Compression;
