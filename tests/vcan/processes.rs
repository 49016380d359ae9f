//! Host and controller as two processes on one bus, others listening.

use std::io::Read as _;
use std::process::Command;
use std::time::Duration;

use can_driver::{CandumpLine, Message, Protocol};
use serde_json::Value;

use crate::{Process, active, host_report, interface, judged, pause, peer, prepared};

/// Runs host and controller for some seconds, with candump beside them; gives the host's report
/// and the log. `centre` are angles that the host stays near.
pub(crate) fn captured_run(
    name: &str,
    mut controller: Command,
    rate_hz: u32,
    seconds: f64,
    centre: Option<&str>,
) -> (Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("candump.log");
    let candump = Command::new(prepared("VCAN_TOOLS").join("candump"))
        .args(["-L", name])
        .stdout(std::fs::File::create(&log).unwrap())
        .stdin(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let mut candump = Process(candump);
    let mut controller = Process::start(&mut controller);
    pause(Duration::from_millis(300));
    let output = peer(&["host", name, &rate_hz.to_string(), &seconds.to_string()]).args(centre).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    pause(Duration::from_millis(100));
    controller.kill();
    candump.kill();
    let mut text = String::new();
    std::fs::File::open(&log).unwrap().read_to_string(&mut text).unwrap();
    (host_report(&output), text)
}

/// Every frame of a log through the codec: how many of each identifier.
fn decoded(log: &str) -> std::collections::BTreeMap<u16, usize> {
    let protocol = Protocol::new(0).unwrap();
    let mut counts = std::collections::BTreeMap::new();
    for (number, line) in log.lines().enumerate() {
        let Some(line) = CandumpLine::parse(line, number + 1).unwrap() else { continue };
        let counted = protocol.decode(&line.frame).unwrap_or_else(|_| panic!("damaged: {line}")).unwrap();
        if let Message::Stop { cause, .. } = counted.message {
            panic!("stopped: {cause:?}");
        }
        *counts.entry(line.frame.id().raw()).or_default() += 1;
    }
    counts
}

#[test]
fn a_host_and_a_controller_process_exchange_whole_sets_while_candump_listens() {
    let Some(name) = interface(1) else { return };
    let run = || captured_run(&name, peer(&["controller", &name, "30"]), 200, 2.0, None);
    let Some((report, log)) = judged(active, run) else { return };
    assert_eq!(report["state"], "Active", "{report}");
    assert_eq!(report["corrupt_frames"], 0, "{report}");
    assert_eq!(report["transmit_full"], 0, "{report}");
    let counts = decoded(&log);
    let sets = counts[&0x103];
    assert!(sets >= 300, "{counts:?}");
    // The log may begin or end inside a set.
    for (id, whole) in [(0x100, 0x103), (0x101, 0x103), (0x102, 0x103), (0x180, 0x183), (0x181, 0x183), (0x182, 0x183)]
    {
        assert!(counts[&id].abs_diff(counts[&whole]) <= 1, "{counts:?}");
    }
}
