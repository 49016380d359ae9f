//! Attempts from many starts, each by Levenberg-Marquardt within box limits.
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
//! which converges at the edge of the workspace, where `J` loses rank. Joints at a limit that would move out of it are held.
//! `lambda` follows the gain ratio (Nielsen 1999). An attempt ends when the target is reached, when the free part of the
//! gradient vanishes (a nearest pose), or when it stops making progress.
//!
//! The first attempt starts from the seed, the next ones from those poses of the chain's table ([`Starts`]) that are
//! nearest to the target, the others from random poses.

use nalgebra::Isometry3;
use pulp::{Simd, WithSimd};

use super::descent::End;
use super::problem::{Point, Problem};
use super::starts::Near;
use super::{IkOptions, IkReason, IkReport};
use crate::Chain;

/// Attempts after which none is abandoned any more.
const ATTEMPTS_IN_HASTE: u32 = 30;

/// Attempts from the table of starts.
const ATTEMPTS_FROM_TABLE: u32 = 16;

/// Random poses looked at per restart.
const LOOKS_PER_RESTART: u32 = 8;

/// Solves on the best instruction set of this machine. `D` joints at most, in `L >= D` lanes.
pub(super) fn solve<const D: usize, const L: usize>(
    chain: &Chain,
    base_from_target: &Isometry3<f64>,
    options: &IkOptions,
    q: &mut [f64],
    go_on: &mut dyn FnMut() -> bool,
) -> IkReport {
    let problem = Problem::new(chain, base_from_target, options);
    chain.machine.run(Solve::<D, L> { problem, q, go_on })
}

struct Solve<'a, const D: usize, const L: usize> {
    problem: Problem<'a>,
    q: &'a mut [f64],
    go_on: &'a mut dyn FnMut() -> bool,
}

impl<const D: usize, const L: usize> WithSimd for Solve<'_, D, L> {
    type Output = IkReport;

    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set it is dispatched to")]
    fn with_simd<S: Simd>(self, _: S) -> IkReport {
        solve_here::<D, L>(&self.problem, self.q, self.go_on)
    }
}

#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn solve_here<const D: usize, const L: usize>(
    problem: &Problem,
    q: &mut [f64],
    go_on: &mut dyn FnMut() -> bool,
) -> IkReport {
    let (chain, options) = (problem.chain, problem.options);
    let dof = q.len();
    let mut seed = [0.0; D];
    seed[..dof].copy_from_slice(q);
    for (value, limits) in seed.iter_mut().zip(chain.limits()) {
        // A seed that is no number is no seed.
        *value = if value.is_finite() {
            value.clamp(limits.lower, limits.upper)
        } else {
            let (lower, upper) = limits.finite_range();
            f64::midpoint(lower, upper)
        };
    }
    let mut report = IkReport {
        reason: IkReason::BadTarget,
        position_error_m: f64::INFINITY,
        rotation_error_rad: f64::INFINITY,
        iterations: 0,
        attempts: 0,
        from_seed: true,
    };
    let mut near: Option<Near> = None;
    let mut random = SplitMix(options.random_seed);
    let mut best: Option<(Point<D, L>, End)> = None;
    let mut stopped = false;
    let mut finishing = false;
    loop {
        let begin = match &best {
            None => seed,
            Some((_, End::Reached)) => break,
            Some(_) if stopped || finishing => break,
            Some((point, end)) if report.attempts > options.restarts || report.iterations >= options.iterations => {
                // Nothing beats an attempt that was abandoned: finish it.
                if *end != End::GaveUp {
                    break;
                }
                finishing = true;
                point.q
            }
            Some(_) if report.attempts <= ATTEMPTS_FROM_TABLE => {
                let near = match &mut near {
                    Some(near) => near,
                    none => none.insert(chain.starts.near(problem)),
                };
                let mut q = [0.0; D];
                chain.starts.take(near, &mut q[..dof]);
                q
            }
            Some(_) => problem.promising_pose(&mut random),
        };
        let start: Point<D, L> = problem.evaluate(begin);
        if !start.cost.is_finite() {
            return report;
        }
        report.attempts += u32::from(!finishing);
        let patience = match &best {
            None if options.restarts > 0 => 0.0,
            // After so many the target is likely out of reach, and what counts is the nearest pose.
            Some((best, _)) if !finishing && report.attempts <= ATTEMPTS_IN_HASTE => best.cost,
            _ => f64::INFINITY,
        };
        let (point, end, ended) = problem.descend(start, patience, &mut report.iterations, go_on);
        stopped = ended;
        if best.as_ref().is_none_or(|(best, _)| finishing || end == End::Reached || point.cost < best.cost) {
            report.from_seed = best.is_none() || finishing && report.from_seed;
            best = Some((point, end));
        }
    }
    let Some((best, best_end)) = best else {
        return report;
    };
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
    /// The best of some random poses within the limits. Looking costs a tenth of a step, a wrong start ten steps.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    fn promising_pose<const D: usize>(&self, random: &mut SplitMix) -> [f64; D] {
        let (mut best, mut least) = ([0.0; D], f64::INFINITY);
        for _ in 0..LOOKS_PER_RESTART {
            let mut q = [0.0; D];
            for (value, limits) in q.iter_mut().zip(self.chain.limits()) {
                let (lower, upper) = limits.finite_range();
                *value = lower + (upper - lower) * random.unit();
            }
            let tip = self.chain.tip_frame_here(&q[..self.chain.dof()]);
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
