//! From a person's keypoints to an arm that can be followed: what is measured, what is inferred, what is lost.
//!
//! Networks swap left and right for a few pictures, throw a wrist across the picture, and give confident answers for what
//! they cannot see. Each joint of *both* arms has a Kalman filter per coordinate; every keypoint passes these gates, in
//! this order, before it may move its filter:
//!
//! 1. **score**: the calibrated probability is at least `min_probability`, and everything is finite;
//! 2. **swap**: with both sides seen as `r`, `l` and expected at `r'`, `l'`, the two are swapped when that explains them
//!    better, `|r - l'|^2 + |l - r'|^2 < |r - r'|^2 + |l - l'|^2`, which is `(r - l) . (r' - l') < 0`; below
//!    `swap_separation` noise decides, so the product must be below `-swap_separation^2`, and the left side below
//!    `|r' - l'|^2`, or else something other than a swap has happened. With one side seen, it must not
//!    lie where the other arm's joint is expected instead of its own;
//! 3. **speed**: from the last accepted place it moved no faster than `max_speed`, beyond noise;
//! 4. **limb length**: upper arm and forearm are no longer than `max_stretch` times the longest seen of late. (A limb
//!    may look arbitrarily short; it points at the camera then.) From a joint that is lost nothing is measured.
//!
//! Where both sides are swapped, each filter is moved by the keypoint of the other label; the joint still counts as
//! inferred. A joint without an accepted keypoint is [`ArmJoint::Inferred`] from its motion for at most `max_inferred`, with a
//! growing sigma and a falling probability, and [`ArmJoint::Lost`] after that. A joint that was never seen, is lost, or is
//! refused for `max_inferred` on end, and does not pass, is taken up where the network sees it in two consecutive pictures.
//!
//! Lengths and speeds are relative to the arm: `reach` is the longest of upper arm and forearm seen of late, in pixels.
//! Lag of the result: none at constant speed (the filter has position and speed); see [`OneEuro`](crate::OneEuro) for the
//! optional smoothing on top, whose lag is stated there.

use std::time::Duration;

use crate::{Keypoint, Part, Person, Result, Side};

mod joint;
mod options;

pub use joint::Refusal;
use joint::{JointFilter, Sight};
pub use options::GateOptions;

/// Where a joint is, px.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointEstimate {
    /// Column.
    pub u_px: f64,
    /// Row.
    pub v_px: f64,
    /// Standard deviation of each coordinate.
    pub sigma_px: f64,
    /// Probability that the joint is where this says, 0 to 1.
    pub probability: f64,
}

/// What is known of a joint.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArmJoint {
    /// Seen in this picture, and believed.
    Measured(JointEstimate),
    /// Continued from pictures before.
    Inferred(JointEstimate),
    /// Not known.
    Lost,
}

impl ArmJoint {
    /// The place, measured or inferred.
    pub fn estimate(&self) -> Option<JointEstimate> {
        match self {
            Self::Measured(e) | Self::Inferred(e) => Some(*e),
            Self::Lost => None,
        }
    }

    /// True when it was seen in this picture.
    pub fn is_measured(&self) -> bool {
        matches!(self, Self::Measured(_))
    }
}

/// One arm in one picture.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ArmKeypoints {
    /// Capture time of the picture.
    pub time: Duration,
    /// Whose arm.
    pub side: Side,
    /// Shoulder.
    pub shoulder: ArmJoint,
    /// Elbow.
    pub elbow: ArmJoint,
    /// Wrist.
    pub wrist: ArmJoint,
}

impl ArmKeypoints {
    /// Shoulder, elbow and wrist.
    pub fn joints(&self) -> [ArmJoint; 3] {
        [self.shoulder, self.elbow, self.wrist]
    }
}

/// Gates and filters both arms of one worker in one camera.
///
/// ```
/// use std::time::Duration;
/// use pose::{ArmGate, GateOptions, Keypoint, Person, Side, Skeleton};
/// let mut keypoints = vec![None; 8];
/// for (i, (u_px, v_px)) in [(2, (100.0, 50.0)), (3, (90.0, 120.0)), (4, (140.0, 160.0))] {
///     keypoints[i] = Some(Keypoint { u_px, v_px, score: 0.9 });
/// }
/// let person = Person { skeleton: Skeleton::UpperLimb8, keypoints, score: 0.9 };
/// let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
/// let seen = gate.update(Duration::ZERO, Some(&person));
/// assert!(seen.wrist.is_measured());
/// let gone = gate.update(Duration::from_millis(100), None);
/// assert!(!gone.wrist.is_measured() && gone.wrist.estimate().is_some());
/// assert_eq!(gate.update(Duration::from_millis(500), None).wrist, pose::ArmJoint::Lost);
/// ```
#[derive(Debug, Clone)]
pub struct ArmGate {
    side: Side,
    options: GateOptions,
    /// Right arm, left arm; each shoulder, elbow, wrist.
    joints: [[JointFilter; 3]; 2],
    reach_px: Option<f64>,
    now: Option<Duration>,
}

/// The reach forgets this share of itself per second, so that a worker who leans back is not measured by the past.
const REACH_DECAY_PER_S: f64 = 0.05;
/// A limb longer than the reach by less than `max_stretch`, or taken up, raises it by this share of the difference: one bad
/// keypoint moves it little.
const REACH_GAIN: f64 = 0.2;

impl ArmGate {
    /// Knows nothing yet.
    ///
    /// # Errors
    /// [`Error::Parameter`](crate::Error::Parameter) with the field.
    pub fn new(side: Side, options: GateOptions) -> Result<Self> {
        options.validate()?;
        let joint = JointFilter::new(options.smoothing)?;
        let arm = [joint.clone(), joint.clone(), joint];
        Ok(Self { side, options, joints: [arm.clone(), arm], reach_px: None, now: None })
    }

    /// Takes the worker as seen at capture time `now`, or `None` when nobody was seen. Times never go back; a picture of an
    /// earlier time counts as of the same time.
    pub fn update(&mut self, now: Duration, person: Option<&Person>) -> ArmKeypoints {
        let dt = self.now.map_or(Duration::ZERO, |before| now.saturating_sub(before));
        let now = self.now.map_or(now, |before| before.max(now));
        self.now = Some(now);
        let sights = [Side::Right, Side::Left].map(|side| Part::arm(side).map(|part| self.sight(person, part)));
        let reach_px = self.grow_reach(&sights, dt);
        if let Some(reach_px) = reach_px {
            self.advance(dt, reach_px);
            let verdicts = self.judge(&sights, now, reach_px);
            for a in 0..2 {
                for j in 0..3 {
                    let exchanged = match (verdicts[a][j], verdicts[1 - a][j], sights[1 - a][j]) {
                        (Some(Refusal::Swapped), Some(Refusal::Swapped), Sight::At { u_px, v_px, .. }) => {
                            Some((u_px, v_px))
                        }
                        _ => None,
                    };
                    let seen = (sights[a][j], exchanged);
                    self.joints[a][j].absorb(seen, verdicts[a][j], now, &self.options, reach_px);
                }
            }
            self.reach_px = Some(self.believed_reach(verdicts, reach_px));
        }
        self.arm(now, dt)
    }

    /// Why the last keypoint of a joint was not believed; `None` when it was.
    pub fn refusal(&self, part: Part) -> Option<Refusal> {
        for (a, side) in [Side::Right, Side::Left].into_iter().enumerate() {
            for (j, p) in Part::arm(side).into_iter().enumerate() {
                if p == part {
                    return self.joints[a][j].refusal();
                }
            }
        }
        Some(Refusal::NotSeen)
    }

    /// Longest of upper arm and forearm seen of late, px.
    pub fn reach_px(&self) -> Option<f64> {
        self.reach_px
    }

    /// Forgets everything, for a cut or a new worker.
    pub fn reset(&mut self) {
        for joint in self.joints.iter_mut().flatten() {
            joint.forget();
        }
        self.reach_px = None;
        self.now = None;
    }

    fn sight(&self, person: Option<&Person>, part: Part) -> Sight {
        let Some(Keypoint { u_px, v_px, score }) = person.and_then(|p| p.get(part)) else { return Sight::Nothing };
        let (u_px, v_px) = (f64::from(u_px), f64::from(v_px));
        let probability = self.options.calibration.probability(score.into());
        if !(u_px.is_finite() && v_px.is_finite() && probability.is_finite()) {
            return Sight::NotFinite;
        }
        if probability < self.options.min_probability {
            return Sight::Weak;
        }
        Sight::At { u_px, v_px, probability }
    }

    /// Updates the reach by limbs that are seen whole; the first limb sets it.
    fn grow_reach(&mut self, sights: &[[Sight; 3]; 2], dt: Duration) -> Option<f64> {
        let limbs = sights.iter().flat_map(|arm| [arm[0].distance_px(&arm[1]), arm[1].distance_px(&arm[2])]);
        let longest = limbs.flatten().reduce(f64::max);
        self.reach_px = match (self.reach_px, longest) {
            (None, None) => None,
            (None, Some(length)) => Some(length.max(1.0)),
            (Some(reach), seen) => {
                let decayed = reach * (-REACH_DECAY_PER_S * dt.as_secs_f64()).exp();
                let seen = seen.filter(|s| *s > decayed && *s <= self.options.max_stretch * reach);
                Some(seen.map_or(decayed, |s| decayed + REACH_GAIN * (s - decayed)).max(1.0))
            }
        };
        self.reach_px
    }

    /// A limb that was too long and is taken up nonetheless raises the reach, or it would be refused again for ever.
    fn believed_reach(&self, verdicts: [[Option<Refusal>; 3]; 2], mut reach_px: f64) -> f64 {
        for (arm, verdicts) in self.joints.iter().zip(verdicts) {
            for j in (1..3).filter(|j| verdicts[*j] == Some(Refusal::LimbTooLong) && arm[*j].refusal().is_none()) {
                if let (Some(from), Some(to)) = (arm[j - 1].place(), arm[j].place()) {
                    let raised = reach_px + REACH_GAIN * ((to.0 - from.0).hypot(to.1 - from.1) - reach_px);
                    reach_px = raised.clamp(reach_px, self.options.max_stretch * reach_px);
                }
            }
        }
        reach_px
    }

    fn advance(&mut self, dt: Duration, reach_px: f64) {
        for joint in self.joints.iter_mut().flatten() {
            joint.predict(dt.as_secs_f64(), self.options.acceleration * reach_px);
        }
    }

    /// Gates 2 to 4 for both arms.
    fn judge(&self, sights: &[[Sight; 3]; 2], now: Duration, reach_px: f64) -> [[Option<Refusal>; 3]; 2] {
        let mut verdicts = [[None; 3]; 2];
        for a in 0..2 {
            let mut before: Option<(f64, f64)> = None;
            for j in 0..3 {
                let (own, other) = (&self.joints[a][j], &self.joints[1 - a][j]);
                let verdict = match sights[a][j] {
                    Sight::Nothing => Some(Refusal::NotSeen),
                    Sight::NotFinite => Some(Refusal::NotFinite),
                    Sight::Weak => Some(Refusal::Weak),
                    Sight::At { u_px, v_px, .. } => {
                        let at = (u_px, v_px);
                        let too_long = before
                            .is_some_and(|b| (at.0 - b.0).hypot(at.1 - b.1) > self.options.max_stretch * reach_px);
                        let separation_px = self.options.swap_separation * reach_px;
                        let swapped = match sights[1 - a][j] {
                            Sight::At { u_px, v_px, .. } => own.is_swapped_with(other, at, (u_px, v_px), separation_px),
                            _ => false,
                        };
                        if swapped || own.looks_like(other, at, separation_px) {
                            Some(Refusal::Swapped)
                        } else if own.is_too_fast(at, now, &self.options, reach_px) {
                            Some(Refusal::TooFast)
                        } else if too_long {
                            Some(Refusal::LimbTooLong)
                        } else {
                            None
                        }
                    }
                };
                before = match (verdict, sights[a][j]) {
                    (None, Sight::At { u_px, v_px, .. }) => Some((u_px, v_px)),
                    _ => own.known_place(now, self.options.max_inferred),
                };
                verdicts[a][j] = verdict;
            }
        }
        verdicts
    }

    fn arm(&mut self, now: Duration, dt: Duration) -> ArmKeypoints {
        let arm = match self.side {
            Side::Right => 0,
            Side::Left => 1,
        };
        let max_inferred = self.options.max_inferred;
        let [shoulder, elbow, wrist] = &mut self.joints[arm];
        let state = |joint: &mut JointFilter| joint.state(now, dt, max_inferred);
        ArmKeypoints { time: now, side: self.side, shoulder: state(shoulder), elbow: state(elbow), wrist: state(wrist) }
    }
}

#[cfg(test)]
mod tests;
