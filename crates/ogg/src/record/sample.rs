//! What is recorded, in plain structs: the pipeline needs no message types of a viewer.

use std::sync::Arc;
use std::time::Duration;

use image::RgbImage;

/// One joint at one time. Absent quantities are left out of the message.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JointValue {
    /// Name as in the URDF.
    pub name: String,
    /// Radians (metres for a sliding joint).
    pub position: Option<f64>,
    /// Radians (metres) per second.
    pub velocity: Option<f64>,
    /// Radians (metres) per second squared.
    pub acceleration: Option<f64>,
    /// Newton metres (newtons).
    pub effort: Option<f64>,
}

/// Which stream of joint values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum JointStream {
    /// Measured by the controller: `/joint_states`.
    Measured,
    /// Sent to the controller, after all limits: `/setpoints`.
    Setpoint,
    /// Wanted by the follower, before the limits: `/targets`.
    Target,
}

/// Where a keypoint comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum KeypointState {
    /// Seen in this frame.
    Measured,
    /// Filled in by a model.
    Inferred,
    /// Not known; its coordinates mean nothing.
    Lost,
}

/// A keypoint in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct PixelPoint {
    /// Name, such as `right_wrist`.
    pub name: String,
    /// Column, pixels of the captured image; 0 is the centre of the leftmost pixel.
    pub x_px: f64,
    /// Row, pixels; 0 is the centre of the top pixel.
    pub y_px: f64,
    /// Where it comes from.
    pub state: KeypointState,
}

/// A person found in an image: points, and which of them are joined by a limb.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skeleton {
    /// Keypoints.
    pub points: Vec<PixelPoint>,
    /// Pairs of indices into `points`.
    pub limbs: Vec<(usize, usize)>,
    /// True for the worker that is followed.
    pub followed: bool,
}

/// A keypoint in space.
#[derive(Debug, Clone, PartialEq)]
pub struct SpacePoint {
    /// Name, such as `right_wrist`.
    pub name: String,
    /// Metres in the frame of the message.
    pub position_m: [f64; 3],
    /// Row-major covariance, square metres.
    pub covariance_m2: Option<[f64; 9]>,
    /// Where it comes from.
    pub state: KeypointState,
}

/// Pose of a frame in its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePose {
    /// Name of the frame in which the pose is given.
    pub parent: String,
    /// Name of the frame whose pose it is.
    pub child: String,
    /// Metres.
    pub translation_m: [f64; 3],
    /// Unit quaternion `x, y, z, w`.
    pub rotation_xyzw: [f64; 4],
}

/// Intrinsics of a camera for the captured image size.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraInfo {
    /// Pixels per row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Focal lengths, pixels.
    pub focal_px: [f64; 2],
    /// Principal point, pixels; integers are pixel centres.
    pub centre_px: [f64; 2],
    /// OpenCV order `k1, k2, p1, p2, k3[, k4, k5, k6]`; empty for none.
    pub distortion: Vec<f64>,
}

/// A number with a name and a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Metric {
    /// Name, such as `latency.pose`.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit, such as `ms`; empty for a count.
    pub unit: String,
}

/// Weight of a line of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Level {
    /// For developers.
    Debug,
    /// What happens.
    Info,
    /// What may matter.
    Warning,
    /// What went wrong.
    Error,
    /// What ended the run.
    Fatal,
}

/// One thing to record.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Sample {
    /// A picture of a camera; reduced and compressed by the recording thread.
    Image {
        /// Camera index.
        camera: usize,
        /// Pixels.
        image: Arc<RgbImage>,
    },
    /// Intrinsics of a camera.
    Calibration {
        /// Camera index.
        camera: usize,
        /// Intrinsics.
        info: CameraInfo,
    },
    /// People found in a picture.
    Annotations {
        /// Camera index.
        camera: usize,
        /// Size of the picture, so that the marks follow its reduction.
        size_px: (u32, u32),
        /// People.
        people: Vec<Skeleton>,
    },
    /// Keypoints in space.
    Keypoints {
        /// Frame of the coordinates.
        frame: String,
        /// Keypoints in a fixed order.
        points: Vec<SpacePoint>,
    },
    /// Poses of frames.
    Transforms(Vec<FramePose>),
    /// Joint values.
    Joints(JointStream, Vec<JointValue>),
    /// Numbers about the run.
    Metrics(Vec<Metric>),
    /// A line of the log.
    Log {
        /// Weight.
        level: Level,
        /// Part of the program.
        name: String,
        /// Text.
        message: String,
    },
}

/// A sample and its time since the start of the run.
#[derive(Debug, Clone)]
pub(super) struct Stamped {
    pub(super) at: Duration,
    pub(super) sample: Sample,
}
