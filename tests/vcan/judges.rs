//! python-can and cantools, which share no code with this project, read the same bus with the DBC
//! file.

use std::process::{Command, Stdio};
use std::time::Duration;

use can_driver::{CandumpLine, DBC, Dbc, Protocol};
use serde_json::Value;

use crate::processes::captured_run;
use crate::{Process, active, host_report, interface, judged, pause, peer, prepared};

fn python(script: &str) -> Command {
    let mut command = Command::new(prepared("VCAN_PYTHON"));
    command.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/vcan/judges.py")).arg(script);
    command
}

fn dbc_file(folder: &tempfile::TempDir) -> std::path::PathBuf {
    let path = folder.path().join("ogg-joint.dbc");
    std::fs::write(&path, DBC).unwrap();
    path
}

#[test]
fn cantools_decodes_every_frame_of_a_run_to_the_values_of_the_codec() {
    let Some(name) = interface(3) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_, log) = captured_run(&name, peer(&["controller", &name, "30"]), 200, 1.5, None);
    let path = folder.path().join("run.log");
    std::fs::write(&path, &log).unwrap();
    let output = python("decode").arg(dbc_file(&folder)).arg(&path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let theirs = String::from_utf8(output.stdout).unwrap();
    let dbc = Dbc::parse(DBC).unwrap();
    let protocol = Protocol::new(0).unwrap();
    let mut frames = 0;
    for (line, theirs) in log.lines().zip(theirs.lines()) {
        let line = CandumpLine::parse(line, frames + 1).unwrap().unwrap();
        assert!(protocol.decode(&line.frame).unwrap().is_some());
        let theirs: Value = serde_json::from_str(theirs).unwrap();
        let message = dbc.message(line.frame.id().raw()).unwrap();
        assert_eq!(theirs["message"], message.name.as_str());
        for signal in &message.signals {
            let value = signal.physical(line.frame.data());
            let other = theirs["signals"][&signal.name].as_f64().unwrap_or_else(|| panic!("{theirs}"));
            assert!((value - other).abs() <= 1e-9 * value.abs().max(1.0), "{line} {}: {value} {other}", signal.name);
        }
        frames += 1;
    }
    assert_eq!(frames, log.lines().count(), "every frame is judged");
    assert!(frames > 500, "{frames}");
    eprintln!("cantools agrees on {frames} frames");
}

#[test]
fn the_codec_accepts_what_cantools_encodes() {
    // No interface is needed, but the Python packages are.
    let Some(_) = interface(3) else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = python("encode").arg(dbc_file(&folder)).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let protocol = Protocol::new(0).unwrap();
    let mut kinds = std::collections::BTreeSet::new();
    for (number, line) in String::from_utf8(output.stdout).unwrap().lines().enumerate() {
        let line = CandumpLine::parse(line, number + 1).unwrap().unwrap();
        let counted = protocol.decode(&line.frame).unwrap_or_else(|_| panic!("refused: {line}")).unwrap();
        assert_eq!(protocol.encode(&counted), line.frame, "{counted:?}");
        kinds.insert(line.frame.id().raw());
    }
    assert_eq!(kinds.len(), Protocol::IDS.len());
}

/// What the host reports, and what python-can saw of the session on the bus.
fn heard(name: &str) -> (Value, Value) {
    let folder = tempfile::tempdir().unwrap();
    let listener = python("listen").arg(dbc_file(&folder)).args([name, "3"]).stdout(Stdio::piped()).spawn().unwrap();
    pause(Duration::from_millis(1500)); // python starts
    let _controller = Process::start(&mut peer(&["controller", name, "30"]));
    let host = peer(&["host", name, "100", "3"]).stdout(Stdio::piped()).spawn().unwrap();
    let output = listener.wait_with_output().unwrap();
    assert!(output.status.success());
    (host_report(&host.wait_with_output().unwrap()), serde_json::from_slice(&output.stdout).unwrap())
}

#[test]
fn python_can_reads_the_bus_beside_the_sessions() {
    let Some(name) = interface(4) else { return };
    let Some((_, report)) = judged(active, || heard(&name)) else { return };
    assert_eq!(report["undecodable"], 0, "{report}");
    assert!(report["states"].as_array().unwrap().contains(&Value::from("Active")), "{report}");
    // The joint swings from 0.25 rad by up to 0.6 rad downwards.
    let (low, high) = (report["joint1_min"].as_f64().unwrap(), report["joint1_max"].as_f64().unwrap());
    assert!((0.24..0.26).contains(&high) && low < high && low > -0.4, "{report}");
}
