//! The controller's own path generator: whatever the host asks for, what leaves here keeps the
//! position, velocity and acceleration limits.
//!
//! *Following.* The reference moves at the velocity between the last two sets. Per joint, the
//! commanded velocity is v_ref + e / tau, with e the distance to the reference and tau = 20 ms:
//! the distance dies out without overshoot, and the staircase of sets is smoothed (halving tau
//! doubles the velocity ripple; doubling it doubles the lag under acceleration).
//!
//! *Stopping.* All joints slow down in proportion, within the time that the slowest of them needs
//! at its deceleration limit, so that the arm stays on the straight line in joint space that it
//! was on. The stop starts from the commanded state, not from the measured one: starting from the
//! measured one would turn the tracking error into a step.
//!
//! *Limits.* The velocity towards a position limit at distance d never exceeds
//! a (sqrt(dt^2 + 2 d / a) - dt), the speed from which a stop at deceleration a in steps of dt
//! ends before the limit. That speed falls by at most a dt a step, so that no limit contradicts
//! another.

use std::time::Duration;

use crate::{JointLimits, MAX_JOINTS};

/// Time constant with which the distance to the reference dies out.
const CLOSING_TIME_S: f64 = 0.020;
/// Longest step of the integration; longer ticks are divided.
const STEP_S: f64 = 0.001;
/// Below this speed a joint is at rest, one wire step a second.
const REST_RAD_S: f64 = 1.2e-5;

/// Commanded position and velocity of a joint.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Setpoint {
    /// Position.
    pub position_rad: f64,
    /// Velocity.
    pub velocity_rad_s: f64,
}

#[derive(Clone, Copy, Debug)]
enum Course {
    Rest,
    Follow { reference: [Setpoint; MAX_JOINTS], at: Duration },
    Stop { from_rad_s: [f64; MAX_JOINTS], left_s: f64, total_s: f64 },
}

#[derive(Clone, Debug)]
pub(super) struct Generator {
    joints: [Setpoint; MAX_JOINTS],
    course: Course,
    limiting: bool,
}

impl Generator {
    pub(super) fn new() -> Self {
        Self { joints: [Setpoint::default(); MAX_JOINTS], course: Course::Rest, limiting: false }
    }

    pub(super) fn joints(&self) -> &[Setpoint; MAX_JOINTS] {
        &self.joints
    }

    /// Whether a limit shaped the last step.
    pub(super) fn limiting(&self) -> bool {
        self.limiting
    }

    pub(super) fn at_rest(&self) -> bool {
        self.joints.iter().all(|j| j.velocity_rad_s.abs() <= REST_RAD_S)
    }

    /// Stands still at these positions.
    pub(super) fn rest_at(&mut self, position_rad: impl Iterator<Item = f64>) {
        for (joint, position_rad) in self.joints.iter_mut().zip(position_rad) {
            *joint = Setpoint { position_rad, velocity_rad_s: 0.0 };
        }
        self.course = Course::Rest;
        self.limiting = false;
    }

    /// Takes over this state, for a stop from the measured motion.
    pub(super) fn anchor(&mut self, states: impl Iterator<Item = Setpoint>) {
        for (joint, state) in self.joints.iter_mut().zip(states) {
            *joint = state;
        }
    }

    /// Follows a reference that was at these positions and velocities at `at`.
    pub(super) fn follow(&mut self, reference: [Setpoint; MAX_JOINTS], at: Duration) {
        self.course = Course::Follow { reference, at };
    }

    /// Slows down along the present path; a stop that is under way goes on.
    pub(super) fn stop(&mut self, limits: &[JointLimits]) {
        if matches!(self.course, Course::Stop { .. } | Course::Rest) {
            return;
        }
        let from_rad_s = self.joints.map(|j| j.velocity_rad_s);
        let total_s = from_rad_s.iter().zip(limits).map(|(v, l)| v.abs() / l.acceleration_rad_s2).fold(0.0, f64::max);
        self.course = Course::Stop { from_rad_s, left_s: total_s, total_s };
    }

    /// Moves from `now - dt` to `now`.
    pub(super) fn advance(&mut self, now: Duration, dt: Duration, limits: &[JointLimits], speed_scale: f64) {
        let total_s = dt.as_secs_f64();
        let steps = (total_s / STEP_S).ceil().max(1.0);
        let step_s = total_s / steps;
        self.limiting = false;
        if !(step_s > 0.0) {
            return;
        }
        let start_s = now.as_secs_f64() - total_s;
        for i in 0..steps as u32 {
            self.step(start_s + f64::from(i + 1) * step_s, step_s, limits, speed_scale);
        }
    }

    fn step(&mut self, now_s: f64, dt_s: f64, limits: &[JointLimits], speed_scale: f64) {
        if let Course::Stop { left_s, .. } = &mut self.course {
            *left_s = (*left_s - dt_s).max(0.0);
        }
        for (i, (joint, limit)) in self.joints.iter_mut().zip(limits).enumerate() {
            let (wanted_rad_s, cap_rad_s) = match &self.course {
                Course::Rest => (0.0, limit.velocity_rad_s),
                Course::Follow { reference, at } => {
                    let target = reference[i];
                    let ahead_s = now_s - at.as_secs_f64();
                    let error_rad = target.position_rad + target.velocity_rad_s * ahead_s - joint.position_rad;
                    (target.velocity_rad_s + error_rad / CLOSING_TIME_S.max(dt_s), limit.velocity_rad_s * speed_scale)
                }
                Course::Stop { from_rad_s, left_s, total_s } => {
                    let share = if *total_s > 0.0 { left_s / total_s } else { 0.0 };
                    (from_rad_s[i] * share, limit.velocity_rad_s)
                }
            };
            let a = limit.acceleration_rad_s2;
            let stoppable = |distance_rad: f64| a * ((dt_s * dt_s + 2.0 * distance_rad.max(0.0) / a).sqrt() - dt_s);
            let capped = wanted_rad_s.clamp(-cap_rad_s, cap_rad_s);
            let change = a * dt_s;
            let reached = capped.clamp(joint.velocity_rad_s - change, joint.velocity_rad_s + change);
            let velocity_rad_s = reached
                .min(stoppable(limit.max_rad - joint.position_rad))
                .max(-stoppable(joint.position_rad - limit.min_rad));
            self.limiting |= (velocity_rad_s - wanted_rad_s).abs() > 1e-3;
            joint.velocity_rad_s = velocity_rad_s;
            joint.position_rad += velocity_rad_s * dt_s;
        }
    }
}
