//! What a sample weight means: a weight of two is two rows, a weight of zero is no row.

use gmr_core::{
    CovarianceKind, Error, GmmParams, MissingValues, Mixture, MixtureParts, RestartOutcome, Samples, Start,
};

fn close(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "{what}: {a} is not {b}");
    }
}

fn normal(mean: f64, variance: f64, weight: f64) -> MixtureParts {
    MixtureParts {
        kind: CovarianceKind::Full,
        dim: 1,
        weights: vec![weight],
        means: vec![mean],
        covariances: vec![variance],
    }
}

/// `ln N(x | mean, variance)` by its formula.
fn log_normal(x: f64, mean: f64, variance: f64) -> f64 {
    -0.5 * ((std::f64::consts::TAU * variance).ln() + (x - mean) * (x - mean) / variance)
}

#[test]
fn likelihood_and_criteria_count_weights_and_not_rows() {
    let (x, w) = ([0.0, 1.0, 3.0], [1.0, 3.0, 0.5]);
    let mixture = Mixture::new(normal(1.0, 2.0, 1.0)).unwrap();
    let samples = Samples::new(&x, 1).unwrap().with_weights(&w).unwrap();
    let likelihood: f64 = x.iter().zip(&w).map(|(x, w)| w * log_normal(*x, 1.0, 2.0)).sum();
    close("likelihood", &[mixture.log_likelihood(&samples).unwrap()], &[likelihood], 1e-14);
    let expected = 2.0 * 4.5f64.ln() - 2.0 * likelihood;
    close("bic", &[mixture.bic(&samples).unwrap()], &[expected], 1e-14);
    close("aic", &[mixture.aic(&samples).unwrap()], &[4.0 - 2.0 * likelihood], 1e-14);

    let (fitted, report) = GmmParams::default().validate().unwrap().fit(&samples).unwrap();
    let mean = (0.0 + 3.0 + 1.5) / 4.5;
    let variance = x.iter().zip(&w).map(|(x, w)| w * (x - mean) * (x - mean)).sum::<f64>() / 4.5;
    close("mean", fitted.means(), &[mean], 1e-14);
    close("variance", fitted.covariances(), &[variance], 1e-13);
    let likelihood: f64 = x.iter().zip(&w).map(|(x, w)| w * log_normal(*x, mean, variance)).sum();
    close("report likelihood", &[report.log_likelihood], &[likelihood], 1e-13);
    close("report bic", &[report.bic], &[2.0 * 4.5f64.ln() - 2.0 * likelihood], 1e-13);
    close("report aic", &[report.aic], &[4.0 - 2.0 * likelihood], 1e-13);
    close("restart", &[report.restarts[0].log_likelihood.unwrap()], &[likelihood / 4.5], 1e-13);
}

#[test]
fn a_row_of_weight_zero_that_no_component_reaches_is_as_if_it_were_not_there() {
    // So far out that its density is zero: ln 0 times weight 0 must not become NaN.
    let (x, w) = ([0.0, 1e120, 1.0, 2.0], [1.0, 0.0, 2.0, 1.0]);
    let tight = Mixture::new(normal(1.0, 1e-100, 1.0)).unwrap();
    let samples = Samples::new(&x, 1).unwrap().with_weights(&w).unwrap();
    let near = Samples::new(&[0.0, 1.0, 2.0], 1).unwrap().with_weights(&[1.0, 2.0, 1.0]).unwrap();
    let all = tight.log_likelihood(&samples).unwrap();
    close("likelihood", &[all], &[tight.log_likelihood(&near).unwrap()], 1e-14);
    let plan = |missing| GmmParams { start: Start::Mixture(Box::new(tight.clone())), missing, ..GmmParams::default() };
    let with = plan(MissingValues::Refuse).validate().unwrap().fit(&samples).unwrap();
    let without = plan(MissingValues::Refuse).validate().unwrap().fit(&near).unwrap();
    close("history", &with.1.history, &without.1.history, 1e-13);
    close("means", with.0.means(), without.0.means(), 1e-13);
    close("variances", with.0.covariances(), without.0.covariances(), 1e-13);
}

#[test]
fn only_rows_with_weight_count_as_samples_to_fit() {
    let plan = GmmParams { components: 2, floor: 1e-3, ..GmmParams::default() }.validate().unwrap();
    let x = [0.0, 1.0, 5.0];
    let samples = Samples::new(&x, 1).unwrap();
    let one = plan.fit(&samples.with_weights(&[0.0, 0.0, 1.0]).unwrap());
    assert!(matches!(one, Err(Error::TooFewSamples { needed: 2, got: 1, .. })), "{one:?}");
    // As many rows as components are enough.
    let (mixture, _) = plan.fit(&samples.with_weights(&[1.0, 0.0, 3.0]).unwrap()).unwrap();
    let mut pairs: Vec<(f64, f64)> = mixture.means().iter().copied().zip(mixture.weights().iter().copied()).collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    close("means", &[pairs[0].0, pairs[1].0], &[0.0, 5.0], 1e-12);
    close("weights", &[pairs[0].1, pairs[1].1], &[0.25, 0.75], 1e-12);
}

#[test]
fn no_start_is_made_from_rows_of_weight_zero() {
    // Two groups with weight, forty rows without any far outside: a start there would begin empty.
    let mut x: Vec<f64> = (0..10).map(|i| f64::from(i % 2) * 4.0 + 0.01 * f64::from(i)).collect();
    let mut w = vec![1.0; 10];
    x.extend((0..40).map(|i| 1000.0 + 100.0 * f64::from(i)));
    w.extend([0.0; 40]);
    let samples = Samples::new(&x, 1).unwrap().with_weights(&w).unwrap();
    for start in [Start::RandomSamples, Start::KMeansPlusPlus, Start::KMeans] {
        for seed in 0..20 {
            let params = GmmParams { components: 2, start: start.clone(), seed, floor: 1e-3, ..GmmParams::default() };
            let (mixture, _) = params.validate().unwrap().fit(&samples).unwrap();
            assert!(mixture.means().iter().all(|m| (-1.0..6.0).contains(m)), "{start:?}, {seed}: {mixture:?}");
        }
    }
}

#[test]
fn with_missing_values_a_weight_of_two_is_two_rows() {
    let rows = [[0.1, f64::NAN], [0.4, 1.3], [f64::NAN, 0.9], [0.7, 1.1], [1.6, f64::NAN], [-0.2, 0.4]];
    let weights = [2.0, 1.0, 3.0, 1.0, 2.0, 0.0];
    let repeated: Vec<f64> =
        rows.iter().zip(&weights).flat_map(|(r, w)| std::iter::repeat_n(*r, *w as usize).flatten()).collect();
    let values: Vec<f64> = rows.iter().flatten().copied().collect();
    let start = Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 2,
        weights: vec![0.4, 0.6],
        means: vec![0.0, 0.5, 1.0, 1.0],
        covariances: [1.0, 0.3, 0.3, 1.0].repeat(2),
    });
    let params = GmmParams {
        components: 2,
        start: Start::Mixture(Box::new(start.unwrap())),
        max_iterations: 4,
        tolerance: 0.0,
        floor: 1e-3,
        missing: MissingValues::Marginalise,
        ..GmmParams::default()
    };
    let plan = params.validate().unwrap();
    let (a, ra) = plan.fit(&Samples::new(&values, 2).unwrap().with_weights(&weights).unwrap()).unwrap();
    let (b, rb) = plan.fit(&Samples::new(&repeated, 2).unwrap()).unwrap();
    close("history", &ra.history, &rb.history, 1e-12);
    close("means", a.means(), b.means(), 1e-12);
    close("covariances", a.covariances(), b.covariances(), 1e-12);
    close("criteria", &[ra.log_likelihood, ra.bic, ra.aic], &[rb.log_likelihood, rb.bic, rb.aic], 1e-11);
}

#[test]
fn the_start_of_a_table_with_gaps_sees_the_weighted_mean_of_the_column() {
    // One component, one iteration: the first entry of the history is the likelihood of the start, whose moments
    // are those of the table with each gap filled by the weighted mean of its column.
    let (x, w) = ([0.0, f64::NAN, 4.0, 1.0], [1.0, 2.0, 5.0, 2.0]);
    let mean = (4.0 * 5.0 + 1.0 * 2.0) / 8.0;
    let filled = [0.0, mean, 4.0, 1.0];
    let of = |f: &dyn Fn(f64) -> f64| filled.iter().zip(&w).map(|(x, w)| w * f(*x)).sum::<f64>() / 10.0;
    let centre = of(&|x| x);
    let variance = of(&|x| (x - centre) * (x - centre));
    let seen = [0, 2, 3];
    let expected = seen.iter().map(|&i| w[i] * log_normal(x[i], centre, variance)).sum::<f64>() / 8.0;
    let missing = MissingValues::Marginalise;
    let plan = GmmParams { missing, max_iterations: 1, ..GmmParams::default() }.validate().unwrap();
    let (_, report) = plan.fit(&Samples::new(&x, 1).unwrap().with_weights(&w).unwrap()).unwrap();
    close("start", &report.history, &[expected], 1e-13);
}

#[test]
fn a_column_without_any_value_keeps_the_floor_and_the_others_are_fitted() {
    let x = [1.0, f64::NAN, 2.0, f64::NAN, 6.0, f64::NAN];
    let missing = MissingValues::Marginalise;
    let plan = GmmParams { missing, floor: 1e-4, ..GmmParams::default() }.validate().unwrap();
    let (mixture, report) = plan.fit(&Samples::new(&x, 2).unwrap()).unwrap();
    close("mean", mixture.mean(0), &[3.0, 0.0], 1e-12);
    close("variance", &[mixture.covariance(0)[0]], &[14.0 / 3.0], 1e-12);
    assert!(mixture.covariance(0)[3] >= 1e-4 * (1.0 - 1e-9));
    let missing = report.missing.unwrap();
    assert_eq!((missing.values, missing.partial_rows, missing.unused_rows), (3, 3, 0));
}

#[test]
fn a_component_that_keeps_less_than_a_ten_billionth_of_the_weight_is_empty_and_one_with_half_a_percent_is_not() {
    let two = |share: f64| MixtureParts {
        weights: vec![1.0 - share, share],
        means: vec![0.0, 100.0],
        covariances: vec![1.0, 1.0],
        ..normal(0.0, 1.0, 1.0)
    };
    let x = [-1.0, 1.0, 99.0, 101.0];
    let fit = |light: f64| {
        let start = Start::Mixture(Box::new(Mixture::new(two(0.5)).unwrap()));
        let params = GmmParams { components: 2, start, ..GmmParams::default() };
        let weights = [1.0, 1.0, light, light];
        params.validate().unwrap().fit(&Samples::new(&x, 1).unwrap().with_weights(&weights).unwrap())
    };
    let (mixture, _) = fit(0.005).unwrap();
    close("weights", mixture.weights(), &[1.0 / 1.005, 0.005 / 1.005], 1e-12);
    close("variances", mixture.covariances(), &[1.0, 1.0], 1e-12);
    let Err(Error::AllRestartsFailed { restarts }) = fit(1e-11) else { panic!("an empty component passed") };
    let RestartOutcome::EmptyComponent { component, iteration, share } = restarts[0].outcome else { panic!() };
    assert_eq!((component, iteration), (1, 1));
    close("share", &[share * 1e11], &[1.0], 1e-9);
}
