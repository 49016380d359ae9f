//! A known motion, taught, learned and predicted; the judge is its closed form.

use std::f64::consts::TAU;
use std::time::Duration;

use follow::{
    ArmSample, Basis, Evidence, JointSample, LearnParams, Lesson, MotionModel, PhaseParams, Predictor, TeachParams,
    teach,
};
use nalgebra::{Matrix3, Point3};

const PERIOD_S: f64 = 2.4;
const RATE_HZ: f64 = 30.0;

/// The wrist goes round an ellipse; shoulder rests, elbow lies between.
fn wrist(t: f64) -> Point3<f64> {
    let a = TAU * t / PERIOD_S;
    Point3::new(0.10 * a.cos(), 0.06 * a.sin(), 0.08 + 0.03 * (a + 0.4).sin())
}

fn sample(t: f64) -> ArmSample {
    let joint = |position_m| {
        let covariance_m2 = Matrix3::identity() * 1e-6;
        Some(JointSample { position_m, covariance_m2, evidence: Evidence::Measured })
    };
    let w = wrist(t);
    ArmSample {
        captured: Duration::try_from_secs_f64(t).expect("positive"),
        shoulder: joint(Point3::new(-0.25, -0.2, 0.35)),
        elbow: joint(Point3::new(-0.2 + 0.4 * w.x, -0.3, 0.12)),
        wrist: joint(w),
    }
}

fn recording(seconds: f64) -> Vec<ArmSample> {
    (0..(seconds * RATE_HZ) as usize).map(|i| sample(i as f64 / RATE_HZ)).collect()
}

fn lesson() -> Lesson {
    teach(&recording(8.0), &TeachParams::default()).expect("a clean recording teaches")
}

#[test]
fn the_period_is_found_and_every_repetition_cut() {
    let report = lesson().report;
    assert!(report.cyclic && (report.duration_s - PERIOD_S).abs() < 0.02, "{report:?}");
    assert_eq!((report.demonstrations, report.complete), (3, 240));
}

#[test]
fn the_learned_action_is_the_shown_one_and_closes_smoothly() {
    let (model, _) = MotionModel::learn(&lesson(), &LearnParams::default()).expect("fits");
    assert!(model.is_cyclic());
    let mut worst = 0.0_f64;
    for i in 0..240 {
        let t = f64::from(i) * 0.01;
        let mean = model.at(t).mean;
        worst = worst.max((Point3::new(mean[0], mean[1], mean[2]) - wrist(t)).norm());
    }
    // Smoothing of 40 ms takes 0.6 % off a circle of this period; the mixture adds its own millimetres.
    assert!(worst < 0.006, "{worst} m");
    // Position is continuous across the seam, and so is the rate that the model states.
    let duration = model.duration_s();
    let (before, after) = (model.at(duration - 1e-6), model.at(duration + 1e-6));
    assert!((before.mean - after.mean).norm() < 1e-5 && (before.rate - after.rate).norm() < 1e-2);
    // The stated rate is the derivative of the mean, seam included.
    for t in [0.05, 0.1, 0.7, 1.9] {
        let h = 1e-5;
        let slope = (model.at(t + h).mean - model.at(t - h).mean) / (2.0 * h);
        assert!((slope - model.at(t).rate).norm() < 1e-4 * (1.0 + slope.norm()), "{t}");
    }
}

#[test]
fn a_model_file_keeps_every_bit_and_refuses_what_is_none() {
    let (model, _) = MotionModel::learn(&lesson(), &LearnParams::default()).expect("fits");
    let again = MotionModel::from_json(&model.to_json()).expect("its own file");
    assert_eq!(again.to_json(), model.to_json());
    assert_eq!(again.at(0.7).mean, model.at(0.7).mean);
    for wrong in ["", "{}", "{\"format\": 7}", &model.to_json().replacen("/1", "/9", 1)] {
        let message = MotionModel::from_json(wrong).expect_err("refused").to_string();
        assert!(message.contains("expected"), "{message}");
    }
}

#[test]
fn the_model_looks_further_ahead_than_constant_velocity() {
    let (model, _) = MotionModel::learn(&lesson(), &LearnParams::default()).expect("fits");
    let (horizon, step) = (Duration::from_millis(300), Duration::from_millis(20));
    let mut with = Predictor::new(Some(model), PhaseParams::default(), horizon, step).expect("valid");
    let mut without = Predictor::new(None, PhaseParams::default(), horizon, step).expect("valid");
    let (mut errors_with, mut errors_without) = (0.0, 0.0);
    for (i, sample) in recording(6.0).iter().enumerate() {
        let (a, b) = (with.observe(sample).expect("finite"), without.observe(sample).expect("finite"));
        let (a, b) = (a.expect("complete"), b.expect("complete"));
        if i < 30 {
            continue;
        }
        assert_eq!((a.basis, b.basis), (Basis::Model, Basis::ConstantVelocity));
        let truth = wrist(sample.captured.as_secs_f64() + 0.2);
        let error = |e: &follow::Expected| (Point3::new(e.posture[0], e.posture[1], e.posture[2]) - truth).norm();
        errors_with += error(&a.ahead[10]);
        errors_without += error(&b.ahead[10]);
    }
    assert!(errors_with < 0.5 * errors_without, "{errors_with} against {errors_without}");
}

#[test]
fn a_worker_who_does_something_else_is_not_followed_by_the_model() {
    let (model, _) = MotionModel::learn(&lesson(), &LearnParams::default()).expect("fits");
    let step = Duration::from_millis(20);
    let mut predictor = Predictor::new(Some(model), PhaseParams::default(), step * 10, step).expect("valid");
    let mut strange = sample(0.0);
    if let Some(wrist) = &mut strange.wrist {
        wrist.position_m.y += 0.4;
    }
    let prediction = predictor.observe(&strange).expect("finite").expect("complete");
    assert_eq!(prediction.basis, Basis::ConstantVelocity);
}

#[test]
fn too_little_seen_says_how_much_is_needed() {
    let message = teach(&recording(0.2), &TeachParams::default()).expect_err("too short").to_string();
    assert!(message.contains("0.50 s"), "{message}");
    let lost: Vec<ArmSample> = recording(4.0).into_iter().map(|s| ArmSample { wrist: None, ..s }).collect();
    assert!(teach(&lost, &TeachParams::default()).is_err());
}
