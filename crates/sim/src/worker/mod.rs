//! The seated worker: where every joint is at any time.
//!
//! `pose_at(t)` is a pure function of the parameters and `t`. The phase of the cycle is `t / period` plus a slow
//! seeded drift; the action's displacement at that phase, scaled by slowly varying seeded amplitudes, moves the
//! wrists and the trunk; the arms follow by two-link inverse kinematics. Trajectories are twice continuously
//! differentiable and bone lengths are exact.
//!
//! Frame `world`: z up, the bench top is z = 0, the worker sits at negative x facing +x with the right arm at
//! negative y. Body frames have x forward, y left, z up.

mod action;
mod body;
mod keypoint;
mod pose;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;
use std::time::Duration;

pub use action::Action;
pub use body::BodyShape;
pub use keypoint::{KEYPOINT_COUNT, Keypoint};
pub use pose::{HandPose, WorkerPose};

use crate::error::{Error, within};
use crate::smooth::noise;

/// Which actions the worker performs, and in which order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Script {
    /// One action over and over.
    Repeat(Action),
    /// Move, align and flip in turn, each this many times in a row.
    Round {
        /// Cycles of one action before the next begins.
        repetitions: u32,
    },
}

/// Free parameters of a [`Worker`].
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WorkerParams {
    /// Same seed, same worker.
    pub seed: u64,
    /// Body of the worker.
    pub body: BodyShape,
    /// What the worker does.
    pub script: Script,
    /// Mean length of one cycle.
    pub period_s: f64,
    /// Size of the differences between repetitions: 0 none, 1 those of a practised worker
    /// (about 5 % in amplitude, 8 mm in place, 2 % of a cycle in time).
    pub variation: f64,
    /// Size of the movements, 1 for those of the paper's fabric of 260 x 160 mm.
    pub amplitude: f64,
    /// Where the right wrist rests, in `world`, metres.
    pub right_home_m: [f64; 3],
    /// Where the left wrist rests, in `world`, metres.
    pub left_home_m: [f64; 3],
    /// Hip centre in `world`, metres.
    pub hip_m: [f64; 3],
    /// Forward lean of the trunk at rest, radians.
    pub lean_rad: f64,
}

impl Default for WorkerParams {
    fn default() -> Self {
        Self {
            seed: 0,
            body: BodyShape::default(),
            script: Script::Round { repetitions: 3 },
            period_s: 3.0,
            variation: 1.0,
            amplitude: 1.0,
            right_home_m: [0.0, -0.18, 0.06],
            left_home_m: [0.03, 0.17, 0.055],
            hip_m: [-0.36, 0.0, -0.16],
            lean_rad: 0.2,
        }
    }
}

/// A seated person performing sewing actions with the right arm while the left hand holds the fabric.
///
/// ```
/// use sim::{Action, Keypoint, Script, Worker, WorkerParams};
/// use std::time::Duration;
///
/// let worker = Worker::new(WorkerParams { script: Script::Repeat(Action::Flip), ..WorkerParams::default() })?;
/// let pose = worker.pose_at(Duration::from_millis(1500));
/// let forearm = pose.joint(Keypoint::RightWrist) - pose.joint(Keypoint::RightElbow);
/// assert!((forearm.norm() - 0.25).abs() < 1e-12);
/// # Ok::<(), sim::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Worker {
    params: WorkerParams,
}

impl Worker {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the field, [`Error::Zero`] a script without repetitions.
    pub fn new(params: WorkerParams) -> Result<Self, Error> {
        params.body.validate()?;
        within("period_s", params.period_s, 0.5, 60.0)?;
        within("variation", params.variation, 0.0, 4.0)?;
        within("amplitude", params.amplitude, 0.0, 2.0)?;
        within("lean_rad", params.lean_rad, -0.5, 1.0)?;
        for value in params.right_home_m.into_iter().chain(params.left_home_m).chain(params.hip_m) {
            within("home or hip coordinate (m)", value, -2.0, 2.0)?;
        }
        if params.script == (Script::Round { repetitions: 0 }) {
            return Err(Error::Zero { field: "script.repetitions" });
        }
        Ok(Self { params })
    }

    /// The parameters this worker was made from.
    pub fn params(&self) -> &WorkerParams {
        &self.params
    }

    /// The action under way at `since_start`.
    pub fn action_at(&self, since_start: Duration) -> Action {
        let (cycle, _) = self.cycle_at(since_start.as_secs_f64());
        self.action_of_cycle(cycle)
    }

    /// Where everything is at `since_start`.
    pub fn pose_at(&self, since_start: Duration) -> WorkerPose {
        self.pose_at_secs(since_start.as_secs_f64())
    }

    fn action_of_cycle(&self, cycle: i64) -> Action {
        match self.params.script {
            Script::Repeat(action) => action,
            Script::Round { repetitions } => {
                let turn = cycle.div_euclid(i64::from(repetitions)).rem_euclid(3);
                Action::ALL[turn as usize]
            }
        }
    }

    /// Half turns the fabric has made before `cycle`.
    fn flips_before(&self, cycle: i64) -> i64 {
        match self.params.script {
            Script::Repeat(Action::Flip) => cycle,
            Script::Repeat(_) => 0,
            Script::Round { repetitions } => {
                let n = i64::from(repetitions);
                cycle.div_euclid(3 * n) * n + (cycle.rem_euclid(3 * n) - 2 * n).max(0)
            }
        }
    }

    /// Cycle number and phase in `[0, 1)`. The seeded drift changes the rate by at most 10 % at `variation` 1,
    /// and is scaled back above that so that the phase always advances.
    fn cycle_at(&self, t_s: f64) -> (i64, f64) {
        let turns = t_s / self.params.period_s;
        let drift = 0.04 * self.params.variation.min(3.0);
        let phase = turns + drift * (noise(self.params.seed, 1, turns) - noise(self.params.seed, 1, 0.0));
        (phase.floor() as i64, phase - phase.floor())
    }

    fn pose_at_secs(&self, t_s: f64) -> WorkerPose {
        let p = &self.params;
        let (cycle, u) = self.cycle_at(t_s);
        let action = self.action_of_cycle(cycle);
        // The amplitude wanders over about one cycle, so that repetitions differ and stay smooth.
        let turns = t_s / p.period_s;
        let wander = |stream| p.variation * noise(p.seed, stream, turns);
        let size = p.amplitude * p.body.arm_m() / BodyShape::default().arm_m();
        let mut d = action::displacement(action, u, size);
        let scale = nalgebra::Vector3::new(1.0 + 0.10 * wander(2), 1.0 + 0.10 * wander(3), 1.0 + 0.10 * wander(4));
        d.right_wrist.component_mul_assign(&scale);
        d.left_wrist.component_mul_assign(&scale);
        let offset = |stream, axis: [f64; 3]| {
            nalgebra::Vector3::new(axis[0] * wander(stream), axis[1] * wander(stream + 1), axis[2] * wander(stream + 2))
        };
        let right = d.right_wrist + offset(5, [0.012, 0.012, 0.006]);
        let left = d.left_wrist + offset(8, [0.006, 0.006, 0.003]);
        d.lean += 0.012 * wander(11) + 0.003 * p.variation * (TAU * t_s / 4.1).sin();
        d.twist += 0.02 * wander(12);
        d.tilt += 0.012 * wander(13);
        d.swivel += 0.08 * wander(14);
        let half_turns = self.flips_before(cycle) as f64 + d.fabric_turn;
        pose::assemble(p, action, u, right, left, &d, half_turns)
    }
}
