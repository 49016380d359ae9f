//! Agreement with scikit-learn, gmr and statsmodels on the files of `tests/fixtures`.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    Arima, ArimaOrder, ArimaParams, ArimaParts, CovarianceKind, GmmParams, Mixture, MixtureParts, Regressor, Samples,
    Start,
};
use serde_json::Value;

/// Twelve EM iterations from one start: two programs that differ only in rounding.
const EM_TOLERANCE: f64 = 1e-8;
/// One conditioning: two factorisations of a 7 x 7 matrix of condition below 1e3.
const REGRESSION_TOLERANCE: f64 = 1e-10;
/// One Kalman filter over 60 values.
const LIKELIHOOD_TOLERANCE: f64 = 1e-8;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
}

fn fixture(name: &str) -> Value {
    let path = format!("{}/tests/fixtures/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[track_caller]
fn close(what: &str, ours: &[f64], theirs: &[f64], tolerance: f64) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let scale = theirs.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    for (i, (a, b)) in ours.iter().zip(theirs).enumerate() {
        assert!((a - b).abs() <= tolerance * scale, "{what}[{i}]: {a} against {b}");
    }
}

#[test]
fn em_equals_scikit_learn_for_all_four_covariance_types() {
    let all = fixture("sklearn");
    let (dim, iterations) = (all["dim"].as_u64().unwrap() as usize, all["iterations"].as_u64().unwrap() as usize);
    let values = numbers(&all["values"]);
    let samples = Samples::new(&values, dim).unwrap();
    for case in all["cases"].as_array().unwrap() {
        let kind = match case["kind"].as_str().unwrap() {
            "full" => CovarianceKind::Full,
            "tied" => CovarianceKind::Tied,
            "diag" => CovarianceKind::Diagonal,
            _ => CovarianceKind::Spherical,
        };
        let start = Mixture::new(MixtureParts {
            kind,
            dim,
            weights: numbers(&all["weights"]),
            means: numbers(&all["means"]),
            covariances: numbers(&case["start_covariances"]),
        })
        .unwrap();
        let plan = GmmParams {
            components: start.components(),
            covariance: kind,
            start: Start::Mixture(Box::new(start)),
            max_iterations: iterations,
            tolerance: 0.0,
            ridge: all["ridge"].as_f64().unwrap(),
            floor: 0.0,
            ..GmmParams::default()
        }
        .validate()
        .unwrap();
        let (mixture, report) = plan.fit(&samples).unwrap();
        assert_eq!(report.iterations, iterations);
        let name = case["kind"].as_str().unwrap();
        close(name, mixture.weights(), &numbers(&case["weights"]), EM_TOLERANCE);
        close(name, mixture.means(), &numbers(&case["means"]), EM_TOLERANCE);
        close(name, mixture.covariances(), &numbers(&case["covariances"]), EM_TOLERANCE);
        let bound = case["lower_bound"].as_f64().unwrap();
        close(name, &[report.history[iterations - 1]], &[bound], EM_TOLERANCE);
        close(name, &[report.log_likelihood], &[case["score"].as_f64().unwrap()], EM_TOLERANCE);
        close(name, &[report.bic], &[case["bic"].as_f64().unwrap()], EM_TOLERANCE);
        close(name, &[mixture.aic(&samples).unwrap()], &[case["aic"].as_f64().unwrap()], EM_TOLERANCE);
        let first = Samples::new(&values[..10 * dim], dim).unwrap();
        close(name, &mixture.log_densities(&first).unwrap(), &numbers(&case["log_densities"]), EM_TOLERANCE);
        close(name, &mixture.responsibilities(&first).unwrap(), &numbers(&case["responsibilities"]), EM_TOLERANCE);
    }
}

#[test]
fn regression_equals_the_gmr_package() {
    let all = fixture("gmr");
    let dim = all["dim"].as_u64().unwrap() as usize;
    let mixture = Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim,
        weights: numbers(&all["weights"]),
        means: numbers(&all["means"]),
        covariances: numbers(&all["covariances"]),
    })
    .unwrap();
    for case in all["cases"].as_array().unwrap() {
        let inputs: Vec<usize> = numbers(&case["inputs"]).iter().map(|v| *v as usize).collect();
        let outputs: Vec<usize> = (0..dim).filter(|i| !inputs.contains(i)).collect();
        let regressor = Regressor::new(&mixture, &inputs, &outputs).unwrap();
        let x = numbers(&case["x"]);
        let mut out = regressor.prediction();
        regressor.predict_into(&x, &mut out).unwrap();
        close("mean", out.mean(), &numbers(&case["mean"]), REGRESSION_TOLERANCE);
        close("predict", out.mean(), &numbers(&case["predict"]), REGRESSION_TOLERANCE);
        close("covariance", out.covariance(), &numbers(&case["covariance"]), REGRESSION_TOLERANCE);
        close("weights", out.responsibilities(), &numbers(&case["weights"]), REGRESSION_TOLERANCE);
        close("component means", out.component_means(), &numbers(&case["component_means"]), REGRESSION_TOLERANCE);
        let conditional = mixture.condition(&inputs, &x).unwrap();
        let theirs = numbers(&case["component_covariances"]);
        close("component covariances", conditional.covariances(), &theirs, REGRESSION_TOLERANCE);
        let mut row = vec![f64::NAN; dim];
        for (i, v) in inputs.iter().zip(&x) {
            row[*i] = *v;
        }
        let filled = mixture.fill(&row).unwrap();
        assert_eq!(filled.hidden, outputs);
        close("fill", &filled.covariance, &numbers(&case["covariance"]), REGRESSION_TOLERANCE);
    }
}

fn order(case: &Value) -> ArimaOrder {
    let o = numbers(&case["order"]);
    ArimaOrder { p: o[0] as usize, d: o[1] as usize, q: o[2] as usize }
}

#[test]
fn arima_likelihood_equals_statsmodels_with_and_without_gaps() {
    for case in fixture("arima")["likelihoods"].as_array().unwrap() {
        let model = Arima::new(ArimaParts {
            ar: numbers(&case["ar"]),
            difference: order(case).d,
            ma: numbers(&case["ma"]),
            mean: 0.0,
            variance: case["variance"].as_f64().unwrap(),
        })
        .unwrap();
        let y = numbers(&case["values"]);
        // statsmodels counts ln(2 pi) for the values that set the levels as well; a diffuse likelihood is
        // defined up to such a constant, and here complete data must give that of the differences.
        let diffuse = if case["exact_diffuse"].as_bool().unwrap() { order(case).d as f64 } else { 0.0 };
        let theirs = case["log_likelihood"].as_f64().unwrap() + 0.5 * diffuse * std::f64::consts::TAU.ln();
        let ours = model.log_likelihood(&y).unwrap();
        close("log-likelihood", &[ours], &[theirs], LIKELIHOOD_TOLERANCE);
        close("run", &[model.filter(&y).unwrap().log_likelihood], &[theirs], LIKELIHOOD_TOLERANCE);
    }
}

/// The generator of `make.py`, number for number.
struct Lcg(u64);

impl Lcg {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 * 2f64.powi(-53)
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).fold(0.0, |a, b| a + b) - 6.0
    }

    fn polynomial(&mut self, order: usize) -> Vec<f64> {
        let partial: Vec<f64> = (0..order).map(|_| 1.8 * (self.uniform() - 0.5)).collect();
        if order < 2 { partial } else { vec![partial[0] * (1.0 - partial[1]), partial[1]] }
    }
}

fn simulate(index: usize) -> Vec<f64> {
    let mut lcg = Lcg(20_240_611 * 1000 + index as u64);
    let (p, d, q) = (index % 3, index / 3 % 2, index / 6 % 3);
    let n = 80 + 10 * (index % 7);
    let phi = lcg.polynomial(p);
    let theta: Vec<f64> = lcg.polynomial(q).iter().map(|c| -c).collect();
    let noise: Vec<f64> = (0..n + 50).map(|_| lcg.normal()).collect();
    let mut w: Vec<f64> = Vec::new();
    for t in 0..n + 50 {
        let mut value = noise[t];
        for i in 0..p.min(t) {
            value += phi[i] * w[t - 1 - i];
        }
        for i in 0..q.min(t) {
            value += theta[i] * noise[t - 1 - i];
        }
        w.push(value);
    }
    let mut y = w[50..].to_vec();
    for _ in 0..d {
        let mut total = 0.0;
        for v in &mut y {
            total += *v + 0.05;
            *v = total;
        }
    }
    y
}

#[test]
fn arima_maximum_is_never_below_that_of_statsmodels() {
    let mut higher = 0;
    for case in fixture("arima")["maxima"].as_array().unwrap() {
        let index = case["index"].as_u64().unwrap() as usize;
        let y = simulate(index);
        close(
            "series",
            &[y[0], y[y.len() - 1]],
            &[case["first"].as_f64().unwrap(), case["last"].as_f64().unwrap()],
            1e-12,
        );
        let plan = ArimaParams { order: order(case), constant: true, ..ArimaParams::default() }.validate().unwrap();
        let (model, report) = plan.fit(&y).unwrap();
        let theirs = case["log_likelihood"].as_f64().unwrap();
        assert!(
            report.log_likelihood >= theirs - 1e-3,
            "series {index}: {} < {theirs}, {report:?}",
            report.log_likelihood
        );
        higher += usize::from(report.log_likelihood > theirs + 1e-3);
        // The reported likelihood is that of the returned model.
        close("self", &[model.log_likelihood(&y).unwrap()], &[report.log_likelihood], 1e-9);
    }
    // statsmodels stops short of the maximum on some series; equal everywhere would mean that
    // this comparison compares nothing.
    assert!(higher > 0);
}

#[test]
fn arima_forecasts_and_residuals_equal_statsmodels() {
    for case in fixture("arima")["forecasts"].as_array().unwrap() {
        let y = simulate(case["index"].as_u64().unwrap() as usize);
        let model = Arima::new(ArimaParts {
            ar: numbers(&case["ar"]),
            difference: order(case).d,
            ma: numbers(&case["ma"]),
            mean: 0.0,
            variance: case["variance"].as_f64().unwrap(),
        })
        .unwrap();
        let run = model.filter(&y).unwrap();
        let ahead = run.state.forecast(6);
        let means: Vec<f64> = ahead.iter().map(|f| f.mean).collect();
        let variances: Vec<f64> = ahead.iter().map(|f| f.variance).collect();
        close("forecast", &means, &numbers(&case["mean"]), 1e-9);
        close("variance", &variances, &numbers(&case["forecast_variance"]), 1e-9);
        let residuals: Vec<f64> = run.residuals[10..20].iter().map(|r| r.unwrap().value).collect();
        close("residuals", &residuals, &numbers(&case["residuals"]), 1e-9);
        // Appending value by value ends in the same state as one run over everything.
        let mut state = model.filter(&y[..40]).unwrap().state;
        for v in &y[40..] {
            state.append(*v).unwrap();
        }
        let appended: Vec<f64> = state.forecast(6).iter().map(|f| f.mean).collect();
        close("appended", &appended, &means, 1e-9);
    }
}
