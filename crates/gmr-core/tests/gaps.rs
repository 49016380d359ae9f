//! Missing values, conditioning and segmentation against answers found another way.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{
    CovarianceKind, GmmParams, MissingValues, Mixture, MixtureParts, Regressor, RestParams, Samples, Start, Trajectory,
    segment_at_rest,
};

/// Numbers in [0, 1) that depend on the index alone.
fn uniform(index: u64) -> f64 {
    let mut z = index.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x1234_5678_9abc_def1);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53)
}

#[test]
fn em_with_gaps_finds_the_closed_form_of_a_monotone_pattern() {
    // Anderson (1957): x seen everywhere, y only in the first rows. The maximum has the moments of x over all rows
    // and the regression of y on x over the complete ones.
    let (n, complete) = (200, 120);
    let x: Vec<f64> = (0..n).map(|i| 3.0 * uniform(i) - 1.0).collect();
    let y: Vec<f64> = (0..n).map(|i| 0.5 + 1.7 * x[i as usize] + 0.4 * (uniform(1000 + i) - 0.5)).collect();
    let values: Vec<f64> = (0..n as usize).flat_map(|i| [x[i], if i < complete { y[i] } else { f64::NAN }]).collect();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let product = |a: &[f64], b: &[f64]| {
        let (ma, mb) = (mean(a), mean(b));
        a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>() / a.len() as f64
    };
    let (xc, yc) = (&x[..complete], &y[..complete]);
    let slope = product(xc, yc) / product(xc, xc);
    let rest = product(yc, yc) - slope * product(xc, yc);
    let expected_mean = [mean(&x), mean(yc) + slope * (mean(&x) - mean(xc))];
    let sxx = product(&x, &x);
    let expected = [sxx, slope * sxx, slope * sxx, rest + slope * slope * sxx];

    let params = GmmParams {
        components: 1,
        max_iterations: 2000,
        tolerance: 0.0,
        floor: 0.0,
        missing: MissingValues::Marginalise,
        ..GmmParams::default()
    };
    let (mixture, report) = params.validate().unwrap().fit(&Samples::new(&values, 2).unwrap()).unwrap();
    for (a, b) in mixture.mean(0).iter().chain(&mixture.covariance(0)).zip(expected_mean.iter().chain(&expected)) {
        assert!((a - b).abs() < 1e-9, "{a} is not {b}");
    }
    assert_eq!(report.missing.unwrap().values, n as usize - complete);
}

#[test]
fn the_likelihood_of_rows_with_gaps_is_that_of_the_marginals() {
    let mixture = three();
    let rows = [[0.3, f64::NAN, -0.2], [f64::NAN, 0.9, f64::NAN], [0.1, 0.2, 0.3]];
    let values: Vec<f64> = rows.iter().flatten().copied().collect();
    let params = GmmParams {
        components: 2,
        start: Start::Mixture(Box::new(mixture.clone())),
        max_iterations: 1,
        missing: MissingValues::Marginalise,
        ..GmmParams::default()
    };
    let (_, report) = params.validate().unwrap().fit(&Samples::new(&values, 3).unwrap()).unwrap();
    let expected = mixture.marginal(&[0, 2]).unwrap().log_density(&[0.3, -0.2]).unwrap()
        + mixture.marginal(&[1]).unwrap().log_density(&[0.9]).unwrap()
        + mixture.log_density(&[0.1, 0.2, 0.3]).unwrap();
    assert!((report.history[0] - expected / 3.0).abs() < 1e-13, "{} is not {}", report.history[0], expected / 3.0);
}

fn three() -> Mixture {
    Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 3,
        weights: vec![0.3, 0.7],
        means: vec![0.0, 1.0, -1.0, 0.5, -0.5, 0.4],
        covariances: vec![
            1.0, 0.3, 0.2, 0.3, 0.8, -0.1, 0.2, -0.1, 0.5, //
            0.6, -0.2, 0.1, -0.2, 0.9, 0.3, 0.1, 0.3, 0.7,
        ],
    })
    .unwrap()
}

#[test]
fn any_hidden_subset_is_filled_as_the_integral_over_it_says() {
    let mixture = three();
    let grid: Vec<f64> = (0..4001).map(|i| -10.0 + f64::from(i) * 0.005).collect();
    for hidden in 0..3 {
        // One hidden value: moments of the joint density along it, by the trapezoidal rule.
        let row = [0.2, 0.4, -0.3];
        let mut sums = [0.0; 3];
        for &v in &grid {
            let mut point = row;
            point[hidden] = v;
            let p = mixture.log_density(&point).unwrap().exp();
            for (sum, value) in sums.iter_mut().zip([1.0, v, v * v]) {
                *sum += p * value * 0.005;
            }
        }
        let mean = sums[1] / sums[0];
        let mut holed = row;
        holed[hidden] = f64::NAN;
        let filled = mixture.fill(&holed).unwrap();
        assert_eq!(filled.hidden, [hidden]);
        assert!((filled.values[hidden] - mean).abs() < 1e-10);
        assert!((filled.covariance[0] - (sums[2] / sums[0] - mean * mean)).abs() < 1e-10);
        assert!((filled.log_density - sums[0].ln()).abs() < 1e-10);
    }
    // Two hidden values: the chain rule through the conditional mixture gives the same mean.
    let filled = mixture.fill(&[f64::NAN, 0.4, f64::NAN]).unwrap();
    let (mean, covariance) = mixture.condition(&[1], &[0.4]).unwrap().moments();
    assert!((filled.values[0] - mean[0]).abs() < 1e-13 && (filled.values[2] - mean[1]).abs() < 1e-13);
    for (a, b) in filled.covariance.iter().zip(&covariance) {
        assert!((a - b).abs() < 1e-13);
    }
}

#[test]
fn the_mean_only_query_gives_the_bytes_of_the_full_one() {
    let regressor = Regressor::new(&three(), &[1], &[2, 0]).unwrap();
    let (mut full, mut mean) = (regressor.prediction(), regressor.prediction());
    for i in 0..50 {
        let x = [f64::from(i) * 0.1 - 2.5];
        regressor.predict_into(&x, &mut full).unwrap();
        regressor.predict_mean_into(&x, &mut mean).unwrap();
        assert_eq!(full.mean(), mean.mean());
    }
}

#[test]
fn a_motion_with_known_pauses_is_cut_in_them() {
    // Moves of 0.8 s from pose to pose, pauses of 0.4 s.
    let hertz = 100.0;
    let times: Vec<f64> = (0..=440).map(|i| f64::from(i) / hertz).collect();
    let values: Vec<f64> = times
        .iter()
        .map(|t| {
            let (cycle, within) = ((t / 1.2).floor(), t % 1.2);
            let s = (within / 0.8).min(1.0);
            cycle + s * s * (3.0 - 2.0 * s)
        })
        .collect();
    let motion = Trajectory::new(times, values, 1).unwrap();
    let elements = segment_at_rest(&motion, &RestParams { speed: 0.05, shortest_s: 0.3 }).unwrap();
    let cuts: Vec<f64> = elements[1..].iter().map(|e| e.start_s).collect();
    assert_eq!(cuts.len(), 3, "{cuts:?}");
    for (k, cut) in cuts.iter().enumerate() {
        let pause = 0.8 + 1.2 * k as f64;
        assert!((pause - 0.02..=pause + 0.42).contains(cut), "{cut} lies outside the pause from {pause}");
    }
}

#[test]
fn components_far_from_a_sample_change_nothing_in_the_moments() {
    // Two clusters 1e3 deviations apart: each fit equals the fit of its cluster alone, to rounding.
    let near: Vec<f64> = (0..400).map(|i| uniform(i) + uniform(9000 + i) - 1.0).collect();
    let far: Vec<f64> = (0..400).map(|i| 400.0 + 2.0 * (uniform(20_000 + i) - uniform(40_000 + i))).collect();
    let both: Vec<f64> = near.iter().zip(&far).flat_map(|(a, b)| [*a, *b]).collect();
    let params = GmmParams { components: 2, floor: 0.0, max_iterations: 30, tolerance: 0.0, ..GmmParams::default() };
    let (mixture, _) = params.validate().unwrap().fit(&Samples::new(&both, 1).unwrap()).unwrap();
    for cluster in [&near, &far] {
        let mean = cluster.iter().sum::<f64>() / 400.0;
        let variance = cluster.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 400.0;
        let c = usize::from((mixture.means()[1] - mean).abs() < (mixture.means()[0] - mean).abs());
        assert!((mixture.means()[c] - mean).abs() < 1e-12 * mean.abs().max(1.0));
        assert!((mixture.covariance(c)[0] - variance).abs() < 1e-12 * variance);
        assert!((mixture.weights()[c] - 0.5).abs() < 1e-15);
    }
}
