//! How far the tip is from its target, and how that changes with the joints.
//!
//! Joints stand in lanes: arrays over joints are `L` long, padded with zeros, so that sums over the six rows of the Jacobian
//! are sums of whole vectors.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::IkOptions;
use crate::Chain;

pub(super) struct Problem<'a> {
    pub(super) chain: &'a Chain,
    pub(super) target_rotation: Matrix3<f64>,
    pub(super) target_position: Vector3<f64>,
    pub(super) rho: f64,
    pub(super) options: &'a IkOptions,
}

/// A joint vector of up to `D` joints and what it does.
#[derive(Clone, Copy)]
pub(super) struct Point<const D: usize, const L: usize> {
    pub(super) q: [f64; D],
    /// Rows of the Jacobian: linear, then angular.
    pub(super) rows: [[f64; L]; 6],
    pub(super) error: [f64; 6],
    pub(super) position_error: f64,
    pub(super) rotation_error: f64,
    /// d^2.
    pub(super) cost: f64,
}

impl<'a> Problem<'a> {
    pub(super) fn new(chain: &'a Chain, base_from_target: &Isometry3<f64>, options: &'a IkOptions) -> Self {
        Self {
            chain,
            target_rotation: *base_from_target.rotation.to_rotation_matrix().matrix(),
            target_position: base_from_target.translation.vector,
            rho: options.rotation_weight_m_per_rad,
            options,
        }
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(super) fn evaluate<const D: usize, const L: usize>(&self, q: [f64; D]) -> Point<D, L> {
        let (tip, rows) = self.chain.tip_frame_and_rows_here::<D, L>(&q);
        let linear = self.target_position - tip.position();
        let angular =
            if self.rho > 0.0 { turn_between(&tip.rotation(), &self.target_rotation) } else { Vector3::zeros() };
        let (off, turned) = (linear.norm_squared(), angular.norm_squared());
        Point {
            q,
            rows,
            error: [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z],
            position_error: off.sqrt(),
            rotation_error: turned.sqrt(),
            cost: off + self.rho * self.rho * turned,
        }
    }

    pub(super) fn reached<const D: usize, const L: usize>(&self, point: &Point<D, L>) -> bool {
        point.position_error <= self.options.position_tolerance_m
            && point.rotation_error <= self.options.rotation_tolerance_rad
    }

    /// `H` and the curvature of the motion, of which only the lower half means anything. Exact for chains whose stages are
    /// their joints, an approximation with mimic joints (which costs steps, not correctness).
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(super) fn exact_hessian<const D: usize, const L: usize>(
        &self,
        gauss_newton: &[[f64; L]; D],
        point: &Point<D, L>,
        rows: &[[f64; L]; 6],
    ) -> [[f64; L]; D] {
        let mut exact = *gauss_newton;
        let linear_error = Vector3::new(point.error[0], point.error[1], point.error[2]);
        let angular_error = Vector3::new(point.error[3], point.error[4], point.error[5]);
        let angle2 = point.rotation_error * point.rotation_error;
        let half = 0.5 * point.rotation_error;
        let c = if angle2 < 1e-6 { 1.0 / 12.0 } else { (1.0 - half / half.tan()) / angle2 };
        let rho2 = self.rho * self.rho;
        for later in 0..D {
            let linear = Vector3::new(rows[0][later], rows[1][later], rows[2][later]);
            let axis = Vector3::new(rows[3][later], rows[4][later], rows[5][later]);
            let once = cross(&angular_error, &axis);
            let twice = cross(&angular_error, &once);
            // e . (z_i x v_j) = z_i . (v_j x e)
            let along = (once * 0.5 + twice * c) * rho2 - cross(&linear, &linear_error);
            for earlier in 0..L {
                exact[later][earlier] +=
                    rows[3][earlier] * along.x + rows[4][earlier] * along.y + rows[5][earlier] * along.z;
            }
        }
        exact
    }
}

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn cross(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

/// The rotation vector that turns `from` into `to`, in the axes both are written in; length in [0, pi].
#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
pub(super) fn turn_between(from: &Matrix3<f64>, to: &Matrix3<f64>) -> Vector3<f64> {
    // Entry (i, j) of to * from^T.
    let entry = |i: usize, j: usize| to[(i, 0)] * from[(j, 0)] + to[(i, 1)] * from[(j, 1)] + to[(i, 2)] * from[(j, 2)];
    // sin t times the axis, and cos t.
    let skew = Vector3::new(entry(2, 1) - entry(1, 2), entry(0, 2) - entry(2, 0), entry(1, 0) - entry(0, 1)) * 0.5;
    let cosine = 0.5 * (entry(0, 0) + entry(1, 1) + entry(2, 2) - 1.0);
    let sine2 = skew.norm_squared();
    if cosine > 0.0 && sine2 < 1e-3 {
        // asin(s) / s
        let series =
            1.0 + sine2 * (1.0 / 6.0 + sine2 * (3.0 / 40.0 + sine2 * (15.0 / 336.0 + sine2 * (105.0 / 3456.0))));
        return skew * series;
    }
    if cosine > -0.9 {
        let sine = sine2.sqrt();
        return skew * (sine.atan2(cosine) / sine);
    }
    // Near half a turn the skew part vanishes.
    half_turn(&Matrix3::from_fn(entry))
}

#[cold]
fn half_turn(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let quaternion = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation));
    let imaginary = quaternion.imag();
    let (sine, cosine) = (imaginary.norm(), quaternion.w);
    // Of the two quaternions of a rotation take the one of the shorter turn.
    let half = if cosine < 0.0 { (-sine).atan2(-cosine) } else { sine.atan2(cosine) };
    imaginary * (2.0 * half / sine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_turn_between_two_rotations_is_that_of_their_quaternions() {
        let axis = Vector3::new(0.48, -0.6, 0.64);
        let from = *Rotation3::from_euler_angles(0.3, -1.0, 2.0).matrix();
        for angle in [0.0, 1e-12, 1e-7, 0.02, 0.0316, 0.032, 0.5, 1.6, 2.6, 2.7, 3.0, 3.1, std::f64::consts::PI - 1e-9]
        {
            let to = Rotation3::new(axis * angle).matrix() * from;
            let turn = turn_between(&from, &to);
            assert!(
                (turn - axis * angle).norm() < 4e-15 * (1.0 + 1.0 / (std::f64::consts::PI - angle)),
                "{angle}: {turn}"
            );
        }
    }
}
