//! The evaluation gives pycocotools' numbers to 1e-9 on random and hand-made sets (`fixtures/oks/origin.toml`).
#![expect(clippy::unwrap_used, reason = "tests")]

use pose::{DetectedPose, LabelledPose, OksParams, Subset};
use serde_json::Value;

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap()
}

fn numbers<const N: usize>(v: &Value) -> [f64; N] {
    let values: Vec<f64> = v.as_array().unwrap().iter().map(number).collect();
    values.try_into().unwrap()
}

#[test]
fn the_ten_numbers_are_those_of_pycocotools() {
    let cases: Value = serde_json::from_str(include_str!("fixtures/oks/cases.json")).unwrap();
    let cases = cases.as_array().unwrap();
    assert_eq!(cases.len(), 15);
    for (i, case) in cases.iter().enumerate() {
        let labels: Vec<LabelledPose> = case["labels"]
            .as_array()
            .unwrap()
            .iter()
            .map(|l| LabelledPose {
                image_id: l["image_id"].as_u64().unwrap(),
                keypoints: l["keypoints"].as_array().unwrap().iter().map(numbers).collect(),
                area_px2: number(&l["area"]),
                box_px: numbers(&l["bbox"]),
                is_crowd: l["iscrowd"].as_bool().unwrap(),
            })
            .collect();
        let detections: Vec<DetectedPose> = case["detections"]
            .as_array()
            .unwrap()
            .iter()
            .map(|d| DetectedPose {
                image_id: d["image_id"].as_u64().unwrap(),
                keypoints: d["keypoints"].as_array().unwrap().iter().map(numbers).collect(),
                score: number(&d["score"]),
            })
            .collect();
        let subset = &case["subset"];
        let params = OksParams {
            sigmas: case["sigmas"].as_array().unwrap().iter().map(number).collect(),
            max_detections: case["max_detections"].as_u64().unwrap() as usize,
            subset: Subset {
                keypoints: subset["keypoints"]
                    .as_array()
                    .map(|k| k.iter().map(|i| i.as_u64().unwrap() as usize).collect()),
                visibility: subset["visibility"].as_u64().map(|v| v as u8),
            },
        };
        let got = params.evaluate(&labels, &detections).unwrap().to_array();
        let expected: [f64; 10] = numbers(&case["expected"]);
        for (name, (got, expected)) in got.iter().zip(&expected).enumerate() {
            assert!((got - expected).abs() <= 1e-9, "case {i}, number {name}: {got} and {expected}");
        }
    }
}

/// Two people labelled in one place, a small and a large one. The first detection is exactly both and takes the later label;
/// what the second one is worth is its similarity to the label that is left.
#[test]
fn a_detection_that_is_equally_similar_to_two_labels_takes_the_later() {
    let label = |area_px2: f64| LabelledPose {
        image_id: 1,
        keypoints: (0..17).map(|i| [f64::from(i) * 10.0, 50.0, 2.0]).collect(),
        area_px2,
        box_px: [0.0, 0.0, 170.0, 100.0],
        is_crowd: false,
    };
    let found = |du: f64, score: f64| DetectedPose {
        image_id: 1,
        keypoints: (0..17).map(|i| [f64::from(i) * 10.0 + du, 50.0]).collect(),
        score,
    };
    let params = OksParams::default();
    let beside = found(10.0, 0.8);
    let detections = [found(0.0, 0.9), beside.clone()];
    let (small, large) = (label(8_000.0), label(200_000.0));
    for labels in [[small.clone(), large.clone()], [large, small]] {
        let left = params.similarity(&labels[0], &beside).unwrap();
        let matched = (0..10).filter(|t| left >= 0.5 + 0.05 * f64::from(*t)).count() as f64;
        let recall = params.evaluate(&labels, &detections).unwrap().ar.unwrap();
        assert!((recall - (10.0 + matched) / 20.0).abs() < 1e-9, "{recall} {left}");
    }
}

#[test]
fn wrong_lengths_and_nan_are_refused() {
    let label = LabelledPose {
        image_id: 1,
        keypoints: vec![[0.0, 0.0, 2.0]; 17],
        area_px2: 100.0,
        box_px: [0.0, 0.0, 10.0, 10.0],
        is_crowd: false,
    };
    let found = DetectedPose { image_id: 1, keypoints: vec![[0.0, 0.0]; 17], score: 0.5 };
    let params = OksParams::default();
    let short = DetectedPose { keypoints: vec![[0.0, 0.0]; 16], ..found.clone() };
    assert!(params.evaluate(std::slice::from_ref(&label), &[short]).is_err());
    let nan = DetectedPose { score: f64::NAN, ..found.clone() };
    assert!(params.evaluate(std::slice::from_ref(&label), &[nan]).is_err());
    for (i, value) in [(0, f64::NAN), (1, f64::INFINITY)] {
        let mut label = label.clone();
        label.keypoints[3][i] = value;
        assert!(params.evaluate(&[label], std::slice::from_ref(&found)).is_err());
    }
    let no_area = LabelledPose { area_px2: f64::NAN, ..label.clone() };
    assert!(params.evaluate(&[no_area], std::slice::from_ref(&found)).is_err());
    for (keypoints, visibility) in [(Some(vec![3, 17]), None), (None, Some(0)), (None, Some(3))] {
        let beyond = OksParams { subset: Subset { keypoints, visibility }, ..OksParams::default() };
        assert!(beyond.evaluate(std::slice::from_ref(&label), std::slice::from_ref(&found)).is_err());
    }
    let wrong = OksParams { sigmas: vec![0.0; 17], ..OksParams::default() };
    assert!(wrong.evaluate(&[label], &[found]).is_err());
}
