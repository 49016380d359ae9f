//! The robot's end of the bus: the controller's rules and the plant behind them, in virtual time.

use std::collections::VecDeque;
use std::time::Duration;

use can_driver::{Controller, ControllerOutput, Event, Stamped};

use crate::arm::Arm;
use crate::error::Error;

/// How often the controller runs.
const TICK: Duration = Duration::from_millis(1);

/// A controller with an arm behind it.
///
/// The node ticks at every whole millisecond of its own clock. An event acts in the first tick that is not before
/// its stamp, so live and offline runs with equal stamps give equal frames.
#[expect(missing_debug_implementations, reason = "rapier's world has none")]
pub struct ControllerNode {
    controller: Controller,
    arm: Arm,
    next: Duration,
    waiting: VecDeque<Event>,
    due: Vec<Event>,
    last: Option<ControllerOutput>,
}

impl ControllerNode {
    /// # Errors
    /// [`Error::JointCount`] when controller and arm differ in their number of joints.
    pub fn new(controller: Controller, arm: Arm) -> Result<Self, Error> {
        if controller.joints() != arm.joints() {
            return Err(Error::JointCount { expected: controller.joints(), got: arm.joints() });
        }
        Ok(Self { controller, arm, next: Duration::ZERO, waiting: VecDeque::new(), due: Vec::new(), last: None })
    }

    /// Runs all ticks up to and including `now`. `rx` are frames and conditions of the bus in the order of their
    /// stamps; those after `now` wait. What the controller sends is added to `tx`, stamped with its tick.
    ///
    /// # Errors
    /// None of the arm's can arise from a controller with as many joints; they are passed on all the same.
    pub fn advance_to(&mut self, now: Duration, rx: &[Event], tx: &mut Vec<Stamped>) -> Result<(), Error> {
        self.waiting.extend(rx);
        while self.next <= now {
            self.due.clear();
            while let Some(&event) = self.waiting.front() {
                match event {
                    Event::Frame(stamped) if stamped.at > self.next => break,
                    _ => self.due.push(event),
                }
                self.waiting.pop_front();
            }
            let output = self.controller.tick(self.next, &self.due, self.arm.measured());
            tx.extend(output.tx.iter().map(|&frame| Stamped { at: self.next, frame }));
            self.arm.step(TICK, &output.setpoints, output.drive)?;
            self.last = Some(output);
            self.next += TICK;
        }
        Ok(())
    }

    /// The controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The arm.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// What the controller decided in its last tick; `None` before the first.
    pub fn last_output(&self) -> Option<&ControllerOutput> {
        self.last.as_ref()
    }
}
