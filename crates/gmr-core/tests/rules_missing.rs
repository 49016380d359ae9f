//! One EM step with missing values against the same step written with conditional mixtures.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{CovarianceKind, Error, GmmParams, MissingValues, Mixture, MixtureParts, Samples, Start};

const N: f64 = f64::NAN;

fn close(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "{what}: {a} is not {b}");
    }
}

fn start(shift: f64) -> Mixture {
    Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 3,
        weights: vec![0.3, 0.7],
        means: vec![shift, 1.0, -1.0, 0.5 + shift, -0.5, 0.4],
        covariances: vec![
            1.0, 0.3, 0.2, 0.3, 0.8, -0.1, 0.2, -0.1, 0.5, //
            0.6, -0.2, 0.1, -0.2, 0.9, 0.3, 0.1, 0.3, 0.7,
        ],
    })
    .unwrap()
}

fn one_step(mixture: &Mixture, values: &[f64], weights: &[f64]) -> (Mixture, gmr_core::FitReport) {
    let params = GmmParams {
        components: 2,
        start: Start::Mixture(Box::new(mixture.clone())),
        max_iterations: 1,
        floor: 0.0,
        missing: MissingValues::Marginalise,
        ..GmmParams::default()
    };
    let samples = Samples::new(values, 3).unwrap().with_weights(weights).unwrap();
    params.validate().unwrap().fit(&samples).unwrap()
}

/// The same step: responsibilities from marginals, moments of the hidden part from the component conditioned on the seen
/// part. Returns weights, means, covariances and the mean log-likelihood.
fn by_hand(mixture: &Mixture, values: &[f64], weights: &[f64]) -> (Vec<f64>, Vec<f64>, Vec<f64>, f64) {
    let (mut mass, mut first, mut second) = ([0.0; 2], [[0.0; 3]; 2], [[0.0; 9]; 2]);
    let (mut likelihood, mut total) = (0.0, 0.0);
    for (row, weight) in values.chunks_exact(3).zip(weights) {
        let seen: Vec<usize> = (0..3).filter(|&j| !row[j].is_nan()).collect();
        let hidden: Vec<usize> = (0..3).filter(|&j| row[j].is_nan()).collect();
        if seen.is_empty() || *weight == 0.0 {
            continue;
        }
        let x: Vec<f64> = seen.iter().map(|&j| row[j]).collect();
        let marginal = mixture.marginal(&seen).unwrap();
        likelihood += weight * marginal.log_density(&x).unwrap();
        total += weight;
        let shares = marginal.responsibilities(&Samples::new(&x, seen.len()).unwrap()).unwrap();
        let rest = (!hidden.is_empty() && hidden.len() < 3).then(|| mixture.condition(&seen, &x).unwrap());
        for c in 0..2 {
            let mut full = row.to_vec();
            let mut spread = [0.0; 9];
            if let Some(rest) = &rest {
                let covariance = rest.covariance(c);
                for (a, &i) in hidden.iter().enumerate() {
                    full[i] = rest.mean(c)[a];
                    for (b, &j) in hidden.iter().enumerate() {
                        spread[i * 3 + j] = covariance[a * hidden.len() + b];
                    }
                }
            }
            let r = weight * shares[c];
            mass[c] += r;
            for i in 0..3 {
                first[c][i] += r * full[i];
                for j in 0..3 {
                    second[c][i * 3 + j] += r * (full[i] * full[j] + spread[i * 3 + j]);
                }
            }
        }
    }
    let means: Vec<f64> = (0..6).map(|i| first[i / 3][i % 3] / mass[i / 3]).collect();
    let covariances = (0..18)
        .map(|i| {
            let (c, a, b) = (i / 9, i % 9 / 3, i % 3);
            second[c][a * 3 + b] / mass[c] - means[c * 3 + a] * means[c * 3 + b]
        })
        .collect();
    (mass.iter().map(|m| m / total).collect(), means, covariances, likelihood / total)
}

fn holed() -> (Vec<f64>, Vec<f64>) {
    let values = vec![
        0.3, N, -0.2, N, 0.9, N, 0.1, 0.2, 0.3, N, N, 0.8, 1.4, N, N, -0.6, 1.3, N, N, -0.8, 0.9, N, N, N, 0.7, -1.1,
        1.5, 0.2, 1.2, -1.4, 5.0, N, 5.0,
    ];
    (values, vec![1.0, 2.0, 1.0, 0.5, 1.0, 3.0, 1.0, 4.0, 1.0, 1.5, 0.0])
}

#[test]
fn a_step_with_gaps_is_that_of_the_conditional_mixtures() {
    let (values, weights) = holed();
    let (mixture, report) = one_step(&start(0.0), &values, &weights);
    let (shares, means, covariances, likelihood) = by_hand(&start(0.0), &values, &weights);
    close("likelihood", &report.history, &[likelihood], 1e-13);
    close("weights", mixture.weights(), &shares, 1e-13);
    close("means", mixture.means(), &means, 1e-13);
    close("covariances", mixture.covariances(), &covariances, 1e-12);
    let missing = report.missing.unwrap();
    // The row without any value and the one of weight zero are not used; seven others have gaps, and so has the latter.
    assert_eq!((missing.values, missing.partial_rows, missing.unused_rows), (13, 7, 2));
}

#[test]
fn a_step_from_far_away_is_taken_about_the_new_means() {
    // Means shifted by a thousand deviations in the first column: everything about the old mean loses six digits.
    let (values, weights) = holed();
    let far: Vec<f64> = values.iter().enumerate().map(|(i, v)| if i % 3 == 0 { v + 1000.0 } else { *v }).collect();
    let wide = {
        let mut parts = start(0.0).parts().clone();
        parts.covariances =
            parts.covariances.iter().enumerate().map(|(i, v)| if i % 9 == 0 { 1e6 } else { *v }).collect();
        Mixture::new(parts).unwrap()
    };
    let (mixture, report) = one_step(&wide, &far, &weights);
    let (_, means, ..) = by_hand(&wide, &far, &weights);
    close("means", mixture.means(), &means, 1e-12);
    // Rows that hide the first column spread it over the wide start, so nothing there is far in its own deviations;
    // with that column seen everywhere it is.
    assert_eq!(report.recentred, 0);
    let seen: Vec<f64> =
        far.iter().enumerate().map(|(i, v)| if i % 3 == 0 && v.is_nan() { 1000.2 } else { *v }).collect();
    let (mixture, report) = one_step(&wide, &seen, &weights);
    assert_eq!(report.recentred, 1);
    let origin: Vec<f64> = seen.iter().enumerate().map(|(i, v)| if i % 3 == 0 { v - 1000.0 } else { *v }).collect();
    let back = {
        let mut parts = wide.parts().clone();
        parts.means[0] -= 1000.0;
        parts.means[3] -= 1000.0;
        Mixture::new(parts).unwrap()
    };
    let (_, _, covariances, _) = by_hand(&back, &origin, &weights);
    close("covariances", mixture.covariances(), &covariances, 1e-10);
}

#[test]
fn complete_rows_give_the_same_fit_whether_or_not_gaps_are_allowed() {
    // One row without any value more: it takes no part, but all others go through the code for gaps.
    let values: Vec<f64> = (0..240).map(|i| f64::from(i / 3 % 2) * 3.0 + (f64::from(i) * 0.73).sin()).collect();
    let mut longer = values.clone();
    longer.extend([N; 3]);
    let start = Start::Mixture(Box::new(start(0.0)));
    let params = GmmParams { components: 2, start, missing: MissingValues::Marginalise, ..GmmParams::default() };
    let plan = params.validate().unwrap();
    let (a, ra) = plan.fit(&Samples::new(&values, 3).unwrap()).unwrap();
    let (b, rb) = plan.fit(&Samples::new(&longer, 3).unwrap()).unwrap();
    assert!(ra.missing.is_none());
    let missing = rb.missing.unwrap();
    assert_eq!((missing.values, missing.partial_rows, missing.unused_rows), (3, 0, 1));
    close("history", &rb.history, &ra.history, 1e-11);
    close("means", b.means(), a.means(), 1e-9);
    close("covariances", b.covariances(), a.covariances(), 1e-9);
    close("criteria", &[rb.bic, rb.aic], &[ra.bic, ra.aic], 1e-10);
}

#[test]
fn a_filled_row_keeps_what_was_seen_and_says_how_sure_the_rest_is() {
    let mixture = start(0.0);
    let nothing = mixture.fill(&[N; 3]).unwrap();
    let (mean, covariance) = mixture.moments();
    assert_eq!((nothing.values, nothing.covariance, nothing.hidden), (mean.clone(), covariance.clone(), vec![0, 1, 2]));
    // The moments of the whole: sum w m, and sum w (S + m m') - mean mean'.
    for i in 0..3 {
        let first: f64 = (0..2).map(|c| mixture.weights()[c] * mixture.mean(c)[i]).sum();
        close("mean", &[mean[i]], &[first], 1e-15);
        for j in 0..3 {
            let product = |c: usize| mixture.covariance(c)[i * 3 + j] + mixture.mean(c)[i] * mixture.mean(c)[j];
            let second: f64 = (0..2).map(|c| mixture.weights()[c] * product(c)).sum();
            close("covariance", &[covariance[i * 3 + j]], &[second - mean[i] * mean[j]], 1e-14);
        }
    }
    let everything = mixture.fill(&[0.1, 0.2, 0.3]).unwrap();
    assert!(everything.hidden.is_empty() && everything.covariance.is_empty());
    close("values", &everything.values, &[0.1, 0.2, 0.3], 0.0);
    close("density", &[everything.log_density], &[mixture.log_density(&[0.1, 0.2, 0.3]).unwrap()], 1e-14);
    assert!(matches!(mixture.fill(&[f64::INFINITY, N, 0.0]), Err(Error::NotFinite { .. })));
    assert!(matches!(mixture.fill(&[0.0, 0.0, f64::INFINITY]), Err(Error::NotFinite { .. })));
}
