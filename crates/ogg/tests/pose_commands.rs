//! `ogg pose`, run as a person runs it, on the built-in network in pure Rust.
#![expect(clippy::unwrap_used, reason = "tests")]

use std::path::Path;
use std::process::{Command, Output};

use image::{Rgb, RgbImage};

fn ogg(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ogg")).args(arguments).output().unwrap()
}

fn said(output: &Output) -> (Option<i32>, String) {
    let text = [&output.stdout[..], &output.stderr[..]].concat();
    (output.status.code(), String::from_utf8_lossy(&text).into_owned())
}

/// Three grey pictures and labels of a person in one of them, whom nobody can see.
fn data(folder: &Path) {
    for i in 0..3 {
        RgbImage::from_pixel(160, 120, Rgb([90 + i, 90, 90])).save(folder.join(format!("{i}.png"))).unwrap();
    }
    let mut keypoints = vec![0; 51];
    for (joint, u) in [(5, 60), (7, 55), (9, 70), (11, 62)] {
        keypoints[3 * joint..3 * joint + 3].copy_from_slice(&[u, 20 + 4 * joint, 2]);
    }
    let labels = serde_json::json!({
        "images": (0..3).map(|i| serde_json::json!({ "id": i, "file_name": format!("{i}.png") })).collect::<Vec<_>>(),
        "annotations": [{ "id": 1, "image_id": 1, "keypoints": keypoints, "area": 3000.0, "bbox": [40, 30, 50, 60], "iscrowd": 0 }],
    });
    std::fs::write(folder.join("annotations.json"), labels.to_string()).unwrap();
}

#[test]
fn eval_prints_scores_and_stages_and_writes_them() {
    let dir = tempfile::tempdir().unwrap();
    data(dir.path());
    let (labels, report) = (dir.path().join("annotations.json"), dir.path().join("report.json"));
    let arguments = ["pose", "eval", "--onnxruntime", "tract", "--data", labels.to_str().unwrap(), "--json"];
    let (code, text) = said(&ogg(&[&arguments[..], &[report.to_str().unwrap()]].concat()));
    assert_eq!(code, Some(0), "{text}");
    for part in ["ogg-lite on tract", "3 pictures, 1 people labelled", "left_wrist", "decode", "visible"] {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(report).unwrap()).unwrap();
    // A person whom nobody can see: no recall, no correct keypoint.
    assert_eq!((report["oks"][0]["ar"].as_f64(), report["oks"][0]["subset"].as_str()), (Some(0.0), Some("all")));
    let rows = report["pck"].as_array().unwrap();
    let arms = rows.iter().find(|r| r["joint"] == "arms").unwrap();
    assert_eq!((arms["labelled"].as_u64(), arms["pck_02"].as_f64()), (Some(3), Some(0.0)));
    assert_eq!(report["stages"].as_array().unwrap().len(), 4);
}

#[test]
fn video_draws_a_folder_into_a_film_and_into_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let pictures = dir.path().join("in");
    std::fs::create_dir(&pictures).unwrap();
    data(&pictures);
    for out in ["out.mp4", "frames"] {
        let out = dir.path().join(out);
        let arguments = ["pose", "video", "--onnxruntime", "tract", "--fps", "25", pictures.to_str().unwrap(), "--out"];
        let (code, text) = said(&ogg(&[&arguments[..], &[out.to_str().unwrap()]].concat()));
        assert_eq!(code, Some(0), "{text}");
        assert!(text.contains("3 pictures, 0.00 people"), "{text}");
    }
    assert_eq!(std::fs::read_dir(dir.path().join("frames")).unwrap().count(), 3);
    let options = ogg::capture::OpenOptions::default();
    let mut film = ogg::capture::open(&dir.path().join("out.mp4"), &options).unwrap();
    let mut count = 0;
    while let Some(frame) = ogg::capture::Source::next_frame(&mut film).unwrap() {
        assert_eq!((frame.image.dimensions(), frame.captured.as_millis()), ((160, 120), 40 * count));
        count += 1;
    }
    assert_eq!(count, 3);
}

/// No silent fallback: a provider that is not there ends the run.
#[test]
fn a_provider_that_is_not_there_is_an_error_that_names_it() {
    let dir = tempfile::tempdir().unwrap();
    data(dir.path());
    let labels = dir.path().join("annotations.json");
    for provider in ["openvino", "cuda", "tensorrt"] {
        let arguments = ["pose", "eval", "--onnxruntime", "tract", "--provider", provider, "--data"];
        let (code, text) = said(&ogg(&[&arguments[..], &[labels.to_str().unwrap()]].concat()));
        assert_eq!(code, Some(2), "{text}");
        assert!(text.contains(&format!("execution provider {provider} is not available in tract")), "{text}");
    }
}

#[test]
fn wrong_input_is_named() {
    let dir = tempfile::tempdir().unwrap();
    data(dir.path());
    let labels = dir.path().join("annotations.json");
    let labels = labels.to_str().unwrap();
    let cases: [(&[&str], &str); 4] = [
        (&["eval", "--data", "/nowhere/labels.json"], "/nowhere/labels.json"),
        (
            &["eval", "--data", labels, "--onnxruntime", "tract", "--sigmas", "0.1,0.2"],
            "--sigmas: 2 numbers, expected 17",
        ),
        (&["eval", "--data", labels, "--model", "builtin:nobody"], "builtin:nobody"),
        (&["video", dir.path().to_str().unwrap(), "--onnxruntime", "tract", "--out", "x.avi"], "--out: .avi given"),
    ];
    for (arguments, part) in cases {
        let (code, text) = said(&ogg(&[&["pose"], arguments].concat()));
        assert_eq!(code, Some(2), "{text}");
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}
