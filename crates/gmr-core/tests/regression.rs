//! Regression against closed forms and finite differences.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    CovarianceKind, ElementModel, ElementSequence, ElementSequenceParts, Error, GmmParams, Mixture, MixtureParts,
    MotionElement, Phase, Regressor, Samples,
};

fn two_components() -> Mixture {
    Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 3,
        weights: vec![0.3, 0.7],
        means: vec![0.0, 1.0, -1.0, 1.0, 2.0, 0.5],
        covariances: vec![
            0.5, 0.1, 0.05, 0.1, 0.4, -0.1, 0.05, -0.1, 0.3, //
            0.8, -0.2, 0.1, -0.2, 0.6, 0.2, 0.1, 0.2, 0.9,
        ],
    })
    .unwrap()
}

#[test]
fn mean_and_covariance_equal_the_textbook_formula() {
    let mixture = two_components();
    let regressor = Regressor::new(&mixture, &[0], &[1, 2]).unwrap();
    let mut out = regressor.prediction();
    let t = 0.4;
    regressor.predict_into(&[t], &mut out).unwrap();
    // Equations (7)-(10), written out for a scalar input, in the uncentred form of the paper.
    let (mut beta, mut sum) = ([0.0; 2], 0.0);
    let mut means = [[0.0; 2]; 2];
    let mut spreads = [[[0.0; 2]; 2]; 2];
    for n in 0..2 {
        let s = mixture.covariance(n);
        let mu = mixture.mean(n);
        let z = t - mu[0];
        beta[n] = mixture.weights()[n] * (-0.5 * z * z / s[0]).exp() / (2.0 * std::f64::consts::PI * s[0]).sqrt();
        sum += beta[n];
        for i in 0..2 {
            means[n][i] = mu[1 + i] + s[3 * (1 + i)] / s[0] * z;
            for j in 0..2 {
                spreads[n][i][j] = s[3 * (1 + i) + 1 + j] - s[3 * (1 + i)] * s[1 + j] / s[0];
            }
        }
    }
    for i in 0..2 {
        let mean: f64 = (0..2).map(|n| beta[n] / sum * means[n][i]).sum();
        assert!((out.mean()[i] - mean).abs() < 1e-14);
        for j in 0..2 {
            let other: f64 = (0..2).map(|n| beta[n] / sum * means[n][j]).sum();
            let second: f64 = (0..2).map(|n| beta[n] / sum * (means[n][i] * means[n][j] + spreads[n][i][j])).sum();
            assert!((out.covariance()[2 * i + j] - (second - mean * other)).abs() < 1e-14);
        }
    }
    assert!((out.responsibilities().iter().sum::<f64>() - 1.0).abs() < 1e-15);
    assert!((out.log_density() - sum.ln()).abs() < 1e-14);
}

#[test]
fn jacobian_equals_central_differences_for_one_and_two_inputs() {
    let mixture = two_components();
    for (inputs, outputs, x) in [(vec![0], vec![2, 1], vec![0.4]), (vec![2, 0], vec![1], vec![0.1, 0.7])] {
        let regressor = Regressor::new(&mixture, &inputs, &outputs).unwrap();
        let mut out = regressor.prediction();
        regressor.predict_with_jacobian_into(&x, &mut out).unwrap();
        let jacobian = out.jacobian().to_vec();
        let h = 1e-5;
        for j in 0..inputs.len() {
            let mut moved = x.clone();
            moved[j] += h;
            regressor.predict_into(&moved, &mut out).unwrap();
            let up = out.mean().to_vec();
            moved[j] -= 2.0 * h;
            regressor.predict_into(&moved, &mut out).unwrap();
            for o in 0..outputs.len() {
                let difference = (up[o] - out.mean()[o]) / (2.0 * h);
                // Central differences are good to h^2 times the third derivative (order one).
                assert!((jacobian[o * inputs.len() + j] - difference).abs() < 1e-8);
            }
        }
    }
}

#[test]
fn a_query_beyond_every_density_is_an_error_and_a_distant_one_is_not() {
    let regressor = Regressor::new(&two_components(), &[0], &[1]).unwrap();
    let mut out = regressor.prediction();
    regressor.predict_into(&[1e100], &mut out).unwrap();
    assert!(out.mean()[0].is_finite());
    let narrow = Mixture::new(MixtureParts {
        kind: CovarianceKind::Diagonal,
        dim: 2,
        weights: vec![1.0],
        means: vec![0.0, 0.0],
        covariances: vec![1e-100, 1.0],
    })
    .unwrap();
    let regressor = Regressor::new(&narrow, &[0], &[1]).unwrap();
    let mut out = regressor.prediction();
    assert_eq!(regressor.predict_into(&[1e139], &mut out), Err(Error::NoSupport { components: 1 }));
    assert!(matches!(regressor.predict_into(&[f64::NAN], &mut out), Err(Error::NotFinite { .. })));
    assert!(matches!(regressor.predict_into(&[1e200], &mut out), Err(Error::OutOfRange { .. })));
}

#[test]
fn splits_that_make_no_sense_are_refused() {
    let mixture = two_components();
    for (inputs, outputs) in [(&[][..], &[1][..]), (&[0][..], &[][..]), (&[0][..], &[0][..]), (&[3][..], &[1][..])] {
        assert!(Regressor::new(&mixture, inputs, outputs).is_err());
    }
}

fn straight(start_s: f64, slope: f64, height: f64) -> ElementModel {
    // h = height + slope (t - start), exact up to a variance of 1e-4.
    let covariance = vec![0.1, 0.1 * slope, 0.1 * slope, 0.1 * slope * slope + 1e-4];
    ElementModel {
        element: MotionElement { start_s, end_s: start_s + 1.0 },
        mixture: Mixture::new(MixtureParts {
            kind: CovarianceKind::Full,
            dim: 2,
            weights: vec![1.0],
            means: vec![0.5, height + 0.5 * slope],
            covariances: covariance,
        })
        .unwrap(),
    }
}

#[test]
fn joined_elements_are_continuous_in_position_and_velocity() {
    // A deliberate jump of 0.2 m and a kink at t = 1 s.
    let sequence = ElementSequence::new(ElementSequenceParts {
        elements: vec![straight(0.0, 1.0, 0.0), straight(1.0, -2.0, 1.2)],
        blend_s: 0.3,
    })
    .unwrap();
    let regressor = sequence.regressor().unwrap();
    let mut out = regressor.prediction();
    let mut at = |t: f64| {
        regressor.predict_into(t, &mut out).unwrap();
        (out.mean()[0], out.velocity()[0], out.covariance()[0])
    };
    let h = 1e-6;
    let mut previous = at(0.0);
    for i in 1..=2_000_000 / 500 {
        let t = f64::from(i) * 5e-4;
        let now = at(t);
        // Velocity is below 4 m/s and acceleration below 60 m/s^2 in this joint.
        assert!((now.0 - previous.0).abs() < 4.0 * 5e-4, "position jumps at {t}");
        assert!((now.1 - previous.1).abs() < 60.0 * 5e-4, "velocity jumps at {t}");
        assert!(now.2 > 0.0);
        previous = now;
        if t + h < 2.0 {
            let difference = (at(t + h).0 - at(t - h).0) / (2.0 * h);
            assert!((difference - now.1).abs() < 1e-6, "velocity is not the derivative at {t}");
        }
    }
    regressor.predict_into(-1.0, &mut out).unwrap();
    assert_eq!((out.phase(), out.velocity()[0]), (Phase::Before, 0.0));
    regressor.predict_into(3.0, &mut out).unwrap();
    assert_eq!((out.phase(), out.velocity()[0]), (Phase::After, 0.0));
}

#[test]
fn a_mixture_survives_a_json_round_trip_and_a_broken_file_is_refused() {
    let values: Vec<f64> = (0..60).map(|i| (f64::from(i) * 0.7).sin() + f64::from(i % 3)).collect();
    let plan = GmmParams { components: 3, ..GmmParams::default() }.validate().unwrap();
    let (mixture, _) = plan.fit(&Samples::new(&values, 2).unwrap()).unwrap();
    let text = serde_json::to_string(&mixture).unwrap();
    let back: Mixture = serde_json::from_str(&text).unwrap();
    for (a, b) in mixture.means().iter().zip(back.means()) {
        assert!((a - b).abs() <= f64::EPSILON * a.abs());
    }
    let broken = text.replacen("\"weights\":[", "\"weights\":[0.5,", 1);
    assert!(serde_json::from_str::<Mixture>(&broken).is_err());
}
