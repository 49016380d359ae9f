//! From samples to messages: topic, schema and bytes.
//!
//! Pictures are reduced by a whole factor so that their longer side stays within a limit; calibration and marks are reduced with
//! them. With integer pixel centres, `x' = (x + 1/2) / n - 1/2`.

mod marks;
mod picture;

use std::time::Duration;

use foxglove::Encode;
use foxglove::messages::{
    CameraCalibration, CompressedImage, FrameTransform, FrameTransforms, ImageAnnotations, JointState, JointStates,
    Log, Pose, PosesInFrame, Quaternion, Timestamp, Vector3, log,
};
use jpeg_encoder::EncodingError;
use prost::Message;

use super::sample::{CameraInfo, JointStream, JointValue, KeypointState, Level, Sample};
use super::schema::{KeypointMessage, KeypointsMessage, MetricMessage, MetricsMessage};
use super::schema::{keypoints_schema, metrics_schema};
use marks::{marks, shifted};
use picture::{jpeg, reduced};

/// Schema of a channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Schema {
    pub(super) name: String,
    pub(super) encoding: String,
    pub(super) data: Vec<u8>,
}

/// A message ready to be written.
#[derive(Debug, Clone)]
pub(super) struct Encoded {
    pub(super) topic: String,
    pub(super) schema: fn() -> Schema,
    pub(super) bytes: Vec<u8>,
}

/// How samples are turned into messages.
#[derive(Debug, Clone)]
pub(super) struct Encoder {
    pub(super) cameras: usize,
    pub(super) max_image_side_px: u32,
    pub(super) jpeg_quality: u8,
    pub(super) start_unix_ns: u64,
}

/// Topic of a camera's pictures: `/camera`, or `/camera_1`, `/camera_2` … in a rig of several.
pub fn camera_topic(camera: usize, cameras: usize) -> String {
    if cameras <= 1 { "/camera".to_owned() } else { format!("/camera_{}", camera + 1) }
}

/// Optical frame of a camera (x right, y down, z forward): `camera_color_optical_frame`, or
/// `camera_1_color_optical_frame` … in a rig of several.
pub fn camera_frame(camera: usize, cameras: usize) -> String {
    format!("{}_color_optical_frame", &camera_topic(camera, cameras)[1..])
}

/// Topic of a stream of joint values.
pub(super) fn joint_topic(stream: JointStream) -> &'static str {
    match stream {
        JointStream::Measured => "/joint_states",
        JointStream::Setpoint => "/setpoints",
        JointStream::Target => "/targets",
    }
}

pub(super) const KEYPOINTS_TOPIC: &str = "/human/keypoints";

fn foxglove_schema<T: Encode>() -> Schema {
    let Some(schema) = T::get_schema() else { unreachable!("Foxglove's own messages have schemas") };
    Schema { name: schema.name, encoding: schema.encoding, data: schema.data.into_owned() }
}

fn encoded<T: Encode + Message>(topic: impl Into<String>, message: &T) -> Encoded {
    Encoded { topic: topic.into(), schema: foxglove_schema::<T>, bytes: message.encode_to_vec() }
}

impl Encoder {
    pub(super) fn log_time_ns(&self, at: Duration) -> u64 {
        self.start_unix_ns.saturating_add(u64::try_from(at.as_nanos()).unwrap_or(u64::MAX))
    }

    fn timestamp(&self, at: Duration) -> Timestamp {
        let nanos = self.log_time_ns(at);
        let seconds = u32::try_from(nanos / 1_000_000_000).unwrap_or(u32::MAX);
        Timestamp::new_checked(seconds, (nanos % 1_000_000_000) as u32).unwrap_or(Timestamp::MAX)
    }

    /// The whole factor by which pictures of this size are reduced.
    fn divisor(&self, width: u32, height: u32) -> u32 {
        width.max(height).div_ceil(self.max_image_side_px.clamp(1, u32::from(u16::MAX))).max(1)
    }

    /// Turns a sample into its messages.
    pub(super) fn encode(&self, at: Duration, sample: &Sample) -> Result<Vec<Encoded>, EncodingError> {
        let timestamp = Some(self.timestamp(at));
        Ok(match sample {
            Sample::Image { camera, image } => {
                let divisor = self.divisor(image.width(), image.height());
                let data = if divisor == 1 {
                    jpeg(image, self.jpeg_quality)?
                } else {
                    jpeg(&reduced(image, divisor), self.jpeg_quality)?
                };
                let message = CompressedImage {
                    timestamp,
                    frame_id: camera_frame(*camera, self.cameras),
                    data: data.into(),
                    format: "jpeg".to_owned(),
                };
                vec![encoded(camera_topic(*camera, self.cameras), &message)]
            }
            Sample::Calibration { camera, info } => {
                let mut message = self.calibration(info);
                message.timestamp = timestamp;
                message.frame_id = camera_frame(*camera, self.cameras);
                vec![encoded(format!("{}/calibration", camera_topic(*camera, self.cameras)), &message)]
            }
            Sample::Annotations { camera, size_px: (width, height), people } => {
                let divisor = self.divisor(*width, *height);
                let points = people.iter().flat_map(|person| marks(person, timestamp, divisor)).collect();
                let message = ImageAnnotations { timestamp, points, ..ImageAnnotations::default() };
                vec![encoded(format!("{}/annotations", camera_topic(*camera, self.cameras)), &message)]
            }
            Sample::Keypoints { frame, points } => {
                let seen = points.iter().filter(|point| point.state != KeypointState::Lost);
                let poses = seen
                    .map(|point| Pose {
                        position: Some(vector(point.position_m)),
                        orientation: Some(Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
                    })
                    .collect();
                let keypoints = points
                    .iter()
                    .map(|point| KeypointMessage {
                        name: point.name.clone(),
                        state: state_name(point.state).to_owned(),
                        x: point.position_m[0],
                        y: point.position_m[1],
                        z: point.position_m[2],
                        covariance: point.covariance_m2.map(Vec::from).unwrap_or_default(),
                    })
                    .collect();
                vec![
                    encoded("/human/keypoints3d", &PosesInFrame { timestamp, frame_id: frame.clone(), poses }),
                    Encoded {
                        topic: KEYPOINTS_TOPIC.to_owned(),
                        schema: || Schema {
                            name: "ogg.Keypoints".to_owned(),
                            encoding: "protobuf".to_owned(),
                            data: keypoints_schema(),
                        },
                        bytes: KeypointsMessage { frame_id: frame.clone(), keypoints }.encode_to_vec(),
                    },
                ]
            }
            Sample::Transforms(frames) => {
                let transforms = frames
                    .iter()
                    .map(|frame| {
                        let [x, y, z, w] = frame.rotation_xyzw;
                        FrameTransform {
                            timestamp,
                            parent_frame_id: frame.parent.clone(),
                            child_frame_id: frame.child.clone(),
                            translation: Some(vector(frame.translation_m)),
                            rotation: Some(Quaternion { x, y, z, w }),
                        }
                    })
                    .collect();
                vec![encoded("/tf", &FrameTransforms { transforms })]
            }
            Sample::Joints(stream, joints) => {
                let joints = joints.iter().map(joint_state).collect();
                vec![encoded(joint_topic(*stream), &JointStates { timestamp, joints })]
            }
            Sample::Metrics(metrics) => {
                let metrics = metrics
                    .iter()
                    .map(|metric| MetricMessage {
                        name: metric.name.clone(),
                        value: metric.value,
                        unit: metric.unit.clone(),
                    })
                    .collect();
                vec![Encoded {
                    topic: "/metrics".to_owned(),
                    schema: || Schema {
                        name: "ogg.Metrics".to_owned(),
                        encoding: "protobuf".to_owned(),
                        data: metrics_schema(),
                    },
                    bytes: MetricsMessage { metrics }.encode_to_vec(),
                }]
            }
            Sample::Log { level, name, message } => {
                let level = match level {
                    Level::Debug => log::Level::Debug,
                    Level::Info => log::Level::Info,
                    Level::Warning => log::Level::Warning,
                    Level::Error => log::Level::Error,
                    Level::Fatal => log::Level::Fatal,
                };
                let message = Log {
                    timestamp,
                    level: level as i32,
                    message: message.clone(),
                    name: name.clone(),
                    ..Log::default()
                };
                vec![encoded("/log", &message)]
            }
        })
    }

    fn calibration(&self, info: &CameraInfo) -> CameraCalibration {
        let divisor = self.divisor(info.width_px, info.height_px);
        let n = f64::from(divisor);
        let [fx, fy] = info.focal_px.map(|focal| focal / n);
        let [cx, cy] = info.centre_px.map(|centre| shifted(centre, n));
        let rational = info.distortion.iter().skip(5).any(|&k| k != 0.0);
        let model = if rational { "rational_polynomial" } else { "plumb_bob" };
        let mut d = info.distortion.clone();
        // Viewers index the whole vector: five numbers for plumb_bob, eight for rational_polynomial.
        d.resize(if rational { 8 } else { 5 }, 0.0);
        CameraCalibration {
            width: info.width_px / divisor,
            height: info.height_px / divisor,
            distortion_model: model.to_owned(),
            d,
            k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            ..CameraCalibration::default()
        }
    }
}

pub(super) fn state_name(state: KeypointState) -> &'static str {
    match state {
        KeypointState::Measured => "measured",
        KeypointState::Inferred => "inferred",
        KeypointState::Lost => "lost",
    }
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn joint_state(joint: &JointValue) -> JointState {
    JointState {
        name: joint.name.clone(),
        position: joint.position,
        velocity: joint.velocity,
        acceleration: joint.acceleration,
        effort: joint.effort,
    }
}

#[cfg(test)]
mod tests;
