//! Times a closure.

use std::time::{Duration, Instant};

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

/// With the processor time of all threads, which a busy machine lengthens less.
pub(crate) fn row(name: &str, n: usize, call: impl FnMut()) -> Value {
    let before = processor_ms();
    let times = times_ms(n, call);
    // With those that warm up.
    let calls = (n + n.div_ceil(10)) as f64;
    let mut row = of_times(name, &times);
    row["ours_processor"] = json!((processor_ms() - before) / calls);
    row
}

/// Processor time of this process's threads so far.
fn processor_ms() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let text = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("schedstat")).ok());
    text.filter_map(|text| text.split_whitespace().next()?.parse::<f64>().ok()).sum::<f64>() * 1e-6
}

/// As many calls as fit into `budget`, at least 5 and at most `most`.
pub(crate) fn row_for(name: &str, budget: Duration, most: usize, mut call: impl FnMut()) -> Value {
    let start = Instant::now();
    call();
    let fits = (budget.as_secs_f64() / start.elapsed().as_secs_f64().max(1e-9)) as usize;
    of_times(name, &times_ms(fits.clamp(5, most), call))
}

fn of_times(name: &str, times: &[f64]) -> Value {
    let n = times.len();
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
    json!({
        "name": name, "unit": "ms", "ours": at(0.5), "p50": at(0.5), "p99": at(0.99), "min": at(0.0), "max": at(1.0), "n": n,
    })
}
