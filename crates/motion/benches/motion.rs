//! Limits over millions of cases, tracking figures and update time, beside rsruckig. Prints one
//! JSON document.
//!
//! `--wrist FILE` names a table with columns `rsho_x` .. `rwri_z` in metres at 60 Hz; without it the rows of the
//! recording say that they are left out. `--seed N` sets the seed, `--share X` in (0, 1] runs that share of the cases,
//! `--tables` the tracking tables alone.
#![expect(clippy::print_stdout, reason = "the JSON document is the product of this program")]
#![expect(clippy::disallowed_methods, reason = "a benchmark reads its clock")]

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
    let seed = argument("--seed").map_or(20_260_101, |s| s.parse().expect("--seed takes a whole number"));
    let share: f64 = argument("--share").map_or(1.0, |s| s.parse().expect("--share takes a number"));
    let mut rows = Vec::new();
    if !std::env::args().any(|a| a == "--tables") {
        for (name, kind, count) in [("random", Kind::Random, 5_000_000.0), ("hostile", Kind::Hostile, 1_000_000.0)] {
            limit_rows(&mut rows, name, &cases::run(kind, (share * count) as u64, seed), seed);
        }
        timing_row(&mut rows);
    }
    let mut signals = Signal::synthetic();
    match argument("--wrist") {
        Some(path) => {
            let table = std::fs::read_to_string(&path).expect("the table of the wrist is readable");
            signals.push(Signal::recorded(&table).expect("the table of the wrist has its columns"));
        }
        None => rows.push(json!({
            "name": "recorded wrist", "unit": "", "note": "left out: no --wrist FILE",
        })),
    }
    for signal in &signals {
        for rate_hz in [15.0, 30.0] {
            tracking_rows(&mut rows, signal, rate_hz);
        }
    }
    println!("{}", json!({ "area": "motion", "rows": rows }));
}

/// What follows `name` on the command line.
fn argument(name: &str) -> Option<String> {
    let mut arguments = std::env::args().skip_while(|a| a != name);
    arguments.nth(1)
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
        "peer_name": PEER, "ratio": peer.p50 / ours.p50, "p50": ours.p50, "p99": ours.p99,
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
            "ratio": get(&moving) / get(&ours),
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
