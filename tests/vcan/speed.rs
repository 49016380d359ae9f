//! Round trip and throughput beside python-can, in one run on one kernel.

use std::io::{BufRead as _, BufReader};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use can_driver::{Bus as _, Event, Filter, Id, SendOutcome, SocketCan};

use crate::{Process, frame, interface, peer, prepared, setting};

fn receive(bus: &mut SocketCan) -> can_driver::Frame {
    for _ in 0..20 {
        if let Some(Event::Frame(stamped)) = bus.receive(Duration::ZERO).unwrap() {
            return stamped.frame;
        }
        bus.wait(Duration::from_millis(50)).unwrap();
    }
    panic!("no frame within a second");
}

fn started(command: &mut Command) -> Process {
    let mut process = Process::start(command.stdout(Stdio::piped()));
    let mut line = String::new();
    BufReader::new(process.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    assert_eq!(line.trim(), "ready");
    process
}

/// Median and 99th percentile of the round trip in us, and frames a second through one pair.
fn ours(name: &str, count: u64) -> (f64, f64, f64) {
    let mut trips_us = Vec::new();
    {
        let _echo = started(&mut peer(&["echo", name, "60"]));
        let mut bus = SocketCan::open(name, Filter::Only(&[Id::new(0x501).unwrap()]), 65_536).unwrap();
        for k in 0..count {
            let begin = Instant::now();
            assert_eq!(bus.send(Duration::ZERO, &frame(0x500, &k.to_le_bytes())).unwrap(), SendOutcome::Sent);
            assert_eq!(receive(&mut bus).data(), k.to_le_bytes());
            trips_us.push(begin.elapsed().as_secs_f64() * 1e6);
        }
    }
    let mut sender = SocketCan::open(name, Filter::Only(&[]), 262_144).unwrap();
    let mut receiver = SocketCan::open(name, Filter::All, 4096).unwrap();
    let begin = Instant::now();
    for k in (0..count).step_by(50) {
        for i in k..k + 50 {
            assert_eq!(sender.send(Duration::ZERO, &frame(0x400, &i.to_le_bytes())).unwrap(), SendOutcome::Sent);
        }
        for i in k..k + 50 {
            assert_eq!(receive(&mut receiver).data(), i.to_le_bytes());
        }
    }
    let rate_hz = count as f64 / begin.elapsed().as_secs_f64();
    trips_us.sort_by(f64::total_cmp);
    (trips_us[trips_us.len() / 2], trips_us[trips_us.len() * 99 / 100], rate_hz)
}

fn theirs(name: &str, count: u64) -> (f64, f64, f64) {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/vcan/judges.py");
    let python = || {
        let mut command = Command::new(prepared("VCAN_PYTHON"));
        command.arg(script);
        command
    };
    let _echo = started(python().args(["echo", name, "60"]));
    let output = python().args(["speed", name, &count.to_string()]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let value = |field: &str| report[field].as_f64().unwrap();
    (value("round_trip_p50_us"), value("round_trip_p99_us"), value("through_hz"))
}

#[test]
fn round_trip_and_throughput_beside_python_can() {
    let Some(name) = interface(7) else { return };
    let count = setting("VCAN_SPEED_FRAMES", 1000.0) as u64;
    let (mine, python) = (ours(&name, count), theirs(&name, count));
    eprintln!("                      ours    python-can");
    eprintln!("round trip p50 us {:>8.0} {:>13.0}", mine.0, python.0);
    eprintln!("round trip p99 us {:>8.0} {:>13.0}", mine.1, python.1);
    eprintln!("frames a second   {:>8.0} {:>13.0}", mine.2, python.2);
    assert!(mine.0 < python.0, "the median round trip is shorter than python-can's");
    assert!(mine.2 > python.2, "more frames a second pass than through python-can");
}
