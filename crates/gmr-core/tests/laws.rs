//! Laws that hold for every input, each tried on random cases.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    Arima, ArimaOrder, ArimaParams, CovarianceKind, Error, Fusion, FusionReading, GmmParams, MissingValues, Mixture,
    MixtureParts, Regressor, Samples, Start, mutual_support,
};
use proptest::prelude::*;

fn cases(n: u32) -> ProptestConfig {
    ProptestConfig { cases: n, failure_persistence: None, ..ProptestConfig::default() }
}

fn kinds() -> impl Strategy<Value = CovarianceKind> {
    prop_oneof![
        Just(CovarianceKind::Full),
        Just(CovarianceKind::Tied),
        Just(CovarianceKind::Diagonal),
        Just(CovarianceKind::Spherical),
    ]
}

fn starts() -> impl Strategy<Value = Start> {
    prop_oneof![Just(Start::KMeans), Just(Start::KMeansPlusPlus), Just(Start::RandomSamples)]
}

/// Rows of two or three loose clusters.
fn table() -> impl Strategy<Value = (usize, Vec<f64>)> {
    (1usize..4, 12usize..60).prop_flat_map(|(d, n)| {
        let cell = (0u8..3, -1.0f64..1.0).prop_map(|(c, v)| f64::from(c) * 1.5 + v);
        (Just(d), prop::collection::vec(cell, n * d))
    })
}

/// A mixture with well-conditioned covariances.
fn mixture(d: usize, k: usize) -> impl Strategy<Value = Mixture> {
    let weights = prop::collection::vec(0.05f64..1.0, k);
    let means = prop::collection::vec(-2.0f64..2.0, k * d);
    let factors = prop::collection::vec(-1.0f64..1.0, k * d * d);
    (weights, means, factors).prop_map(move |(mut weights, means, factors)| {
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        let covariances = factors
            .chunks_exact(d * d)
            .flat_map(|f| {
                (0..d * d).map(|i| {
                    let (a, b) = (i / d, i % d);
                    let product: f64 = (0..d).map(|l| f[a * d + l] * f[b * d + l]).sum();
                    product + if a == b { 0.1 } else { 0.0 }
                })
            })
            .collect();
        Mixture::new(MixtureParts { kind: CovarianceKind::Full, dim: d, weights, means, covariances }).unwrap()
    })
}

proptest! {
    #![proptest_config(cases(10_000))]

    #[test]
    fn likelihood_never_falls_in_plain_em((d, values) in table(), k in 1usize..4, kind in kinds(), start in starts(), seed in 0u64..1000) {
        let params = GmmParams { components: k, covariance: kind, start, seed, max_iterations: 40, tolerance: 0.0, floor: 1e-4, ..GmmParams::default() };
        let samples = Samples::new(&values, d).unwrap();
        match params.validate().unwrap().fit(&samples) {
            Ok((mixture, report)) => {
                for pair in report.history.windows(2) {
                    // Rounding of a sum of n log densities.
                    prop_assert!(pair[1] >= pair[0] - 1e-11 * (1.0 + pair[0].abs()), "{:?}", report.history);
                }
                let last = report.history[report.history.len() - 1];
                prop_assert!(report.log_likelihood / samples.total_weight() >= last - 1e-11 * (1.0 + last.abs()));
                prop_assert!((mixture.weights().iter().sum::<f64>() - 1.0).abs() < 1e-12);
                let direct = mixture.log_likelihood(&samples).unwrap();
                prop_assert!((report.log_likelihood - direct).abs() <= 1e-9 * (1.0 + direct.abs()));
            }
            Err(error) => prop_assert!(matches!(error, Error::AllRestartsFailed { .. }), "{error}"),
        }
    }
}

proptest! {
    #![proptest_config(cases(10_000))]

    #[test]
    fn likelihood_never_falls_with_missing_values((d, values) in table(), k in 1usize..3, kind in kinds(), holes in prop::collection::vec(0.0f64..1.0, 180)) {
        let holed: Vec<f64> = values.iter().zip(&holes).map(|(v, h)| if *h < 0.2 { f64::NAN } else { *v }).collect();
        let params = GmmParams { components: k, covariance: kind, max_iterations: 15, tolerance: 0.0, floor: 1e-4, missing: MissingValues::Marginalise, ..GmmParams::default() };
        let samples = Samples::new(&holed, d).unwrap();
        match params.validate().unwrap().fit(&samples) {
            Ok((mixture, report)) => {
                for pair in report.history.windows(2) {
                    prop_assert!(pair[1] >= pair[0] - 1e-11 * (1.0 + pair[0].abs()), "{:?}", report.history);
                }
                prop_assert!(mixture.means().iter().all(|v| v.is_finite()));
            }
            Err(error) => prop_assert!(matches!(error, Error::AllRestartsFailed { .. } | Error::TooFewSamples { .. }), "{error}"),
        }
    }

    #[test]
    fn responsibilities_sum_to_one(mixture in mixture(3, 4), x in prop::collection::vec(-1e3f64..1e3, 30)) {
        let responsibilities = mixture.responsibilities(&Samples::new(&x, 3).unwrap()).unwrap();
        for row in responsibilities.chunks_exact(4) {
            prop_assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(row.iter().all(|r| *r >= 0.0));
        }
    }

    #[test]
    fn relabelling_changes_nothing(mixture in mixture(3, 4), x in -3.0f64..3.0, order in Just(vec![0usize, 1, 2, 3]).prop_shuffle()) {
        let other = mixture.reordered(&order).unwrap();
        let (a, b) = (Regressor::new(&mixture, &[0], &[1, 2]).unwrap(), Regressor::new(&other, &[0], &[1, 2]).unwrap());
        let (mut pa, mut pb) = (a.prediction(), b.prediction());
        a.predict_with_jacobian_into(&[x], &mut pa).unwrap();
        b.predict_with_jacobian_into(&[x], &mut pb).unwrap();
        let both = pa.mean().iter().chain(pa.covariance()).chain(pa.jacobian()).zip(pb.mean().iter().chain(pb.covariance()).chain(pb.jacobian()));
        for (u, v) in both {
            prop_assert!((u - v).abs() <= 1e-11 * (1.0 + u.abs()));
        }
    }

    #[test]
    fn regression_is_equivariant_under_affine_maps(mixture in mixture(3, 3), x in -2.0f64..2.0, scale in 0.2f64..5.0, shift in prop::collection::vec(-10.0f64..10.0, 3), m in prop::collection::vec(-2.0f64..2.0, 4)) {
        // t' = scale t + shift_0; h' = M h + shift.
        let map = [scale, 0.0, 0.0, 0.0, m[0] + 3.0, m[1], 0.0, m[2], m[3] + 3.0];
        let apply = |v: &[f64]| -> Vec<f64> { (0..3).map(|i| shift[i] + (0..3).map(|j| map[i * 3 + j] * v[j]).sum::<f64>()).collect() };
        let means = (0..3).flat_map(|c| apply(mixture.mean(c))).collect();
        let covariances = (0..3).flat_map(|c| {
            let s = mixture.covariance(c);
            let mut out = vec![0.0; 9];
            for i in 0..3 { for j in 0..=i {
                let v: f64 = (0..3).map(|a| (0..3).map(|b| map[i * 3 + a] * s[a * 3 + b] * map[j * 3 + b]).sum::<f64>()).sum();
                out[i * 3 + j] = v;
                out[j * 3 + i] = v;
            } }
            out
        }).collect();
        let moved = Mixture::new(MixtureParts { kind: CovarianceKind::Full, dim: 3, weights: mixture.weights().to_vec(), means, covariances }).unwrap();
        let (a, b) = (Regressor::new(&mixture, &[0], &[1, 2]).unwrap(), Regressor::new(&moved, &[0], &[1, 2]).unwrap());
        let (mut pa, mut pb) = (a.prediction(), b.prediction());
        a.predict_into(&[x], &mut pa).unwrap();
        b.predict_into(&[scale * x + shift[0]], &mut pb).unwrap();
        let expected = apply(&[0.0, pa.mean()[0], pa.mean()[1]]);
        for i in 0..2 {
            prop_assert!((pb.mean()[i] - expected[1 + i]).abs() < 1e-9 * (1.0 + expected[1 + i].abs()));
            for j in 0..2 {
                let v: f64 = (0..2).map(|a| (0..2).map(|b| map[(1 + i) * 3 + 1 + a] * pa.covariance()[a * 2 + b] * map[(1 + j) * 3 + 1 + b]).sum::<f64>()).sum();
                prop_assert!((pb.covariance()[i * 2 + j] - v).abs() < 1e-9 * (1.0 + v.abs()));
            }
        }
    }

    #[test]
    fn conditional_covariance_is_positive_and_below_the_marginal(mixture in mixture(3, 3), x in -5.0f64..5.0) {
        let regressor = Regressor::new(&mixture, &[0], &[1, 2]).unwrap();
        let mut out = regressor.prediction();
        regressor.predict_into(&[x], &mut out).unwrap();
        let positive = |v: &[f64]| v[0] > 0.0 && v[0] * v[3] - v[1] * v[2] > 0.0;
        prop_assert!(positive(out.covariance()));
        prop_assert!(out.covariance()[1].to_bits() == out.covariance()[2].to_bits());
        for c in 0..3 {
            let (s, inner) = (mixture.covariance(c), regressor.component_covariance(c));
            prop_assert!(positive(inner));
            // Marginal minus conditional is S_oi S_ii^-1 S_io: positive semidefinite of rank one.
            let gap = [s[4] - inner[0], s[5] - inner[1], s[7] - inner[2], s[8] - inner[3]];
            prop_assert!(gap[0] >= -1e-12 && gap[3] >= -1e-12 && gap[0] * gap[3] - gap[1] * gap[2] >= -1e-10);
        }
    }

    #[test]
    fn integer_weights_equal_repeated_rows((d, values) in table(), k in 1usize..3, repeats in prop::collection::vec(0u8..4, 60)) {
        let n = values.len() / d;
        let weights: Vec<f64> = repeats[..n].iter().map(|r| f64::from(*r)).collect();
        prop_assume!(weights.iter().filter(|w| **w > 0.0).count() >= 6);
        let repeated: Vec<f64> = (0..n).flat_map(|i| std::iter::repeat_n(&values[i * d..(i + 1) * d], repeats[i] as usize).flatten().copied()).collect();
        let start = MixtureParts { kind: CovarianceKind::Full, dim: d, weights: vec![1.0 / k as f64; k], means: values[..k * d].to_vec(),
            covariances: (0..k * d * d).map(|i| if (i / d) % d == i % d { 2.0 } else { 0.0 }).collect() };
        let params = GmmParams { components: k, start: Start::Mixture(Box::new(Mixture::new(start).unwrap())), max_iterations: 5, tolerance: 0.0, floor: 1e-3, ..GmmParams::default() };
        let plan = params.validate().unwrap();
        let a = plan.fit(&Samples::new(&values, d).unwrap().with_weights(&weights).unwrap());
        let b = plan.fit(&Samples::new(&repeated, d).unwrap());
        if let (Ok((a, _)), Ok((b, _))) = (a, b) {
            for (u, v) in a.means().iter().chain(a.covariances()).zip(b.means().iter().chain(b.covariances())) {
                prop_assert!((u - v).abs() < 1e-8 * (1.0 + v.abs()), "{u} {v}");
            }
        }
    }

    #[test]
    fn support_weights_are_a_distribution(r in prop::collection::vec(0.0f64..1e6, 1..9)) {
        let omega = mutual_support(&r);
        prop_assert!((omega.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        prop_assert!(omega.iter().all(|w| *w >= 0.0));
    }

    #[test]
    fn hostile_tables_never_panic_and_never_give_nan(
        d in 1usize..4, n in 1usize..12, k in 1usize..5, kind in kinds(), start in starts(), restarts in 1usize..3,
        floor in prop_oneof![Just(0.0), Just(1e-9)], exponent in -320i32..309, pattern in 0u8..5,
        cells in prop::collection::vec(prop_oneof![9 => -1.0f64..1.0, 1 => Just(0.0)], 48), hole in 0usize..200,
    ) {
        let scale = 10f64.powi(exponent);
        let mut values: Vec<f64> = (0..n * d).map(|i| match pattern {
            0 => cells[i] * scale,
            1 => cells[i % d] * scale,                       // duplicates
            2 => cells[i / d] * scale,                       // collinear
            3 => if i % d == 0 { cells[i] * scale } else { cells[i] / scale.clamp(1e-100, 1e100) },
            _ => (cells[i] * 3.0).round() * scale,           // few distinct points
        }).collect();
        if hole < values.len() {
            values[hole] = f64::NAN;
        }
        let Ok(samples) = Samples::new(&values, d) else { return Ok(()) };
        for missing in [MissingValues::Refuse, MissingValues::Marginalise] {
            let params = GmmParams { components: k, covariance: kind, start: start.clone(), restarts, floor, missing, max_iterations: 20, ..GmmParams::default() };
            if let Ok((mixture, report)) = params.validate().unwrap().fit(&samples) {
                prop_assert!(mixture.means().iter().chain(mixture.covariances()).chain(mixture.weights()).all(|v| v.is_finite()));
                prop_assert!(report.log_likelihood.is_finite() && report.bic.is_finite());
                prop_assert!(report.history.iter().all(|v| v.is_finite()));
                if d > 1 && let Ok(regressor) = Regressor::new(&mixture, &[0], &[1]) {
                    let mut out = regressor.prediction();
                    for x in [values[0], 0.0, scale, 1e300] {
                        if regressor.predict_with_jacobian_into(&[x], &mut out).is_ok() {
                            prop_assert!(out.mean().iter().chain(out.covariance()).all(|v| !v.is_nan()));
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn hostile_series_never_panic_and_never_give_nan(
        p in 0usize..4, d in 0usize..3, q in 0usize..4, n in 0usize..30, exponent in -320i32..309, pattern in 0u8..4, constant: bool,
        cells in prop::collection::vec(-1.0f64..1.0, 30), hole in 0usize..60,
    ) {
        let scale = 10f64.powi(exponent);
        let mut y: Vec<f64> = (0..n).map(|i| match pattern {
            0 => cells[i] * scale,
            1 => scale,
            2 => i as f64 * scale,
            _ => (cells[i] * 2.0).round() * scale,
        }).collect();
        if hole < n {
            y[hole] = f64::NAN;
        }
        let params = ArimaParams { order: ArimaOrder { p, d, q }, constant, max_iterations: 30, ..ArimaParams::default() };
        if let Ok((model, report)) = params.validate().unwrap().fit(&y) {
            prop_assert!(report.log_likelihood.is_finite() && report.bic.is_finite());
            let parts = model.parts();
            prop_assert!(parts.ar.iter().chain(&parts.ma).all(|c| c.is_finite()) && parts.variance > 0.0 && parts.mean.is_finite());
            let run = model.filter(&y).unwrap();
            prop_assert!(run.state.forecast(3).iter().all(|f| !f.mean.is_nan() && f.variance > 0.0));
        }
    }
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn arima_is_equivariant_under_scaling_and_shifting(seed in 0u64..10_000, scale in 0.001f64..1000.0, shift in -100.0f64..100.0) {
        let mut state = seed;
        let mut next = || { state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407); (state >> 11) as f64 * 2f64.powi(-53) - 0.5 };
        let mut w = vec![0.0; 60];
        for t in 1..60 { w[t] = 0.6 * w[t - 1] + next(); }
        let moved: Vec<f64> = w.iter().map(|v| v * scale + shift).collect();
        let plan = ArimaParams { order: ArimaOrder { p: 1, d: 0, q: 0 }, constant: true, tolerance: 1e-8, ..ArimaParams::default() }.validate().unwrap();
        let ((a, ra), (b, rb)) = (plan.fit(&w).unwrap(), plan.fit(&moved).unwrap());
        prop_assert!((a.parts().ar[0] - b.parts().ar[0]).abs() < 1e-5);
        prop_assert!((a.parts().mean * scale + shift - b.parts().mean).abs() < 1e-4 * scale.max(1.0));
        prop_assert!((ra.log_likelihood - 60.0 * scale.ln() - rb.log_likelihood).abs() < 1e-6);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_at_any_thread_count() {
    let values: Vec<f64> =
        (0..30_000).map(|i| (f64::from(i) * 0.37).sin() * 3.0 + (f64::from(i) * 0.011).cos()).collect();
    let holed: Vec<f64> =
        values.iter().take(6000).enumerate().map(|(i, v)| if i % 13 == 0 { f64::NAN } else { *v }).collect();
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let params = GmmParams { components: 4, restarts: 3, max_iterations: 20, seed: 7, ..GmmParams::default() };
            let plan = params.clone().validate().unwrap();
            let dense = plan.fit(&Samples::new(&values, 3).unwrap()).unwrap();
            let gaps = GmmParams { missing: MissingValues::Marginalise, ..params }.validate().unwrap();
            let gaps = gaps.fit(&Samples::new(&holed, 3).unwrap()).unwrap();
            serde_json::to_string(&(dense, gaps)).unwrap()
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(3) && one == run(8));
}

#[test]
fn the_literal_reading_of_fusion_is_plain_em_and_the_working_one_is_not() {
    let values: Vec<f64> = (0..300).map(|i| f64::from(i % 3) * 6.0 + (f64::from(i) * 0.7).sin()).collect();
    let errors: Vec<f64> = (0..300).map(|i| if i % 3 == 0 { 3.0 } else { 0.5 }).collect();
    let samples = Samples::new(&values, 1).unwrap();
    let plan = GmmParams { components: 3, ..GmmParams::default() }.validate().unwrap();
    let plain = plan.fit(&samples).unwrap();
    let literal = plan.fit_fused(&samples, &Fusion::new(&errors, FusionReading::Literal).unwrap()).unwrap();
    assert_eq!(plain.1.history.len(), literal.1.history.len());
    for (a, b) in plain.1.history.iter().zip(&literal.1.history) {
        assert!((a - b).abs() < 1e-13);
    }
    for step in &literal.1.fusion.unwrap().steps {
        assert!((step.mass - 0.5).abs() < 1e-12 && step.omega == [0.5, 0.5] && step.largest_change < 1e-12);
    }
    let working = plan.fit_fused(&samples, &Fusion::new(&errors, FusionReading::Components).unwrap()).unwrap();
    // The component that explains the badly predicted third loses weight.
    let share = |m: &Mixture| {
        let nearest = (0..3).min_by(|&a, &b| m.mean(a)[0].abs().total_cmp(&m.mean(b)[0].abs())).unwrap();
        m.weights()[nearest]
    };
    assert!(share(&working.0) < share(&plain.0) - 0.02, "{} {}", share(&working.0), share(&plain.0));
    assert_eq!(working.1.fusion.unwrap().steps.len(), working.1.iterations);
}

#[test]
fn an_empty_and_a_collapsed_component_are_typed_outcomes() {
    // Two exact points cannot carry a full covariance without a floor.
    let values = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0];
    let samples = Samples::new(&values, 2).unwrap();
    let collapse = GmmParams { components: 2, floor: 0.0, ..GmmParams::default() }.validate().unwrap().fit(&samples);
    assert!(matches!(collapse, Err(Error::AllRestartsFailed { .. })));
    let (_, report) =
        GmmParams { components: 2, floor: 1e-6, ..GmmParams::default() }.validate().unwrap().fit(&samples).unwrap();
    assert_eq!(report.regularisation.floored.len(), 2);
    assert!(report.regularisation.floored.iter().all(|f| f.last_iteration == report.iterations));
    // Three components for two distinct points: one starts empty.
    let empty = GmmParams { components: 3, start: Start::KMeansPlusPlus, ..GmmParams::default() }
        .validate()
        .unwrap()
        .fit(&samples);
    assert!(matches!(empty, Err(Error::AllRestartsFailed { .. })));
}

#[test]
fn a_gap_in_an_arima_series_is_bridged_with_growing_variance() {
    let y: Vec<f64> = (0..80)
        .map(|i| {
            if (30..35).contains(&i) { f64::NAN } else { (f64::from(i) * 0.4).sin() + 0.1 * (f64::from(i) * 2.9).cos() }
        })
        .collect();
    let plan = ArimaParams { order: ArimaOrder { p: 2, d: 1, q: 0 }, constant: false, ..ArimaParams::default() }
        .validate()
        .unwrap();
    let (model, report) = plan.fit(&y).unwrap();
    assert_eq!((report.missing, report.observations), (5, 74));
    let run = model.filter(&y).unwrap();
    assert!(run.residuals[30..35].iter().all(Option::is_none) && run.residuals[0].is_none());
    assert!(run.residuals[35].unwrap().variance > 3.0 * run.residuals[29].unwrap().variance);
    let back: Arima = serde_json::from_str(&serde_json::to_string(&model).unwrap()).unwrap();
    assert!((back.log_likelihood(&y).unwrap() - report.log_likelihood).abs() < 1e-8);
}
