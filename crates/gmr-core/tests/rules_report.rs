//! A fit's report says what was done: why it stopped, what was lifted, what was taken again, what failed where.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    CovarianceKind, Error, FitReport, GmmParams, MissingValues, Mixture, MixtureParts, RestartOutcome, Samples, Start,
    Stop,
};

fn close(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "{what}: {a} is not {b}");
    }
}

fn fit(params: GmmParams, values: &[f64], dim: usize) -> Result<(Mixture, FitReport), Error> {
    params.validate().unwrap().fit(&Samples::new(values, dim).unwrap())
}

fn normals(means: Vec<f64>, covariances: Vec<f64>) -> Mixture {
    let weights = vec![1.0 / means.len() as f64; means.len()];
    Mixture::new(MixtureParts { kind: CovarianceKind::Full, dim: 1, weights, means, covariances }).unwrap()
}

fn warm(mixture: Mixture) -> GmmParams {
    GmmParams { components: mixture.components(), start: Start::Mixture(Box::new(mixture)), ..GmmParams::default() }
}

/// Two overlapping groups, slowly told apart.
fn overlapping() -> Vec<f64> {
    (0..200).map(|i| f64::from(i % 2) * 2.0 + (f64::from(i) * 0.7).sin() + 0.5 * (f64::from(i) * 1.9).cos()).collect()
}

#[test]
fn a_fit_stops_at_the_first_change_below_the_tolerance_and_not_before() {
    // Heights of 1e4 give a mean log-likelihood near -10: a tolerance relative to it would stop sooner.
    let values: Vec<f64> = overlapping().iter().map(|v| 1e4 * v).collect();
    for (shrinkage, ridge) in [(0.0, 0.0), (0.3, 1e7)] {
        let params = GmmParams { components: 2, tolerance: 1e-4, shrinkage, ridge, ..GmmParams::default() };
        let (_, report) = fit(params, &values, 1).unwrap();
        let changes: Vec<f64> = report.history.windows(2).map(|h| h[1] - h[0]).collect();
        let (last, before) = changes.split_last().unwrap();
        assert!(last.abs() < 1e-4 && before.iter().all(|c| c.abs() >= 1e-4), "{changes:?}");
        let Stop::Converged { change } = report.stop else { panic!("{:?}", report.stop) };
        close("change", &[change], &[*last], 1e-15);
        assert_eq!(report.iterations, report.history.len());
    }
}

#[test]
fn a_fall_larger_than_the_tolerance_is_no_convergence() {
    // Fusion may lose likelihood: the run goes on until it stands still.
    let values = overlapping();
    let errors: Vec<f64> = values.iter().map(|v| if *v < 0.5 { 4.0 } else { 0.1 }).collect();
    let fusion = gmr_core::Fusion::new(&errors, gmr_core::FusionReading::Components).unwrap();
    let plan = GmmParams { components: 3, tolerance: 1e-7, ..GmmParams::default() }.validate().unwrap();
    let (_, report) = plan.fit_fused(&Samples::new(&values, 1).unwrap(), &fusion).unwrap();
    let changes: Vec<f64> = report.history.windows(2).map(|h| h[1] - h[0]).collect();
    assert!(changes.iter().any(|c| *c < -1e-7), "no step fell, so nothing was tried: {changes:?}");
    let (_, before) = changes.split_last().unwrap();
    assert!(before.iter().all(|c| c.abs() >= 1e-7), "{changes:?}");
}

#[test]
fn with_tolerance_zero_every_iteration_is_done() {
    // One component stands still after one iteration, exactly.
    let params = GmmParams { tolerance: 0.0, max_iterations: 7, ..GmmParams::default() };
    let (_, report) = fit(params, &overlapping(), 1).unwrap();
    assert_eq!((report.iterations, report.history.len()), (7, 7));
    assert!(matches!(report.stop, Stop::IterationLimit { .. }));
}

#[test]
fn the_kept_restart_is_the_first_of_the_best_and_the_report_is_its_own() {
    // Six groups and random starts: several optima, some reached more than once.
    let values: Vec<f64> = (0..240).map(|i| f64::from(i % 6) * 3.0 + (f64::from(i) * 0.37).sin()).collect();
    let params = GmmParams { components: 6, start: Start::RandomSamples, restarts: 12, ..GmmParams::default() };
    let (mixture, report) = fit(params.clone(), &values, 1).unwrap();
    let found: Vec<f64> = report.restarts.iter().map(|r| r.log_likelihood.unwrap_or(f64::NEG_INFINITY)).collect();
    let best = found.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let spread = best - found.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(spread > 1e-3, "every start ends alike, so nothing was chosen: {found:?}");
    assert_eq!(report.best_restart, found.iter().position(|l| l.to_bits() == best.to_bits()).unwrap());
    close("likelihood", &[report.log_likelihood / 240.0], &[best], 1e-12);
    let samples = Samples::new(&values, 1).unwrap();
    close("mixture", &[mixture.log_likelihood(&samples).unwrap()], &[report.log_likelihood], 1e-12);
    assert_eq!(report.restarts[report.best_restart].iterations, report.iterations);
    // Another seed starts elsewhere.
    let (_, other) = fit(GmmParams { seed: 1, ..params.clone() }, &values, 1).unwrap();
    assert_ne!(report.restarts, other.restarts);
    // Equal restarts: a warm start is one, and twelve equal ones of a single component keep the first.
    let (_, equal) = fit(GmmParams { components: 1, ..params }, &values, 1).unwrap();
    assert_eq!(equal.best_restart, 0);
}

#[test]
fn the_floor_reports_where_when_how_often_and_how_low_it_acted() {
    // Hard clusters {0, 1, 2} and {10, 11, 12} have variance 2/3; with a floor of 100 both soft components then spread
    // over everything (variance up to 26), still below the floor.
    let values = [0.0, 1.0, 2.0, 10.0, 11.0, 12.0];
    for covariance in [CovarianceKind::Full, CovarianceKind::Diagonal, CovarianceKind::Spherical] {
        let params = GmmParams {
            components: 2,
            covariance,
            floor: 100.0,
            max_iterations: 5,
            tolerance: 0.0,
            ..GmmParams::default()
        };
        let (mixture, report) = fit(params, &values, 1).unwrap();
        close("variances", mixture.covariances(), &[100.0, 100.0], 1e-14);
        let mut floored = report.regularisation.floored.clone();
        floored.sort_by_key(|f| f.component);
        assert_eq!(floored.iter().map(|f| f.component).collect::<Vec<_>>(), [0, 1]);
        for f in floored {
            assert_eq!((f.first_iteration, f.last_iteration, f.times), (0, 5, 6), "{covariance:?}");
            close("smallest", &[f.smallest_eigenvalue], &[2.0 / 3.0], 1e-12);
        }
        assert!((report.regularisation.floor - 100.0).abs() < 1e-12);
    }
}

#[test]
fn shrinkage_and_ridge_are_those_of_their_formula_in_every_kind() {
    // One component: (1 - l) S + l trace(S)/d I + ridge I; floor 0.
    let values = [0.0, 0.0, 2.0, 1.0, 1.0, 3.0, -1.0, 0.5];
    let n = 4.0;
    let mean = [0.5, 1.125];
    let s = |i: usize, j: usize| values.chunks(2).map(|r| (r[i] - mean[i]) * (r[j] - mean[j])).sum::<f64>() / n;
    let (l, ridge) = (0.25, 0.125);
    let t = 0.5 * (s(0, 0) + s(1, 1));
    let full = vec![
        (1.0 - l) * s(0, 0) + l * t + ridge,
        (1.0 - l) * s(0, 1),
        (1.0 - l) * s(0, 1),
        (1.0 - l) * s(1, 1) + l * t + ridge,
    ];
    for (covariance, expected) in [
        (CovarianceKind::Full, full.clone()),
        (CovarianceKind::Tied, full.clone()),
        (CovarianceKind::Diagonal, vec![full[0], full[3]]),
        (CovarianceKind::Spherical, vec![t + ridge]),
    ] {
        let params = GmmParams { covariance, shrinkage: l, ridge, floor: 0.0, ..GmmParams::default() };
        let (mixture, report) = fit(params, &values, 2).unwrap();
        close(&format!("{covariance:?}"), mixture.covariances(), &expected, 1e-13);
        assert!((report.regularisation.shrinkage - l).abs() + (report.regularisation.ridge - ridge).abs() < 1e-15);
        assert!(report.regularisation.floored.is_empty());
    }
}

#[test]
fn a_floor_above_the_ridge_acts_beside_it() {
    // Duplicates have variance 0; the ridge lifts it to 0.5, the floor to 2.
    let values = [1.0, 1.0, 1.0];
    for covariance in [CovarianceKind::Full, CovarianceKind::Diagonal] {
        let params = GmmParams { covariance, ridge: 0.5, floor: 2.0, ..GmmParams::default() };
        let (mixture, report) = fit(params, &values, 1).unwrap();
        close("variance", mixture.covariances(), &[2.0], 1e-14);
        close("found", &[report.regularisation.floored[0].smallest_eigenvalue], &[0.5], 1e-14);
    }
}

#[test]
fn a_component_that_moves_by_many_of_its_deviations_is_taken_again_about_its_new_mean() {
    // The start lies 1e4 deviations away; about it, the second moment is 1e8 times the variance.
    let values: Vec<f64> = (0..64).map(|i| 1e4 + (f64::from(i) * 0.9).sin()).collect();
    let mean = values.iter().sum::<f64>() / 64.0;
    let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / 64.0;
    let params = GmmParams { max_iterations: 1, ..warm(normals(vec![0.0], vec![1e8])) };
    let (mixture, report) = fit(params, &values, 1).unwrap();
    assert_eq!(report.recentred, 1);
    close("variance", mixture.covariances(), &[variance], 1e-13);
    // From its own maximum nothing moves, and nothing is taken again.
    let (_, report) = fit(warm(normals(vec![mean], vec![variance])), &values, 1).unwrap();
    assert_eq!(report.recentred, 0);
    // Thirty deviations and less lose no more than three digits of sixteen.
    let (_, report) =
        fit(GmmParams { max_iterations: 1, ..warm(normals(vec![1e4 - 20.0], vec![500.0])) }, &values, 1).unwrap();
    assert_eq!(report.recentred, 0);
    let (_, report) =
        fit(GmmParams { max_iterations: 1, ..warm(normals(vec![1e4 - 40.0], vec![500.0])) }, &values, 1).unwrap();
    assert_eq!(report.recentred, 1);
}

#[test]
fn a_start_that_no_sample_reaches_and_a_component_that_collapses_are_named_with_their_iteration() {
    let out = |result: Result<(Mixture, FitReport), Error>| {
        let Err(Error::AllRestartsFailed { restarts }) = result else { panic!("{result:?}") };
        assert!(restarts.iter().all(|r| r.log_likelihood.is_none()));
        (restarts[0].outcome, restarts[0].iterations)
    };
    let far = out(fit(warm(normals(vec![0.0], vec![1e-200])), &[1e100, 2e100], 1));
    assert_eq!(far, (RestartOutcome::NoSupport { iteration: 1 }, 1));
    let holed = GmmParams { missing: MissingValues::Marginalise, ..warm(normals(vec![0.0], vec![1e-200])) };
    assert_eq!(out(fit(holed, &[1e100, f64::NAN], 1)), (RestartOutcome::NoSupport { iteration: 1 }, 1));
    // The second component has nothing but duplicates.
    let params = GmmParams { floor: 0.0, ..warm(normals(vec![0.0, 50.0], vec![1.0, 1.0])) };
    let (outcome, iterations) = out(fit(params, &[-1.0, 1.0, 0.3, 50.0, 50.0], 1));
    let RestartOutcome::CollapsedComponent { component, iteration, pivot } = outcome else { panic!("{outcome:?}") };
    assert_eq!((component, iteration, iterations), (1, 1, 1));
    assert!(pivot.abs() < 1e-12, "{pivot}");
}

#[test]
fn a_mixture_that_no_longer_reaches_a_sample_it_was_fitted_to_is_no_fit() {
    // Started wide, everything has a density; the M step leaves a variance in which the far sample, of next to no
    // weight, has none.
    let values = [0.0, 0.0, 1e140];
    let samples = Samples::new(&values, 1).unwrap().with_weights(&[1.0, 1.0, 1e-320]).unwrap();
    let params = GmmParams { floor: 0.0, max_iterations: 1, ..warm(normals(vec![0.0], vec![1e280])) };
    let Err(Error::AllRestartsFailed { restarts }) = params.validate().unwrap().fit(&samples) else { panic!() };
    assert_eq!((restarts[0].outcome, restarts[0].iterations), (RestartOutcome::NoSupport { iteration: 1 }, 1));
}

#[test]
fn duplicates_have_no_variance_and_never_one_below_zero() {
    for covariance in [CovarianceKind::Full, CovarianceKind::Diagonal, CovarianceKind::Spherical] {
        for i in 1..100 {
            let values = [0.1 * f64::from(i); 7];
            let (_, report) = fit(GmmParams { covariance, ..GmmParams::default() }, &values, 1).unwrap();
            let smallest = report.regularisation.floored[0].smallest_eigenvalue;
            assert!((0.0..1e-25).contains(&smallest), "{covariance:?} {i}: {smallest:e}");
        }
    }
}

#[test]
fn missing_values_are_counted_by_value_by_partial_row_and_by_unused_row() {
    let nan = f64::NAN;
    let values = [1.0, 2.0, nan, 3.0, 4.0, nan, nan, nan, 0.0, 1.0, 5.0, nan];
    let samples = Samples::new(&values, 2).unwrap().with_weights(&[1.0, 1.0, 1.0, 1.0, 0.0, 2.0]).unwrap();
    let plan = GmmParams { missing: MissingValues::Marginalise, ..GmmParams::default() }.validate().unwrap();
    let missing = plan.fit(&samples).unwrap().1.missing.unwrap();
    // Unused: the row without any value and the complete row of weight zero.
    assert_eq!((missing.values, missing.partial_rows, missing.unused_rows), (5, 3, 2));
}
