//! One joint: its filter, its gates, and what is known of it.

use std::time::Duration;

use super::{ArmJoint, GateOptions, JointEstimate};
use crate::{Kalman, OneEuro, OneEuroParams, Result};

/// Why a keypoint was not believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Refusal {
    /// The network saw nothing.
    NotSeen,
    /// The network's answer is NaN or infinite.
    NotFinite,
    /// Less probable than the limit.
    Weak,
    /// It lies where the other arm's joint is expected.
    Swapped,
    /// It moved faster than an arm can.
    TooFast,
    /// The limb that it ends would be longer than it is.
    LimbTooLong,
}

/// What the network says of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Sight {
    Nothing,
    NotFinite,
    Weak,
    At { u_px: f64, v_px: f64, probability: f64 },
}

impl Sight {
    pub(super) fn distance_px(&self, other: &Self) -> Option<f64> {
        match (self, other) {
            (Self::At { u_px: a, v_px: b, .. }, Self::At { u_px: c, v_px: d, .. }) => Some((a - c).hypot(b - d)),
            _ => None,
        }
    }
}

/// Gate width in standard deviations: five keep all but one in a million good keypoints.
const GATE_SIGMA: f64 = 5.0;
/// A keypoint of probability p is trusted with `noise * (1 + this * (1 - p))`.
const WEAK_NOISE: f64 = 3.0;
/// Share of the speed that is left after 100 ms of coasting: arms decelerate, and a frozen guess beats a flying one.
const COAST_SHARE_PER_100_MS: f64 = 0.5;
/// Time constant of the probability while coasting, s.
const DOUBT_S: f64 = 0.2;

#[derive(Debug, Clone)]
pub(super) struct JointFilter {
    track: Option<Track>,
    /// A refused place of the picture before, from where the joint may be taken up again.
    rival: Option<(f64, f64)>,
    refusal: Option<Refusal>,
    /// The last picture moved nothing.
    coasting: bool,
    smoothing: Option<[OneEuro; 2]>,
}

#[derive(Debug, Clone, Copy)]
struct Track {
    u: Kalman,
    v: Kalman,
    accepted: (f64, f64),
    accepted_at: Duration,
    probability: f64,
}

impl Track {
    fn place(&self) -> (f64, f64) {
        (self.u.position(), self.v.position())
    }
}

fn distance(a: (f64, f64), b: (f64, f64)) -> f64 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

impl JointFilter {
    pub(super) fn new(smoothing: Option<OneEuroParams>) -> Result<Self> {
        let smoothing = match smoothing {
            Some(p) => Some([OneEuro::new(p)?, OneEuro::new(p)?]),
            None => None,
        };
        Ok(Self { track: None, rival: None, refusal: Some(Refusal::NotSeen), coasting: false, smoothing })
    }

    pub(super) fn refusal(&self) -> Option<Refusal> {
        self.refusal
    }

    pub(super) fn forget(&mut self) {
        self.track = None;
        self.rival = None;
        self.refusal = Some(Refusal::NotSeen);
        self.smoothing.iter_mut().flatten().for_each(OneEuro::reset);
    }

    pub(super) fn place(&self) -> Option<(f64, f64)> {
        self.track.map(|t| t.place())
    }

    /// The place, unless the joint is lost.
    pub(super) fn known_place(&self, now: Duration, max_inferred: Duration) -> Option<(f64, f64)> {
        self.track.filter(|t| now.saturating_sub(t.accepted_at) <= max_inferred).map(|t| t.place())
    }

    pub(super) fn predict(&mut self, dt_s: f64, acceleration_px: f64) {
        let coasting = self.coasting;
        if let Some(track) = &mut self.track {
            if coasting {
                let share = COAST_SHARE_PER_100_MS.powf(dt_s / 0.1);
                track.u.damp(share);
                track.v.damp(share);
            }
            track.u.predict(dt_s, acceleration_px);
            track.v.predict(dt_s, acceleration_px);
        }
    }

    /// Gate 2 with both sides seen: the line between them points against the line between the predictions, and the
    /// exchange explains both.
    pub(super) fn is_swapped_with(
        &self,
        other: &Self,
        at: (f64, f64),
        other_at: (f64, f64),
        separation_px: f64,
    ) -> bool {
        let (Some(own), Some(other)) = (self.place(), other.place()) else { return false };
        let seen = (at.0 - other_at.0, at.1 - other_at.1);
        let expected = (own.0 - other.0, own.1 - other.1);
        let crosswise = distance(at, other).hypot(distance(other_at, own));
        crosswise < distance(own, other) && seen.0 * expected.0 + seen.1 * expected.1 < -separation_px * separation_px
    }

    /// Gate 2 with one side seen, or both in one place: near the other arm's prediction, and nearer than
    /// to its own by half their separation.
    pub(super) fn looks_like(&self, other: &Self, at: (f64, f64), separation_px: f64) -> bool {
        let (Some(own), Some(other)) = (self.place(), other.place()) else { return false };
        let apart = distance(own, other);
        let (to_own, to_other) = (distance(at, own), distance(at, other));
        apart >= separation_px && to_other < 0.5 * apart && to_own - to_other > 0.5 * apart
    }

    /// Gate 3: beyond what the fastest arm does since the last accepted keypoint, and beyond the prediction's doubt.
    pub(super) fn is_too_fast(&self, at: (f64, f64), now: Duration, options: &GateOptions, reach_px: f64) -> bool {
        let Some(track) = &self.track else { return false };
        let dt_s = now.saturating_sub(track.accepted_at).as_secs_f64();
        let noise_px = options.noise * reach_px;
        let furthest = options.max_speed * reach_px * dt_s + GATE_SIGMA * noise_px;
        if distance(at, track.accepted) > furthest {
            return true;
        }
        let sigma = |k: &Kalman| (k.variance() + noise_px * noise_px).sqrt();
        let (du, dv) = ((at.0 - track.u.position()) / sigma(&track.u), (at.1 - track.v.position()) / sigma(&track.v));
        du.hypot(dv) > GATE_SIGMA
    }

    /// Takes or refuses the keypoint of this picture. The filters have been predicted to `now`. `exchanged` is what the
    /// network says of the other arm's joint, where both are swapped.
    pub(super) fn absorb(
        &mut self,
        (sight, exchanged): (Sight, Option<(f64, f64)>),
        verdict: Option<Refusal>,
        now: Duration,
        options: &GateOptions,
        reach_px: f64,
    ) {
        self.refusal = verdict;
        self.coasting = verdict.is_some();
        let Sight::At { u_px, v_px, probability } = sight else {
            self.rival = None;
            return;
        };
        let at = (u_px, v_px);
        let sigma_px = options.noise * reach_px * (1.0 + WEAK_NOISE * (1.0 - probability));
        let start = Track {
            u: Kalman::new(u_px, sigma_px, options.max_speed * reach_px / GATE_SIGMA),
            v: Kalman::new(v_px, sigma_px, options.max_speed * reach_px / GATE_SIGMA),
            accepted: at,
            accepted_at: now,
            probability,
        };
        let agrees = self.rival.is_some_and(|r| distance(r, at) < 0.5 * reach_px);
        let Some(track) = &mut self.track else {
            // At first sight only the length of the limb can speak against it.
            if verdict.is_none() || agrees {
                self.begin(start);
            } else {
                self.rival = Some(at);
            }
            return;
        };
        if verdict.is_none() {
            track.u.update(u_px, sigma_px);
            track.v.update(v_px, sigma_px);
            track.accepted = at;
            track.accepted_at = now;
            track.probability = probability;
            self.rival = None;
            return;
        }
        // Refused for so long that the track is worth nothing: believe two pictures that agree.
        if agrees && now.saturating_sub(track.accepted_at) > options.max_inferred {
            self.begin(start);
            return;
        }
        self.rival = Some(at);
        if let Some((u_px, v_px)) = exchanged {
            // The other label's place moves the filter, but does not make the joint seen: labels that stay exchanged end
            // as lost, and are then taken as the network gives them.
            track.u.update(u_px, sigma_px);
            track.v.update(v_px, sigma_px);
            self.coasting = false;
        }
    }

    fn begin(&mut self, track: Track) {
        self.track = Some(track);
        self.refusal = None;
        self.coasting = false;
        self.rival = None;
        self.smoothing.iter_mut().flatten().for_each(OneEuro::reset);
    }

    pub(super) fn state(&mut self, now: Duration, dt: Duration, max_inferred: Duration) -> ArmJoint {
        let Some(track) = &self.track else { return ArmJoint::Lost };
        let age = now.saturating_sub(track.accepted_at);
        let measured = self.refusal.is_none();
        if !measured && age > max_inferred {
            return ArmJoint::Lost;
        }
        let (mut u_px, mut v_px) = track.place();
        if let Some([u, v]) = &mut self.smoothing {
            // Without a step of time there is nothing to smooth with.
            if dt > Duration::ZERO {
                u_px = u.update(dt.as_secs_f64(), u_px);
                v_px = v.update(dt.as_secs_f64(), v_px);
            }
        }
        let estimate = JointEstimate {
            u_px,
            v_px,
            sigma_px: f64::midpoint(track.u.variance(), track.v.variance()).sqrt(),
            probability: track.probability * (-age.as_secs_f64() / DOUBT_S).exp(),
        };
        if measured { ArmJoint::Measured(estimate) } else { ArmJoint::Inferred(estimate) }
    }
}
