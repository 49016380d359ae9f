//! The tracker: phases, time steps, and the way from reference to command.

use std::time::Duration;

use crate::brake::{Brake, coasting_velocity};
use crate::error::{Error, Result};
use crate::guard::{self, Verdict, Walls};
use crate::law::{self, Approach, Errors, Wanted};
use crate::params::{EngageParams, Synchronisation, TrackerParams};
use crate::reference::{Freshness, Reference};
use crate::state::State;
use crate::target::Target;

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

    /// One stretch of constant wanted jerk.
    fn advance(&mut self, span_s: f64, report: &mut Report) {
        let following = matches!(self.phase, Phase::Aligning | Phase::Ramping | Phase::Engaged);
        if following && self.reference.is_present() {
            self.place_reference();
            self.plan_approach(span_s);
            match self.synchronisation {
                Synchronisation::None => self.want_separately(),
                Synchronisation::Straight => self.want_together(),
            }
            self.move_guarded(span_s, report);
        } else {
            for (joint, x) in self.joints.iter().zip(&mut self.states) {
                let share = if self.phase == Phase::Stopping { joint.stop_share } else { 1.0 };
                *x = full_brake(*x, &joint.walls, share).state_after(*x, span_s);
            }
        }
        self.reference.grow_older(span_s);
        if following && self.reference.is_present() {
            self.place_reference();
            self.change_phase(span_s);
        }
    }

    /// Evaluates the reference and clips it to what the joints may do.
    fn place_reference(&mut self) {
        self.reference.evaluate_into(&mut self.reference_states);
        for (joint, r) in self.joints.iter().zip(&mut self.reference_states) {
            let walls = &joint.walls;
            let inside = r.position_rad.clamp(walls.lower, walls.upper);
            let outwards = (r.position_rad - inside) * r.velocity_rad_s > 0.0;
            if outwards {
                r.velocity_rad_s = 0.0;
                r.acceleration_rad_s2 = 0.0;
            }
            r.position_rad = inside;
            if r.velocity_rad_s.abs() > walls.velocity {
                r.velocity_rad_s = walls.velocity.copysign(r.velocity_rad_s);
                r.acceleration_rad_s2 = 0.0;
            }
            r.acceleration_rad_s2 = r.acceleration_rad_s2.clamp(-walls.acceleration, walls.acceleration);
        }
    }

    /// Follows the demand of the reference and plans the approach with what it leaves.
    fn plan_approach(&mut self, span_s: f64) {
        let keep = (-span_s / DEMAND_MEMORY_S).exp();
        for (joint, r) in self.joints.iter_mut().zip(&self.reference_states) {
            joint.demand = r.acceleration_rad_s2.abs().max(keep * joint.demand);
            let Walls { acceleration, jerk, .. } = joint.walls;
            joint.approach = Approach::new(self.bandwidth, acceleration, jerk, joint.demand);
        }
    }

    /// The speed limit of a joint in the present phase.
    fn speed_limit(&self, walls: &Walls) -> f64 {
        let slow = self.engage.velocity_rad_s.min(walls.velocity);
        match self.phase {
            Phase::Aligning => slow,
            Phase::Ramping => {
                let share = self.ramped_s / self.engage.ramp.as_secs_f64();
                slow + share.min(1.0) * (walls.velocity - slow)
            }
            _ => walls.velocity,
        }
    }

    fn want_separately(&mut self) {
        for i in 0..self.joints.len() {
            let pull = self.wanted_acceleration(i);
            let a = self.states[i].acceleration_rad_s2;
            self.wanted[i].value = law::jerk(self.bandwidth, &pull, a, self.joints[i].walls.acceleration);
        }
    }

    /// Stages one and two of the law for one joint.
    fn wanted_acceleration(&self, i: usize) -> Wanted {
        let (joint, x, r) = (&self.joints[i], &self.states[i], &self.reference_states[i]);
        let relative = law::relative_velocity(&joint.approach, &errors(r, x), r.velocity_rad_s);
        let velocity = law::velocity(&relative, r.velocity_rad_s, r.acceleration_rad_s2);
        let limit = self.speed_limit(&joint.walls);
        law::acceleration(&joint.approach, &velocity, limit, x.velocity_rad_s, x.acceleration_rad_s2)
    }

    /// As `want_separately`, but the joint that needs longest leads and the others take its
    /// motion in proportion to their errors, on the straight line to the reference. Every
    /// saturation is applied to all joints in proportion. Small errors need no leader: there the
    /// law is linear and the same for all joints.
    fn want_together(&mut self) {
        let Some(lead) = self.slowest() else {
            self.want_separately();
            return;
        };
        let (r, x) = (self.reference_states[lead], self.states[lead]);
        let to_lead = errors(&r, &x);
        let leading = self.wanted_acceleration(lead);
        let mut room = 1.0_f64;
        for i in 0..self.joints.len() {
            let (joint, r) = (&self.joints[i], &self.reference_states[i]);
            let e = errors(r, &self.states[i]);
            let part = e.position / to_lead.position;
            // What the joint moves across the line is braked with the law's bandwidth.
            let across = 2.0 * self.bandwidth;
            let own = r.acceleration_rad_s2 - part * self.reference_states[lead].acceleration_rad_s2;
            let wanted = Wanted {
                value: part * leading.value + own + across * (e.velocity - part * to_lead.velocity),
                rate: part * leading.rate + across * (e.acceleration - part * to_lead.acceleration),
                rate_of_rate: 0.0,
            };
            room = room.min(joint.walls.acceleration / wanted.value.abs());
            self.wanted[i] = wanted;
        }
        let mut share = 1.0_f64;
        for ((joint, x), wanted) in self.joints.iter().zip(&self.states).zip(&mut self.wanted) {
            if room < 1.0 {
                wanted.value *= room;
                wanted.rate = 0.0;
            }
            let a = x.acceleration_rad_s2;
            let jerk = wanted.rate + self.bandwidth * (wanted.value - a);
            share = share.min(joint.walls.jerk / jerk.abs());
            wanted.value = jerk;
        }
        for wanted in &mut self.wanted {
            wanted.value *= share;
        }
    }

    /// The joint whose approach is the slowest for its distance, unless all are in the linear
    /// part of the law.
    fn slowest(&self) -> Option<usize> {
        let mut slowest = None;
        let mut pace = self.bandwidth * (1.0 - 1e-9);
        for (i, joint) in self.joints.iter().enumerate() {
            let (r, x) = (&self.reference_states[i], &self.states[i]);
            let e = errors(r, x);
            let speed = law::relative_velocity(&joint.approach, &e, r.velocity_rad_s).value.abs();
            let own = speed.min(self.speed_limit(&joint.walls)) / e.position.abs();
            if own < pace {
                (slowest, pace) = (Some(i), own);
            }
        }
        slowest
    }

    fn move_guarded(&mut self, span_s: f64, report: &mut Report) {
        for i in 0..self.joints.len() {
            let walls = Walls { velocity: self.speed_limit(&self.joints[i].walls), ..self.joints[i].walls };
            let (end, verdict) = guard::step(self.states[i], self.wanted[i].value, span_s, &walls);
            self.states[i] = end;
            match verdict {
                Verdict::Free => {}
                Verdict::Reduced => report.guarded |= 1 << i,
                Verdict::Recovering => report.recovering |= 1 << i,
            }
        }
    }

    fn change_phase(&mut self, span_s: f64) {
        match self.phase {
            Phase::Aligning => {
                let aligned = self
                    .states
                    .iter()
                    .zip(&self.reference_states)
                    .all(|(x, r)| (r.position_rad - x.position_rad).abs() <= self.engage.tolerance_rad);
                if aligned && self.reference.freshness() == Freshness::Fresh {
                    self.phase = Phase::Ramping;
                    self.ramped_s = 0.0;
                }
            }
            Phase::Ramping => {
                self.ramped_s += span_s;
                if self.ramped_s >= self.engage.ramp.as_secs_f64() {
                    self.phase = Phase::Engaged;
                }
            }
            _ => {}
        }
    }
}

fn errors(r: &State, x: &State) -> Errors {
    Errors {
        position: r.position_rad - x.position_rad,
        velocity: r.velocity_rad_s - x.velocity_rad_s,
        acceleration: r.acceleration_rad_s2 - x.acceleration_rad_s2,
    }
}

/// The brake with a share of acceleration and jerk limit.
fn full_brake(x: State, walls: &Walls, share: f64) -> Brake {
    Brake::of(x, share * walls.acceleration, share * walls.jerk)
}

/// Share of the limits with which a joint takes `duration_s` to rest, if it can do so without
/// turning round or leaving its limits; otherwise 1.
fn stop_share(x: State, walls: &Walls, duration_s: f64) -> f64 {
    let (v, a) = (x.velocity_rad_s, x.acceleration_rad_s2);
    if a.abs() > walls.acceleration || !guard::viable(x, walls) {
        return 1.0;
    }
    let fits = |share: f64| {
        let jerk = share * walls.jerk;
        let peak = coasting_velocity(v, a, jerk);
        let (low, high) = full_brake(x, walls, share).extent(x);
        a.abs() <= share * walls.acceleration
            && peak.abs() <= walls.velocity
            && peak * coasting_velocity(v, a, walls.jerk) >= 0.0
            && low >= walls.lower
            && high <= walls.upper
    };
    let (mut slow, mut fast) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = f64::midpoint(slow, fast);
        if fits(middle) && full_brake(x, walls, middle).duration_s() <= duration_s {
            fast = middle;
        } else {
            slow = middle;
        }
    }
    fast
}
