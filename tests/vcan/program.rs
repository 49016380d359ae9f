//! The `ogg` program on the bus.

use std::process::Command;

use crate::processes::captured_run;
use crate::{interface, prepared};

#[test]
fn ogg_controller_is_a_controller_for_a_host_in_another_process() {
    let Some(name) = interface(2) else { return };
    let mut controller = Command::new(prepared("OGG_BIN"));
    controller.args(["controller", "--bus", &name]);
    // The host of these tests asks for tighter limits than the arm's own, which are granted.
    let (report, log) = captured_run(&name, controller, 200, 1.0);
    assert_eq!(report["state"], "Active", "{report}");
    assert!(log.lines().count() > 1000, "{}", log.lines().count());
}
