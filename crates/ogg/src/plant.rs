//! The controller's end of the bus with the simulated arm behind it, joined to a bus.

use std::fmt;
use std::time::Duration;

use can_driver::{Bus, Controller, Event, SendOutcome, Stamped};
use sim::{Arm, ArmParams, ControllerNode};

use crate::cell::Cell;
use crate::error::Error;

/// Frames and faults that may wait for one call.
const EVENTS: usize = 1024;

/// Controller and arm in the caller's time. The host cannot tell it from a real robot.
pub struct Plant<B> {
    bus: B,
    node: ControllerNode,
    events: Vec<Event>,
    frames: Vec<Stamped>,
}

impl<B> fmt::Debug for Plant<B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Plant").field("measured", &self.node.arm().measured()).finish_non_exhaustive()
    }
}

impl<B: Bus> Plant<B> {
    /// The simulated arm of a cell, at its home position, on an end of a bus.
    ///
    /// # Errors
    /// [`Error::Sim`] for a robot that cannot be simulated, [`Error::Usage`] where the chain is not the whole robot.
    pub fn new(cell: &Cell, bus: B) -> Result<Self, Error> {
        let whole: Vec<_> = cell.robot.dofs().to_vec();
        if whole != cell.chain.joints() {
            return Err(Error::Usage(format!(
                "{}: the simulated arm needs the chain {} -> {} to hold every moving joint of the robot, in order ({}); it holds {}",
                cell.robot.name(),
                cell.chain.base(),
                cell.chain.tip(),
                cell.robot.dof_names().join(", "),
                cell.chain.joint_names().join(", ")
            )));
        }
        let arm = Arm::new(&cell.robot, ArmParams::new(cell.config.robot.home_rad.clone()))?;
        let node = ControllerNode::new(Controller::new(cell.controller())?, arm)?;
        Ok(Self { bus, node, events: Vec::with_capacity(EVENTS), frames: Vec::new() })
    }

    /// Runs controller and arm up to `now`.
    ///
    /// # Errors
    /// [`Error::Bus`] when the bus is gone.
    pub fn advance_to(&mut self, now: Duration) -> Result<(), Error> {
        self.bus.drain(now, &mut self.events)?;
        self.frames.clear();
        self.node.advance_to(now, &self.events, &mut self.frames)?;
        for stamped in &self.frames {
            // A full queue is a lost frame; the host's session sees the gap.
            if self.bus.send(stamped.at, &stamped.frame)? == SendOutcome::Full {
                tracing::debug!("the controller's frame found the bus full");
            }
        }
        Ok(())
    }
}
