use std::sync::Arc;

use foxglove::messages::points_annotation;
use image::{Rgb, RgbImage};

use super::marks::marks;
use super::picture::reduced;
use super::*;
use crate::record::sample::{KeypointState, PixelPoint, Skeleton};

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
