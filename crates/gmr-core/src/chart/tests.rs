#![expect(clippy::float_cmp, reason = "these results are exact")]
use std::f64::consts::PI;

use super::turn::exponential;
use super::*;
use crate::{GmmParams, Regressor, Samples};

#[test]
fn wrapping_is_idempotent_and_keeps_the_point() {
    for i in -1000..1000 {
        let a = f64::from(i) * 0.037;
        let w = wrap_rad(a);
        assert!(w > -PI && w <= PI);
        assert!((w.sin() - a.sin()).abs() < 1e-12 && (w.cos() - a.cos()).abs() < 1e-12);
    }
    assert!(wrap_rad(PI) == PI && wrap_rad(-PI) == PI);
}

#[test]
fn a_motion_through_pi_is_learned_like_the_same_motion_through_zero() {
    let times: Vec<f64> = (0..=100).map(|i| f64::from(i) * 0.01).collect();
    let swing = |t: f64| 1.2 * (5.0 * t).sin();
    let predict = |offset: f64| -> Vec<f64> {
        let values = times.iter().map(|&t| wrap_rad(swing(t) + offset)).collect();
        let motion = Trajectory::new(times.clone(), values, 1).unwrap();
        let chart = Chart::fit(&[CoordinateKind::Angle], std::slice::from_ref(&motion)).unwrap();
        let flat = chart.encode(&motion).unwrap();
        let rows: Vec<f64> = times.iter().zip(flat.values()).flat_map(|(t, v)| [*t, *v]).collect();
        let plan = GmmParams { components: 8, ..GmmParams::default() }.validate().unwrap();
        let (mixture, _) = plan.fit(&Samples::new(&rows, 2).unwrap()).unwrap();
        let regressor = Regressor::new(&mixture, &[0], &[1]).unwrap();
        let mut out = regressor.prediction();
        let mut angle = [0.0];
        times
            .iter()
            .map(|t| {
                regressor.predict_into(&[*t], &mut out).unwrap();
                chart.decode_into(out.mean(), &mut angle).unwrap();
                wrap_rad(angle[0] - offset)
            })
            .collect()
    };
    let (plain, turned) = (predict(0.0), predict(PI));
    for ((a, b), t) in plain.iter().zip(&turned).zip(&times) {
        assert!((a - b).abs() < 1e-6, "the turn changes the prediction at {t}");
        assert!((a - swing(*t)).abs() < 0.1);
    }
}

#[test]
fn orientations_go_through_a_full_turn_and_come_back() {
    let axis = [0.6, 0.0, 0.8];
    let times: Vec<f64> = (0..=300).map(|i| f64::from(i) * 0.01).collect();
    let mut values = Vec::new();
    for t in &times {
        let q = exponential(axis.map(|a| a * 3.0 * t));
        // A sensor is free to report either sign.
        let sign = if (t * 7.0).sin() > 0.0 { 1.0 } else { -1.0 };
        values.extend(q.map(|v| sign * v));
    }
    let motion = Trajectory::new(times, values, 4).unwrap();
    let chart = Chart::fit(&[CoordinateKind::Rotation], std::slice::from_ref(&motion)).unwrap();
    let flat = chart.encode(&motion).unwrap();
    for i in 1..flat.len() {
        let step: f64 = flat.row(i).iter().zip(flat.row(i - 1)).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!((step - 0.03).abs() < 1e-9, "step {step} at {i}");
    }
    let mut q = [0.0; 4];
    for i in 0..flat.len() {
        chart.decode_into(flat.row(i), &mut q).unwrap();
        let dot: f64 = q.iter().zip(motion.row(i)).map(|(a, b)| a * b).sum();
        assert!((dot.abs() - 1.0).abs() < 1e-12);
    }
}

#[test]
fn a_quaternion_that_is_no_rotation_is_refused() {
    let motion = Trajectory::new(vec![0.0], vec![0.5, 0.0, 0.0, 0.0], 4).unwrap();
    assert!(Chart::fit(&[CoordinateKind::Rotation], &[motion]).is_err());
}
