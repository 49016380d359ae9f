//! Levenberg-Marquardt within box limits, with restarts.
//!
//! Each step solves `(H + lambda D) s = g` with `g = J^T W e` (which is the exact downhill direction of `d^2 / 2`:
//! the rotation vector is an eigenvector of the left Jacobian of SO(3)), `H = J^T W J` and `D = diag(H)` floored.
//! Where the distance no longer falls by half per step, `H` is the exact second derivative of `d^2 / 2`:
//!
//! ```text
//! H_ij -= e_p . (z_i x v_j)                                     for i <= j, v_j the linear column of joint j
//! H_ij += rho^2 (z_i . (e_w x z_j) / 2 + c z_i . (e_w x (e_w x z_j))),   c = (1 - (t/2) cot(t/2)) / t^2, t = |e_w|
//! ```
//!
//! which converges at the edge of the workspace, where `J` loses rank. Joints at a limit that would move out of it are held. `lambda` follows the gain ratio (Nielsen 1999). An attempt
//! ends when the target is reached, when the free part of the gradient vanishes (a nearest pose), or when it stops
//! making progress.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::{IkOptions, IkReason, IkReport};
use crate::Chain;
use pulp::{Simd, WithSimd};

/// Steps of one attempt. A hopeless attempt is cheaper to abandon than to finish.
const STEPS_PER_ATTEMPT: u32 = 60;

/// An attempt whose distance has not halved within so many steps is abandoned, unless it is the best one known or no other
/// may follow.
const STEPS_PER_MILESTONE: u32 = 6;

/// Attempts after which none is abandoned any more.
const ATTEMPTS_IN_HASTE: u32 = 30;

/// Random poses looked at per restart.
const LOOKS_PER_RESTART: u32 = 8;

struct Problem<'a> {
    chain: &'a Chain,
    dof: usize,
    target_rotation: Matrix3<f64>,
    target_position: Vector3<f64>,
    rho: f64,
    options: &'a IkOptions,
}

#[derive(Clone, Copy)]
struct Point<const N: usize> {
    q: [f64; N],
    /// Columns of the Jacobian, linear then angular.
    columns: [[f64; 6]; N],
    error: [f64; 6],
    position_error: f64,
    rotation_error: f64,
    /// d^2.
    cost: f64,
}

#[derive(Clone, Copy, PartialEq)]
enum End {
    Reached,
    Stationary { at_limit: bool },
    GaveUp,
}

/// Solves on the best instruction set of this machine.
pub(super) fn solve<const N: usize>(
    chain: &Chain,
    base_from_target: &Isometry3<f64>,
    options: &IkOptions,
    q: &mut [f64],
    go_on: &mut dyn FnMut() -> bool,
) -> IkReport {
    chain.machine.run(Solve::<N> { chain, base_from_target, options, q, go_on })
}

struct Solve<'a, const N: usize> {
    chain: &'a Chain,
    base_from_target: &'a Isometry3<f64>,
    options: &'a IkOptions,
    q: &'a mut [f64],
    go_on: &'a mut dyn FnMut() -> bool,
}

impl<const N: usize> WithSimd for Solve<'_, N> {
    type Output = IkReport;

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set it is dispatched to")]
    fn with_simd<S: Simd>(self, _: S) -> IkReport {
        solve_here::<N>(self.chain, self.base_from_target, self.options, self.q, self.go_on)
    }
}

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn solve_here<const N: usize>(
    chain: &Chain,
    base_from_target: &Isometry3<f64>,
    options: &IkOptions,
    q: &mut [f64],
    go_on: &mut dyn FnMut() -> bool,
) -> IkReport {
    let dof = q.len();
    let problem = Problem {
        chain,
        dof,
        target_rotation: *base_from_target.rotation.to_rotation_matrix().matrix(),
        target_position: base_from_target.translation.vector,
        rho: options.rotation_weight_m_per_rad,
        options,
    };
    let mut seed = [0.0; N];
    seed[..dof].copy_from_slice(q);
    for (value, limits) in seed.iter_mut().zip(chain.limits()) {
        // A seed that is no number is no seed.
        *value = if value.is_finite() {
            value.clamp(limits.lower, limits.upper)
        } else {
            middle(limits.lower, limits.upper)
        };
    }
    let mut best = problem.evaluate(seed);
    let mut report = IkReport {
        reason: IkReason::Budget,
        position_error_m: best.position_error,
        rotation_error_rad: best.rotation_error,
        iterations: 0,
        attempts: 0,
        from_seed: true,
    };
    if !best.cost.is_finite() {
        report.reason = IkReason::BadTarget;
        (report.position_error_m, report.rotation_error_rad) = (f64::INFINITY, f64::INFINITY);
        return report;
    }
    let mut random = SplitMix(options.random_seed);
    let mut best_end = End::GaveUp;
    let mut stopped = false;
    while report.attempts <= options.restarts && report.iterations < options.iterations && !stopped {
        let first = report.attempts == 0;
        let start = if first { best } else { problem.evaluate(problem.promising_pose(&mut random)) };
        report.attempts += 1;
        let patience = match (first, options.restarts) {
            (true, 0) => f64::INFINITY,
            (true, _) => 0.0,
            // After so many the target is likely out of reach, and what counts is the nearest pose.
            (false, _) if report.attempts > ATTEMPTS_IN_HASTE => f64::INFINITY,
            (false, _) => best.cost,
        };
        let (point, end, ended) = problem.descend(start, patience, &mut report.iterations, go_on);
        stopped = ended;
        if end == End::Reached || point.cost < best.cost || first {
            best = point;
            best_end = end;
            report.from_seed = first;
        }
        if end == End::Reached {
            break;
        }
    }
    if best_end == End::GaveUp && !stopped {
        // Nothing beats an attempt that was abandoned: finish it.
        let (point, end, _) = problem.descend(best, f64::INFINITY, &mut report.iterations, go_on);
        best = point;
        best_end = end;
    }
    q.copy_from_slice(&best.q[..dof]);
    report.position_error_m = best.position_error;
    report.rotation_error_rad = best.rotation_error;
    report.reason = match best_end {
        End::Reached => IkReason::Reached,
        End::Stationary { at_limit: true } => IkReason::JointLimit,
        End::Stationary { at_limit: false } => IkReason::OutOfReach,
        End::GaveUp => IkReason::Budget,
    };
    report
}

impl Problem<'_> {
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    fn evaluate<const N: usize>(&self, q: [f64; N]) -> Point<N> {
        let mut columns = [[0.0; 6]; N];
        let tip = self.chain.tip_frame_and_jacobian_here(&q[..self.dof], columns[..self.dof].as_flattened_mut());
        let linear = self.target_position - tip.position();
        let angular = if self.rho > 0.0 {
            rotation_vector(&(self.target_rotation * tip.rotation().transpose()))
        } else {
            Vector3::zeros()
        };
        let cost = linear.norm_squared() + self.rho * self.rho * angular.norm_squared();
        Point {
            q,
            columns,
            error: [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z],
            position_error: linear.norm(),
            rotation_error: angular.norm(),
            cost,
        }
    }

    /// The best of some random poses within the limits. Looking costs a tenth of a step, a wrong start ten steps.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    fn promising_pose<const N: usize>(&self, random: &mut SplitMix) -> [f64; N] {
        let (mut best, mut least) = ([0.0; N], f64::INFINITY);
        for _ in 0..LOOKS_PER_RESTART {
            let mut q = [0.0; N];
            for (value, limits) in q.iter_mut().zip(self.chain.limits()) {
                let (lower, upper) = finite_range(limits.lower, limits.upper);
                *value = lower + (upper - lower) * random.unit();
            }
            let tip = self.chain.tip_frame_here(&q[..self.dof]);
            let off = (self.target_position - tip.position()).norm_squared();
            // |R_1 - R_2|^2 = 4 (1 - cos t) orders rotations as their angle does.
            let turned = (self.target_rotation - tip.rotation()).norm_squared() / 2.0;
            let cost = off + self.rho * self.rho * turned;
            if cost < least {
                (best, least) = (q, cost);
            }
        }
        best
    }

    fn reached<const N: usize>(&self, point: &Point<N>) -> bool {
        point.position_error <= self.options.position_tolerance_m
            && point.rotation_error <= self.options.rotation_tolerance_rad
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    /// `H` and the curvature of the motion, lower half. Exact for chains whose stages are their joints, an
    /// approximation with mimic joints (which costs steps, not correctness).
    fn exact_hessian<const N: usize>(&self, gauss_newton: &[[f64; N]; N], point: &Point<N>) -> [[f64; N]; N] {
        let mut exact = *gauss_newton;
        let part = |column: &[f64; 6], from: usize| Vector3::new(column[from], column[from + 1], column[from + 2]);
        let linear_error = part(&point.error, 0);
        let angular_error = part(&point.error, 3);
        let angle2 = angular_error.norm_squared();
        let half = 0.5 * angle2.sqrt();
        let c = if angle2 < 1e-6 { 1.0 / 12.0 } else { (1.0 - half / half.tan()) / angle2 };
        let rho2 = self.rho * self.rho;
        for later in 0..self.dof {
            let linear = part(&point.columns[later], 0);
            let axis = part(&point.columns[later], 3);
            let turned = linear.cross(&linear_error);
            let once = angular_error.cross(&axis);
            let twice = angular_error.cross(&once);
            for earlier in 0..=later {
                let other = part(&point.columns[earlier], 3);
                // e . (z_i x v_j) = z_i . (v_j x e)
                exact[later][earlier] -= other.dot(&turned);
                let first_order = if earlier == later { 0.0 } else { 0.5 * other.dot(&once) };
                exact[later][earlier] += rho2 * (first_order + c * other.dot(&twice));
            }
        }
        exact
    }

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    fn descend<const N: usize>(
        &self,
        start: Point<N>,
        patience: f64,
        iterations: &mut u32,
        go_on: &mut dyn FnMut() -> bool,
    ) -> (Point<N>, End, bool) {
        let limits = self.chain.limits();
        let weights = [1.0, 1.0, 1.0, self.rho * self.rho, self.rho * self.rho, self.rho * self.rho];
        let mut point = start;
        let mut lambda = 1e-4;
        let mut growth = 2.0;
        // Far from the target the curvature of the motion itself matters more than H knows.
        let mut curved = false;
        let mut milestone = point.cost;
        for step in 1..=STEPS_PER_ATTEMPT {
            if step % STEPS_PER_MILESTONE == 0 {
                if point.cost > patience && point.cost > 0.25 * milestone {
                    return (point, End::GaveUp, false);
                }
                milestone = point.cost;
            }
            if self.reached(&point) {
                return (point, End::Reached, false);
            }
            if *iterations >= self.options.iterations || !go_on() {
                return (point, End::GaveUp, true);
            }
            *iterations += 1;
            let mut gradient = [0.0; N];
            let mut hessian = [[0.0; N]; N];
            let mut held = [false; N];
            let mut at_limit = false;
            let mut downhill = 0.0f64;
            for i in 0..self.dof {
                let weighted: [f64; 6] = std::array::from_fn(|r| weights[r] * point.columns[i][r]);
                gradient[i] = (0..6).map(|r| weighted[r] * point.error[r]).sum();
                for j in 0..=i {
                    hessian[i][j] = (0..6).map(|r| weighted[r] * point.columns[j][r]).sum();
                }
                held[i] = (point.q[i] <= limits[i].lower && gradient[i] < 0.0)
                    || (point.q[i] >= limits[i].upper && gradient[i] > 0.0);
                at_limit |= held[i];
                if !held[i] {
                    // How much of the distance this joint's direction still sees.
                    downhill = downhill.max(gradient[i].abs() / (hessian[i][i].sqrt() + 1e-12));
                }
            }
            if downhill <= STATIONARY * point.cost.sqrt() {
                return (point, End::Stationary { at_limit }, false);
            }
            let mut step = None;
            if curved {
                let exact = self.exact_hessian(&hessian, &point);
                step = damped_step(&exact, &hessian, &gradient, &held, lambda, self.dof);
                if step.is_some() {
                    hessian = exact;
                }
            }
            let Some(step) = step.or_else(|| damped_step(&hessian, &hessian, &gradient, &held, lambda, self.dof))
            else {
                return (point, End::GaveUp, false);
            };
            let mut q = point.q;
            let mut predicted = 0.0;
            let mut moved = 0.0f64;
            for i in 0..self.dof {
                q[i] = (q[i] + step[i]).clamp(limits[i].lower, limits[i].upper);
                moved = moved.max((q[i] - point.q[i]).abs());
            }
            for i in 0..self.dof {
                let s = q[i] - point.q[i];
                predicted += 2.0 * gradient[i] * s - hessian[i][i] * s * s;
                for j in 0..i {
                    predicted -= 2.0 * hessian[i][j] * s * (q[j] - point.q[j]);
                }
            }
            let next = self.evaluate(q);
            let gain = (point.cost - next.cost) / predicted.max(f64::MIN_POSITIVE);
            if next.cost < point.cost {
                curved = next.cost > 0.5 * point.cost;
                point = next;
                let shrink = 1.0 - (2.0 * gain.min(2.0) - 1.0).powi(3);
                lambda = (lambda * shrink.max(0.1)).max(1e-12);
                growth = 2.0;
            } else {
                lambda = (lambda * growth).max(1e-9);
                growth *= 2.0;
            }
            if moved <= 1e-14 || lambda > 1e12 {
                let end = if self.reached(&point) { End::Reached } else { End::Stationary { at_limit } };
                return (point, end, false);
            }
        }
        let end = if self.reached(&point) { End::Reached } else { End::GaveUp };
        (point, end, false)
    }
}

/// An attempt has found a nearest pose when no joint sees more than this part of the remaining distance: the error
/// stands at right angles to everything that can move, to within this angle (rad).
const STATIONARY: f64 = 1e-7;

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
/// Solves `(H + lambda D) s = g` over the joints that are not held, by Cholesky; `None` where the matrix is not
/// positive definite. Only the lower half of `H` is read; `D` is the floored diagonal of `scale`.
fn damped_step<const N: usize>(
    hessian: &[[f64; N]; N],
    scale: &[[f64; N]; N],
    gradient: &[f64; N],
    held: &[bool; N],
    lambda: f64,
    dof: usize,
) -> Option<[f64; N]> {
    let mut factor = [[0.0; N]; N];
    let mut inverse_diagonal = [0.0; N];
    let mut step = [0.0; N];
    let mut trace = 0.0;
    for i in 0..dof {
        trace += scale[i][i];
    }
    // A joint that does nothing here must not take an endless step.
    let floor = 1e-3 * trace / dof as f64 + 1e-300;
    for i in 0..dof {
        if held[i] {
            continue;
        }
        let mut right = gradient[i];
        for j in 0..i {
            if held[j] {
                continue;
            }
            let mut sum = hessian[i][j];
            for k in 0..j {
                sum -= factor[i][k] * factor[j][k];
            }
            factor[i][j] = sum * inverse_diagonal[j];
            right -= factor[i][j] * step[j];
        }
        let mut diagonal = hessian[i][i] + lambda * scale[i][i].max(floor);
        for k in 0..i {
            diagonal -= factor[i][k] * factor[i][k];
        }
        if !(diagonal > 1e-12 * floor) {
            return None;
        }
        inverse_diagonal[i] = 1.0 / diagonal.sqrt();
        step[i] = right * inverse_diagonal[i];
    }
    for i in (0..dof).rev() {
        let mut right = step[i];
        for k in i + 1..dof {
            right -= factor[k][i] * step[k];
        }
        step[i] = right * inverse_diagonal[i];
    }
    Some(step)
}

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
/// The rotation vector of a rotation matrix, length in [0, pi].
fn rotation_vector(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let quaternion = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation));
    let imaginary = quaternion.imag();
    let sine = imaginary.norm();
    let cosine = quaternion.w;
    if sine < 1e-12 {
        return 2.0 * imaginary * cosine.signum();
    }
    // Of the two quaternions of a rotation take the one of the shorter turn.
    let half = if cosine < 0.0 { (-sine).atan2(-cosine) } else { sine.atan2(cosine) };
    imaginary * (2.0 * half / sine)
}

fn finite_range(lower: f64, upper: f64) -> (f64, f64) {
    (lower.max(-std::f64::consts::PI), upper.min(std::f64::consts::PI))
}

fn middle(lower: f64, upper: f64) -> f64 {
    let (lower, upper) = finite_range(lower, upper);
    f64::midpoint(lower, upper)
}

/// A small generator for restart poses (Steele, Lea and Flood 2014).
struct SplitMix(u64);

impl SplitMix {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / 9_007_199_254_740_992.0
    }
}
