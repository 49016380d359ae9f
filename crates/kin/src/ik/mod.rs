//! Inverse kinematics: joint values for a pose of the tip.
//!
//! The pose error is the position error `e_p` (m) and the rotation vector `e_w = log(R_target R^T)` (rad), both in
//! axes of the base. The distance that is minimised, and that "nearest" refers to, is
//!
//! ```text
//! d^2 = |e_p|^2 + (rho |e_w|)^2,      rho = IkOptions::rotation_weight_m_per_rad
//! ```

mod descent;
mod problem;
mod search;
mod starts;

use nalgebra::Isometry3;

pub(crate) use starts::Starts;

/// How the answer is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum IkMethod {
    /// In closed form where the chain has one and other branches are allowed, else by least squares.
    #[default]
    Auto,
    /// By least squares only.
    Numeric,
}

/// What to solve for and how hard to try.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct IkOptions {
    /// A solution is this close in position (m). Default 1e-6.
    pub position_tolerance_m: f64,
    /// A solution is this close in rotation (rad). Default 1e-6.
    pub rotation_tolerance_rad: f64,
    /// How many metres one radian counts when the target cannot be reached; zero ignores the rotation altogether.
    /// Default 0.3, about the length of the wrist and tool of a bench arm.
    pub rotation_weight_m_per_rad: f64,
    /// Least-squares steps over all attempts. Default 6000.
    pub iterations: u32,
    /// Attempts from random poses within the limits, after the first one from the seed. Zero stays on the branch of
    /// the seed. Default 200.
    pub restarts: u32,
    /// Where the random poses begin; the same number gives the same answer. Default 0.
    pub random_seed: u64,
    /// Closed form or least squares. Default [`IkMethod::Auto`].
    pub method: IkMethod,
}

impl Default for IkOptions {
    fn default() -> Self {
        Self {
            position_tolerance_m: 1e-6,
            rotation_tolerance_rad: 1e-6,
            rotation_weight_m_per_rad: 0.3,
            iterations: 6000,
            restarts: 200,
            random_seed: 0,
            method: IkMethod::Auto,
        }
    }
}

impl IkOptions {
    /// For following a moving target: one attempt from the last pose, no jump to another branch.
    pub fn on_branch() -> Self {
        Self { restarts: 0, iterations: 100, ..Self::default() }
    }

    /// Sets both tolerances.
    #[must_use]
    pub fn tolerances(mut self, position_m: f64, rotation_rad: f64) -> Self {
        self.position_tolerance_m = position_m;
        self.rotation_tolerance_rad = rotation_rad;
        self
    }

    /// Sets [`IkOptions::rotation_weight_m_per_rad`].
    #[must_use]
    pub fn rotation_weight(mut self, metres_per_radian: f64) -> Self {
        self.rotation_weight_m_per_rad = metres_per_radian;
        self
    }

    /// Asks for the position of the tip only.
    #[must_use]
    pub fn position_only(self) -> Self {
        self.rotation_weight(0.0)
    }

    /// Sets [`IkOptions::iterations`].
    #[must_use]
    pub fn iterations(mut self, iterations: u32) -> Self {
        self.iterations = iterations;
        self
    }

    /// Sets [`IkOptions::restarts`].
    #[must_use]
    pub fn restarts(mut self, restarts: u32) -> Self {
        self.restarts = restarts;
        self
    }

    /// Sets [`IkOptions::method`].
    #[must_use]
    pub fn method(mut self, method: IkMethod) -> Self {
        self.method = method;
        self
    }

    /// Sets [`IkOptions::random_seed`].
    #[must_use]
    pub fn random_seed(mut self, seed: u64) -> Self {
        self.random_seed = seed;
        self
    }
}

/// Why the answer is what it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum IkReason {
    /// The target is reached within the tolerances.
    Reached,
    /// No direction in joint space leads nearer and no joint is at a limit: the target is out of reach.
    OutOfReach,
    /// No direction in joint space leads nearer without leaving the limits of some joint.
    JointLimit,
    /// The iterations were used up or the caller ended the search; the answer may be improved.
    Budget,
    /// The target is not finite; the joint values are those of the seed.
    BadTarget,
}

/// What the solver did. The joint values are in the slice that held the seed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IkReport {
    /// Why the answer is what it is.
    pub reason: IkReason,
    /// Distance of the tip from the target (m).
    pub position_error_m: f64,
    /// Angle between the tip and the target (rad); NaN never, zero when the rotation is ignored.
    pub rotation_error_rad: f64,
    /// Least-squares steps over all attempts; zero for an answer in closed form.
    pub iterations: u32,
    /// Attempts, the one from the seed included; zero for an answer in closed form.
    pub attempts: u32,
    /// Whether the answer came from the seed, in closed form the branch nearest to it (else from a random restart, on
    /// whichever branch).
    pub from_seed: bool,
}

impl IkReport {
    /// Whether the target is reached.
    pub fn reached(&self) -> bool {
        self.reason == IkReason::Reached
    }
}

impl crate::Chain {
    /// Joint values that bring the tip to `base_from_target`, or as near to it as the limits allow.
    ///
    /// `q` holds the seed (usually the last pose) and receives the answer, which always lies within the joint
    /// limits: the best of all attempts, reached or not. See [`IkOptions`] for what "nearest" means and for the
    /// search budget. No allocation. A continuous joint is not wrapped.
    ///
    /// # Panics
    /// When `q` does not have [`crate::Chain::dof`] values.
    ///
    /// ```
    /// use kin::{IkOptions, IkReason, Robot};
    /// let chain = Robot::builtin().chain("base_link", "tool0")?;
    /// let target = chain.fk(&[0.3, 1.2, -1.6, -1.1, 0.2, 0.0]);
    /// let mut q = [0.0, 1.0, -1.5, -1.0, 0.0, 0.0];
    /// let report = chain.ik(&target, &IkOptions::default(), &mut q);
    /// assert!(report.reached());
    /// assert!((chain.fk(&q).translation.vector - target.translation.vector).norm() < 1e-6);
    /// // Two metres away: the arm stretches towards it, and says so.
    /// let far = nalgebra::Isometry3::translation(2.0, 0.0, 0.14);
    /// let report = chain.ik(&far, &IkOptions::default().position_only(), &mut q);
    /// assert_eq!(report.reason, IkReason::OutOfReach);
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn ik(&self, base_from_target: &Isometry3<f64>, options: &IkOptions, q: &mut [f64]) -> IkReport {
        self.ik_while(base_from_target, options, q, &mut || true)
    }

    /// As [`crate::Chain::ik`], asking `go_on` before each step: how the caller, who owns the clock, sets a deadline.
    /// When it says no, the best joint values so far are the answer.
    ///
    /// # Panics
    /// When `q` does not have [`crate::Chain::dof`] values.
    pub fn ik_while(
        &self,
        base_from_target: &Isometry3<f64>,
        options: &IkOptions,
        q: &mut [f64],
        go_on: &mut dyn FnMut() -> bool,
    ) -> IkReport {
        assert_eq!(q.len(), self.dof(), "seed of chain {} -> {}", self.base(), self.tip());
        if options.method == IkMethod::Auto
            && options.restarts > 0
            && options.rotation_weight_m_per_rad > 0.0
            && let Some(report) = self.in_closed_form(base_from_target, options, q)
        {
            return report;
        }
        match self.dof() {
            1..=6 => search::solve::<6, 8>(self, base_from_target, options, q, go_on),
            7 => search::solve::<7, 8>(self, base_from_target, options, q, go_on),
            _ => search::solve::<32, 32>(self, base_from_target, options, q, go_on),
        }
    }

    fn in_closed_form(
        &self,
        base_from_target: &Isometry3<f64>,
        options: &IkOptions,
        q: &mut [f64],
    ) -> Option<IkReport> {
        let analytic = self.analytic()?;
        let seed: [f64; 6] = (&*q).try_into().ok()?;
        if !seed.iter().all(|value| value.is_finite()) {
            return None;
        }
        let solution = analytic.nearest(base_from_target, &seed)?;
        let reached = self.tip_frame(&solution);
        let position_error_m = (reached.position() - base_from_target.translation.vector).norm();
        let wanted = base_from_target.rotation.to_rotation_matrix();
        let rotation_error_rad = problem::turn_between(&reached.rotation(), wanted.matrix()).norm();
        if !(position_error_m <= options.position_tolerance_m && rotation_error_rad <= options.rotation_tolerance_rad) {
            return None;
        }
        q.copy_from_slice(&solution);
        Some(IkReport {
            reason: IkReason::Reached,
            position_error_m,
            rotation_error_rad,
            iterations: 0,
            attempts: 0,
            from_seed: true,
        })
    }
}
