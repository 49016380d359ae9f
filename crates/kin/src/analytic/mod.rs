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
//! In a wrist singularity (`R(h5, q5) h6` along the axis that should turn it) only a sum of two joints is fixed: the one
//! nearer to the base takes the seed's value and joint 6 takes the rest.

mod geometry;
mod subproblems;

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::Chain;
use geometry::Family;
pub(crate) use geometry::recognise;
use subproblems::{Roots, align, axis_angle, reach, slide};

/// The closed-form solver of a chain, see [`Chain::analytic`].
#[derive(Debug, Clone)]
pub struct Analytic {
    family: Family,
    /// Axes at zero, in base axes.
    h: [Vector3<f64>; 6],
    /// Joint value in the chain over joint value in these formulas: -1 where an axis was turned round.
    signs: [f64; 6],
    /// From joint `i` to joint `i + 1` at zero; the last one from the wrist origin to the tip.
    p: [Vector3<f64>; 6],
    /// Base to joint 1.
    start: Vector3<f64>,
    /// Rotation of the tip at zero.
    zero_rotation: Matrix3<f64>,
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

    fn push(&mut self, q: [f64; 6]) {
        if self.count < 8 {
            self.q[self.count] = q;
            self.count += 1;
        }
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
        let rotation = *base_from_target.rotation.to_rotation_matrix().matrix() * self.zero_rotation.transpose();
        let p = base_from_target.translation.vector - self.start - rotation * self.p[5];
        let mut branches = Branches { count: 0, q: [[0.0; 6]; 8] };
        if !(p.iter().all(|value| value.is_finite()) && rotation.iter().all(|value| value.is_finite())) {
            return branches;
        }
        let along = self.h[1].dot(&(self.p[0] + self.p[1] + self.p[2] + self.p[3]));
        for &q1 in slide(&self.h[1], &p, &-self.h[0], along).as_slice() {
            let r01_inverse = axis_angle(&-self.h[0], q1);
            let in_one = r01_inverse * p - self.p[0];
            let r16 = r01_inverse * rotation;
            match self.family {
                Family::Parallel => self.parallel(q1, &in_one, &r16, seed, &mut branches),
                Family::SphericalWrist => self.spherical(q1, &in_one, &r16, seed, &mut branches),
            }
        }
        for branch in &mut branches.q[..branches.count] {
            for (value, sign) in branch.iter_mut().zip(&self.signs) {
                *value = wrap_near(*value * sign);
            }
        }
        branches
    }

    /// The branch nearest to the seed (smallest largest change of a joint) among those within the limits, each value moved
    /// by whole turns as near to the seed as the limits allow.
    pub fn nearest(&self, base_from_target: &Isometry3<f64>, seed: &[f64; 6]) -> Option<[f64; 6]> {
        let mut best: Option<(f64, [f64; 6])> = None;
        for branch in self.all(base_from_target, seed).as_slice() {
            let mut q = *branch;
            let mut largest = 0.0f64;
            let least = best.map_or(f64::INFINITY, |(least, _)| least);
            let allowed = (0..6).all(|joint| {
                let Some(value) = near(q[joint], seed[joint], self.lower[joint], self.upper[joint]) else {
                    return false;
                };
                q[joint] = value;
                largest = largest.max((value - seed[joint]).abs());
                // Farther than the best already: the other joints cannot mend it.
                largest < least
            });
            if allowed {
                best = Some((largest, q));
            }
        }
        best.map(|(_, q)| q)
    }

    fn parallel(&self, q1: f64, in_one: &Vector3<f64>, r16: &Matrix3<f64>, seed: &[f64; 6], branches: &mut Branches) {
        let h2 = &self.h[1];
        let pointing = r16 * self.h[5];
        for &q5 in slide(h2, &self.h[5], &self.h[4], h2.dot(&pointing)).as_slice() {
            let r45 = axis_angle(&self.h[4], q5);
            let (q234, q6) =
                self.turns(h2, &r45, &pointing, r16, || seed[1] + self.signs[2] * seed[2] + self.signs[3] * seed[3]);
            let reach_vector = in_one - axis_angle(h2, q234) * self.p[3];
            self.elbow(&reach_vector, |q2, q3| branches.push([q1, q2, q3, q234 - q2 - q3, q5, q6]));
        }
    }

    fn spherical(&self, q1: f64, in_one: &Vector3<f64>, r16: &Matrix3<f64>, seed: &[f64; 6], branches: &mut Branches) {
        let h4 = &self.h[3];
        self.elbow(in_one, |q2, q3| {
            let r36 = axis_angle(&self.h[1], -(q2 + q3)) * r16;
            let pointing = r36 * self.h[5];
            for &q5 in slide(h4, &self.h[5], &self.h[4], h4.dot(&pointing)).as_slice() {
                let r45 = axis_angle(&self.h[4], q5);
                let (q4, q6) = self.turns(h4, &r45, &pointing, &r36, || self.signs[3] * seed[3]);
                branches.push([q1, q2, q3, q4, q5, q6]);
            }
        });
    }

    /// The turn about `axis` that takes `R_45 h6` to `pointing`, and the q6 that completes `target = R(axis) R_45 R(h6)`.
    fn turns(
        &self,
        axis: &Vector3<f64>,
        r45: &Matrix3<f64>,
        pointing: &Vector3<f64>,
        target: &Matrix3<f64>,
        free: impl Fn() -> f64,
    ) -> (f64, f64) {
        let spun = r45 * self.h[5];
        if let Some(turn) = align(axis, &spun, pointing) {
            let from = r45.transpose() * axis;
            if let Some(q6) = align(&-self.h[5], &from, &(target.transpose() * axis)) {
                return (turn, q6);
            }
        }
        // Wrist singularity: the first turn is free, the last one makes up for it.
        let turn = Some(crate::wrap_rad(free())).filter(|turn| turn.is_finite()).unwrap_or(0.0);
        let rest = r45.transpose() * axis_angle(axis, -turn) * target;
        let probe = subproblems::across(&self.h[5]);
        (turn, align(&self.h[5], &probe, &(rest * probe)).unwrap_or(0.0))
    }

    /// Both ways to put the elbow.
    fn elbow(&self, wanted: &Vector3<f64>, mut found: impl FnMut(f64, f64)) {
        let h2 = &self.h[1];
        let roots: Roots = reach(h2, &self.p[1], &self.p[2], wanted.norm());
        for &q3 in roots.as_slice() {
            let bent = self.p[1] + axis_angle(h2, q3) * self.p[2];
            // A wrist on the shoulder axis leaves q2 free; zero is as good as any.
            let q2 = align(h2, &bent, wanted).unwrap_or(0.0);
            found(q2, q3);
        }
    }
}

/// [`crate::wrap_rad`] for the sum of a few angles: additions instead of a division.
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
fn near(value: f64, seed: f64, lower: f64, upper: f64) -> Option<f64> {
    let turn = std::f64::consts::TAU;
    let nearest = value + turn * ((seed - value) / turn).round();
    // Rounding of the limits themselves (pi written with fifteen digits) is not a violation.
    let slack = 1e-9;
    [0.0, -turn, turn, -2.0 * turn, 2.0 * turn]
        .into_iter()
        .map(|shift| nearest + shift)
        .find(|candidate| *candidate >= lower - slack && *candidate <= upper + slack)
        .map(|candidate| candidate.clamp(lower, upper))
}
