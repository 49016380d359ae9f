//! The order found automatically: differences by the KPSS test, the grid, the lowest AICc.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{ArimaOrder, ArimaParams, AutoArima, AutoArimaParams, Error, kpss};

fn noise(seed: u64, n: usize) -> Vec<f64> {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 * 2f64.powi(-53)
    };
    (0..n).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
}

fn summed(mut y: Vec<f64>) -> Vec<f64> {
    for i in 1..y.len() {
        y[i] += y[i - 1];
    }
    y
}

fn search(params: AutoArimaParams, y: &[f64]) -> AutoArima {
    params.validate().unwrap().fit(y).unwrap()
}

#[test]
fn the_kpss_statistic_is_that_of_its_definition() {
    for n in [3, 10, 99, 100, 400] {
        let y: Vec<f64> = summed(noise(n as u64, n)).iter().map(|v| v + 5.0).collect();
        let mean = y.iter().sum::<f64>() / n as f64;
        let e: Vec<f64> = y.iter().map(|v| v - mean).collect();
        let lags = (4.0 * (n as f64 / 100.0).powf(0.25)).floor() as usize;
        let mut long_run = 0.0;
        for s in 0..n {
            for t in 0..n {
                let lag = s.abs_diff(t);
                if lag <= lags {
                    long_run += (1.0 - lag as f64 / (lags + 1) as f64) * e[s] * e[t] / n as f64;
                }
            }
        }
        let partial: f64 = (0..n).map(|t| e[..=t].iter().sum::<f64>().powi(2)).sum();
        let expected = partial / (n * n) as f64 / long_run;
        for scale in [1.0, 1e-150, 1e130] {
            let found = kpss(&y.iter().map(|v| v * scale).collect::<Vec<_>>()).unwrap();
            assert!((found - expected).abs() < 1e-9 * expected, "{n} {scale:e}: {found} is not {expected}");
        }
    }
    assert_eq!(kpss(&[4.0; 30]).map(f64::to_bits), Ok(0));
}

#[test]
fn each_sum_of_noise_takes_one_difference_and_no_more_than_allowed() {
    let small = AutoArimaParams { max_p: 1, max_q: 1, ..AutoArimaParams::default() };
    let white = noise(4, 200);
    let once = summed(white.clone());
    let twice = summed(once.clone());
    for (y, d) in [(&white, 0), (&once, 1), (&twice, 2)] {
        let found = search(small, y);
        assert_eq!((found.order.d, found.kpss.len()), (d, d + 1));
        // Every statistic but the last rejects.
        assert!(found.kpss[d] <= 0.463 && found.kpss[..d].iter().all(|s| *s > 0.463), "{:?}", found.kpss);
        assert!((found.kpss[0] - kpss(y).unwrap()).abs() < 1e-15);
        // A mean or drift is tried up to one difference.
        let constants = found.candidates.iter().filter(|c| c.constant).count();
        assert_eq!((found.candidates.len(), constants), if d < 2 { (8, 4) } else { (4, 0) });
    }
    let held = search(AutoArimaParams { max_d: 0, ..small }, &once);
    assert_eq!((held.order.d, held.kpss.len()), (0, 1));
}

#[test]
fn the_grid_has_every_order_within_the_bounds_once_and_rows_are_single_fits() {
    let params = AutoArimaParams { max_p: 3, max_q: 2, max_terms: 3, ..AutoArimaParams::default() };
    let y = noise(6, 60);
    let found = search(params, &y);
    let mut orders: Vec<(usize, usize, bool)> =
        found.candidates.iter().map(|c| (c.order.p, c.order.q, c.constant)).collect();
    orders.sort_unstable();
    let mut expected: Vec<(usize, usize, bool)> = (0..=3)
        .flat_map(|p| (0..=2).flat_map(move |q| [(p, q, false), (p, q, true)]))
        .filter(|(p, q, _)| p + q <= 3)
        .collect();
    expected.sort_unstable();
    assert_eq!(orders, expected);
    for candidate in &found.candidates {
        let plan = ArimaParams {
            order: candidate.order,
            constant: candidate.constant,
            max_iterations: params.max_iterations,
            ..ArimaParams::default()
        };
        assert_eq!(candidate.result.as_ref().unwrap(), &plan.validate().unwrap().fit(&y).unwrap().1);
    }
}

#[test]
fn the_lowest_corrected_criterion_wins_where_the_plain_one_says_otherwise() {
    let params = AutoArimaParams { max_p: 3, max_q: 2, max_d: 0, ..AutoArimaParams::default() };
    let mut different = 0;
    for seed in 0..12 {
        // So short that the correction of AICc weighs.
        let y = noise(100 + seed, 16);
        let found = search(params, &y);
        let fitted: Vec<_> = found.candidates.iter().filter_map(|c| c.result.as_ref().ok().map(|r| (c, r))).collect();
        let (best, report) = fitted.iter().min_by(|a, b| a.1.aicc.total_cmp(&b.1.aicc)).unwrap();
        assert_eq!((&found.report, found.order), (*report, best.order));
        assert_eq!(found.model.parts().ar.len(), best.order.p);
        let plain = fitted.iter().min_by(|a, b| a.1.aic.total_cmp(&b.1.aic)).unwrap().0;
        different += usize::from((plain.order, plain.constant) != (best.order, best.constant));
    }
    assert!(different > 0, "both criteria agree everywhere, so nothing tells them apart");
}

#[test]
fn bounds_and_series_that_no_order_fits_are_refused() {
    for params in [
        AutoArimaParams { max_p: 24, ..AutoArimaParams::default() },
        AutoArimaParams { max_q: 23, ..AutoArimaParams::default() },
        AutoArimaParams { max_d: 5, ..AutoArimaParams::default() },
        AutoArimaParams { max_iterations: 0, ..AutoArimaParams::default() },
    ] {
        assert!(matches!(params.validate(), Err(Error::InvalidParameter { .. })), "{params:?}");
    }
    let plan = AutoArimaParams { max_p: 1, max_q: 0, ..AutoArimaParams::default() }.validate().unwrap();
    assert!(matches!(plan.fit(&[1.0, 2.0]), Err(Error::TooFewSamples { .. })));
    assert!(matches!(plan.fit(&[f64::NAN; 20]), Err(Error::TooFewSamples { .. })));
    assert!(matches!(plan.fit(&[0.0; 20]), Err(Error::Degenerate { .. })));
    // The largest orders allowed are allowed.
    for order in [ArimaOrder { p: 23, d: 4, q: 0 }, ArimaOrder { p: 0, d: 0, q: 22 }] {
        assert!(ArimaParams { order, ..ArimaParams::default() }.validate().is_ok(), "{order:?}");
    }
}
