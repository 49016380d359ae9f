//! Queries: whose prediction, how many outputs, what is left of a query before, what a query without support leaves.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{CovarianceKind, Error, Mixture, MixtureParts, Regressor, Samples};

/// A mixture of `k` components over `d` dimensions with dense covariances `F F' + I / 2`.
fn mixture(d: usize, k: usize) -> Mixture {
    let f = |i: usize| (i as f64 * 1.37).sin();
    let covariance = |c: usize| {
        (0..d * d).map(move |i| {
            let (a, b) = (i / d, i % d);
            let product: f64 = (0..d).map(|l| f(c * 97 + a * d + l) * f(c * 97 + b * d + l)).sum();
            product + if a == b { 0.5 } else { 0.0 }
        })
    };
    let total: f64 = (1..=k).map(|c| c as f64).sum();
    Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: d,
        weights: (1..=k).map(|c| c as f64 / total).collect(),
        means: (0..k * d).map(|i| 1.5 * f(i + 7)).collect(),
        covariances: (0..k).flat_map(covariance).collect(),
    })
    .unwrap()
}

fn close(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "{what}: {a} is not {b}");
    }
}

#[test]
fn any_number_of_outputs_and_components_has_the_same_numbers_as_each_pair_of_outputs_alone() {
    for (d, k) in [(3, 1), (9, 8), (10, 9), (12, 3), (19, 17)] {
        let mixture = mixture(d, k);
        let outputs: Vec<usize> = (2..d).collect();
        let x = [0.4, -0.7];
        let all = Regressor::new(&mixture, &[1, 0], &outputs).unwrap();
        let mut out = all.prediction();
        all.predict_with_jacobian_into(&x, &mut out).unwrap();
        let n = outputs.len();
        for i in 0..n {
            for j in 0..i {
                let pair = Regressor::new(&mixture, &[1, 0], &[outputs[i], outputs[j]]).unwrap();
                let mut two = pair.prediction();
                pair.predict_with_jacobian_into(&x, &mut two).unwrap();
                let v = out.covariance();
                close("mean", two.mean(), &[out.mean()[i], out.mean()[j]], 1e-11);
                close("covariance", two.covariance(), &[v[i * n + i], v[i * n + j], v[j * n + i], v[j * n + j]], 1e-10);
                let jacobian = out.jacobian();
                let expected = [jacobian[2 * i], jacobian[2 * i + 1], jacobian[2 * j], jacobian[2 * j + 1]];
                close("jacobian", two.jacobian(), &expected, 1e-10);
            }
        }
        // One output alone: closed form with the 2 x 2 inverse written out (eqs. 7 to 10).
        let (mut beta, mut sum) = (vec![0.0; k], 0.0);
        let (mut means, mut spreads) = (vec![0.0; k], vec![0.0; k]);
        for c in 0..k {
            let (s, m) = (mixture.covariance(c), mixture.mean(c));
            let (a, b, e) = (s[d + 1], s[d], s[0]);
            let det = a * e - b * b;
            let z = [x[0] - m[1], x[1] - m[0]];
            let solved = [(e * z[0] - b * z[1]) / det, (a * z[1] - b * z[0]) / det];
            let norm = z[0] * solved[0] + z[1] * solved[1];
            beta[c] = mixture.weights()[c] * (-0.5 * norm).exp() / (std::f64::consts::TAU * det.sqrt());
            sum += beta[c];
            let (g0, g1) = (s[2 * d + 1], s[2 * d]);
            means[c] = m[2] + g0 * solved[0] + g1 * solved[1];
            let gain = [(g0 * e - g1 * b) / det, (g1 * a - g0 * b) / det];
            spreads[c] = s[2 * d + 2] - gain[0] * g0 - gain[1] * g1;
            close("gain", &all.gain(c)[..2], &gain, 1e-10);
            close("conditional", &all.component_covariance(c)[..1], &spreads[c..=c], 1e-10);
        }
        let mean: f64 = (0..k).map(|c| beta[c] / sum * means[c]).sum();
        let variance: f64 = (0..k).map(|c| beta[c] / sum * (spreads[c] + (means[c] - mean) * (means[c] - mean))).sum();
        close("closed mean", &out.mean()[..1], &[mean], 1e-11);
        close("closed variance", &out.covariance()[..1], &[variance], 1e-10);
        close("density", &[out.log_density()], &[sum.ln()], 1e-12);
        close("shares", out.responsibilities(), &beta.iter().map(|b| b / sum).collect::<Vec<_>>(), 1e-11);
    }
}

#[test]
fn a_query_leaves_nothing_of_the_one_before() {
    let mixture = mixture(5, 3);
    let regressor = Regressor::new(&mixture, &[0, 1], &[2, 3, 4]).unwrap();
    let mut used = regressor.prediction();
    for x in [[0.1, 0.2], [-1.0, 3.0], [1e3, -1e3], [0.1, 0.2]] {
        regressor.predict_with_jacobian_into(&x, &mut used).unwrap();
        let mut fresh = regressor.prediction();
        regressor.predict_with_jacobian_into(&x, &mut fresh).unwrap();
        assert_eq!(used, fresh);
    }
    // A query for less leaves the rest as it was, as documented: zero until it is asked for.
    let mut fresh = regressor.prediction();
    regressor.predict_into(&[0.1, 0.2], &mut fresh).unwrap();
    assert!(fresh.jacobian().iter().all(|v| *v == 0.0) && fresh.covariance() == used.covariance());
}

#[test]
fn a_batch_is_its_single_queries() {
    let mixture = mixture(4, 5);
    let regressor = Regressor::new(&mixture, &[3, 1], &[0, 2]).unwrap();
    let queries: Vec<f64> = (0..14).map(|i| (f64::from(i) * 0.9).cos()).collect();
    let samples = Samples::new(&queries, 2).unwrap();
    let batch = regressor.predict_batch(&samples).unwrap();
    let means = regressor.predict_mean_batch(&samples).unwrap();
    let mut out = regressor.prediction();
    for i in 0..7 {
        regressor.predict_into(samples.row(i), &mut out).unwrap();
        assert_eq!(&batch.means[2 * i..2 * i + 2], out.mean());
        assert_eq!(&batch.covariances[4 * i..4 * i + 4], out.covariance());
    }
    assert_eq!(means, batch.means);
    let holed = [0.0, 1.0, f64::NAN, 0.0];
    let holed = Samples::new(&holed, 2).unwrap();
    assert!(matches!(regressor.predict_batch(&holed), Err(Error::NotFinite { .. })));
    assert!(matches!(regressor.predict_mean_batch(&holed), Err(Error::NotFinite { .. })));
}

#[test]
fn a_prediction_made_for_another_split_is_refused_whatever_differs() {
    let mixture = mixture(6, 3);
    let regressor = Regressor::new(&mixture, &[0, 1], &[2, 3]).unwrap();
    let mut own = regressor.prediction();
    assert_eq!(regressor.predict_into(&[0.0, 0.0], &mut own), Ok(()));
    // More inputs, fewer inputs, more outputs, fewer components: each alone.
    let others = [
        Regressor::new(&mixture, &[0, 1, 4], &[2, 3]).unwrap(),
        Regressor::new(&mixture, &[0], &[2, 3]).unwrap(),
        Regressor::new(&mixture, &[0, 1], &[2, 3, 5]).unwrap(),
        Regressor::new(&self::mixture(6, 2), &[0, 1], &[2, 3]).unwrap(),
        Regressor::new(&self::mixture(6, 11), &[0, 1], &[2, 3]).unwrap(),
    ];
    for other in &others {
        let refused = regressor.predict_into(&[0.0, 0.0], &mut other.prediction());
        assert!(matches!(refused, Err(Error::Length { .. })), "{refused:?}");
    }
}

#[test]
fn a_query_that_no_component_reaches_is_an_error_and_leaves_no_nan() {
    let narrow = Mixture::new(MixtureParts {
        kind: CovarianceKind::Diagonal,
        dim: 2,
        weights: vec![0.5, 0.5],
        means: vec![0.0, 1.0, 2.0, 3.0],
        covariances: vec![1e-100, 1.0, 1e-100, 1.0],
    })
    .unwrap();
    let regressor = Regressor::new(&narrow, &[0], &[1]).unwrap();
    let mut out = regressor.prediction();
    regressor.predict_with_jacobian_into(&[0.0], &mut out).unwrap();
    let refused = regressor.predict_with_jacobian_into(&[1e139], &mut out);
    assert_eq!(refused, Err(Error::NoSupport { components: 2 }));
    assert_eq!(out.responsibilities(), [0.0, 0.0]);
    assert!(out.log_density() == f64::NEG_INFINITY && out.mean().iter().all(|m| !m.is_nan()));
}
