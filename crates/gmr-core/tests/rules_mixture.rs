//! What counts as a mixture, and what its samples, zero weights and empty tables mean.

use gmr_core::{CovarianceKind, Error, Mixture, MixtureParts, Regressor, Samples};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

fn plane(weights: Vec<f64>, means: Vec<f64>, covariances: Vec<f64>) -> MixtureParts {
    MixtureParts { kind: CovarianceKind::Full, dim: 2, weights, means, covariances }
}

#[test]
fn weights_sum_to_one_within_a_billionth_on_either_side_and_none_is_negative() {
    let with = |weights: [f64; 2]| {
        Mixture::new(plane(weights.to_vec(), vec![0.0; 4], [1.0, 0.0, 0.0, 1.0].repeat(2))).map(|_| ())
    };
    for off in [0.0, 5e-10, -5e-10] {
        assert_eq!(with([0.5, 0.5 + off]), Ok(()));
    }
    for off in [2e-9, -2e-9, 1e-4, -1e-4] {
        assert!(matches!(with([0.5, 0.5 + off]), Err(Error::WeightsNotNormalised { .. })), "{off}");
    }
    for weights in [[-0.25, 1.25], [-1e-12, 1.0], [1.25, -0.25]] {
        assert!(matches!(with(weights), Err(Error::InvalidParameter { name: "weight", .. })), "{weights:?}");
    }
}

#[test]
fn asymmetry_is_judged_beside_the_deviations_of_the_two_columns() {
    let with = |scale: f64, off: f64| {
        let covariance = vec![scale, 0.5 * scale, (0.5 + off) * scale, scale];
        Mixture::new(plane(vec![1.0], vec![0.0; 2], covariance)).map(|_| ())
    };
    for scale in [1e-20, 1.0, 1e20] {
        assert_eq!(with(scale, 1e-10), Ok(()), "rounding at {scale:e}");
        for off in [1e-8, -1e-8, 1e-4] {
            let refused = with(scale, off);
            assert!(matches!(refused, Err(Error::InvalidParameter { name: "covariance asymmetry", .. })), "{scale:e}");
        }
    }
}

#[test]
fn a_variance_without_full_precision_is_no_variance() {
    // 1e-310 is above zero but has lost digits: one over its root times a distance would not have them either.
    for (kind, covariances) in [
        (CovarianceKind::Full, vec![1.0, 0.0, 0.0, 1e-310]),
        (CovarianceKind::Tied, vec![1.0, 0.0, 0.0, 1e-310]),
        (CovarianceKind::Diagonal, vec![1.0, 1e-310]),
        (CovarianceKind::Spherical, vec![1e-310]),
    ] {
        let refused = Mixture::new(MixtureParts { kind, dim: 2, weights: vec![1.0], means: vec![0.0; 2], covariances });
        let pivot = usize::from(kind != CovarianceKind::Spherical);
        assert!(
            matches!(refused, Err(Error::NotPositiveDefinite { index: 0, pivot: p, .. }) if p == pivot),
            "{kind:?}"
        );
    }
}

#[test]
fn a_component_of_weight_zero_takes_part_in_nothing() {
    let single = Mixture::new(plane(vec![1.0], vec![3.0, 1.0], vec![1.0, 0.3, 0.3, 0.5])).unwrap();
    // The first component has no weight, and the queries lie in its middle.
    let means = vec![-40.0, 2.0, 3.0, 1.0];
    let pair = Mixture::new(plane(vec![0.0, 1.0], means, [1.0, 0.3, 0.3, 0.5].repeat(2))).unwrap();
    let x = [-40.0, 2.0, -39.0, 2.0];
    let samples = Samples::new(&x, 2).unwrap();
    assert_eq!(pair.log_densities(&samples).unwrap(), single.log_densities(&samples).unwrap());
    assert_eq!(pair.responsibilities(&samples).unwrap(), [0.0, 1.0, 0.0, 1.0]);
    let (a, b) = (Regressor::new(&pair, &[0], &[1]).unwrap(), Regressor::new(&single, &[0], &[1]).unwrap());
    let (mut pa, mut pb) = (a.prediction(), b.prediction());
    a.predict_with_jacobian_into(&[-40.0], &mut pa).unwrap();
    b.predict_with_jacobian_into(&[-40.0], &mut pb).unwrap();
    assert_eq!((pa.mean(), pa.covariance(), pa.jacobian()), (pb.mean(), pb.covariance(), pb.jacobian()));
    assert!((pa.log_density() - pb.log_density()).abs() < 1e-12 * pb.log_density().abs());
    let filled = pair.fill(&[-40.0, f64::NAN]).unwrap();
    assert!((filled.values[1] - pb.mean()[0]).abs() < 1e-12);
    // Nothing is drawn from it either.
    let (_, labels) = pair.sample(500, &mut ChaCha8Rng::seed_from_u64(1));
    assert!(labels.iter().all(|c| *c == 1));
}

#[test]
fn samples_have_the_shares_means_and_covariances_of_their_components() {
    let weights = vec![0.2, 0.5, 0.3];
    let means = vec![0.0, 0.0, 10.0, -5.0, -20.0, 3.0];
    let covariances = vec![1.0, 0.9, 0.9, 2.0, 4.0, -1.0, -1.0, 0.5, 0.1, 0.0, 0.0, 9.0];
    let mixture = Mixture::new(plane(weights.clone(), means.clone(), covariances.clone())).unwrap();
    let n = 60_000;
    let (values, labels) = mixture.sample(n, &mut ChaCha8Rng::seed_from_u64(42));
    assert_eq!((values.len(), labels.len()), (2 * n, n));
    for c in 0..3 {
        let mine: Vec<&[f64]> =
            values.chunks_exact(2).zip(&labels).filter(|(_, l)| **l == c).map(|(row, _)| row).collect();
        let m = mine.len() as f64;
        // Five standard errors of a share, a mean and a second moment.
        let p = weights[c];
        assert!((m / n as f64 - p).abs() < 5.0 * (p * (1.0 - p) / n as f64).sqrt());
        let mean: Vec<f64> = (0..2).map(|j| mine.iter().map(|r| r[j]).sum::<f64>() / m).collect();
        for i in 0..2 {
            let variance = covariances[c * 4 + i * 3];
            assert!((mean[i] - means[2 * c + i]).abs() < 5.0 * (variance / m).sqrt());
            for j in 0..2 {
                let product = mine.iter().map(|r| (r[i] - mean[i]) * (r[j] - mean[j])).sum::<f64>() / m;
                let expected = covariances[c * 4 + 2 * i + j];
                let spread = variance * covariances[c * 4 + j * 3] + expected * expected;
                assert!((product - expected).abs() < 5.0 * (spread / m).sqrt(), "{c} {i} {j}: {product}");
            }
        }
    }
}

#[test]
fn an_empty_table_has_no_densities_and_likelihood_zero() {
    let mixture = Mixture::new(plane(vec![1.0], vec![0.0; 2], vec![1.0, 0.0, 0.0, 1.0])).unwrap();
    let none = Samples::new(&[], 2).unwrap();
    assert!(mixture.log_densities(&none).unwrap().is_empty());
    assert!(mixture.responsibilities(&none).unwrap().is_empty());
    assert!(mixture.log_likelihood(&none).unwrap().abs() < f64::MIN_POSITIVE);
}

#[test]
fn the_largest_magnitude_allowed_is_allowed() {
    let x = [1e140, -1e140];
    assert_eq!(Samples::new(&x, 2).unwrap().len(), 1);
    assert_eq!(Samples::new(&x, 2).unwrap().with_weights(&[1e140]).unwrap().weight(0).to_bits(), 1e140f64.to_bits());
    let wide = Mixture::new(plane(vec![1.0], x.to_vec(), vec![1e250, 0.0, 0.0, 1e250])).unwrap();
    assert!(wide.log_density(&[1e140, -1e140]).unwrap().is_finite());
    let regressor = Regressor::new(&wide, &[0], &[1]).unwrap();
    let mut out = regressor.prediction();
    regressor.predict_into(&[-1e140], &mut out).unwrap();
    assert!((out.mean()[0] + 1e140).abs() < 1e126);
}

#[test]
fn covariances_of_every_kind_have_the_parameters_of_the_textbook() {
    // k = 3, d = 4: 3 means of 4, 2 free weights, and the covariance's own.
    for (kind, stored, own) in [
        (CovarianceKind::Full, 48, 30),
        (CovarianceKind::Tied, 16, 10),
        (CovarianceKind::Diagonal, 12, 12),
        (CovarianceKind::Spherical, 3, 3),
    ] {
        let covariances = match kind {
            CovarianceKind::Full | CovarianceKind::Tied => {
                (0..stored).map(|i| if i % 16 % 5 == 0 { 1.0 } else { 0.0 }).collect()
            }
            _ => vec![1.0; stored],
        };
        let weights = vec![0.25, 0.25, 0.5];
        let mixture = Mixture::new(MixtureParts { kind, dim: 4, weights, means: vec![0.0; 12], covariances }).unwrap();
        assert_eq!(mixture.parameters(), own + 12 + 2, "{kind:?}");
    }
}
