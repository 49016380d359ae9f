//! The arm behind the controller.

use std::time::Duration;

use can_driver::{ControllerOutput, JointState};

/// An arm that is where its setpoints are: drives without lag, brakes without slip.
#[derive(Debug)]
pub(super) struct Plant {
    joints: Vec<JointState>,
}

impl Plant {
    pub(super) fn new(home_rad: &[f64]) -> Self {
        let joints = home_rad.iter().map(|q| JointState { position_rad: *q, velocity_rad_s: 0.0 }).collect();
        Self { joints }
    }

    pub(super) fn measured(&self) -> &[JointState] {
        &self.joints
    }

    /// Moves by `_dt` under the controller's output.
    pub(super) fn step(&mut self, _dt: Duration, output: &ControllerOutput) {
        for (joint, setpoint) in self.joints.iter_mut().zip(&output.setpoints) {
            *joint = JointState { position_rad: setpoint.position_rad, velocity_rad_s: setpoint.velocity_rad_s };
        }
    }
}
