//! `ogg controller`: the controller's end of the joint protocol on a SocketCAN interface.

use std::time::Duration;

use can_driver::{Bus as _, Controller, ControllerState, Event, Filter, Protocol, SocketCan, drain};

use super::plant::Plant;
use super::{ControllerArgs, Until};
use crate::cell::Cell;
use crate::commands::say;
use crate::config::Config;
use crate::error::Error;

/// The controller's own cycle, that of a drive's position loop.
const TICK: Duration = Duration::from_millis(1);
/// Room for the reports of one tick, some times over.
const SEND_BUFFER_BYTES: u32 = 16_384;
const EVENTS: usize = 256;

/// Runs until a signal or the given time.
///
/// # Errors
/// What is wrong with the configuration; [`Error::Bus`] when the interface is down or gone.
pub fn controller(args: &ControllerArgs) -> Result<(), Error> {
    let config = match &args.config {
        Some(path) => Config::load(path)?,
        None => Config::builtin(),
    };
    let home_rad = config.robot.home_rad.clone();
    let cell = Cell::open(config)?;
    let mut controller = Controller::new(cell.controller())?;
    let mut plant = Plant::new(&home_rad);
    let mut bus = SocketCan::open(&args.bus, Filter::Only(&Protocol::IDS), SEND_BUFFER_BYTES)?;
    let until = Until::new(args.duration)?;
    tracing::info!(bus = args.bus, joints = controller.joints(), "controller runs");

    let mut rx: Vec<Event> = Vec::with_capacity(EVENTS);
    let mut state = ControllerState::Unconfigured;
    let (mut last, mut due) = (Duration::ZERO, TICK);
    let mut unsent = 0_u64;
    while !until.over() {
        // A frame is answered at once, and the path moves on at least every tick.
        bus.wait(due.saturating_sub(until.now()))?;
        let now = until.now();
        if now >= due {
            due = now + TICK;
        }
        drain(&mut bus, now, &mut rx)?;
        let output = controller.tick(now, &rx, plant.measured());
        for frame in &output.tx {
            if bus.send(now, frame)? == can_driver::SendOutcome::Full {
                unsent += 1;
            }
        }
        plant.step(now.saturating_sub(last), &output);
        last = now;
        if output.state != state {
            state = output.state;
            match output.cause {
                Some(cause) => tracing::warn!(?state, code = cause.code(), "{cause}"),
                None => tracing::info!(?state),
            }
        }
    }
    let c = controller.counts();
    say(format_args!(
        "sets: {} accepted, {} lost, {} stale, {} out of sequence, {} incomplete, {} too far; {} damaged frames; {unsent} \
         frames not taken by the bus; ended {state:?}",
        c.accepted, c.lost, c.stale, c.out_of_sequence, c.incomplete, c.step_too_large, c.corrupt_frames
    ));
    Ok(())
}
