//! Limits over millions of cases, tracking figures and update time, beside rsruckig. Prints one
//! JSON document.
//!
//! `OGG_WRIST_CSV` names a table with columns `rsho_x` .. `rwri_z` in metres at 60 Hz; without
//! it the rows of the recording say that they are left out. `OGG_BENCH_SEED` sets the seed,
//! `OGG_BENCH_SHARE` in (0, 1] runs that share of the cases.
#![expect(clippy::print_stdout, reason = "the JSON document is the product of this program")]
#![expect(clippy::disallowed_methods, reason = "a benchmark reads its clock and its environment")]

#[path = "motion/cases.rs"]
mod cases;
#[path = "motion/followers.rs"]
mod followers;
#[path = "../tests/common/judge.rs"]
mod judge;
#[path = "motion/measure.rs"]
mod measure;
#[path = "motion/signals.rs"]
mod signals;
#[path = "motion/timing.rs"]
mod timing;

use cases::{Kind, Tally};
use followers::{Ask, Follower, Ours, StateToState, Tracking};
use measure::{Figures, follow};
use serde_json::{Value, json};
use signals::Signal;

/// Bandwidth of the tracking law in all tables.
const BANDWIDTH_RAD_S: f64 = 45.0;
const PEER: &str = "rsruckig state-to-state each cycle, with target velocity";

fn main() {
    let seed = std::env::var("OGG_BENCH_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(20_260_101);
    let share: f64 = std::env::var("OGG_BENCH_SHARE").ok().and_then(|s| s.parse().ok()).unwrap_or(1.0);
    let mut rows = Vec::new();
    for (name, kind, count) in [("random", Kind::Random, 5_000_000.0), ("hostile", Kind::Hostile, 1_000_000.0)] {
        limit_rows(&mut rows, name, &cases::run(kind, (share * count) as u64, seed), seed);
    }
    timing_row(&mut rows);
    let mut signals = Signal::synthetic();
    match std::env::var("OGG_WRIST_CSV") {
        Ok(path) => {
            let table = std::fs::read_to_string(&path).expect("OGG_WRIST_CSV is readable");
            signals.push(Signal::recorded(&table).expect("OGG_WRIST_CSV has the wrist's columns"));
        }
        Err(_) => rows.push(json!({
            "name": "recorded wrist", "unit": "", "note": "left out: OGG_WRIST_CSV is not set",
        })),
    }
    for signal in &signals {
        for rate_hz in [15.0, 30.0] {
            tracking_rows(&mut rows, signal, rate_hz);
        }
    }
    println!("{}", json!({ "area": "motion", "rows": rows }));
}

fn limit_rows(rows: &mut Vec<Value>, name: &str, tally: &Tally, seed: u64) {
    let note = format!("{} updates, seed {seed}", tally.updates);
    rows.push(json!({
        "name": format!("{name} cases with a violation beyond 1e-9"), "unit": "cases",
        "ours": tally.violations, "n": tally.cases, "note": note,
    }));
    let worst = &tally.worst;
    for (quantity, unit, excess) in [
        ("position", "rad", worst.position),
        ("velocity", "rad/s", worst.velocity),
        ("acceleration", "rad/s^2", worst.acceleration),
        ("jerk", "SI", worst.jerk),
        ("consistency", "SI", worst.consistency),
    ] {
        rows.push(json!({
            "name": format!("{name} cases, largest excess of {quantity}"), "unit": unit,
            "ours": excess, "n": tally.cases, "note": "negative: room left",
        }));
    }
}

fn timing_row(rows: &mut Vec<Value>) {
    let (ours, peer) = (timing::ours(BANDWIDTH_RAD_S), timing::peer());
    rows.push(json!({
        "name": "update of 6 joints", "unit": "us", "ours": ours.p50, "peer": peer.p50,
        "peer_name": PEER, "ratio": ours.p50 / peer.p50, "p50": ours.p50, "p99": ours.p99,
        "max": ours.max, "n": ours.n,
        "note": format!("mean {:.2}, peer mean {:.2}", ours.mean, peer.mean),
    }));
}

fn tracking_rows(rows: &mut Vec<Value>, signal: &Signal, rate_hz: f64) {
    let start = signal.position(0.0);
    let run = |mut follower: Box<dyn Follower>| follow(follower.as_mut(), signal, rate_hz);
    let ours = run(Box::new(Ours::new(start, BANDWIDTH_RAD_S)));
    let moving = run(Box::new(StateToState::new(start, Ask::Moving)));
    let rest = run(Box::new(StateToState::new(start, Ask::Rest)));
    let tracking = run(Box::new(Tracking::new(start)));
    let mut row = |what: &str, unit: &str, get: &dyn Fn(&Figures) -> f64| {
        rows.push(json!({
            "name": format!("{} at {rate_hz} Hz, {what}", signal.name), "unit": unit,
            "ours": get(&ours), "peer": get(&moving), "peer_name": PEER,
            "ratio": get(&ours) / get(&moving),
            "note": format!("to rest at the target: {:.4}; rsruckig Trackig: {:.4}", get(&rest), get(&tracking)),
        }));
    };
    if signal.moving {
        row("lag", "ms", &|f| f.lag_ms);
    } else {
        row("settled to 1 %", "ms", &|f| f.settled_ms);
    }
    if signal.ends_at_rest {
        row("overshoot", "rad", &|f| f.overshoot_rad);
    }
    row("error RMS", "rad", &|f| f.error_rms_rad);
    row("jerk RMS", "rad/s^3", &|f| f.jerk_rms);
}
