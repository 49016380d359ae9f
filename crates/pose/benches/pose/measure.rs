//! Times a closure.

use std::time::Instant;

use serde_json::{Value, json};

/// Milliseconds of `n` calls after a tenth as many to warm up.
pub(crate) fn times_ms(n: usize, mut call: impl FnMut()) -> Vec<f64> {
    for _ in 0..n.div_ceil(10) {
        call();
    }
    let mut times: Vec<f64> = (0..n)
        .map(|_| {
            let start = Instant::now();
            call();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times
}

pub(crate) fn row(name: &str, n: usize, call: impl FnMut()) -> Value {
    let times = times_ms(n, call);
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
    json!({
        "name": name, "unit": "ms", "ours": at(0.5), "p50": at(0.5), "p99": at(0.99), "min": at(0.0), "max": at(1.0), "n": n,
    })
}
