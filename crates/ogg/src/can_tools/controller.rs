//! `ogg controller`: the controller's end of the joint protocol on a SocketCAN interface, with the simulated arm behind it.

use std::time::Duration;

use can_driver::{Bus as _, Controller, ControllerState, Event, Filter, Frame, Protocol, SendOutcome, SocketCan};
use sim::{Arm, ArmParams, ControllerNode};

use super::{ControllerArgs, Until};
use crate::cell::Cell;
use crate::commands::say;
use crate::config::Config;
use crate::error::Error;

/// The controller's own cycle, that of a drive's position loop.
const TICK: Duration = Duration::from_millis(1);
/// Room for the reports of one tick, some times over.
const SEND_BUFFER_BYTES: u32 = 16_384;
/// Frames and faults taken in one tick; a cycle has at most a dozen.
const EVENTS: usize = 256;

/// Runs until a signal or the given time.
///
/// # Errors
/// What is wrong with the configuration or the robot; [`Error::Bus`] when the interface is down or gone.
pub fn controller(args: &ControllerArgs) -> Result<(), Error> {
    let config = match &args.config {
        Some(path) => Config::load(path)?,
        None => Config::builtin(),
    };
    let cell = Cell::open(config)?;
    let arm = Arm::new(&cell.robot, ArmParams::new(cell.config.robot.home_rad.clone()))?;
    let mut node = ControllerNode::new(Controller::new(cell.controller())?, arm)?;
    let mut bus = SocketCan::open(&args.bus, Filter::Only(&Protocol::IDS), SEND_BUFFER_BYTES)?;
    let until = Until::new(args.duration)?;
    tracing::info!(bus = args.bus, joints = node.controller().joints(), "controller runs");

    let mut rx: Vec<Event> = Vec::with_capacity(EVENTS);
    let mut tx = Vec::new();
    let mut frames: Vec<Frame> = Vec::new();
    let mut state = ControllerState::Unconfigured;
    let mut due = TICK;
    let mut unsent = 0_u64;
    while !until.over() {
        std::thread::sleep(due.saturating_sub(until.now()));
        let now = until.now();
        due = now + TICK;
        bus.drain(now, &mut rx)?;
        tx.clear();
        node.advance_to(now, &rx, &mut tx)?;
        frames.clear();
        frames.extend(tx.iter().map(|stamped| stamped.frame));
        unsent += u64::from(bus.transmit(now, &frames)? == SendOutcome::Full);
        if let Some(output) = node.last_output().filter(|output| output.state != state) {
            state = output.state;
            if let Some(cause) = output.cause {
                tracing::warn!(?state, code = cause.code(), "{cause}");
            } else {
                tracing::info!(?state);
            }
        }
    }
    let c = node.controller().counts();
    say(format_args!(
        "sets: {} accepted, {} lost, {} stale, {} out of sequence, {} incomplete, {} too far; {} damaged frames; {unsent} \
         ticks cut short by a full bus; ended {state:?}",
        c.accepted, c.lost, c.stale, c.out_of_sequence, c.incomplete, c.step_too_large, c.corrupt_frames
    ));
    Ok(())
}
