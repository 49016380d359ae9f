//! Measures kinematics beside its peers and prints one JSON document.
//!
//! `cargo bench -p kin --bench kin` takes a minute or two; `-- --full` runs the published counts: 10^6 inverse kinematics
//! of the built-in arm and 10^6 paths through singularities. Words among the arguments choose the parts: `kernels`,
//! `inverse`, `paths`; without any, all run.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::disallowed_methods,
    clippy::format_push_string,
    reason = "a benchmark reads the clock and prints"
)]
#![allow(missing_docs, reason = "a program")]

#[path = "kin/inverse.rs"]
mod inverse;
#[path = "kin/kernels.rs"]
mod kernels;
#[path = "kin/paths.rs"]
mod paths;

use std::time::Instant;

use kin::Chain;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

/// A seven-joint arm with a spherical shoulder and wrist, 1.2 m long.
const SEVEN: &[([f64; 3], [f64; 3], f64)] = &[
    ([0.0, 0.0, 0.2], [0.0, 0.0, 1.0], 2.9),
    ([0.0, 0.0, 0.15], [0.0, 1.0, 0.0], 2.0),
    ([0.0, 0.0, 0.2], [0.0, 0.0, 1.0], 2.9),
    ([0.0, 0.0, 0.2], [0.0, -1.0, 0.0], 2.0),
    ([0.0, 0.0, 0.2], [0.0, 0.0, 1.0], 2.9),
    ([0.0, 0.0, 0.2], [0.0, 1.0, 0.0], 2.0),
    ([0.0, 0.0, 0.08], [0.0, 0.0, 1.0], 3.0),
];

/// Where a joint is, its axis and its limit either way.
type JointAt = ([f64; 3], [f64; 3], f64);

/// A chain out of offsets, axes and symmetric limits, with the tip beyond the last joint.
fn serial(joints: &[JointAt], tip: [f64; 3]) -> Chain {
    let mut text = String::from(r#"<robot name="serial"><link name="l0"/>"#);
    for (i, (p, axis, limit)) in joints.iter().enumerate() {
        text += &format!(
            r#"<link name="l{n}"/><joint name="j{n}" type="revolute"><parent link="l{i}"/><child link="l{n}"/>
            <origin xyz="{} {} {}"/><axis xyz="{} {} {}"/><limit lower="-{limit}" upper="{limit}" effort="1" velocity="3"/></joint>"#,
            p[0],
            p[1],
            p[2],
            axis[0],
            axis[1],
            axis[2],
            n = i + 1,
        );
    }
    text += &format!(
        r#"<link name="tip"/><joint name="end" type="fixed"><parent link="l{}"/><child link="tip"/><origin xyz="{} {} {}"/></joint></robot>"#,
        joints.len(),
        tip[0],
        tip[1],
        tip[2],
    );
    kin::Robot::from_urdf_str(&text, &kin::UrdfOptions::default()).unwrap().chain("l0", "tip").unwrap()
}

fn within(chain: &Chain, random: &mut ChaCha8Rng) -> Vec<f64> {
    chain.limits().iter().map(|limits| random.random_range(limits.lower..limits.upper)).collect()
}

/// Median, 99th percentile, least and largest.
struct Spread {
    p50: f64,
    p99: f64,
    min: f64,
    max: f64,
    n: usize,
}

impl Spread {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let n = values.len();
        Self { p50: values[n / 2], p99: values[n * 99 / 100], min: values[0], max: values[n - 1], n }
    }

    fn row(&self, name: &str, unit: &str, peer: Option<(&str, f64)>, note: &str) -> Value {
        json!({
            "name": name, "unit": unit, "ours": self.p50, "p50": self.p50, "p99": self.p99, "min": self.min, "max": self.max,
            "n": self.n, "peer_name": peer.map(|p| p.0), "peer": peer.map(|p| p.1),
            "ratio": peer.map(|p| p.1 / self.p50), "note": note,
        })
    }
}

fn single(name: &str, unit: &str, ours: f64, peer: Option<(&str, f64)>, n: usize, note: &str) -> Value {
    json!({"name": name, "unit": unit, "ours": ours, "peer_name": peer.map(|p| p.0), "peer": peer.map(|p| p.1), "n": n, "note": note})
}

/// Microseconds per call over blocks of all inputs.
fn blocks<T>(inputs: &[T], count: usize, mut call: impl FnMut(&T)) -> Spread {
    let mut times = Vec::with_capacity(count);
    for _ in 0..count {
        let start = Instant::now();
        for input in inputs {
            call(input);
        }
        times.push(start.elapsed().as_secs_f64() * 1e6 / inputs.len() as f64);
    }
    Spread::of(times)
}

fn main() {
    let full = std::env::args().any(|argument| argument == "--full");
    let parts: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let wanted = |part: &str| parts.is_empty() || parts.iter().any(|p| p == part);
    let mut rows = Vec::new();
    if wanted("kernels") {
        rows.extend(kernels::rows());
    }
    if wanted("inverse") {
        rows.extend(inverse::rows(full));
    }
    if wanted("paths") {
        rows.extend(paths::rows(full));
    }
    println!("{}", json!({"area": "kin", "rows": rows}));
}
