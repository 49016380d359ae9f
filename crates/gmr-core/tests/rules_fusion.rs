//! Equations (11)-(14) of the paper in numbers, in both readings, and the ARIMA errors that go into them.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    ArimaOrder, ArimaParams, CovarianceKind, Error, Fusion, FusionReading, GmmParams, MissingValues, Mixture,
    MixtureParts, Samples, Start, Trajectory, arima_errors, mutual_support,
};

fn close(what: &str, a: &[f64], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len(), "{what}");
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "{what}: {a} is not {b}");
    }
}

#[test]
fn support_follows_equations_11_to_13() {
    let r = [0.2, 0.5, 2.0];
    let si = |a: f64, b: f64| (-(a - b).abs()).exp();
    let a =
        [0.5 * (si(0.2, 0.5) + si(0.2, 2.0)), 0.5 * (si(0.5, 0.2) + si(0.5, 2.0)), 0.5 * (si(2.0, 0.2) + si(2.0, 0.5))];
    let sum: f64 = a.iter().sum();
    close("omega", &mutual_support(&r), &a.map(|v| v / sum), 1e-15);
    assert_eq!(mutual_support(&[7.0]), [1.0]);
    assert!(mutual_support(&[]).is_empty());
    // Where every distance underflows nobody is preferred.
    assert_eq!(mutual_support(&[0.0, 1e5, 2e5, 3e5]), [0.25; 4]);
}

/// Two narrow components far apart, so that responsibilities are 0 or 1 and one M step is known by hand.
fn apart() -> (Mixture, Vec<f64>, Vec<f64>) {
    let mixture = Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 1,
        weights: vec![0.5, 0.5],
        means: vec![0.0, 1000.0],
        covariances: vec![1.0, 1.0],
    });
    let values = vec![-1.0, 1.0, 0.5, 999.0, 1001.0, 1000.5, 1000.0, 999.5];
    let errors = vec![0.1, 0.3, 0.2, 1.0, 2.0, 0.5, 1.5, 1.0];
    (mixture.unwrap(), values, errors)
}

#[test]
fn one_fused_step_multiplies_each_weight_by_its_support_and_normalises() {
    let (mixture, mut values, errors) = apart();
    let reliability = [0.6 / 3.0, 6.0 / 5.0];
    let omega = mutual_support(&reliability);
    let products = [omega[0] * 3.0 / 8.0, omega[1] * 5.0 / 8.0];
    let mass = products[0] + products[1];
    let params = GmmParams {
        components: 2,
        start: Start::Mixture(Box::new(mixture)),
        max_iterations: 1,
        missing: MissingValues::Marginalise,
        ..GmmParams::default()
    };
    let plan = params.validate().unwrap();
    // With and without a row that is missing altogether, which takes no part.
    for holed in [false, true] {
        let mut errors = errors.clone();
        if holed {
            values.push(f64::NAN);
            errors.push(50.0);
        }
        let fusion = Fusion::new(&errors, FusionReading::Components).unwrap();
        let (fused, report) = plan.fit_fused(&Samples::new(&values, 1).unwrap(), &fusion).unwrap();
        close("weights", fused.weights(), &[products[0] / mass, products[1] / mass], 1e-13);
        let report = report.fusion.unwrap();
        assert_eq!((report.reading, report.steps.len()), (FusionReading::Components, 1));
        let step = &report.steps[0];
        close("reliability", &step.reliability, &reliability, 1e-13);
        close("omega", &step.omega, &omega, 1e-13);
        close("mass", &[step.mass], &[mass], 1e-13);
        // The largest change is a loss of the one weight and a gain of the other.
        close("change", &[step.largest_change], &[(products[0] / mass - 3.0 / 8.0).abs()], 1e-13);
    }
}

#[test]
fn the_largest_change_is_one_of_either_sign() {
    // Of three weights one loses what two share.
    let (_, values, _) = apart();
    let start = Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 1,
        weights: vec![0.2, 0.4, 0.4],
        means: vec![0.0, 999.25, 1000.9],
        covariances: vec![1.0, 0.05, 0.05],
    });
    let params = GmmParams { components: 3, start: Start::Mixture(Box::new(start.unwrap())), ..GmmParams::default() };
    let plan = GmmParams { max_iterations: 1, ..params }.validate().unwrap();
    let errors = [9.0, 9.0, 9.0, 1.0, 1.0, 1.0, 1.0, 1.0];
    let samples = Samples::new(&values, 1).unwrap();
    let (plain, _) = plan.fit(&samples).unwrap();
    let fusion = Fusion::new(&errors, FusionReading::Components).unwrap();
    let (fused, report) = plan.fit_fused(&samples, &fusion).unwrap();
    let changes: Vec<f64> = fused.weights().iter().zip(plain.weights()).map(|(a, b)| a - b).collect();
    let largest = changes.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    assert!(changes.iter().all(|c| *c < largest - 1e-3), "the largest change is no loss: {changes:?}");
    close("change", &[report.fusion.unwrap().steps[0].largest_change], &[largest], 1e-12);
}

#[test]
fn the_literal_reading_compares_the_mixture_with_the_mean_error_and_halves_every_weight() {
    let (mixture, values, errors) = apart();
    let params = GmmParams { components: 2, start: Start::Mixture(Box::new(mixture)), ..GmmParams::default() };
    let plan = GmmParams { max_iterations: 1, ..params }.validate().unwrap();
    let fusion = Fusion::new(&errors, FusionReading::Literal).unwrap();
    let (fused, report) = plan.fit_fused(&Samples::new(&values, 1).unwrap(), &fusion).unwrap();
    close("weights", fused.weights(), &[3.0 / 8.0, 5.0 / 8.0], 1e-14);
    let step = &report.fusion.unwrap().steps[0];
    // The ARIMA model's reliability is the mean of all errors, the mixture's is one by construction.
    close("reliability", &step.reliability, &[1.0, 6.6 / 8.0], 1e-13);
    close("omega", &step.omega, &[0.5, 0.5], 1e-15);
    close("mass", &[step.mass], &[0.5], 1e-15);
}

fn noise(n: usize, from: usize) -> Vec<f64> {
    (from..from + n)
        .map(|i| {
            let u = (i as f64 * 12.9898).sin() * 43758.5453;
            u - u.floor() - 0.5
        })
        .collect()
}

#[test]
fn an_arima_error_is_the_mean_over_columns_of_the_standardised_residual() {
    let n = 60;
    let times: Vec<f64> = (0..n).map(|i| i as f64 * 0.1).collect();
    // Columns of very different units, and one that stands still.
    let (a, b) = (noise(n, 0), noise(n, 500));
    let values: Vec<f64> = (0..n).flat_map(|i| [1e-3 * a[i], 7.0, 1e3 * b[i]]).collect();
    let motion = Trajectory::new(times, values, 3).unwrap();
    let order = ArimaOrder { p: 0, d: 1, q: 1 };
    let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate().unwrap();
    let found = arima_errors(&[motion.clone(), motion.clone()], &plan).unwrap();
    assert_eq!((found.errors.len(), found.columns.len(), found.columns[0].len()), (2, 2, 3));
    assert!(matches!(found.columns[0][1], Err(Error::Degenerate { .. })));
    assert_eq!(found.errors[0], found.errors[1]);
    let mut sums = vec![0.0; n];
    for column in [0, 2] {
        let y = motion.column(column);
        let (model, report) = plan.fit(&y).unwrap();
        assert_eq!(found.columns[0][column].as_ref().unwrap(), &report);
        for (t, r) in model.filter(&y).unwrap().residuals.iter().enumerate().skip(1) {
            let r = r.unwrap();
            sums[t] += 0.5 * r.value.abs() / r.variance.sqrt();
        }
    }
    close("errors", &found.errors[0][1..], &sums[1..], 1e-12);
    // The first value has no prediction: it gets the mean of the others.
    close("first", &found.errors[0][..1], &[sums.iter().sum::<f64>() / (n - 1) as f64], 1e-12);
}

#[test]
fn a_motion_in_which_nothing_moves_has_no_error() {
    let motion = Trajectory::new((0..20).map(f64::from).collect(), vec![3.0; 20], 1).unwrap();
    let found = arima_errors(&[motion], &ArimaParams::default().validate().unwrap()).unwrap();
    assert_eq!(found.errors, [vec![0.0; 20]]);
}
