//! The tracker: phases, time steps, and the way from reference to command.

mod steps;
mod stop;

use std::time::Duration;

use crate::error::{Error, Result};
use crate::guard::Walls;
use crate::law::{Approach, Wanted};
use crate::params::{EngageParams, Synchronisation, TrackerParams};
use crate::reference::{Freshness, Reference};
use crate::state::State;
use crate::target::Target;
use stop::{full_brake, stop_share};

/// What a tracker is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Not engaged: at rest, or braking to rest from the start state.
    Idle,
    /// Approaching the worker's pose at the engage speed.
    Aligning,
    /// Aligned once; the speed limit rises.
    Ramping,
    /// Following at full limits.
    Engaged,
    /// Braking, or at rest after [`Tracker::stop`]; stays so until [`Tracker::engage`].
    Stopping,
}

/// What one update did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Report {
    /// Phase after the update.
    pub phase: Phase,
    /// Freshness of the newest target after the update.
    pub freshness: Freshness,
    /// Time that the joints have moved; shorter than the time step if that exceeds
    /// [`max_step`](TrackerParams::max_step).
    pub moved: Duration,
    /// Bit `i` is set if joint `i` got less than the tracking law wanted, so as to be able to
    /// stop inside its limits.
    pub guarded: u64,
    /// Bit `i` is set if joint `i` was outside its velocity or acceleration limit.
    pub recovering: u64,
}

/// Below this a joint counts as resting (rounding of a finished brake).
const REST: f64 = 1e-9;
/// Share of a limit left free, so that rounding never carries a command over the true limit.
const MARGIN: f64 = 1e-11;
/// Longest stretch of constant jerk, as a share of the law's time constant: at 0.1 the sampled
/// law decays within 1 % of the continuous one.
const LAW_STEP: f64 = 0.1;

/// How long a peak of the reference's acceleration is remembered; about a period of fast arm
/// motion, so that the quiet parts of a swing do not look like room for a hasty approach.
const DEMAND_MEMORY_S: f64 = 0.5;

#[derive(Debug, Clone)]
struct Joint {
    walls: Walls,
    approach: Approach,
    /// Peak acceleration of the reference, decaying.
    demand: f64,
    /// Shares of acceleration and jerk limit that a stop uses.
    stop_share: f64,
}

/// Jerk-limited online tracker of a moving target; see the crate documentation.
///
/// No method allocates after construction.
#[derive(Debug, Clone)]
pub struct Tracker {
    joints: Vec<Joint>,
    states: Vec<State>,
    reference: Reference,
    reference_states: Vec<State>,
    wanted: Vec<Wanted>,
    phase: Phase,
    ramped_s: f64,
    bandwidth: f64,
    synchronisation: Synchronisation,
    longest_piece_s: f64,
    max_step: Duration,
    horizon_capacity: usize,
    engage: EngageParams,
}

impl Tracker {
    pub(crate) fn new(params: &TrackerParams, states: &[State], phase: Phase) -> Self {
        let joints = params
            .limits
            .iter()
            .map(|limits| {
                let walls = Walls {
                    lower: limits.lower_rad + MARGIN * (1.0 + limits.lower_rad.abs()),
                    upper: limits.upper_rad - MARGIN * (1.0 + limits.upper_rad.abs()),
                    velocity: limits.velocity_rad_s * (1.0 - MARGIN),
                    acceleration: limits.acceleration_rad_s2 * (1.0 - MARGIN),
                    jerk: limits.jerk_rad_s3 * (1.0 - MARGIN),
                };
                let approach = Approach::new(params.bandwidth_rad_s, walls.acceleration, walls.jerk, 0.0);
                Joint { walls, approach, demand: 0.0, stop_share: 1.0 }
            })
            .collect();
        Self {
            joints,
            states: states.to_vec(),
            reference: Reference::new(params),
            reference_states: states.to_vec(),
            wanted: vec![Wanted::default(); states.len()],
            phase,
            ramped_s: 0.0,
            bandwidth: params.bandwidth_rad_s,
            synchronisation: params.synchronisation,
            longest_piece_s: LAW_STEP / params.bandwidth_rad_s,
            max_step: params.max_step,
            horizon_capacity: params.horizon_capacity,
            engage: params.engage,
        }
    }

    /// The last command: one state per joint.
    pub fn states(&self) -> &[State] {
        &self.states
    }

    /// Where the target, continued to the end of the last update, is; clipped to the limits.
    pub fn reference(&self) -> &[State] {
        &self.reference_states
    }

    /// What the tracker is doing.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Whether every joint of the last command rests.
    pub fn is_at_rest(&self) -> bool {
        self.states.iter().all(|x| x.velocity_rad_s.abs() < REST && x.acceleration_rad_s2.abs() < REST)
    }

    /// Begins to follow, from the measured pose: first slowly until aligned with the target,
    /// then with a rising speed limit. Forgets earlier targets and ends a stop.
    ///
    /// # Errors
    /// [`Error::EngageWhileMoving`], [`Error::EngageGap`], [`Error::Count`] or
    /// [`Error::NotFinite`]; the tracker is unchanged then.
    pub fn engage(&mut self, measured_rad: &[f64]) -> Result<()> {
        if measured_rad.len() != self.states.len() {
            return Err(Error::Count {
                what: "measured positions",
                expected: self.states.len(),
                got: measured_rad.len(),
            });
        }
        for (joint, (x, &measured)) in self.states.iter().zip(measured_rad).enumerate() {
            if !measured.is_finite() {
                return Err(Error::NotFinite { joint, what: "measured position", value: measured });
            }
            if x.velocity_rad_s.abs() >= REST || x.acceleration_rad_s2.abs() >= REST {
                return Err(Error::EngageWhileMoving { joint, velocity_rad_s: x.velocity_rad_s });
            }
            let gap = (x.position_rad - measured).abs();
            if gap > self.engage.gap_rad {
                return Err(Error::EngageGap { joint, gap_rad: gap, allowed_rad: self.engage.gap_rad });
            }
        }
        for (x, &measured) in self.states.iter_mut().zip(measured_rad) {
            *x = State::at_rest(measured);
        }
        self.reference_states.copy_from_slice(&self.states);
        self.reference.forget();
        self.phase = Phase::Aligning;
        Ok(())
    }

    /// Takes over a new target. Rejected targets leave everything as it is.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::Count`], [`Error::Age`], [`Error::OutOfOrder`],
    /// [`Error::HorizonTooLong`] or [`Error::InvalidParameter`].
    pub fn offer(&mut self, target: &Target<'_>) -> Result<()> {
        target.check(self.states.len(), self.horizon_capacity)?;
        self.reference.accept(target)
    }

    /// Brakes to rest from the last command, jerk limited. If all joints can take the same
    /// time, they do, so a straight motion stops on its line.
    pub fn stop(&mut self) {
        if self.phase == Phase::Stopping {
            return;
        }
        self.phase = Phase::Stopping;
        let slowest_s = self
            .joints
            .iter()
            .zip(&self.states)
            .map(|(joint, x)| full_brake(*x, &joint.walls, 1.0).duration_s())
            .fold(0.0, f64::max);
        for (joint, x) in self.joints.iter_mut().zip(&self.states) {
            joint.stop_share = stop_share(*x, &joint.walls, slowest_s);
        }
    }

    /// Moves on by `dt` and returns what was done; the command is in [`states`](Self::states).
    ///
    /// # Errors
    /// [`Error::ZeroStep`]; nothing has changed then.
    pub fn update(&mut self, dt: Duration) -> Result<Report> {
        if dt.is_zero() {
            return Err(Error::ZeroStep);
        }
        let moved = dt.min(self.max_step);
        self.reference.grow_older(dt.saturating_sub(moved).as_secs_f64());
        let mut report = Report { phase: self.phase, freshness: Freshness::None, moved, guarded: 0, recovering: 0 };
        let moved_s = moved.as_secs_f64();
        let pieces = (moved_s / self.longest_piece_s).ceil().max(1.0);
        let piece_s = moved_s / pieces;
        for _ in 0..pieces as u32 {
            self.advance(piece_s, &mut report);
        }
        report.phase = self.phase;
        report.freshness = self.reference.freshness();
        Ok(report)
    }
}
