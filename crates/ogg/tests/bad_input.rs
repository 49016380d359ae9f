//! Bad input ends with exit code 2 and a message that names the file, the place and what was expected.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::path::{Path, PathBuf};
use std::process::Command;

struct Refusal {
    code: Option<i32>,
    message: String,
}

fn ogg(arguments: &[&str]) -> Refusal {
    let output = Command::new(env!("CARGO_BIN_EXE_ogg"))
        .args(arguments)
        .current_dir(std::env::temp_dir())
        .output()
        .expect("the binary starts");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!message.contains("panicked"), "{message}");
    Refusal { code: output.status.code(), message }
}

fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).unwrap();
    path
}

#[track_caller]
fn refused(arguments: &[&str], parts: &[&str]) {
    let refusal = ogg(arguments);
    assert_eq!(refusal.code, Some(2), "{arguments:?}: {}", refusal.message);
    for part in parts {
        assert!(refusal.message.contains(part), "{arguments:?}: {part:?} is not in: {}", refusal.message);
    }
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_missing_configuration() {
    refused(&["follow", "check-config", "--config", "/nowhere/cell.toml"], &["/nowhere/cell.toml", "expected"]);
}

#[test]
fn an_unknown_configuration_key() {
    let dir = tempfile::tempdir().unwrap();
    let file =
        write(dir.path(), "cell.toml", ogg::config::BUILTIN_CELL.replace("[control]", "[control]\nrate_khz = 1"));
    refused(&["follow", "run", "--config", text(&file)], &["cell.toml", "rate_khz", "rate_hz", "line "]);
}

#[test]
fn a_configuration_without_limits() {
    let dir = tempfile::tempdir().unwrap();
    let without: String =
        ogg::config::BUILTIN_CELL.lines().filter(|l| !l.starts_with("jerk")).flat_map(|l| [l, "\n"]).collect();
    let file = write(dir.path(), "cell.toml", without);
    refused(&["follow", "daemon", "--config", text(&file)], &["cell.toml", "jerk_rad_s3"]);
}

/// `ogg describe builtin | head -1`, with a reader that is gone before the first line.
#[test]
fn a_reader_that_has_read_enough_is_no_error() {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = Command::new(env!("CARGO_BIN_EXE_ogg")).arg("describe").stdout(writer).output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && message.is_empty(), "{message}");
}

#[test]
fn a_missing_video() {
    refused(&["follow", "run", "--input", "/nowhere/cam.mp4"], &["/nowhere/cam.mp4", "expected"]);
}

#[test]
fn a_file_that_is_no_video() {
    let dir = tempfile::tempdir().unwrap();
    let video = write(dir.path(), "cam.mp4", b"not a video at all");
    let calibration = write(dir.path(), "calib.toml", CALIBRATION);
    refused(&["follow", "run", "--input", text(&video), "--calibration", text(&calibration)], &["cam.mp4", "expected"]);
    // What is wrong with the file comes before what else the source needs.
    refused(&["follow", "run", "--input", text(&video)], &["cam.mp4", "expected"]);
}

#[test]
fn a_video_without_a_calibration() {
    let dir = tempfile::tempdir().unwrap();
    let images = dir.path().join("images");
    std::fs::create_dir(&images).unwrap();
    image::RgbImage::new(64, 64).save(images.join("0001.png")).unwrap();
    refused(&["follow", "run", "--input", text(&images), "--fps", "30"], &["lift.calibration", "--calibration FILE"]);
}

#[test]
fn a_robot_without_limits() {
    let dir = tempfile::tempdir().unwrap();
    let urdf = write(dir.path(), "arm.urdf", URDF_WITHOUT_LIMITS);
    refused(&["follow", "run", "--robot", text(&urdf)], &["arm.urdf", "elbow", "limit"]);
}

#[test]
fn a_calibration_that_is_none() {
    let dir = tempfile::tempdir().unwrap();
    let images = dir.path().join("images");
    std::fs::create_dir(&images).unwrap();
    image::RgbImage::new(64, 64).save(images.join("0001.png")).unwrap();
    let calibration = write(dir.path(), "calib.toml", "[cam01]\nmatrix = 3\n");
    refused(
        &["follow", "run", "--input", text(&images), "--fps", "30", "--calibration", text(&calibration)],
        &["calib.toml", "cam01.size", "expected"],
    );
}

#[test]
fn a_corrupt_network_and_a_wrong_card() {
    let dir = tempfile::tempdir().unwrap();
    let model = write(dir.path(), "net.onnx", [0xde, 0xad, 0xbe, 0xef].repeat(64));
    refused(&["follow", "run", "--model", text(&model)], &["net.onnx", "card"]);
    let card = write(dir.path(), "net.toml", "name = \"net\"\nflavour = \"sweet\"\n");
    refused(&["follow", "run", "--model", text(&card)], &["net.toml"]);
    refused(&["follow", "run", "--model", "builtin:nothing"], &["builtin:nothing", "builtin:ogg-lite"]);
}

#[test]
fn a_motion_model_that_is_none() {
    let dir = tempfile::tempdir().unwrap();
    let model = write(dir.path(), "action.json", "{\"format\": 7}");
    refused(&["follow", "run", "--motion-model", text(&model)], &["action.json", "expected"]);
    refused(&["inspect", text(&model)], &["action.json", "expected"]);
}

const CALIBRATION: &str = r#"
[cam01]
name = "cam01"
size = [640.0, 480.0]
matrix = [[600.0, 0, 320.0], [0, 600.0, 240.0], [0, 0, 1]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [2.2, 0.0, 0.0]
translation = [0.0, 0.0, 2.0]
fisheye = false
"#;

const URDF_WITHOUT_LIMITS: &str = r#"<?xml version="1.0"?>
<robot name="arm">
  <link name="base_link"/>
  <link name="tool0"/>
  <joint name="elbow" type="revolute">
    <parent link="base_link"/><child link="tool0"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
  </joint>
</robot>
"#;
