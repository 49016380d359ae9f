//! What an ARIMA fit reports, and that the general filter for gaps finds what the plain one finds.
#![expect(clippy::unwrap_used, reason = "tests")]

use gmr_core::{Arima, ArimaOrder, ArimaParams, ArimaParts, ArimaReport, ArimaStart, ArimaStop, Error};

fn close(what: &str, a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance * (1.0 + b.abs()), "{what}: {a} is not {b}");
}

/// Noise near normal, from the index alone.
fn noise(seed: u64, n: usize) -> Vec<f64> {
    let mut state = seed;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 * 2f64.powi(-53)
    };
    (0..n).map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0).collect()
}

/// An ARMA series with a mean, then summed `d` times.
fn simulate(seed: u64, n: usize, parts: &ArimaParts) -> Vec<f64> {
    let e = noise(seed, n + 100);
    let mut w: Vec<f64> = Vec::new();
    for t in 0..n + 100 {
        let ar: f64 = parts.ar.iter().enumerate().filter(|(i, _)| *i < t).map(|(i, c)| c * w[t - 1 - i]).sum();
        let ma: f64 = parts.ma.iter().enumerate().filter(|(i, _)| *i < t).map(|(i, c)| c * e[t - 1 - i]).sum();
        w.push(e[t] + ar + ma);
    }
    let mut y: Vec<f64> = w[100..].iter().map(|v| v * parts.variance.sqrt() + parts.mean).collect();
    for _ in 0..parts.difference {
        let mut sum = 0.0;
        y.iter_mut().for_each(|v| {
            sum += *v;
            *v = sum;
        });
    }
    y
}

fn parts(ar: &[f64], difference: usize, ma: &[f64]) -> ArimaParts {
    ArimaParts { ar: ar.to_vec(), difference, ma: ma.to_vec(), mean: 0.4, variance: 4.0 }
}

fn fit(y: &[f64], (p, d, q): (usize, usize, usize), constant: bool) -> Result<(Arima, ArimaReport), Error> {
    let order = ArimaOrder { p, d, q };
    ArimaParams { order, constant, tolerance: 1e-8, ..ArimaParams::default() }.validate().unwrap().fit(y)
}

#[test]
fn criteria_and_counts_are_those_of_their_formulas() {
    let mut y = simulate(3, 50, &parts(&[0.5], 1, &[0.3]));
    for (holes, constant) in [(0, true), (0, false), (4, true), (4, false)] {
        (0..holes).for_each(|i| y[10 + 7 * i] = f64::NAN);
        let (_, report) = fit(&y, (1, 1, 1), constant).unwrap();
        let (k, n) = (3.0 + f64::from(u8::from(constant)), (49 - holes) as f64);
        let l = report.log_likelihood;
        assert_eq!((report.parameters, report.observations, report.missing), (k as usize, 49 - holes, holes));
        close("aic", report.aic, 2.0 * k - 2.0 * l, 1e-14);
        close("aicc", report.aicc, 2.0 * k - 2.0 * l + 2.0 * k * (k + 1.0) / (n - k - 1.0), 1e-14);
        close("bic", report.bic, k * n.ln() - 2.0 * l, 1e-14);
    }
}

#[test]
fn parameters_come_back_from_a_long_series_with_their_signs() {
    for true_parts in
        [parts(&[0.6, -0.3], 0, &[]), parts(&[], 0, &[0.6]), parts(&[0.5], 1, &[0.4]), parts(&[], 1, &[0.5, 0.2])]
    {
        let y = simulate(11, 4000, &true_parts);
        let order = (true_parts.ar.len(), true_parts.difference, true_parts.ma.len());
        let (model, report) = fit(&y, order, true).unwrap();
        let found = model.parts();
        // Five standard errors of some 1 / sqrt(n).
        for (a, b) in found.ar.iter().chain(&found.ma).zip(true_parts.ar.iter().chain(&true_parts.ma)) {
            assert!((a - b).abs() < 5.0 / 4000f64.sqrt(), "{found:?} is not {true_parts:?}");
        }
        assert!((found.variance - 4.0).abs() < 5.0 * 4.0 * (2.0 / 4000f64).sqrt());
        assert!((found.mean - 0.4).abs() < 0.4);
        assert!(!report.on_border && report.stop != ArimaStop::IterationLimit);
    }
}

#[test]
fn a_trailing_gap_tells_nothing_so_the_general_filter_finds_what_the_plain_one_finds() {
    for (seed, order) in
        [(1, (1, 0, 0)), (2, (0, 0, 1)), (3, (1, 0, 1)), (4, (2, 0, 0)), (5, (1, 1, 0)), (6, (0, 1, 1)), (7, (0, 2, 1))]
    {
        let ar = [0.5, 0.2][..order.0].to_vec();
        let y = simulate(seed, 70, &parts(&ar, order.1, &[0.4][..order.2]));
        let mut holed = y.clone();
        holed.push(f64::NAN);
        for constant in [false, true] {
            let ((a, ra), (b, rb)) = (fit(&y, order, constant).unwrap(), fit(&holed, order, constant).unwrap());
            // The diffuse likelihood of two levels counts their determinant too: a constant beside d = 2.
            if order.1 < 2 {
                close("likelihood", rb.log_likelihood, ra.log_likelihood, 1e-7);
            }
            for (u, v) in b.parts().ar.iter().chain(&b.parts().ma).zip(a.parts().ar.iter().chain(&a.parts().ma)) {
                assert!((u - v).abs() < 2e-3, "{order:?} {constant}: {:?} {:?}", a.parts(), b.parts());
            }
            close("mean", b.parts().mean, a.parts().mean, 1e-3);
            close("variance", b.parts().variance, a.parts().variance, 1e-3);
            assert_eq!((rb.missing, rb.observations, rb.parameters), (1, ra.observations, ra.parameters));
            assert_eq!(rb.start, ArimaStart::Grid);
        }
    }
}

#[test]
fn the_likelihood_reported_is_the_models_and_no_neighbour_has_more() {
    for (order, holes) in [((1, 0, 1), false), ((1, 1, 0), false), ((1, 0, 1), true), ((0, 1, 1), true)] {
        let ar = [0.5][..order.0].to_vec();
        let mut y = simulate(21, 90, &parts(&ar, order.1, &[0.4][..order.2]));
        if holes {
            for i in [0, 7, 8, 9, 40] {
                y[i] = f64::NAN;
            }
        }
        let (model, report) = fit(&y, order, true).unwrap();
        let best = model.log_likelihood(&y).unwrap();
        close("own", best, report.log_likelihood, 1e-9);
        close("run", model.filter(&y).unwrap().log_likelihood, best, 1e-10);
        let step = 0.02;
        for change in 0..4 {
            for sign in [-1.0, 1.0] {
                let mut moved = model.parts().clone();
                match change {
                    0 => moved.mean += sign * step,
                    1 => moved.variance *= 1.0 + sign * step,
                    2 if !moved.ar.is_empty() => moved.ar[0] += sign * step,
                    _ if !moved.ma.is_empty() => moved.ma[0] += sign * step,
                    _ => continue,
                }
                let there = Arima::new(moved).unwrap().log_likelihood(&y).unwrap();
                assert!(there < best, "{order:?} {holes} {change} {sign}: {there} above {best}");
            }
        }
    }
}

#[test]
fn the_report_says_how_the_search_began_and_ended() {
    let y = simulate(5, 80, &parts(&[0.6], 0, &[0.4]));
    assert_eq!(fit(&y, (0, 0, 0), true).unwrap().1.start, ArimaStart::Closed);
    let plain = fit(&y, (1, 0, 1), true).unwrap().1;
    assert_eq!(plain.start, ArimaStart::ConditionalSquares);
    assert!(match plain.stop {
        ArimaStop::Converged => plain.gradient <= 1e-8,
        ArimaStop::NoFurtherGain => plain.gradient > 1e-8 && plain.iterations < 200,
        ArimaStop::IterationLimit => false,
    });
    let order = ArimaOrder { p: 1, d: 0, q: 1 };
    let short = ArimaParams { order, max_iterations: 1, tolerance: 1e-12, ..ArimaParams::default() };
    let cut = short.validate().unwrap().fit(&y).unwrap().1;
    assert_eq!((cut.stop, cut.iterations), (ArimaStop::IterationLimit, 1));
    assert!(cut.gradient > 1e-12);
}

#[test]
fn a_series_that_wants_a_unit_root_ends_on_the_border_inside_it() {
    // A straight line with a little noise is all but a unit root; a difference too many is a root of the other side.
    let line: Vec<f64> = noise(2, 200).iter().enumerate().map(|(i, e)| i as f64 + 1e-3 * e).collect();
    let (model, _) = fit(&line, (1, 0, 0), false).unwrap();
    let ar = model.parts().ar[0];
    assert!(ar > 0.99 && ar <= 1.0 - 0.9e-6, "{ar}");
    for seed in 0..5 {
        let (model, report) = fit(&noise(seed, 60), (0, 1, 1), false).unwrap();
        let ma = model.parts().ma[0];
        assert!((-1.0 + 0.9e-6..-0.5).contains(&ma) && !report.on_border, "{ma}");
    }
    // What alternates without any noise is predicted better and better towards the root: the border holds it, and is
    // told.
    let swing: Vec<f64> = (0..60).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect();
    let (model, report) = fit(&swing, (1, 0, 0), false).unwrap();
    let ar = model.parts().ar[0];
    assert!(report.on_border && (-1.0 + 0.9e-6..-1.0 + 3e-6).contains(&ar), "{ar} {report:?}");
}

#[test]
fn the_fewest_samples_are_one_more_than_the_numbers_to_find() {
    let y = simulate(8, 40, &parts(&[0.3], 0, &[]));
    // ARIMA(1, 1, 0) with drift: one coefficient, drift, variance, one value for the level.
    let found = fit(&y[..5], (1, 1, 0), true).unwrap().1;
    assert_eq!((found.parameters, found.observations), (3, 4));
    // n = k + 1: the correction of AICc has no meaning.
    assert!(found.aicc.is_infinite() && found.aicc > 0.0);
    assert!(fit(&y[..6], (1, 1, 0), true).unwrap().1.aicc.is_finite());
    assert!(matches!(fit(&y[..4], (1, 1, 0), true), Err(Error::TooFewSamples { needed: 5, got: 4, .. })));
    let mut holed = y[..6].to_vec();
    holed[2] = f64::NAN;
    holed[4] = f64::NAN;
    assert!(matches!(fit(&holed, (1, 1, 0), true), Err(Error::TooFewSamples { needed: 5, got: 4, .. })));
}

#[test]
fn a_series_without_anything_to_explain_is_degenerate() {
    let still = "series after differencing and removing the mean";
    for (y, order, constant) in [
        (vec![0.0; 30], (1, 0, 0), false),
        (vec![4.0; 30], (1, 0, 1), true),
        ((0..30).map(f64::from).collect(), (1, 2, 0), false),
        ((0..30).map(|i| 3.0 + 2.0 * f64::from(i)).collect(), (0, 1, 1), true),
        // So small that its variance is no number.
        (noise(1, 30).iter().map(|v| 1e-300 * v).collect(), (1, 0, 0), true),
    ] {
        let refused = fit(&y, order, constant);
        assert!(matches!(refused, Err(Error::Degenerate { what }) if what == still), "{order:?}: {refused:?}");
    }
}

#[test]
fn a_level_far_above_the_noise_costs_no_digits_of_the_coefficients() {
    let y = simulate(17, 80, &parts(&[0.6], 0, &[]));
    let (a, ra) = fit(&y, (1, 0, 0), true).unwrap();
    let (b, rb) = fit(&y.iter().map(|v| v + 1e9).collect::<Vec<_>>(), (1, 0, 0), true).unwrap();
    // What is left of the noise beside 1e9 has ten digits.
    close("ar", b.parts().ar[0], a.parts().ar[0], 1e-5);
    close("variance", b.parts().variance, a.parts().variance, 1e-5);
    close("mean", b.parts().mean - 1e9, a.parts().mean, 1e-5);
    close("likelihood", rb.log_likelihood, ra.log_likelihood, 1e-6);
}

#[test]
fn units_change_the_scale_of_mean_and_variance_and_nothing_else() {
    let y = simulate(13, 60, &parts(&[0.6], 0, &[]));
    for (constant, holes) in [(true, false), (false, false), (true, true)] {
        let mut y = y.clone();
        if holes {
            y[20] = f64::NAN;
        }
        let (a, ra) = fit(&y, (1, 0, 0), constant).unwrap();
        for power in [-300, 40, 300] {
            let scale = 2f64.powi(power);
            let (b, rb) = fit(&y.iter().map(|v| v * scale).collect::<Vec<_>>(), (1, 0, 0), constant).unwrap();
            close("ar", b.parts().ar[0], a.parts().ar[0], 1e-12);
            close("mean", b.parts().mean / scale, a.parts().mean, 1e-12);
            close("variance", b.parts().variance / scale / scale, a.parts().variance, 1e-12);
            let n = rb.observations as f64;
            close("likelihood", rb.log_likelihood + n * scale.ln(), ra.log_likelihood, 1e-10);
        }
    }
}

#[test]
fn beside_a_unit_root_the_likelihood_reported_is_a_number_or_the_fit_an_error() {
    for exponent in -80..80 {
        let y: Vec<f64> = (0..11).map(|i| f64::from(i) * 10f64.powi(exponent)).collect();
        if let Ok((model, report)) = fit(&y, (2, 1, 3), false) {
            assert!(report.log_likelihood.is_finite() && report.bic.is_finite(), "10^{exponent}: {report:?}");
            model.filter(&y).unwrap();
        }
    }
}
