//! The `ogg` program on the bus.

use std::process::{Command, Stdio};
use std::time::Duration;

use can_driver::CandumpLine;

use crate::processes::captured_run;
use crate::{Process, active, interface, judged, pause, peer, prepared};

/// Where the arm of the built-in cell stands, from the configuration that the program prints.
fn home() -> String {
    let output = Command::new(prepared("OGG_BIN")).args(["follow", "config"]).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let line = text.lines().find_map(|l| l.strip_prefix("home_rad = [")).unwrap_or_else(|| panic!("{text}"));
    line.split(']').next().unwrap().replace(' ', "")
}

#[test]
fn ogg_controller_is_a_controller_for_a_host_in_another_process() {
    let Some(name) = interface(2) else { return };
    let home = home();
    // The host asks for tighter limits than the arm's own, which are granted.
    let run = || {
        let mut controller = Command::new(prepared("OGG_BIN"));
        controller.args(["controller", "--bus", &name]);
        captured_run(&name, controller, 200, 1.0, Some(&home))
    };
    let Some((report, log)) = judged(active, run) else { return };
    assert_eq!(report["state"], "Active", "{report}");
    assert!(log.lines().count() > 1000, "{}", log.lines().count());
}

#[test]
fn ogg_can_logs_what_it_then_replays_and_monitors() {
    let (Some(from), Some(to)) = (interface(8), interface(10)) else { return };
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("run.log");
    let can = |arguments: &[&str]| {
        let mut command = Command::new(prepared("OGG_BIN"));
        command.arg("can").args(arguments);
        command
    };
    let mut logger = Process::start(&mut can(&["log", "--bus", &from, "--out", log.to_str().unwrap()]));
    let _controller = Process::start(&mut peer(&["controller", &from, "30"]));
    pause(Duration::from_millis(700));
    logger.kill();
    let text = std::fs::read_to_string(&log).unwrap();
    let logged = text.lines().map(|l| CandumpLine::parse(l, 1).unwrap().unwrap().frame).collect::<Vec<_>>();
    assert!(logged.len() > 100, "{}", logged.len());

    let monitor = can(&["monitor", "--bus", &to, "--duration", "3"]).stdout(Stdio::piped()).spawn().unwrap();
    pause(Duration::from_millis(800));
    let arguments = ["replay", log.to_str().unwrap(), "--bus", to.as_str(), "--speed", "2", "--sender", "controller"];
    let replay = can(&arguments).output().unwrap();
    assert!(replay.status.success(), "{}", String::from_utf8_lossy(&replay.stderr));
    let said = String::from_utf8(replay.stdout).unwrap();
    assert!(said.starts_with(&format!("{} frames sent, 0 not", logged.len())), "{said}");
    let output = monitor.wait_with_output().unwrap();
    let seen = String::from_utf8(output.stdout).unwrap();
    assert_eq!(seen.lines().count(), logged.len());
    assert!(seen.lines().any(|l| l.contains("State Unconfigured")), "{seen}");
}
