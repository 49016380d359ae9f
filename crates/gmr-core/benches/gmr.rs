//! Speed of fits, regressions and ARIMA; prints one JSON document. `peers.py` times the same rows on the same data.
//!
//! Words among the arguments choose the parts: `fits`, `regressions`, `arima`, `large`; without any, all run.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program")]
#![expect(clippy::disallowed_methods, reason = "measuring needs the clock")]

use std::hint::black_box;
use std::time::Instant;

use gmr_core::{ArimaOrder, ArimaParams, CovarianceKind, GmmParams, Mixture, MixtureParts, Regressor, Samples, Start};
use serde_json::{Value, json};

/// `splitmix64` of a counter: the same numbers in Rust and, vectorised, in numpy.
fn uniform(counter: u64) -> f64 {
    let mut z = counter.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53)
}

/// Nearly normal: the sum of twelve uniforms.
fn normal(index: u64) -> f64 {
    (0..12).map(|i| uniform(index * 12 + i)).fold(0.0, |a, b| a + b) - 6.0
}

/// Demonstrations of a smooth seven-column motion `(t, h)`: `n / 200` repetitions with noise.
fn motion(n: usize) -> Vec<f64> {
    let mut rows = Vec::with_capacity(n * 7);
    for i in 0..n {
        let t = (i % 200) as f64 * 0.005;
        rows.push(t);
        for j in 0..6 {
            let f = 0.7 + 0.3 * j as f64;
            let value = (0.1 + 0.05 * j as f64) * (std::f64::consts::TAU * f * t + j as f64).sin();
            rows.push(value + 0.01 * normal((i * 6 + j) as u64));
        }
    }
    rows
}

/// `k` overlapping correlated clusters in seven dimensions.
fn clusters(n: usize, k: usize) -> Vec<f64> {
    let mut rows = Vec::with_capacity(n * 7);
    for i in 0..n {
        let mut previous = 0.0;
        for j in 0..7 {
            let z = normal((i * 7 + j) as u64) + 0.5 * previous;
            rows.push(centre(i % k, j) + (0.5 + 0.1 * j as f64) * z);
            previous = z;
        }
    }
    rows
}

fn centre(c: usize, j: usize) -> f64 {
    4.0 * uniform(1_000_000_007 + (c * 7 + j) as u64)
}

/// A fixed start for both programs: the true centres, moved, with unit covariances.
fn start(k: usize) -> Mixture {
    let means = (0..k * 7).map(|i| centre(i / 7, i % 7) + 0.3 * (uniform(2_000_000_011 + i as u64) - 0.5)).collect();
    let covariances = (0..k).flat_map(|_| (0..49).map(|i| f64::from(u8::from(i % 8 == 0)))).collect();
    Mixture::new(MixtureParts {
        kind: CovarianceKind::Full,
        dim: 7,
        weights: vec![1.0 / k as f64; k],
        means,
        covariances,
    })
    .unwrap()
}

fn arima_series() -> Vec<f64> {
    let noise: Vec<f64> = (0..1100u64).map(|t| normal(50_000_017 + t)).collect();
    let mut w = [0.0; 1100];
    let mut y = Vec::new();
    let mut level = 0.0;
    for t in 2..1100 {
        w[t] = 0.6 * w[t - 1] - 0.2 * w[t - 2] + noise[t] + 0.4 * noise[t - 1];
        if t >= 100 {
            level += w[t];
            y.push(level);
        }
    }
    y
}

/// Wall seconds of each repetition, sorted, and the mean processor seconds of one.
struct Timing(Vec<f64>, f64);

/// Processor time of all threads in seconds, from the kernel's own accounting, which is brought up to date some
/// hundred times a second; zero where there is none.
fn processor_seconds() -> f64 {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0.0 };
    tasks
        .filter_map(|task| std::fs::read_to_string(task.ok()?.path().join("schedstat")).ok())
        .filter_map(|text| text.split_whitespace().next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-9
}

impl Timing {
    fn of(repetitions: usize, mut f: impl FnMut()) -> Self {
        f();
        let mut wall = Vec::with_capacity(repetitions);
        let before = processor_seconds();
        for _ in 0..repetitions {
            let begin = Instant::now();
            f();
            wall.push(begin.elapsed().as_secs_f64());
        }
        let processor = (processor_seconds() - before) / repetitions as f64;
        wall.sort_by(f64::total_cmp);
        Self(wall, processor)
    }

    /// The same for one of the `parts` that each repetition consisted of.
    fn per(mut self, parts: f64) -> Self {
        self.0.iter_mut().for_each(|t| *t /= parts);
        self.1 /= parts;
        self
    }

    fn quantile(&self, q: f64) -> f64 {
        self.0[((self.0.len() - 1) as f64 * q).round() as usize]
    }

    fn row(&self, name: &str, unit: &str, scale: f64, note: &str) -> Value {
        json!({
            "name": name, "unit": unit, "ours": self.quantile(0.5) * scale, "p50": self.quantile(0.5) * scale,
            "p99": self.quantile(0.99) * scale, "min": self.0[0] * scale, "max": self.0[self.0.len() - 1] * scale,
            "n": self.0.len(), "note": note, "ours_processor": self.1 * scale,
        })
    }
}

fn fits(rows: &mut Vec<Value>) {
    let values = motion(1000);
    let samples = Samples::new(&values, 7).unwrap();
    for k in [5, 10] {
        // The number of iterations depends on the start, so each repetition has its own.
        let plans: Vec<_> = (0..60)
            .map(|seed| GmmParams { components: k, tolerance: 1e-3, ridge: 1e-6, seed, ..GmmParams::default() })
            .map(|params| params.validate().unwrap())
            .collect();
        let (mut iterations, mut lloyd, mut likelihood) = (0.0, 0.0, 0.0);
        for plan in &plans {
            let report = plan.fit(&samples).unwrap().1;
            iterations += report.iterations as f64 / 60.0;
            lloyd += report.k_means_iterations as f64 / 60.0;
            likelihood += report.log_likelihood / 60_000.0;
        }
        let mut plan = plans.iter().cycle();
        let timing = Timing::of(240, || {
            black_box(plan.next().unwrap().fit(black_box(&samples)).unwrap());
        });
        let note = format!(
            "one thread; k-means start, tol 1e-3, 60 seeds; mean of {lloyd:.1} Lloyd + {iterations:.1} EM iterations, \
             log-likelihood {likelihood:.4}",
        );
        rows.push(timing.row(&format!("gmm_fit_1000x7_k{k}"), "ms", 1e3, &note));
    }
}

fn large_em(rows: &mut Vec<Value>) {
    let values = clusters(200_000, 16);
    let samples = Samples::new(&values, 7).unwrap();
    let plan = GmmParams {
        components: 16,
        start: Start::Mixture(Box::new(start(16))),
        max_iterations: 10,
        tolerance: 0.0,
        ridge: 1e-6,
        ..GmmParams::default()
    }
    .validate()
    .unwrap();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let report = plan.fit(&samples).unwrap().1;
            let timing = Timing::of(7, || {
                black_box(plan.fit(black_box(&samples)).unwrap());
            });
            // Per sample, component and iteration: E step 28 + 7 multiply-adds and 7 differences, exponential 17,
            // M step 36 multiply-adds and 8 products.
            let flops = 200_000.0 * 16.0 * 10.0 * (2.0 * (28.0 + 7.0 + 17.0 + 36.0) + 7.0 + 8.0);
            let note = format!(
                "{threads} thread(s); mean log-likelihood before step 10: {:.9}; {:.2} Gflop per processor second",
                report.history[9],
                flops / timing.1 / 1e9
            );
            let name = if threads == 2 {
                "em_10_steps_200000x7_k16".into()
            } else {
                "em_10_steps_200000x7_k16_1_thread".to_string()
            };
            rows.push(timing.row(&name, "ms", 1e3, &note));
        });
    }
}

fn regressions(rows: &mut Vec<Value>) {
    let values = motion(1000);
    let samples = Samples::new(&values, 7).unwrap();
    let outputs = [1, 2, 3, 4, 5, 6];
    let fit = |components| {
        let params = GmmParams { components, ridge: 1e-6, ..GmmParams::default() };
        params.validate().unwrap().fit(&samples).unwrap().0
    };
    let regressor = Regressor::new(&fit(10), &[0], &outputs).unwrap();
    let queries: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.005).collect();
    let queries = Samples::new(&queries, 1).unwrap();
    let batch = Timing::of(400, || {
        black_box(regressor.predict_batch(black_box(&queries)).unwrap());
    });
    rows.push(batch.row(
        "gmr_200_queries_k10_mean_and_covariance",
        "us",
        1e6,
        "one thread, batch with allocation of the answer",
    ));
    rows.push(batch.row(
        "gmr_200_queries_k10_mean_and_covariance_against_mean_only",
        "us",
        1e6,
        "ours with covariance",
    ));
    let batch = Timing::of(400, || {
        black_box(regressor.predict_mean_batch(black_box(&queries)).unwrap());
    });
    rows.push(batch.row("gmr_200_queries_k10_mean", "us", 1e6, "one thread, mean only"));
    let regressor = Regressor::new(&fit(8), &[0], &outputs).unwrap();
    let mut out = regressor.prediction();
    let single = |f: &mut dyn FnMut(f64)| {
        // A clock read costs a good part of a query, so each measurement covers 64 of them.
        let mut i = 0u32;
        let timing = Timing::of(4000, || {
            for _ in 0..64 {
                i = i.wrapping_add(37);
                f(f64::from(i % 1000) * 1e-3);
            }
        });
        timing.per(64.0)
    };
    let timing = single(&mut |t| regressor.predict_into(black_box(&[t]), black_box(&mut out)).unwrap());
    rows.push(timing.row(
        "gmr_single_query_k8_mean_and_covariance",
        "ns",
        1e9,
        "no allocation; mean of 64 per reading",
    ));
    let timing = single(&mut |t| regressor.predict_with_jacobian_into(black_box(&[t]), black_box(&mut out)).unwrap());
    rows.push(timing.row("gmr_single_query_k8_with_velocity", "ns", 1e9, "no allocation; mean of 64 per reading"));
    let timing = single(&mut |t| regressor.predict_mean_into(black_box(&[t]), black_box(&mut out)).unwrap());
    rows.push(timing.row("gmr_single_query_k8_mean", "ns", 1e9, "no allocation; mean of 64 per reading"));
}

fn arima(rows: &mut Vec<Value>) {
    let y = arima_series();
    let order = ArimaOrder { p: 2, d: 1, q: 1 };
    let plan = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate().unwrap();
    let (model, report) = plan.fit(&y).unwrap();
    let timing = Timing::of(60, || {
        black_box(plan.fit(black_box(&y)).unwrap());
    });
    let note = format!("one thread, exact ML; log-likelihood {:.6}", report.log_likelihood);
    for peer in ["statsmodels", "statsforecast"] {
        rows.push(timing.row(&format!("arima_211_n1000_against_{peer}"), "ms", 1e3, &note));
    }
    let timing = Timing::of(400, || {
        black_box(model.log_likelihood(black_box(&y)).unwrap());
    });
    rows.push(timing.row("arima_211_n1000_one_likelihood", "us", 1e6, "exact, differencing included"));
    let mut state = model.filter(&y).unwrap().state;
    let mut i = 0;
    let timing = Timing::of(1000, || {
        for _ in 0..64 {
            i = (i + 1) % y.len();
            black_box(state.append(y[i]).unwrap());
        }
    });
    rows.push(timing.per(64.0).row("arima_211_append", "ns", 1e9, "one value, no refit; mean of 64 per reading"));
}

/// Multiply-adds per second of one core with nothing to load: what the kernels are measured against.
fn peak(rows: &mut Vec<Value>) {
    struct Spin;
    impl pulp::WithSimd for Spin {
        type Output = f64;
        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, simd: S) -> f64 {
            let (a, b) = (simd.splat_f64s(black_box(0.999_999)), simd.splat_f64s(black_box(1e-9)));
            let mut sums = [simd.splat_f64s(1.0); 12];
            for _ in 0..1_000_000 {
                for s in &mut sums {
                    *s = simd.mul_add_f64s(*s, a, b);
                }
            }
            sums.iter().map(|s| simd.reduce_sum_f64s(*s)).sum::<f64>() + S::F64_LANES as f64 * 1e-300
        }
    }
    struct Lanes;
    impl pulp::WithSimd for Lanes {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: pulp::Simd>(self, _: S) -> usize {
            S::F64_LANES
        }
    }
    let lanes = pulp::Arch::new().dispatch(Lanes);
    let timing = Timing::of(15, || {
        black_box(pulp::Arch::new().dispatch(Spin));
    });
    let gflops = 12e6 * 2.0 * lanes as f64 / timing.0[0] / 1e9;
    rows.push(json!({
        "name": "peak_multiply_add_1_thread", "unit": "Gflop/s", "ours": gflops, "n": 15,
        "note": format!("register-only multiply-adds, {lanes} lanes, fastest of 15"),
    }));
}

fn main() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut rows = Vec::new();
    let parts: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let wanted = |part: &str| parts.is_empty() || parts.iter().any(|p| p == part);
    pool.install(|| {
        if wanted("fits") {
            fits(&mut rows);
        }
        if wanted("regressions") {
            regressions(&mut rows);
        }
        if wanted("arima") {
            arima(&mut rows);
        }
        peak(&mut rows);
    });
    if wanted("large") {
        large_em(&mut rows);
    }
    println!("{}", serde_json::to_string_pretty(&json!({ "area": "gmr", "rows": rows })).unwrap());
}
