//! Residuals, fitted values, forecasts and appended values against the conditional distributions of a Gaussian vector.

use gmr_core::{Arima, ArimaParts, Error};

fn close(what: &str, a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "{what}: {a} is not {b}");
}

/// `Cov(y_s, y_t)` for `s, t < n`: of the process itself for `d = 0`, of `y_t - y_0` for `d = 1`; from the first 4000
/// weights of its moving average form, without any recursion over states.
fn covariance(parts: &ArimaParts, n: usize) -> Vec<Vec<f64>> {
    let mut psi = vec![0.0; 4000];
    for t in 0..psi.len() {
        let noise = if t == 0 { 1.0 } else { parts.ma.get(t - 1).copied().unwrap_or(0.0) };
        psi[t] = noise + (0..parts.ar.len().min(t)).map(|i| parts.ar[i] * psi[t - 1 - i]).sum::<f64>();
    }
    let gamma: Vec<f64> =
        (0..n).map(|k| parts.variance * psi.iter().zip(&psi[k..]).map(|(a, b)| a * b).sum::<f64>()).collect();
    if parts.difference == 0 {
        return (0..n).map(|s| (0..n).map(|t| gamma[s.abs_diff(t)]).collect()).collect();
    }
    let sum = |s: usize, t: usize| (1..=s).flat_map(move |a| (1..=t).map(move |b| (a, b)));
    (0..n).map(|s| (0..n).map(|t| sum(s, t).map(|(a, b)| gamma[usize::abs_diff(a, b)]).sum()).collect()).collect()
}

/// Mean and variance of `y_t` given the values of `seen`, by Gaussian elimination.
fn given(parts: &ArimaParts, cov: &[Vec<f64>], y: &[f64], seen: &[usize], t: usize) -> (f64, f64) {
    let integrated = parts.difference == 1;
    let mean = |i: usize| if integrated { y[0] + parts.mean * i as f64 } else { parts.mean };
    let known: Vec<usize> = seen.iter().copied().filter(|&i| !integrated || i > 0).collect();
    let m = known.len();
    // [Sigma | sigma_t | y - mean], solved for both right sides.
    let mut rows: Vec<Vec<f64>> =
        known.iter().map(|&a| known.iter().map(|&b| cov[a][b]).chain([cov[a][t], y[a] - mean(a)]).collect()).collect();
    for i in 0..m {
        for r in i + 1..m {
            let factor = rows[r][i] / rows[i][i];
            let (head, tail) = rows.split_at_mut(r);
            tail[0].iter_mut().zip(&head[i]).skip(i).for_each(|(x, p)| *x -= factor * p);
        }
    }
    let mut solved = vec![[0.0; 2]; m];
    for i in (0..m).rev() {
        for side in 0..2 {
            let rest: f64 = (i + 1..m).map(|j| rows[i][j] * solved[j][side]).sum();
            solved[i][side] = (rows[i][m + side] - rest) / rows[i][i];
        }
    }
    let value = mean(t) + known.iter().zip(&solved).map(|(&a, s)| cov[a][t] * s[1]).sum::<f64>();
    let variance = cov[t][t] - known.iter().zip(&solved).map(|(&a, s)| cov[a][t] * s[0]).sum::<f64>();
    (value, variance)
}

fn models() -> Vec<ArimaParts> {
    let parts = |ar: &[f64], difference, ma: &[f64]| ArimaParts {
        ar: ar.to_vec(),
        difference,
        ma: ma.to_vec(),
        mean: 0.7,
        variance: 2.5,
    };
    vec![
        parts(&[0.6], 0, &[]),
        parts(&[0.5, -0.3], 0, &[0.4]),
        parts(&[], 0, &[0.8, -0.2]),
        parts(&[], 1, &[]),
        parts(&[0.4], 1, &[0.3]),
        parts(&[-0.5, 0.2], 1, &[]),
    ]
}

fn series(n: usize, holes: &[usize]) -> Vec<f64> {
    let y = |i: usize| 0.7 * i as f64 + 2.0 * (i as f64 * 0.9).sin() + (i as f64 * 2.3).cos();
    (0..n).map(|i| if holes.contains(&i) { f64::NAN } else { y(i) }).collect()
}

#[test]
fn every_residual_and_the_likelihood_are_those_of_the_values_before() {
    for parts in models() {
        let model = Arima::new(parts.clone()).unwrap();
        for holes in [&[][..], &[4, 9, 10, 11]] {
            let y = series(20, holes);
            let cov = covariance(&parts, 20);
            let run = model.filter(&y).unwrap();
            let mut seen = Vec::new();
            let mut likelihood = 0.0;
            for t in 0..20 {
                let skipped = holes.contains(&t) || (parts.difference == 1 && t == 0);
                assert_eq!((run.residuals[t].is_none(), run.fitted[t].is_none()), (skipped, skipped), "{parts:?} {t}");
                if !skipped {
                    let (mean, variance) = given(&parts, &cov, &y, &seen, t);
                    let residual = run.residuals[t].unwrap();
                    close("residual", residual.value, y[t] - mean, 1e-9);
                    close("variance", residual.variance, variance, 1e-9);
                    close("fitted", run.fitted[t].unwrap(), mean, 1e-9);
                    let square = (y[t] - mean) * (y[t] - mean) / variance;
                    likelihood -= 0.5 * ((std::f64::consts::TAU * variance).ln() + square);
                }
                if !holes.contains(&t) {
                    seen.push(t);
                }
            }
            close("likelihood", run.log_likelihood, likelihood, 1e-10);
            close("alone", model.log_likelihood(&y).unwrap(), likelihood, 1e-10);
        }
    }
}

#[test]
fn forecasts_are_the_conditional_means_and_variances_of_what_comes() {
    for parts in models() {
        let model = Arima::new(parts.clone()).unwrap();
        for holes in [&[][..], &[13, 14], &[5]] {
            let mut y = series(15, holes);
            let ahead = model.filter(&y).unwrap().state.forecast(6);
            let seen: Vec<usize> = (0..15).filter(|i| !holes.contains(i)).collect();
            y.extend([f64::NAN; 6]);
            let cov = covariance(&parts, 21);
            for (h, forecast) in ahead.iter().enumerate() {
                let (mean, variance) = given(&parts, &cov, &y, &seen, 15 + h);
                close("mean", forecast.mean, mean, 1e-9);
                close("variance", forecast.variance, variance, 1e-9);
            }
        }
    }
}

#[test]
fn appending_goes_on_as_if_the_series_had_been_longer_through_gaps_and_after_settling() {
    for parts in models() {
        let model = Arima::new(parts.clone()).unwrap();
        // Sixty values settle every model here; then gaps of one and of three, each followed by values.
        let holes = [62, 70, 71, 72, 90];
        let y = series(92, &holes);
        let whole = model.filter(&y).unwrap();
        let mut state = model.filter(&y[..5]).unwrap().state;
        for (t, value) in y.iter().enumerate().skip(5) {
            let innovation = state.append(*value).unwrap();
            assert_eq!(innovation.is_none(), holes.contains(&t), "{parts:?} {t}");
            if let Some(innovation) = innovation {
                let expected = whole.residuals[t].unwrap();
                close("value", innovation.value, expected.value, 1e-9);
                close("variance", innovation.variance, expected.variance, 1e-12);
            }
        }
        for (a, b) in state.forecast(4).iter().zip(whole.state.forecast(4)) {
            close("mean", a.mean, b.mean, 1e-9);
            close("variance", a.variance, b.variance, 1e-12);
        }
        // No forecast is surer than the innovation.
        assert!(state.forecast(1)[0].variance >= parts.variance);
    }
}

#[test]
fn an_appended_value_that_is_no_number_changes_nothing() {
    let parts = ArimaParts { ar: vec![0.5], difference: 1, ma: vec![0.2], mean: 0.1, variance: 1.0 };
    let model = Arima::new(parts).unwrap();
    let mut state = model.filter(&series(30, &[])).unwrap().state;
    let before = state.clone();
    assert!(matches!(state.append(f64::INFINITY), Err(Error::NotFinite { .. })));
    assert!(matches!(state.append(-1e150), Err(Error::OutOfRange { .. })));
    assert_eq!(state, before);
}

#[test]
fn too_few_values_for_the_levels_are_refused() {
    let parts = ArimaParts { ar: vec![], difference: 2, ma: vec![], mean: 0.0, variance: 1.0 };
    let model = Arima::new(parts).unwrap();
    for y in [&[][..], &[1.0], &[1.0, f64::NAN, f64::NAN]] {
        assert!(matches!(model.filter(y), Err(Error::TooFewSamples { needed: 2, .. })), "{y:?}");
        assert!(matches!(model.log_likelihood(y), Err(Error::TooFewSamples { needed: 2, .. })), "{y:?}");
    }
    // Two values set the levels and leave nothing to judge: likelihood of no value, and a straight line ahead.
    let run = model.filter(&[1.0, 3.0]).unwrap();
    close("likelihood", run.log_likelihood, 0.0, 1e-12);
    close("ahead", run.state.forecast(2)[1].mean, 7.0, 1e-12);
    close("differences", model.log_likelihood(&[1.0, 3.0, 5.0]).unwrap(), -0.5 * std::f64::consts::TAU.ln(), 1e-12);
}
