//! Parameters of a tracker: freely set, then validated once.

use std::time::Duration;

use crate::error::{Error, Result};
use crate::limits::JointLimits;
use crate::state::State;
use crate::target::{AccelerationSource, AgePolicy};
use crate::tracker::{Phase, Tracker};

/// How the joints of one tracker relate to each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Synchronisation {
    /// Each joint catches up as fast as its own limits allow.
    None,
    /// All joints catch up along the straight line between error and reference; the slowest
    /// one sets the pace.
    Straight,
}

/// How following begins: slowly to where the worker is, then gradually to full speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EngageParams {
    /// Speed limit of every joint while aligning; above zero.
    pub velocity_rad_s: f64,
    /// Position error below which every joint counts as aligned; above zero.
    pub tolerance_rad: f64,
    /// Largest distance between the measured pose and the last command; above zero.
    pub gap_rad: f64,
    /// Time in which the speed limit rises from `velocity_rad_s` to the joint's own.
    pub ramp: Duration,
}

/// Everything a tracker needs to know. There are no defaults.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerParams {
    /// One entry per joint, 1 to 64 joints.
    pub limits: Vec<JointLimits>,
    /// Bandwidth of the tracking law, in (0, 1000]. A small position error decays as
    /// `exp(-w t)` with three equal poles; a jump of the target by `d` costs a jerk of `w^3 d`.
    /// 25 to 45 suits targets at 10 to 60 Hz: lower is smoother, higher follows more closely.
    pub bandwidth_rad_s: f64,
    /// Relation between the joints.
    pub synchronisation: Synchronisation,
    /// Where the acceleration of the reference comes from.
    pub acceleration: AccelerationSource,
    /// What happens when targets stop coming.
    pub age: AgePolicy,
    /// Longest stretch of motion per update; a longer time step lets the targets age in full
    /// but the joints move only this long. With the speed limit it bounds the change per step.
    pub max_step: Duration,
    /// Largest number of horizon rows in a target.
    pub horizon_capacity: usize,
    /// How following begins.
    pub engage: EngageParams,
}

/// Parameters that have passed all checks.
#[derive(Debug, Clone)]
pub struct TrackerPlan {
    params: TrackerParams,
}

const MOST_JOINTS: usize = 64;

impl TrackerParams {
    /// Checks all parameters.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`], [`Error::InvalidLimit`] or [`Error::Count`], naming the
    /// first field that is not acceptable.
    pub fn validate(self) -> Result<TrackerPlan> {
        if self.limits.is_empty() || self.limits.len() > MOST_JOINTS {
            return Err(Error::Count {
                what: "limits (1 to 64 joints)",
                expected: self.limits.len().clamp(1, MOST_JOINTS),
                got: self.limits.len(),
            });
        }
        for (joint, limits) in self.limits.iter().enumerate() {
            limits.check(joint)?;
        }
        let seconds = |span: Duration| span.as_secs_f64();
        let checks = [
            ("bandwidth_rad_s", self.bandwidth_rad_s, 1e-3, 1e3, "[1e-3, 1e3]"),
            ("age.coast", seconds(self.age.coast), 1e-3, 10.0, "[1 ms, 10 s]"),
            ("age.fade", seconds(self.age.fade), 1e-3, 10.0, "[1 ms, 10 s]"),
            ("max_step", seconds(self.max_step), 1e-5, 1.0, "[10 us, 1 s]"),
            ("engage.velocity_rad_s", self.engage.velocity_rad_s, 1e-6, 1e6, "[1e-6, 1e6]"),
            ("engage.tolerance_rad", self.engage.tolerance_rad, 1e-9, 1e3, "[1e-9, 1e3]"),
            ("engage.gap_rad", self.engage.gap_rad, 1e-9, 1e3, "[1e-9, 1e3]"),
            ("engage.ramp", seconds(self.engage.ramp), 1e-3, 60.0, "[1 ms, 60 s]"),
        ];
        for (field, value, low, high, allowed) in checks {
            if !(low..=high).contains(&value) {
                return Err(Error::InvalidParameter { field, allowed, value });
            }
        }
        Ok(TrackerPlan { params: self })
    }
}

impl TrackerPlan {
    /// The checked parameters.
    pub fn params(&self) -> &TrackerParams {
        &self.params
    }

    /// A tracker whose last command is `states`, any finite states. It brakes to rest and
    /// follows nothing until [`Tracker::engage`].
    ///
    /// # Errors
    /// [`Error::Count`] or [`Error::NotFinite`].
    pub fn start(&self, states: &[State]) -> Result<Tracker> {
        self.check_start(states)?;
        Ok(Tracker::new(&self.params, states, Phase::Idle))
    }

    /// A tracker that follows at once and at full limits, from commands that are already being
    /// carried out: a change of limits in motion, or a hand-over from another generator. There
    /// is no alignment; use [`start`](Self::start) and [`Tracker::engage`] for that.
    ///
    /// # Errors
    /// [`Error::Count`] or [`Error::NotFinite`].
    pub fn take_over(&self, states: &[State]) -> Result<Tracker> {
        self.check_start(states)?;
        Ok(Tracker::new(&self.params, states, Phase::Engaged))
    }

    fn check_start(&self, states: &[State]) -> Result<()> {
        let joints = self.params.limits.len();
        if states.len() != joints {
            return Err(Error::Count { what: "start states", expected: joints, got: states.len() });
        }
        for (joint, state) in states.iter().enumerate() {
            if !state.is_finite() {
                return Err(Error::NotFinite { joint, what: "start state", value: f64::NAN });
            }
        }
        Ok(())
    }
}
