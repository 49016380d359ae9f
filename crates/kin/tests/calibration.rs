//! Calibration files in three formats, good and bad.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::disallowed_methods,
    clippy::unreadable_literal,
    reason = "tests: a panic is a failure, exact values are meant"
)]

use kin::{CalibrationFormat, Error, parse_calibration, read_calibration, read_cameras};
use nalgebra::{Point3, Vector3};

const POSE2SIM: &str = r#"
[cam01]
name = "cam01"
size = [1080.0, 1920.0]
matrix = [[1674.8803, 0, 530.46792], [0, 1674.7115, 951.60131], [0, 0, 1]]
distortions = [-0.00072160938, 0.0021872344, 9.5e-06, 1.078125e-05]
rotation = [1.6743878, 1.0472579, -0.43225079]
translation = [0.33953564, 1.0004798, 2.8736139]
fisheye = false

[metadata]
adjusted = false
error = 0.0
"#;

const ROS: &str = "
image_width: 640
image_height: 480
camera_name: head_camera
camera_matrix:
  rows: 3
  cols: 3
  data: [610.5, 0.0, 320.1, 0.0, 611.0, 239.9, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, -0.002, 0.0]
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
";

const OPENCV: &str = "%YAML:1.0
---
calibration_time: \"Mon 21 Jul 2025\"
image_width: 1280
image_height: 720
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 9.0e+02, 0., 640., 0., 9.1e+02, 360., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 8
   cols: 1
   dt: d
   data: [ .1, -.2, 0., 0., .01, 0.3, 0.02, 0.001 ]
rvec: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ 0., 0., 1.5707963267948966 ]
tvec: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ 0., 0., 2. ]
";

fn parse(text: &str, format: CalibrationFormat) -> Result<Vec<kin::Calibration>, Error> {
    parse_calibration(text, format, "file")
}

#[test]
fn pose2sim_files_hold_world_to_camera_as_a_rodrigues_vector() {
    let cameras = parse(POSE2SIM, CalibrationFormat::Pose2SimToml).unwrap();
    assert_eq!(cameras.len(), 1);
    assert_eq!((cameras[0].name.as_str(), cameras[0].size_px), ("cam01", [1080, 1920]));
    let pose = cameras[0].camera_from_world.unwrap();
    // Rodrigues' formula by hand for the world's z axis.
    let r = Vector3::<f64>::new(1.6743878, 1.0472579, -0.43225079);
    let (theta, k) = (r.norm(), r / r.norm());
    let z = Vector3::z();
    let rotated = z * theta.cos() + k.cross(&z) * theta.sin() + k * k.dot(&z) * (1.0 - theta.cos());
    let expected = rotated + Vector3::new(0.33953564, 1.0004798, 2.8736139);
    assert!(((pose * Point3::new(0.0, 0.0, 1.0)).coords - expected).norm() < 1e-12);
    assert!((cameras[0].distortion.k2 - 0.0021872344).abs() < 1e-15);
}

#[test]
fn ros_files_have_no_pose() {
    let camera = parse(ROS, CalibrationFormat::RosYaml).unwrap().remove(0);
    assert_eq!((camera.name.as_str(), camera.size_px), ("head_camera", [640, 480]));
    assert_eq!((camera.intrinsics.fx_px, camera.intrinsics.cy_px), (610.5, 239.9));
    assert_eq!((camera.distortion.p2, camera.camera_from_world), (-0.002, None));
    // A printed camera_info message.
    let message = "{width: 640, height: 480, distortion_model: plumb_bob, d: [0.1, 0, 0, 0, 0], k: [600, 0, 320, 0, 600, 240, 0, 0, 1]}";
    assert_eq!(parse(message, CalibrationFormat::RosYaml).unwrap()[0].intrinsics.fx_px, 600.0);
}

#[test]
fn opencv_files_have_their_own_first_line_and_tags() {
    let camera = parse(OPENCV, CalibrationFormat::OpenCvYaml).unwrap().remove(0);
    assert_eq!((camera.size_px, camera.intrinsics.fy_px, camera.distortion.k6), ([1280, 720], 910.0, 0.001));
    let pose = camera.camera_from_world.unwrap();
    assert!((pose * Point3::new(1.0, 0.0, 0.0) - Point3::new(0.0, 1.0, 2.0)).norm() < 1e-12);
    let by_matrix = OPENCV.replace("rvec:", "R:").replace(
        "rows: 3\n   cols: 1\n   dt: d\n   data: [ 0., 0., 1.5707963267948966 ]",
        "rows: 3\n   cols: 3\n   dt: d\n   data: [ 0., -1., 0., 1., 0., 0., 0., 0., 1. ]",
    );
    let same = parse(&by_matrix, CalibrationFormat::OpenCvYaml).unwrap().remove(0);
    assert!((same.camera_from_world.unwrap().to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
}

#[test]
fn the_format_follows_from_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    assert_eq!(read_cameras(write("a.toml", POSE2SIM)).unwrap().len(), 1);
    assert_eq!(read_calibration(write("b.yaml", ROS)).unwrap()[0].size_px, [640, 480]);
    assert_eq!(read_cameras(write("c.yml", OPENCV)).unwrap()[0].size_px, [1280, 720]);
    let error = read_cameras(write("b.yaml", ROS)).unwrap_err().to_string();
    assert!(error.contains("b.yaml") && error.contains("pose of the camera"), "{error}");
    assert!(matches!(read_calibration(write("d.txt", ROS)), Err(Error::CalibrationSyntax { .. })));
    assert!(matches!(read_calibration(folder.path().join("none.toml")), Err(Error::Read { .. })));
}

#[test]
fn complaints_name_the_key_and_what_was_expected() {
    let toml = CalibrationFormat::Pose2SimToml;
    let cases = [
        (toml, POSE2SIM.replace("rotation = [1.6743878, 1.0472579, -0.43225079]", ""), "cam01.rotation", "3 numbers"),
        (toml, POSE2SIM.replace("1674.8803", "-1674.8803"), "cam01.matrix", "fx, fy > 0"),
        (toml, POSE2SIM.replace("1674.8803", "nan"), "cam01.matrix", "3x3 matrix"),
        (toml, POSE2SIM.replace("size = [1080.0, 1920.0]", "size = [0, 1920]"), "cam01.size", "pixels"),
        (toml, POSE2SIM.replace("fisheye = false", "fisheye = true"), "cam01.fisheye", "not supported"),
        (toml, POSE2SIM.replace("9.5e-06, ", ""), "cam01.distortions", "0, 4, 5 or 8"),
        (toml, "cam = 3".to_owned(), "cam", "table"),
        (CalibrationFormat::RosYaml, ROS.replace("plumb_bob", "equidistant"), "distortion_model", "plumb_bob"),
        (CalibrationFormat::RosYaml, ROS.replace("image_width: 640", ""), "image_width", "pixels"),
        (CalibrationFormat::RosYaml, ROS.replace("611.0, 239.9", "239.9"), "camera_matrix", "3x3"),
        (CalibrationFormat::OpenCvYaml, OPENCV.replace("tvec:", "tv:"), "tvec", "because there is a rotation"),
    ];
    for (format, text, key, expected) in cases {
        let error = parse(&text, format).unwrap_err();
        let message = error.to_string();
        assert!(matches!(error, Error::Calibration { .. }), "{message}");
        assert!(message.starts_with("file: key `") && message.contains(key) && message.contains(expected), "{message}");
    }
    for (format, text) in
        [(toml, "[cam"), (toml, ""), (CalibrationFormat::RosYaml, ": ]["), (CalibrationFormat::RosYaml, "")]
    {
        assert!(matches!(parse(text, format), Err(Error::CalibrationSyntax { .. })), "{text}");
    }
}
