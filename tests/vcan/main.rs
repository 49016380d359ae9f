//! Tests on a real SocketCAN interface.
//!
//! `cargo xtask vcan-test` runs them, natively or in a guest kernel (see `README.md`). Without an
//! interface they say so and pass, unless `OGG_REQUIRE_VCAN=1`, which the command above sets.

#![expect(clippy::unwrap_used, reason = "tests")]

mod exchange;
mod judges;
mod kill;
mod processes;
mod program;
mod socket;
mod speed;

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use can_driver::{Filter, Frame, Id, SocketCan};
use serde_json::Value;

/// An interface for one test alone, or `None` where there is no CAN.
///
/// # Panics
/// If `OGG_REQUIRE_VCAN=1` and there is none.
fn interface(number: usize) -> Option<String> {
    let name = format!("vcan{number}");
    match SocketCan::open(&name, Filter::All, 65_536) {
        Ok(_) => Some(name),
        Err(e) => {
            let required = std::env::var_os("OGG_REQUIRE_VCAN").is_some_and(|v| v == "1");
            assert!(!required, "{name} is required: {e}");
            eprintln!("SKIPPED: {e} (cargo xtask vcan-test brings a kernel with vcan)");
            None
        }
    }
}

/// Times that a disturbed run is tried.
const ATTEMPTS: usize = 4;

/// What a run gives, its host's report and the rest, once `holds` is true of the report or the scheduler has not disturbed it. A host that
/// is woken more than 4 ms late may stop, as it should, and says nothing about our code. `None`, and a line that says so, where every
/// attempt was disturbed.
fn judged<T>(holds: impl Fn(&Value) -> bool, mut run: impl FnMut() -> (Value, T)) -> Option<(Value, T)> {
    for _ in 0..ATTEMPTS {
        let (report, rest) = run();
        let latest_us = report["wake_late_us"]["max"].as_u64().unwrap();
        if holds(&report) || latest_us < 4_000 {
            return Some((report, rest));
        }
        eprintln!("DISTURBED: the host was woken {latest_us} us late: {report}");
    }
    eprintln!("NOT JUDGED: this machine wakes processes too late");
    None
}

/// Whether the session was still active at the end.
fn active(report: &Value) -> bool {
    report["state"] == "Active"
}

/// The report that a host process prints as its last line.
fn host_report(output: &std::process::Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    let report = text.lines().last().and_then(|line| serde_json::from_str(line).ok());
    report.unwrap_or_else(|| panic!("no report in {text:?}: {}", String::from_utf8_lossy(&output.stderr)))
}

/// A number from the environment.
fn setting(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().map_or(default, |text| text.parse().unwrap_or_else(|e| panic!("{name}={text}: {e}")))
}

/// A program that `cargo xtask vcan-test` has made ready.
///
/// # Panics
/// If it has not.
fn prepared(variable: &str) -> PathBuf {
    PathBuf::from(std::env::var_os(variable).unwrap_or_else(|| panic!("{variable} is set by cargo xtask vcan-test")))
}

/// A child process that does not outlive its test.
struct Process(Child);

impl Process {
    fn start(command: &mut Command) -> Self {
        Self(command.stdin(Stdio::null()).spawn().unwrap_or_else(|e| panic!("{command:?}: {e}")))
    }

    /// SIGKILL.
    fn kill(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// One of the programs of `peer.rs`.
fn peer(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_vcan-peer"));
    command.args(arguments);
    command
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::new(Id::new(id).unwrap(), data).unwrap()
}

fn pause(time: Duration) {
    std::thread::sleep(time);
}
