//! From samples to messages: topic, schema and bytes.
//!
//! Pictures are reduced by a whole factor so that their longer side stays within a limit; calibration and marks are reduced with
//! them. With integer pixel centres, `x' = (x + 1/2) / n - 1/2`.

use std::time::Duration;

use foxglove::Encode;
use foxglove::messages::{
    CameraCalibration, Color, CompressedImage, FrameTransform, FrameTransforms, ImageAnnotations, JointState,
    JointStates, Log, Point2, PointsAnnotation, Pose, PosesInFrame, Quaternion, Timestamp, Vector3, log,
    points_annotation,
};
use image::RgbImage;
use jpeg_encoder::{ColorType, EncodingError, SamplingFactor};
use prost::Message;

use super::sample::{CameraInfo, JointStream, JointValue, KeypointState, Level, Sample, Skeleton};
use super::schema::{KeypointMessage, KeypointsMessage, MetricMessage, MetricsMessage};
use super::schema::{keypoints_schema, metrics_schema};

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

fn shifted(pixel: f64, n: f64) -> f64 {
    f64::midpoint(2.0 * pixel / n, 1.0 / n - 1.0)
}

/// Limbs as a line list and keypoints as points; a lost keypoint is left out with its limbs.
fn marks(person: &Skeleton, timestamp: Option<Timestamp>, divisor: u32) -> [PointsAnnotation; 2] {
    let colour = |r, g, b| Color { r, g, b, a: 1.0 };
    let limb_colour = if person.followed { colour(0.1, 0.9, 0.3) } else { colour(0.6, 0.6, 0.6) };
    let n = f64::from(divisor);
    let point = |index: usize| {
        let point = person.points.get(index).filter(|point| point.state != KeypointState::Lost)?;
        Some(Point2 { x: shifted(point.x_px, n), y: shifted(point.y_px, n) })
    };
    let ends = person.limbs.iter().filter_map(|&(a, b)| Some([point(a)?, point(b)?]));
    let limbs = PointsAnnotation {
        timestamp,
        r#type: points_annotation::Type::LineList as i32,
        points: ends.flatten().collect(),
        outline_color: Some(limb_colour),
        thickness: 3.0,
        ..PointsAnnotation::default()
    };
    let seen: Vec<(Point2, Color)> = (0..person.points.len())
        .filter_map(|index| {
            let shade = match person.points[index].state {
                KeypointState::Measured => colour(1.0, 1.0, 1.0),
                KeypointState::Inferred | KeypointState::Lost => colour(1.0, 0.6, 0.0),
            };
            Some((point(index)?, shade))
        })
        .collect();
    let joints = PointsAnnotation {
        timestamp,
        r#type: points_annotation::Type::Points as i32,
        points: seen.iter().map(|(point, _)| *point).collect(),
        outline_colors: seen.iter().map(|(_, shade)| *shade).collect(),
        outline_color: Some(limb_colour),
        thickness: 6.0,
        ..PointsAnnotation::default()
    };
    [limbs, joints]
}

/// Averages blocks of `n x n` pixels; rows and columns that fill no block are cut off.
fn reduced(image: &RgbImage, n: u32) -> RgbImage {
    let (width, height) = (image.width() / n, image.height() / n);
    let (n, row_bytes) = (n as usize, image.width() as usize * 3);
    let raw = image.as_raw();
    let mut sums = vec![0_u32; width as usize * 3];
    let mut out = Vec::with_capacity(sums.len() * height as usize);
    let area = (n * n) as u32;
    for block_row in 0..height as usize {
        sums.fill(0);
        for row in raw[block_row * n * row_bytes..].chunks_exact(row_bytes).take(n) {
            for (sum, block) in sums.as_chunks_mut::<3>().0.iter_mut().zip(row.chunks_exact(3 * n)) {
                for pixel in block.as_chunks::<3>().0 {
                    for (sum, &value) in sum.iter_mut().zip(pixel) {
                        *sum += u32::from(value);
                    }
                }
            }
        }
        out.extend(sums.iter().map(|sum| ((sum + area / 2) / area) as u8));
    }
    RgbImage::from_raw(width, height, out).unwrap_or_default()
}

/// JPEG with its colours at half the resolution (4:2:0), as cameras send them.
fn jpeg(image: &RgbImage, quality: u8) -> Result<Vec<u8>, EncodingError> {
    let mut data = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut data, quality);
    encoder.set_sampling_factor(SamplingFactor::R_4_2_0);
    let [width, height] = [image.width(), image.height()].map(|side| u16::try_from(side).unwrap_or(u16::MAX));
    encoder.encode(image, width, height, ColorType::Rgb)?;
    Ok(data)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use image::Rgb;

    use super::super::sample::PixelPoint;
    use super::*;

    fn encoder(max_image_side_px: u32) -> Encoder {
        Encoder { cameras: 1, max_image_side_px, jpeg_quality: 80, start_unix_ns: 5 }
    }

    #[test]
    fn blocks_are_averaged_and_the_rest_cut_off() {
        let image = RgbImage::from_fn(5, 4, |x, y| Rgb([(x * 10) as u8, (y * 10) as u8, 7]));
        let small = reduced(&image, 2);
        assert_eq!(small.dimensions(), (2, 2));
        assert_eq!(small.get_pixel(0, 0).0, [5, 5, 7]);
        assert_eq!(small.get_pixel(1, 1).0, [25, 25, 7]);
    }

    #[test]
    fn another_library_reads_the_picture_that_was_written() {
        // Odd sides: the last block of colours is cut off.
        let image = RgbImage::from_fn(161, 91, |x, y| Rgb([x as u8, 255 - y as u8, 128]));
        let read = |max_image_side_px| {
            let sample = Sample::Image { camera: 0, image: Arc::new(image.clone()) };
            let encoded = encoder(max_image_side_px).encode(Duration::ZERO, &sample).unwrap();
            let message = CompressedImage::decode(&*encoded[0].bytes).unwrap();
            image::load_from_memory_with_format(&message.data, image::ImageFormat::Jpeg).unwrap().to_rgb8()
        };
        let off = |seen: &RgbImage, meant: &RgbImage| {
            assert_eq!(seen.dimensions(), meant.dimensions());
            let sum: u32 = seen.iter().zip(meant.iter()).map(|(&a, &b)| u32::from(a.abs_diff(b))).sum();
            f64::from(sum) / seen.len() as f64
        };
        assert!(off(&read(960), &image) < 2.0, "{}", off(&read(960), &image));
        assert!(off(&read(100), &reduced(&image, 2)) < 2.0);
    }

    #[test]
    fn calibration_shrinks_with_the_picture() {
        let info = CameraInfo {
            width_px: 1920,
            height_px: 1080,
            focal_px: [1000.0, 1000.0],
            centre_px: [959.5, 539.5],
            distortion: vec![0.1, -0.2],
        };
        let small = encoder(960).calibration(&info);
        assert_eq!((small.width, small.height), (960, 540));
        // The centre of the picture stays its centre.
        assert_eq!(small.k, [500.0, 0.0, 479.5, 0.0, 500.0, 269.5, 0.0, 0.0, 1.0]);
        assert_eq!(small.p, [500.0, 0.0, 479.5, 0.0, 0.0, 500.0, 269.5, 0.0, 0.0, 0.0, 1.0, 0.0]);
        assert_eq!((small.d.len(), small.distortion_model.as_str()), (5, "plumb_bob"));
    }

    #[test]
    fn the_rational_model_is_named_only_where_it_is_used() {
        let info = |distortion: &[f64]| CameraInfo {
            width_px: 640,
            height_px: 480,
            focal_px: [500.0, 500.0],
            centre_px: [319.5, 239.5],
            distortion: distortion.to_vec(),
        };
        let plain = encoder(960).calibration(&info(&[0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        assert_eq!((plain.d.len(), plain.distortion_model.as_str()), (5, "plumb_bob"));
        let rational = encoder(960).calibration(&info(&[0.1, 0.0, 0.0, 0.0, 0.0, 0.2]));
        assert_eq!((rational.d.len(), rational.distortion_model.as_str()), (8, "rational_polynomial"));
    }

    #[test]
    fn a_lost_keypoint_takes_its_limbs_with_it() {
        let point = |name: &str, state| PixelPoint { name: name.to_owned(), x_px: 10.0, y_px: 20.0, state };
        let person = Skeleton {
            points: vec![
                point("right_shoulder", KeypointState::Measured),
                point("right_elbow", KeypointState::Inferred),
                point("right_wrist", KeypointState::Lost),
            ],
            limbs: vec![(0, 1), (1, 2)],
            followed: true,
        };
        let [limbs, joints] = marks(&person, None, 1);
        assert_eq!((limbs.points.len(), joints.points.len(), joints.outline_colors.len()), (2, 2, 2));
        assert_eq!(limbs.r#type, points_annotation::Type::LineList as i32);
    }

    #[test]
    fn picture_topics_are_numbered_only_in_a_rig() {
        assert_eq!((camera_topic(0, 1), camera_frame(0, 1)), ("/camera".into(), "camera_color_optical_frame".into()));
        assert_eq!(camera_topic(0, 4), "/camera_1");
        assert_eq!(camera_frame(3, 4), "camera_4_color_optical_frame");
    }

    #[test]
    fn times_count_from_the_start_of_the_run() {
        assert_eq!(encoder(1).log_time_ns(Duration::from_nanos(7)), 12);
        let sample = Sample::Metrics(Vec::new());
        assert_eq!(encoder(1).encode(Duration::ZERO, &sample).unwrap()[0].topic, "/metrics");
    }
}
