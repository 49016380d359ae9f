//! A small quasi-Newton minimiser for smooth functions of a few unconstrained numbers.

/// A minimum.
#[derive(Debug, Clone)]
pub(super) struct Minimum {
    pub(super) x: Vec<f64>,
    pub(super) value: f64,
    pub(super) iterations: usize,
    /// Largest component of the gradient.
    pub(super) gradient: f64,
}

/// Relative step of the central differences: near the cube root of the rounding error, where
/// truncation and rounding balance.
const STEP: f64 = 6e-6;

/// Points about which a function is known: one, and each of its coordinates a step up and a step down.
struct Stencil {
    n: usize,
    /// `(1 + 2 n, n)`.
    points: Vec<f64>,
    values: Vec<f64>,
}

impl Stencil {
    fn new(n: usize) -> Self {
        Self { n, points: vec![0.0; (1 + 2 * n) * n], values: vec![0.0; 1 + 2 * n] }
    }

    fn step(x: f64) -> f64 {
        STEP * x.abs().max(1.0)
    }

    fn place(&mut self, x: &[f64]) {
        for point in self.points.chunks_exact_mut(self.n.max(1)) {
            point.copy_from_slice(x);
        }
        for (i, &at) in x.iter().enumerate() {
            self.points[(1 + 2 * i) * self.n + i] = at + Self::step(at);
            self.points[(2 + 2 * i) * self.n + i] = at - Self::step(at);
        }
    }

    /// The value at the middle.
    fn middle(&mut self, f: &mut impl FnMut(&[f64], &mut [f64])) -> f64 {
        f(&self.points[..self.n], &mut self.values[..1]);
        self.values[0]
    }

    /// The values around the middle.
    fn around(&mut self, f: &mut impl FnMut(&[f64], &mut [f64])) {
        f(&self.points[self.n..], &mut self.values[1..]);
    }

    /// Both in one call.
    fn all(&mut self, f: &mut impl FnMut(&[f64], &mut [f64])) -> f64 {
        f(&self.points, &mut self.values);
        self.values[0]
    }

    fn gradient(&self, gradient: &mut [f64]) {
        for (i, (g, ends)) in gradient.iter_mut().zip(self.values[1..].chunks_exact(2)).enumerate() {
            *g = (ends[0] - ends[1]) / (2.0 * Self::step(self.points[i]));
        }
    }
}

/// BFGS (Nocedal and Wright 2006, algorithm 6.1) with central differences and a backtracking
/// line search. Stops when the gradient falls below `tolerance` or no step lowers the value.
///
/// `f` takes points, one after the other, and writes the value of each. Up to `at_once` points cost it about as much as
/// one; where a point and all its neighbours are no more than that, they are asked for together.
pub(super) fn minimise(
    start: &[f64],
    max_iterations: usize,
    tolerance: f64,
    at_once: usize,
    mut f: impl FnMut(&[f64], &mut [f64]),
) -> Minimum {
    let n = start.len();
    let mut x = start.to_vec();
    let mut stencil = Stencil::new(n);
    let together = stencil.values.len() <= at_once;
    stencil.place(&x);
    let mut value = stencil.all(&mut f);
    let mut gradient = vec![0.0; n];
    stencil.gradient(&mut gradient);
    let mut inverse = identity(n);
    let mut fresh = true;
    let mut iterations = 0;
    let mut trial = vec![0.0; n];
    let mut next_gradient = vec![0.0; n];
    while iterations < max_iterations && largest(&gradient) > tolerance && value.is_finite() {
        iterations += 1;
        let mut direction: Vec<f64> =
            inverse.chunks_exact(n).map(|row| -row.iter().zip(&gradient).map(|(a, b)| a * b).sum::<f64>()).collect();
        let mut slope: f64 = direction.iter().zip(&gradient).map(|(a, b)| a * b).sum();
        if !(slope < 0.0) {
            inverse = identity(n);
            fresh = true;
            direction = gradient.iter().map(|g| -g).collect();
            slope = -gradient.iter().map(|g| g * g).sum::<f64>();
        }
        // One unit of an unconstrained number moves a partial autocorrelation a long way.
        let length = largest(&direction);
        let mut step = if fresh { (0.5 / length).min(1.0) } else { (2.0 / length).min(1.0) };
        let mut lower = f64::INFINITY;
        for _ in 0..30 {
            for ((t, x), d) in trial.iter_mut().zip(&x).zip(&direction) {
                *t = step.mul_add(*d, *x);
            }
            stencil.place(&trial);
            lower = if together { stencil.all(&mut f) } else { stencil.middle(&mut f) };
            if lower <= value + 1e-4 * step * slope {
                break;
            }
            // Minimum of the parabola through what is known, kept within [0.1, 0.5].
            let curvature = lower - value - step * slope;
            let ratio = if curvature > 0.0 { -0.5 * slope * step / curvature } else { 0.5 };
            step *= if ratio.is_finite() { ratio.clamp(0.1, 0.5) } else { 0.1 };
        }
        if !(lower < value) {
            if fresh {
                break;
            }
            inverse = identity(n);
            fresh = true;
            continue;
        }
        if !together {
            stencil.around(&mut f);
        }
        stencil.gradient(&mut next_gradient);
        let s: Vec<f64> = trial.iter().zip(&x).map(|(a, b)| a - b).collect();
        let y: Vec<f64> = next_gradient.iter().zip(&gradient).map(|(a, b)| a - b).collect();
        let sy: f64 = s.iter().zip(&y).map(|(a, b)| a * b).sum();
        let yy: f64 = y.iter().map(|v| v * v).sum();
        let gain = value - lower;
        x.copy_from_slice(&trial);
        gradient.copy_from_slice(&next_gradient);
        value = lower;
        if sy > 1e-12 * yy {
            if fresh {
                let scale = sy / yy;
                inverse.iter_mut().for_each(|v| *v *= scale);
                fresh = false;
            }
            update(&mut inverse, &s, &y, sy);
        }
        if gain <= 1e-13 * (1.0 + value.abs()) && !fresh {
            break;
        }
    }
    Minimum { x, value, iterations, gradient: largest(&gradient) }
}

fn identity(n: usize) -> Vec<f64> {
    (0..n * n).map(|i| if i % (n + 1) == 0 { 1.0 } else { 0.0 }).collect()
}

fn largest(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |m: f64, g| m.max(g.abs()))
}

/// `H <- (I - s y'/sy) H (I - y s'/sy) + s s'/sy`.
fn update(h: &mut [f64], s: &[f64], y: &[f64], sy: f64) {
    let n = s.len();
    let hy: Vec<f64> = h.chunks_exact(n).map(|row| row.iter().zip(y).map(|(a, b)| a * b).sum()).collect();
    let yhy: f64 = hy.iter().zip(y).map(|(a, b)| a * b).sum();
    for i in 0..n {
        for j in 0..n {
            h[i * n + j] += (sy + yhy) * s[i] * s[j] / (sy * sy) - (hy[i] * s[j] + s[i] * hy[j]) / sy;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_by_one(start: &[f64], max_iterations: usize, tolerance: f64, mut f: impl FnMut(&[f64]) -> f64) -> Minimum {
        minimise(start, max_iterations, tolerance, 8, |points, values| {
            for (x, value) in points.chunks_exact(start.len()).zip(values) {
                *value = f(x);
            }
        })
    }

    #[test]
    fn finds_the_minimum_of_the_rosenbrock_valley() {
        for at_once in [1, 8] {
            let minimum = minimise(&[-1.2, 1.0], 200, 1e-8, at_once, |points, values| {
                for (x, value) in points.chunks_exact(2).zip(values) {
                    *value = 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2);
                }
            });
            assert!((minimum.x[0] - 1.0).abs() < 1e-5 && (minimum.x[1] - 1.0).abs() < 1e-5, "{minimum:?}");
            assert!(minimum.gradient < 1e-6 && minimum.iterations < 100, "{minimum:?}");
        }
    }

    #[test]
    fn the_limit_the_tolerance_and_an_infinite_start_end_the_search() {
        let bowl = |x: &[f64]| x.iter().enumerate().map(|(i, v)| (i as f64 + 1.0) * (v - 2.0).powi(4)).sum::<f64>();
        let cut = one_by_one(&[9.0, -9.0], 3, 1e-12, bowl);
        assert!(cut.iterations == 3 && cut.gradient > 1e-12, "{cut:?}");
        // A loose tolerance stops sooner, at a gradient within it.
        let (loose, tight) = (one_by_one(&[9.0, -9.0], 500, 1.0, bowl), one_by_one(&[9.0, -9.0], 500, 1e-9, bowl));
        assert!(loose.gradient <= 1.0 && loose.iterations < tight.iterations, "{loose:?} {tight:?}");
        assert!(tight.value < 1e-9 && tight.value <= loose.value, "{tight:?}");
        assert_eq!(one_by_one(&[9.0], 500, 1e-9, |_| f64::INFINITY).iterations, 0);
    }

    #[test]
    fn walls_and_ridges_are_gone_around_and_no_step_climbs() {
        // Infinite beyond 3, a kink at 1, and steep on one side: the best value seen is the one returned.
        let mut seen = f64::INFINITY;
        let found = one_by_one(&[-2.0], 200, 1e-9, |x| {
            let value = if x[0] > 3.0 { f64::INFINITY } else { (x[0] - 1.0).abs() + (0.1 * x[0]).exp() };
            seen = seen.min(value);
            value
        });
        assert!((found.x[0] - 1.0).abs() < 1e-3, "{found:?}");
        // Central differences look beside the point, never farther below it than a step of theirs.
        assert!(found.value - seen < 1e-5, "{found:?} {seen}");
        // A saddle to begin with: curvature is negative there.
        let saddle = one_by_one(&[0.1, 0.1], 300, 1e-8, |x| x[0].powi(4) - 2.0 * x[0] * x[0] + x[1] * x[1]);
        assert!((saddle.x[0].abs() - 1.0).abs() < 1e-4 && saddle.x[1].abs() < 1e-4, "{saddle:?}");
    }
}
