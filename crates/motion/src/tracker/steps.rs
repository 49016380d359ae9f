//! One stretch of constant jerk: from the reference to the command of every joint.

use super::stop::full_brake;
use super::{DEMAND_MEMORY_S, Phase, Report, Tracker};
use crate::guard::{self, Verdict, Walls};
use crate::law::{self, Approach, Errors, Wanted};
use crate::params::Synchronisation;
use crate::reference::Freshness;
use crate::state::State;

impl Tracker {
    /// One stretch of constant wanted jerk.
    pub(super) fn advance(&mut self, span_s: f64, report: &mut Report) {
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
