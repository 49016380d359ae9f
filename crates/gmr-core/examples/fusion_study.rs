//! Does weight fusion (paper, eqs. 11-14) help? Plain EM against both readings over random starts.
//!
//! Three sewing actions (move, align, flip), each clean, noisy and with outliers; training on four
//! demonstrations, testing on two. Prints a table in markdown and the same as JSON.
//! `cargo run --release -p gmr-core --example fusion_study [starts]`
#![expect(clippy::print_stdout, reason = "a program that prints a table")]

use gmr_core::{
    ArimaOrder, ArimaParams, Fusion, FusionReading, GmmParams, GmmPlan, Regressor, Result, Samples, Start, Trajectory,
    arima_errors,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde_json::json;

const COMPONENTS: usize = 6;
const DURATION_S: f64 = 2.0;
const SAMPLES: usize = 100;
/// Two optima are the same when their mean log-likelihoods differ by less (nats per sample).
const SAME_OPTIMUM: f64 = 1e-3;
/// A start that ends no farther below the best optimum than this (nats per sample) has found a good one.
const GOOD_OPTIMUM: f64 = 0.1;

/// Minimum-jerk passage from 0 to 1 between two times.
fn passage(t: f64, from: f64, to: f64) -> f64 {
    let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

/// Wrist pose `(x, y, z, alpha, beta, theta)` in metres and radians, without noise.
fn action(name: &str, t: f64) -> [f64; 6] {
    let there = passage(t, 0.2, 0.9);
    let back = passage(t, 1.2, 1.9);
    let bump = (std::f64::consts::PI * t / DURATION_S).sin();
    match name {
        "move" => [0.26 * (there - back), 0.02 * bump, 0.05 * bump * bump, 0.0, 0.1 * bump, 0.2 * (there - back)],
        "align" => [0.05 * there, 0.08 * back, 0.01 * bump, 0.3 * there, 0.1 * back, 0.6 * (there - 0.7 * back)],
        _ => {
            [0.1 * there, 0.16 * passage(t, 0.4, 1.6), 0.12 * bump, 3.0 * passage(t, 0.5, 1.5), 0.4 * bump, 0.1 * back]
        }
    }
}

struct Variant {
    name: &'static str,
    noise: f64,
    outliers: f64,
}

const VARIANTS: [Variant; 3] = [
    Variant { name: "clean", noise: 0.002, outliers: 0.0 },
    Variant { name: "noisy", noise: 0.012, outliers: 0.0 },
    Variant { name: "outliers", noise: 0.004, outliers: 0.06 },
];

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

fn demonstration(name: &str, variant: &Variant, rng: &mut ChaCha8Rng) -> Result<Trajectory> {
    let pace = 1.0 + 0.03 * normal(rng);
    let size = 1.0 + 0.04 * normal(rng);
    let mut times = Vec::new();
    let mut values = Vec::new();
    for i in 0..SAMPLES {
        let t = i as f64 * DURATION_S / SAMPLES as f64;
        times.push(t);
        let wild = rng.random::<f64>() < variant.outliers;
        for v in action(name, (t * pace).min(DURATION_S)) {
            let noise = if wild { 0.15 * normal(rng) } else { variant.noise * normal(rng) };
            values.push(size * v + noise);
        }
    }
    Trajectory::new(times, values, 6)
}

fn table(demonstrations: &[Trajectory]) -> Vec<f64> {
    let mut rows = Vec::new();
    for d in demonstrations {
        for i in 0..d.len() {
            rows.push(d.times_s()[i]);
            rows.extend_from_slice(d.row(i));
        }
    }
    rows
}

/// What one start led to.
struct Outcome {
    iterations: f64,
    /// `sum |second difference| / rise` of the likelihood curve; at least about one for a single smooth rise.
    roughness: f64,
    /// Share of iterations in which the likelihood fell.
    falls: f64,
    /// Mean log-likelihood on the training data.
    training: f64,
    held_out: f64,
    /// Root mean square error of the wrist position against the noise-free action, in metres.
    rmse_m: f64,
}

fn outcome(
    plan: &GmmPlan,
    train: &Samples<'_>,
    test: &Samples<'_>,
    fusion: Option<&Fusion<'_>>,
    name: &str,
) -> Option<Outcome> {
    let (mixture, report) = match fusion {
        None => plan.fit(train),
        Some(fusion) => plan.fit_fused(train, fusion),
    }
    .ok()?;
    let h = &report.history;
    let rise = h[h.len() - 1] - h[0];
    let bends: f64 = h.windows(3).map(|w| (w[2] - 2.0 * w[1] + w[0]).abs()).sum();
    let falls = h.windows(2).filter(|w| w[1] < w[0] - 1e-12).count();
    let regressor = Regressor::new(&mixture, &[0], &[1, 2, 3]).ok()?;
    let mut out = regressor.prediction();
    let mut squares = 0.0;
    for i in 0..SAMPLES {
        let t = i as f64 * DURATION_S / SAMPLES as f64;
        regressor.predict_into(&[t], &mut out).ok()?;
        squares += out.mean().iter().zip(action(name, t)).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
    }
    Some(Outcome {
        iterations: report.iterations as f64,
        roughness: if rise.abs() > 0.0 { bends / rise.abs() } else { 0.0 },
        falls: falls as f64 / h.len() as f64,
        training: report.log_likelihood / train.len() as f64,
        held_out: mixture.log_likelihood(test).ok()? / test.len() as f64,
        rmse_m: (squares / SAMPLES as f64).sqrt(),
    })
}

fn mean(outcomes: &[Outcome], f: impl Fn(&Outcome) -> f64) -> f64 {
    outcomes.iter().map(f).sum::<f64>() / outcomes.len() as f64
}

fn main() -> Result<()> {
    let starts: u64 = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(200);
    println!(
        "| action | data | method | iterations | roughness | falls | best optimum | within 0.1 nat | training | held out | RMSE |"
    );
    println!("|---|---|---|---:|---:|---:|---:|---:|---:|---:|---:|");
    let mut rows = Vec::new();
    for (a, name) in ["move", "align", "flip"].into_iter().enumerate() {
        for (v, variant) in VARIANTS.iter().enumerate() {
            let mut rng = ChaCha8Rng::seed_from_u64(1000 + (a * 10 + v) as u64);
            let demonstrations =
                (0..6).map(|_| demonstration(name, variant, &mut rng)).collect::<Result<Vec<Trajectory>>>()?;
            let (train, test) = (table(&demonstrations[..4]), table(&demonstrations[4..]));
            let (train, test) = (Samples::new(&train, 7)?, Samples::new(&test, 7)?);
            let order = ArimaOrder { p: 2, d: 1, q: 1 };
            let arima = ArimaParams { order, constant: false, ..ArimaParams::default() }.validate()?;
            let errors: Vec<f64> = arima_errors(&demonstrations[..4], &arima)?.errors.concat();
            let methods = [
                ("plain", None),
                ("literal", Some(FusionReading::Literal)),
                ("components", Some(FusionReading::Components)),
            ];
            let mut all = Vec::new();
            for (_, reading) in methods {
                let fusion = reading.map(|r| Fusion::new(&errors, r)).transpose()?;
                let outcomes: Vec<Option<Outcome>> = (0..starts)
                    .into_par_iter()
                    .map(|seed| {
                        let params = GmmParams {
                            components: COMPONENTS,
                            start: Start::RandomSamples,
                            seed,
                            floor: 1e-6,
                            max_iterations: 1000,
                            ..GmmParams::default()
                        };
                        outcome(&params.validate().ok()?, &train, &test, fusion.as_ref(), name)
                    })
                    .collect();
                all.push(outcomes.into_iter().flatten().collect::<Vec<Outcome>>());
            }
            // The best optimum that any start of any method has found.
            let top = all.iter().flatten().map(|o| o.training).fold(f64::NEG_INFINITY, f64::max);
            for ((method, _), outcomes) in methods.iter().zip(&all) {
                let share =
                    |below: f64| outcomes.iter().filter(|o| o.training > top - below).count() as f64 / starts as f64;
                let row = json!({
                    "action": name, "data": variant.name, "method": method, "starts": starts,
                    "failed": starts - outcomes.len() as u64,
                    "iterations": mean(outcomes, |o| o.iterations), "roughness": mean(outcomes, |o| o.roughness),
                    "falls": mean(outcomes, |o| o.falls), "best_optimum_share": share(SAME_OPTIMUM),
                    "good_optimum_share": share(GOOD_OPTIMUM), "best_training": top,
                    "training": mean(outcomes, |o| o.training), "held_out": mean(outcomes, |o| o.held_out),
                    "rmse_mm": 1e3 * mean(outcomes, |o| o.rmse_m),
                });
                println!(
                    "| {name} | {} | {method} | {:.1} | {:.2} | {:.1} % | {:.1} % | {:.1} % | {:.3} | {:.3} | {:.2} mm |",
                    variant.name,
                    mean(outcomes, |o| o.iterations),
                    mean(outcomes, |o| o.roughness),
                    100.0 * mean(outcomes, |o| o.falls),
                    100.0 * share(SAME_OPTIMUM),
                    100.0 * share(GOOD_OPTIMUM),
                    mean(outcomes, |o| o.training),
                    mean(outcomes, |o| o.held_out),
                    1e3 * mean(outcomes, |o| o.rmse_m),
                );
                rows.push(row);
            }
        }
    }
    println!("\n```json\n{}\n```", json!({ "area": "gmr-fusion", "rows": rows }));
    Ok(())
}
