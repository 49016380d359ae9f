//! One attempt: Levenberg-Marquardt within box limits from one start.

use super::problem::{Point, Problem};

/// Steps of one attempt. A hopeless attempt is cheaper to abandon than to finish.
const STEPS_PER_ATTEMPT: u32 = 60;

/// An attempt whose distance has not halved within so many steps is abandoned, unless it is the best one known or no other
/// may follow.
const STEPS_PER_MILESTONE: u32 = 6;

/// An attempt has found a nearest pose when no joint sees more than this part of the remaining distance: the error
/// stands at right angles to everything that can move, to within this angle (rad).
const STATIONARY: f64 = 1e-7;

#[derive(Clone, Copy, PartialEq)]
pub(super) enum End {
    Reached,
    Stationary { at_limit: bool },
    GaveUp,
}

impl Problem<'_> {
    /// The end of the way down from a start, how it ended, and whether the search must stop there. Given up when
    /// progress is slow and the distance squared above `patience`.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
    pub(super) fn descend<const D: usize, const L: usize>(
        &self,
        start: Point<D, L>,
        patience: f64,
        iterations: &mut u32,
        go_on: &mut dyn FnMut() -> bool,
    ) -> (Point<D, L>, End, bool) {
        let dof = self.chain.dof();
        let (mut lower, mut upper) = ([0.0; D], [0.0; D]);
        for ((lower, upper), limits) in lower.iter_mut().zip(&mut upper).zip(self.chain.limits()) {
            (*lower, *upper) = (limits.lower, limits.upper);
        }
        let rho2 = self.rho * self.rho;
        let weights = [1.0, 1.0, 1.0, rho2, rho2, rho2];
        let mut point = start;
        // Far away a bold step overshoots; near by nothing should hold it back.
        let mut lambda = point.cost.clamp(1e-8, 1e-2);
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
            let mut gradient = [0.0; L];
            for r in 0..6 {
                let weighted = weights[r] * point.error[r];
                for j in 0..L {
                    gradient[j] += weighted * point.rows[r][j];
                }
            }
            let mut free = [0.0; L];
            let mut at_limit = false;
            for i in 0..D {
                let held =
                    (point.q[i] <= lower[i] && gradient[i] < 0.0) || (point.q[i] >= upper[i] && gradient[i] > 0.0);
                at_limit |= held;
                free[i] = f64::from(u8::from(!held && (D == dof || i < dof)));
            }
            // Joints that are held move nothing.
            let mut rows = point.rows;
            for row in &mut rows {
                for j in 0..L {
                    row[j] *= free[j];
                }
            }
            let mut hessian = [[0.0; L]; D];
            for i in 0..D {
                for r in 0..6 {
                    let weighted = weights[r] * rows[r][i];
                    for j in 0..L {
                        hessian[i][j] += weighted * rows[r][j];
                    }
                }
            }
            // How much of the distance the direction of a joint still sees.
            let unseen = STATIONARY * STATIONARY * point.cost;
            let mut stationary = true;
            for i in 0..D {
                gradient[i] *= free[i];
                stationary &= gradient[i] * gradient[i] <= unseen * (hessian[i][i] + 1e-24);
            }
            if stationary {
                return (point, End::Stationary { at_limit }, false);
            }
            let scale: [f64; D] = std::array::from_fn(|i| hessian[i][i]);
            let mut step = None;
            if curved {
                let exact = self.exact_hessian(&hessian, &point, &rows);
                step = damped_step(&exact, &scale, &gradient, &free, lambda, dof);
                if step.is_some() {
                    hessian = exact;
                }
            }
            let step = match step {
                Some(step) => step,
                None => match damped_step(&hessian, &scale, &gradient, &free, lambda, dof) {
                    Some(step) => step,
                    None => return (point, End::GaveUp, false),
                },
            };
            let mut q = point.q;
            let mut moved = 0.0f64;
            let mut gone = [0.0; D];
            for i in 0..D {
                q[i] = (q[i] + step[i]).max(lower[i]).min(upper[i]);
                gone[i] = q[i] - point.q[i];
                moved = moved.max(gone[i].abs());
            }
            let mut predicted = 0.0;
            for i in 0..D {
                let mut slope = 2.0 * gradient[i] - hessian[i][i] * gone[i];
                for j in 0..i {
                    slope -= 2.0 * hessian[i][j] * gone[j];
                }
                predicted += slope * gone[i];
            }
            let next = self.evaluate(q);
            let gain = (point.cost - next.cost) / predicted.max(f64::MIN_POSITIVE);
            if next.cost < point.cost {
                curved = next.cost > 0.5 * point.cost;
                point = next;
                let off = 2.0 * gain.min(2.0) - 1.0;
                let shrink = 1.0 - off * off * off;
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

/// Solves `(H + lambda D) s = g` over the free joints by `L D L^T`; `None` where the matrix is not positive definite. Only
/// the lower half of `H` is read, whose rows and columns of held joints are zero; `D` is the floored `scale`.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must take on the instruction set of its caller")]
fn damped_step<const D: usize, const L: usize>(
    hessian: &[[f64; L]; D],
    scale: &[f64; D],
    gradient: &[f64; L],
    free: &[f64; L],
    lambda: f64,
    dof: usize,
) -> Option<[f64; D]> {
    // A joint that does nothing here must not take an endless step.
    let floor = 1e-3 * scale.iter().sum::<f64>() / dof as f64 + 1e-300;
    let mut factor = [[0.0; D]; D];
    let mut inverse = [0.0; D];
    let mut step = [0.0; D];
    let mut definite = true;
    for i in 0..D {
        let mut scaled = [0.0; D];
        let mut right = gradient[i];
        let mut diagonal = hessian[i][i] + lambda * scale[i].max(floor);
        for j in 0..i {
            let mut sum = hessian[i][j];
            for k in 0..j {
                sum -= scaled[k] * factor[j][k];
            }
            scaled[j] = sum;
            factor[i][j] = sum * inverse[j];
            diagonal -= sum * factor[i][j];
            right -= factor[i][j] * step[j];
        }
        diagonal = if free[i] > 0.0 { diagonal } else { 1.0 };
        definite &= diagonal > 1e-12 * floor;
        inverse[i] = 1.0 / diagonal;
        step[i] = right;
    }
    if !definite {
        return None;
    }
    for i in (0..D).rev() {
        let mut right = step[i] * inverse[i];
        for k in i + 1..D {
            right -= factor[k][i] * step[k];
        }
        step[i] = right;
    }
    Some(step)
}
