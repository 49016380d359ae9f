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

/// BFGS (Nocedal and Wright 2006, algorithm 6.1) with central differences and a backtracking
/// line search. Stops when the gradient falls below `tolerance` or no step lowers the value.
pub(super) fn minimise(
    start: &[f64],
    max_iterations: usize,
    tolerance: f64,
    mut f: impl FnMut(&[f64]) -> f64,
) -> Minimum {
    let n = start.len();
    let mut x = start.to_vec();
    let mut value = f(&x);
    let mut gradient = vec![0.0; n];
    differentiate(&mut x, &mut gradient, &mut f);
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
            lower = f(&trial);
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
        differentiate(&mut trial, &mut next_gradient, &mut f);
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

fn differentiate(x: &mut [f64], gradient: &mut [f64], f: &mut impl FnMut(&[f64]) -> f64) {
    for i in 0..x.len() {
        let (at, h) = (x[i], STEP * x[i].abs().max(1.0));
        x[i] = at + h;
        let up = f(x);
        x[i] = at - h;
        let down = f(x);
        x[i] = at;
        gradient[i] = (up - down) / (2.0 * h);
    }
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

    #[test]
    fn finds_the_minimum_of_the_rosenbrock_valley() {
        let minimum =
            minimise(&[-1.2, 1.0], 200, 1e-8, |x| 100.0 * (x[1] - x[0] * x[0]).powi(2) + (1.0 - x[0]).powi(2));
        assert!((minimum.x[0] - 1.0).abs() < 1e-5 && (minimum.x[1] - 1.0).abs() < 1e-5, "{minimum:?}");
    }
}
