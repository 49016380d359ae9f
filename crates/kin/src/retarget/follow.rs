//! One step of following a pose: inverse kinematics on the branch of the last pose, slowed near singularities, and
//! never faster than the joints may go.

use nalgebra::Isometry3;

use crate::{Chain, Error, IkOptions, IkReport};

/// Speed over condition number: 1 up to `slow`, falling linearly to 0 at `stop`. It acts only on motion that makes
/// the condition worse, so the arm can always leave. The thresholds are those of MoveIt Servo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SingularityLadder {
    /// Condition number at which slowing begins.
    pub slow: f64,
    /// Condition number at which motion towards the singularity ends.
    pub stop: f64,
}

impl Default for SingularityLadder {
    fn default() -> Self {
        Self { slow: 17.0, stop: 30.0 }
    }
}

impl SingularityLadder {
    /// The factor on the speed for motion from one condition number to another.
    ///
    /// ```
    /// let ladder = kin::SingularityLadder::default();
    /// assert_eq!(ladder.scale(5.0, 10.0), 1.0);
    /// assert_eq!(ladder.scale(20.0, 23.5), 0.5);
    /// assert_eq!(ladder.scale(25.0, 40.0), 0.0);
    /// assert_eq!(ladder.scale(40.0, 39.0), 1.0); // on the way out
    /// ```
    pub fn scale(&self, now: f64, next: f64) -> f64 {
        if next <= now {
            return 1.0;
        }
        ((self.stop - next) / (self.stop - self.slow)).clamp(0.0, 1.0)
    }
}

/// How to follow.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct FollowOptions {
    /// The solver's options; restarts are never used.
    pub ik: IkOptions,
    /// Slowing near singularities.
    pub ladder: SingularityLadder,
    /// Part of each joint's speed limit that may be used, in (0, 1].
    pub speed_fraction: f64,
}

impl Default for FollowOptions {
    fn default() -> Self {
        Self { ik: IkOptions::on_branch(), ladder: SingularityLadder::default(), speed_fraction: 1.0 }
    }
}

impl FollowOptions {
    /// Sets [`FollowOptions::speed_fraction`].
    #[must_use]
    pub fn speed_fraction(mut self, speed_fraction: f64) -> Self {
        self.speed_fraction = speed_fraction;
        self
    }

    /// Sets [`FollowOptions::ladder`].
    #[must_use]
    pub fn ladder(mut self, ladder: SingularityLadder) -> Self {
        self.ladder = ladder;
        self
    }

    /// Sets [`FollowOptions::ik`].
    #[must_use]
    pub fn ik(mut self, ik: IkOptions) -> Self {
        self.ik = ik;
        self
    }
}

/// What held the step back, most severe first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum FollowStatus {
    /// The step goes all the way to the solution.
    OnTarget,
    /// A joint would have been too fast; the whole step is shortened, its direction kept.
    SpeedLimited,
    /// Slowed or stopped before a singularity.
    Singular,
}

/// One step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FollowStep {
    /// What the solver said about the target itself.
    pub ik: IkReport,
    /// What held the step back.
    pub status: FollowStatus,
    /// The part of the way to the solution that was gone, in [0, 1].
    pub fraction: f64,
    /// The ladder's factor.
    pub singularity_scale: f64,
    /// Condition number after the step.
    pub condition: f64,
}

/// What rounding may add to a joint's step is left free below its speed limit.
const BELOW_LIMIT: f64 = 1.0 - 1e-12;

impl Chain {
    /// Moves the joint vector `q` towards `base_from_target` by at most what the joints may go in `dt_s`, on the
    /// branch where it is. The result lies within the position limits if `q` did.
    ///
    /// # Errors
    /// [`Error::Domain`] for a `dt_s` or speed fraction outside its range.
    ///
    /// # Panics
    /// When `q` does not have [`Chain::dof`] values.
    ///
    /// ```
    /// use kin::{FollowOptions, FollowStatus, Robot};
    /// let chain = Robot::builtin().chain("base_link", "tool0")?;
    /// let mut q = [0.0, 1.2, -1.6, -1.1, 0.1, 0.0];
    /// let before = q;
    /// let target = chain.fk(&[0.5, 1.3, -1.7, -1.1, 0.1, 0.0]);
    /// let step = chain.follow_pose(&target, 0.005, &FollowOptions::default(), &mut q)?;
    /// assert_eq!(step.status, FollowStatus::SpeedLimited);
    /// assert!((q[0] - before[0] - 3.0 * 0.005).abs() < 1e-12); // joint1 goes at its limit of 3 rad/s
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn follow_pose(
        &self,
        base_from_target: &Isometry3<f64>,
        dt_s: f64,
        options: &FollowOptions,
        q: &mut [f64],
    ) -> Result<FollowStep, Error> {
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            return Err(Error::Domain { what: "time step (s)", expected: "finite and > 0", got: dt_s });
        }
        let fraction = options.speed_fraction;
        if !(fraction > 0.0 && fraction <= 1.0) {
            return Err(Error::Domain { what: "speed fraction", expected: "in (0, 1]", got: fraction });
        }
        let dof = self.dof();
        let mut solution = [0.0; crate::chain::MAX_DOF];
        let solution = &mut solution[..dof];
        solution.copy_from_slice(q);
        let ik = self.ik(base_from_target, &options.ik.restarts(0), solution);

        let mut allowed = 1.0f64;
        for ((goal, now), limits) in solution.iter().zip(&*q).zip(self.limits()) {
            let way = (goal - now).abs();
            let reach = limits.velocity * fraction * dt_s * BELOW_LIMIT;
            if way > reach {
                allowed = allowed.min(reach / way);
            }
        }
        let mut status = if allowed < 1.0 { FollowStatus::SpeedLimited } else { FollowStatus::OnTarget };
        let condition_now = self.dexterity(q).condition;
        let mut next = [0.0; crate::chain::MAX_DOF];
        let next = &mut next[..dof];
        let walk = |part: f64, next: &mut [f64]| {
            for ((next, goal), now) in next.iter_mut().zip(&*solution).zip(&*q) {
                *next = if part >= 1.0 { *goal } else { now + part * (goal - now) };
            }
        };
        walk(allowed, next);
        let mut condition = self.dexterity(next).condition;
        let singularity_scale = options.ladder.scale(condition_now, condition);
        if singularity_scale < 1.0 {
            status = FollowStatus::Singular;
            allowed *= singularity_scale;
            walk(allowed, next);
            condition = self.dexterity(next).condition;
        }
        q.copy_from_slice(next);
        Ok(FollowStep { ik, status, fraction: allowed, singularity_scale, condition })
    }
}
