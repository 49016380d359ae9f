//! Inverse kinematics in closed form, with all its branches.
//!
//! Two families are recognised from the geometry of a six-joint chain, whatever its frames or joint names:
//!
//! - **parallel 2-3-4** (UR type): axes 2, 3, 4 parallel, axes 5 and 6 intersecting;
//! - **spherical wrist** with parallel 2-3 (most industrial arms): axes 4, 5, 6 through one point.
//!
//! Both are solved by the canonical subproblems of Paden and Kahan in the form of Elias and Wen (2022,
//! "IK-Geo"), with products of exponentials: at zero every joint frame is parallel to the base, `h_i` is the axis of
//! joint `i`, and `p_i` leads from the origin of joint `i` to that of joint `i + 1`. With `R_ij` the rotation from
//! frame `j` to frame `i` and `p` the vector from joint 1 to the wrist origin in the base:
//!
//! ```text
//! q1:   h2 . R(-h1, q1) p = h2 . (p_1 + p_2 + p_3 + p_4)                 (nothing after joint 1 moves along h2)
//! 2-3-4:
//!   q5:   h2 . R(h5, q5) h6 = h2 . R_01' R_06 h6
//!   q234: R(h2, q234) R(h5, q5) h6 = R_01' R_06 h6
//!   q6:   R(-h6, q6) R(-h5, q5) h2 = R_06' R_01 h2
//!   q3:   |p_2 + R(h2, q3) p_3| = |R_01' p - p_1 - R(h2, q234) p_4|
//!   q2:   R(h2, q2) (p_2 + R(h2, q3) p_3) = R_01' p - p_1 - R(h2, q234) p_4
//! spherical wrist (p_4 = p_5 = 0):
//!   q3, q2: as above without p_4
//!   q5:   h4 . R(h5, q5) h6 = h4 . R_36 h6
//!   q4:   R(h4, q4) R(h5, q5) h6 = R_36 h6,      q6: R(-h6, q6) R(-h5, q5) h4 = R_36' h4
//! ```
//!
//! All of it is written in axes whose z is `h2`, so that turns about the parallel axes are turns of the plane. Turns are kept as
//! sines and cosines; an angle is taken once per joint value, and a search for one branch gives up a joint value, with all
//! branches that hang on it, as soon as it is out of limits or farther from the seed than an answer known already.
//!
//! In a wrist singularity (`R(h5, q5) h6` along the axis that should turn it) only a sum of two joints is fixed: the one
//! nearer to the base takes the seed's value and joint 6 takes the rest.

mod geometry;
mod subproblems;

use nalgebra::{Isometry3, Matrix3, Vector3};
use pulp::{Simd, WithSimd};

use crate::Chain;
use crate::simd::Machine;
use geometry::Family;
pub(crate) use geometry::recognise;
use subproblems::{Reach, Slide, Turn, across, align, dot};

/// The closed-form solver of a chain, see [`Chain::analytic`].
#[derive(Debug, Clone)]
pub struct Analytic {
    family: Family,
    machine: Machine,
    /// Takes base axes to the axes of these formulas, whose z is axis 2 at zero.
    from_base: Matrix3<f64>,
    /// Axes at zero.
    h: [Vector3<f64>; 6],
    /// Joint value in the chain over joint value in these formulas: -1 where an axis was turned round.
    signs: [f64; 6],
    /// From joint `i` to joint `i + 1` at zero; the last one from the wrist origin to the tip.
    p: [Vector3<f64>; 6],
    /// Base to joint 1, in base axes.
    start: Vector3<f64>,
    /// From the axes of these formulas to the tip at zero, transposed.
    tip_to_axes: Matrix3<f64>,
    elbow: Reach,
    wrist: Slide,
    lower: [f64; 6],
    upper: [f64; 6],
}

/// Up to eight sets of joint values.
#[derive(Debug, Clone, Copy)]
pub struct Branches {
    count: usize,
    q: [[f64; 6]; 8],
}

impl Branches {
    /// The sets of joint values (rad), each in (-pi, pi], whether within limits or not.
    pub fn as_slice(&self) -> &[[f64; 6]] {
        &self.q[..self.count]
    }
}

impl Chain {
    /// The closed-form solver, where the geometry of this chain has one: six turning joints of a family that the
    /// module documentation of this method's type names.
    ///
    /// ```
    /// let chain = kin::Robot::builtin().chain("base_link", "tool0")?;
    /// let analytic = chain.analytic().expect("parallel axes 2-3-4");
    /// let q = [0.3, 1.2, -1.6, -1.1, 0.4, 0.5];
    /// let branches = analytic.all(&chain.fk(&q), &q);
    /// assert_eq!(branches.as_slice().len(), 8);
    /// let again = branches.as_slice().iter().any(|b| b.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-9));
    /// assert!(again);
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn analytic(&self) -> Option<&Analytic> {
        self.closed_form()
    }
}

impl Analytic {
    /// Every branch that brings the tip to the pose. `seed` decides only what a wrist singularity leaves open.
    pub fn all(&self, base_from_target: &Isometry3<f64>, seed: &[f64; 6]) -> Branches {
        let mut all = All { branches: Branches { count: 0, q: [[0.0; 6]; 8] }, q: [0.0; 6] };
        self.machine.run(Solve { analytic: self, base_from_target, seed, taker: &mut all });
        all.branches
    }

    /// The branch nearest to the seed (smallest largest change of a joint) among those within the limits, each value moved
    /// by whole turns as near to the seed as the limits allow.
    pub fn nearest(&self, base_from_target: &Isometry3<f64>, seed: &[f64; 6]) -> Option<[f64; 6]> {
        let mut nearest = Nearest { analytic: self, seed, q: [0.0; 6], best: None, least: f64::INFINITY };
        self.machine.run(Solve { analytic: self, base_from_target, seed, taker: &mut nearest });
        nearest.best
    }
}

/// Who takes joint values as they are found, from the roots of the tree of branches to its leaves.
trait Taker {
    /// Takes the value of a joint, in (-pi, pi]; `false` where no branch with it is wanted.
    fn take(&mut self, joint: usize, value: f64) -> bool;

    /// The values taken last make a branch.
    fn complete(&mut self);
}

struct All {
    branches: Branches,
    q: [f64; 6],
}

impl Taker for All {
    #[inline(always)]
    fn take(&mut self, joint: usize, value: f64) -> bool {
        self.q[joint] = value;
        true
    }

    #[inline(always)]
    fn complete(&mut self) {
        if let Some(place) = self.branches.q.get_mut(self.branches.count) {
            *place = self.q;
            self.branches.count += 1;
        }
    }
}

struct Nearest<'a> {
    analytic: &'a Analytic,
    seed: &'a [f64; 6],
    q: [f64; 6],
    best: Option<[f64; 6]>,
    /// The largest change of a joint in the best branch.
    least: f64,
}

impl Taker for Nearest<'_> {
    #[inline(always)]
    fn take(&mut self, joint: usize, value: f64) -> bool {
        let (lower, upper) = (self.analytic.lower[joint], self.analytic.upper[joint]);
        let Some(value) = near(value, self.seed[joint], lower, upper) else {
            return false;
        };
        self.q[joint] = value;
        // Farther than the best already: the other joints cannot mend it.
        (value - self.seed[joint]).abs() < self.least
    }

    #[inline(always)]
    fn complete(&mut self) {
        self.best = Some(self.q);
        self.least = self.q.iter().zip(self.seed).map(|(value, seed)| (value - seed).abs()).fold(0.0, f64::max);
    }
}

struct Solve<'a, T> {
    analytic: &'a Analytic,
    base_from_target: &'a Isometry3<f64>,
    seed: &'a [f64; 6],
    taker: &'a mut T,
}

impl<T: Taker> WithSimd for Solve<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.run();
    }
}

/// What joint 1 leaves: in the frame after it, unless said otherwise.
struct AfterOne {
    q1: Turn,
    /// From joint 2 to the wrist origin.
    wrist: Vector3<f64>,
    /// Where axis 6 points.
    pointing: Vector3<f64>,
}

impl<T: Taker> Solve<'_, T> {
    #[inline(always)]
    fn run(mut self) {
        let arm = self.analytic;
        let rotation = product(
            &product(&arm.from_base, self.base_from_target.rotation.to_rotation_matrix().matrix()),
            &arm.tip_to_axes,
        );
        let p = applied(&arm.from_base, &(self.base_from_target.translation.vector - arm.start))
            - applied(&rotation, &arm.p[5]);
        if !(p.iter().all(|value| value.is_finite()) && rotation.iter().all(|value| value.is_finite())) {
            return;
        }
        let z = Vector3::z();
        let along = arm.p[0].z + arm.p[1].z + arm.p[2].z + arm.p[3].z;
        let six = applied(&rotation, &arm.h[5]);
        for &back in Slide::new(&z, &p, &arm.h[0]).turns(along).as_slice() {
            let q1 = back.back();
            if !self.take(0, q1) {
                continue;
            }
            let after = AfterOne { q1, wrist: back.of(&arm.h[0], &p) - arm.p[0], pointing: back.of(&arm.h[0], &six) };
            match arm.family {
                Family::Parallel => self.parallel(&rotation, &after),
                Family::SphericalWrist => self.spherical(&rotation, &after),
            }
        }
    }

    #[inline(always)]
    fn take(&mut self, joint: usize, turn: Turn) -> bool {
        self.take_angle(joint, turn.angle())
    }

    #[inline(always)]
    fn take_angle(&mut self, joint: usize, angle: f64) -> bool {
        self.taker.take(joint, wrap_near(angle * self.analytic.signs[joint]))
    }

    #[inline(always)]
    fn parallel(&mut self, rotation: &Matrix3<f64>, after: &AfterOne) {
        let arm = self.analytic;
        let z = Vector3::z();
        let free = self.seed[1] + arm.signs[2] * self.seed[2] + arm.signs[3] * self.seed[3];
        let seen = transposed(rotation, &after.q1.of(&arm.h[0], &z));
        for &q5 in arm.wrist.turns(after.pointing.z).as_slice() {
            if !self.take(4, q5) {
                continue;
            }
            let (q234, q6) = arm.turns(&z, q5, &after.pointing, &seen, free, |probe| {
                after.q1.back().of(&arm.h[0], &applied(rotation, probe))
            });
            if !self.take(5, q6) {
                continue;
            }
            let wanted = after.wrist - q234.about_z(&arm.p[3]);
            let length_squared = wanted.x * wanted.x + wanted.y * wanted.y;
            let q234 = q234.angle();
            for &q3 in arm.elbow.turns(length_squared).as_slice() {
                let q2 = arm.lean(q3, &wanted);
                let (q2, q3) = (q2.angle(), q3.angle());
                if self.take_angle(2, q3) && self.take_angle(1, q2) && self.take_angle(3, q234 - q2 - q3) {
                    self.taker.complete();
                }
            }
        }
    }

    #[inline(always)]
    fn spherical(&mut self, rotation: &Matrix3<f64>, after: &AfterOne) {
        let arm = self.analytic;
        let h4 = &arm.h[3];
        let free = arm.signs[3] * self.seed[3];
        let length_squared = after.wrist.x * after.wrist.x + after.wrist.y * after.wrist.y;
        for &q3 in arm.elbow.turns(length_squared).as_slice() {
            let q2 = arm.lean(q3, &after.wrist);
            if !(self.take(2, q3) && self.take(1, q2)) {
                continue;
            }
            let q23 = q2.and(q3);
            let pointing = q23.back().about_z(&after.pointing);
            let seen = transposed(rotation, &after.q1.of(&arm.h[0], &q23.about_z(h4)));
            for &q5 in arm.wrist.turns(dot(h4, &pointing)).as_slice() {
                if !self.take(4, q5) {
                    continue;
                }
                let (q4, q6) = arm.turns(h4, q5, &pointing, &seen, free, |probe| {
                    q23.back().about_z(&after.q1.back().of(&arm.h[0], &applied(rotation, probe)))
                });
                if self.take(3, q4) && self.take(5, q6) {
                    self.taker.complete();
                }
            }
        }
    }
}

impl Analytic {
    /// The turn about `axis` that takes `R_45 h6` to `pointing`, and the q6 that completes `target = R(axis) R_45 R(h6)`, of which
    /// `seen = target^T axis` and `target` itself as a function are given.
    #[inline(always)]
    fn turns(
        &self,
        axis: &Vector3<f64>,
        q5: Turn,
        pointing: &Vector3<f64>,
        seen: &Vector3<f64>,
        free: f64,
        target: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> (Turn, Turn) {
        let spun = q5.of(&self.h[4], &self.h[5]);
        if let Some(turn) = align(axis, &spun, pointing) {
            let from = q5.back().of(&self.h[4], axis);
            if let Some(back) = align(&self.h[5], &from, seen) {
                return (turn, back.back());
            }
        }
        // Wrist singularity: the first turn is free, the last one makes up for it.
        let turn = if free.is_finite() { Turn::by(free) } else { Turn::NONE };
        let probe = across(&self.h[5]);
        let rest = q5.back().of(&self.h[4], &turn.back().of(axis, &target(&probe)));
        (turn, align(&self.h[5], &probe, &rest).unwrap_or(Turn::NONE))
    }

    /// The q2 that points the bent arm at the wanted place.
    #[inline(always)]
    fn lean(&self, q3: Turn, wanted: &Vector3<f64>) -> Turn {
        let bent = q3.about_z(&self.p[2]) + self.p[1];
        // A wrist on the shoulder axis leaves q2 free; zero is as good as any.
        align(&Vector3::z(), &bent, wanted).unwrap_or(Turn::NONE)
    }
}

#[inline(always)]
fn applied(m: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let row = |i: usize| m[(i, 0)] * v.x + m[(i, 1)] * v.y + m[(i, 2)] * v.z;
    Vector3::new(row(0), row(1), row(2))
}

#[inline(always)]
fn transposed(m: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let column = |i: usize| m[(0, i)] * v.x + m[(1, i)] * v.y + m[(2, i)] * v.z;
    Vector3::new(column(0), column(1), column(2))
}

#[inline(always)]
fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[(i, 0)] * b[(0, j)] + a[(i, 1)] * b[(1, j)] + a[(i, 2)] * b[(2, j)])
}

/// [`crate::wrap_rad`] for the sum of a few angles: additions instead of a division.
#[inline(always)]
fn wrap_near(mut angle: f64) -> f64 {
    const TURN: f64 = std::f64::consts::TAU;
    while angle > std::f64::consts::PI {
        angle -= TURN;
    }
    while angle <= -std::f64::consts::PI {
        angle += TURN;
    }
    angle
}

/// `value + 2 pi n` within the limits, as near to the seed as possible.
#[inline(always)]
fn near(value: f64, seed: f64, lower: f64, upper: f64) -> Option<f64> {
    let turn = std::f64::consts::TAU;
    let nearest = value + turn * ((seed - value) / turn).round_ties_even();
    // Rounding of the limits themselves (pi written with fifteen digits) is not a violation.
    let slack = 1e-9;
    for shift in [0.0, -turn, turn, -2.0 * turn, 2.0 * turn] {
        let candidate = nearest + shift;
        if candidate >= lower - slack && candidate <= upper + slack {
            return Some(candidate.clamp(lower, upper));
        }
    }
    None
}
