//! Angles, and quaternions `(w, x, y, z)` with their rotation vectors.

use std::f64::consts::{PI, TAU};

use crate::error::{Error, Result};

/// The angle in `(-pi, pi]` that differs from `angle_rad` by whole turns.
///
/// ```
/// assert!((gmr_core::wrap_rad(3.5) + 2.783_185_307_179_586).abs() < 1e-15);
/// ```
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let turned = angle_rad - TAU * (angle_rad / TAU).round();
    if turned <= -PI { turned + TAU } else { turned }
}

/// Adds whole turns so that no step exceeds half a turn.
///
/// ```
/// let mut angles = [3.0, -3.0];
/// gmr_core::unwrap_rad(&mut angles);
/// assert!((angles[1] - 3.283_185_307_179_586).abs() < 1e-15);
/// ```
pub fn unwrap_rad(angles_rad: &mut [f64]) {
    for i in 1..angles_rad.len() {
        let previous = angles_rad[i - 1];
        angles_rad[i] = previous + wrap_rad(angles_rad[i] - previous);
    }
}

/// Product of two quaternions `(w, x, y, z)`.
pub(super) fn multiply(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

pub(super) fn conjugate(q: [f64; 4]) -> [f64; 4] {
    [q[0], -q[1], -q[2], -q[3]]
}

/// Rotation vector of a unit quaternion, of length at most pi.
pub(super) fn logarithm(q: [f64; 4]) -> [f64; 3] {
    let sign = if q[0] < 0.0 { -1.0 } else { 1.0 };
    let (w, v) = (sign * q[0], [sign * q[1], sign * q[2], sign * q[3]]);
    let sine = v[0].hypot(v[1]).hypot(v[2]);
    // angle / sin(angle / 2), with its limit 2 where the quotient loses meaning.
    let factor = if sine < 1e-150 { 2.0 } else { 2.0 * sine.atan2(w) / sine };
    v.map(|x| factor * x)
}

/// Unit quaternion of a rotation vector.
pub(super) fn exponential(v: [f64; 3]) -> [f64; 4] {
    let angle = v[0].hypot(v[1]).hypot(v[2]);
    let half = 0.5 * angle;
    let factor = if angle < 1e-150 { 0.5 } else { half.sin() / angle };
    [half.cos(), factor * v[0], factor * v[1], factor * v[2]]
}

/// The rotation vector of the same rotation that lies nearest to `near`.
pub(super) fn continued(v: [f64; 3], near: [f64; 3]) -> [f64; 3] {
    let angle = v[0].hypot(v[1]).hypot(v[2]);
    if angle < 1e-12 {
        // Near the identity every axis will do: take the one that was being turned about.
        let length = near[0].hypot(near[1]).hypot(near[2]);
        let turns = (length / TAU).round();
        return if turns > 0.0 { std::array::from_fn(|i| v[i] + near[i] / length * turns * TAU) } else { v };
    }
    let along: f64 = (0..3).map(|i| v[i] * near[i]).sum::<f64>() / angle;
    let turns = ((along - angle) / TAU).round();
    v.map(|x| x * (1.0 + turns * TAU / angle))
}

pub(super) fn unit(q: &[f64]) -> Result<[f64; 4]> {
    let length = q[0].hypot(q[1]).hypot(q[2].hypot(q[3]));
    if !((length - 1.0).abs() <= 1e-3) {
        return Err(Error::InvalidParameter { name: "quaternion length", allowed: "1 within 0.001", value: length });
    }
    // What has length one to rounding keeps its bits, so that a stored centre comes back as it was.
    let length = if (length - 1.0).abs() <= 4.0 * f64::EPSILON { 1.0 } else { length };
    Ok(std::array::from_fn(|i| q[i] / length))
}

pub(super) fn mean_rotation(all: &[[f64; 4]]) -> [f64; 4] {
    let mut mean = all[0];
    // Each step contracts by the square of the spread; twenty settle anything within a half turn.
    for _ in 0..20 {
        let mut step = [0.0; 3];
        for q in all {
            for (s, v) in step.iter_mut().zip(logarithm(multiply(conjugate(mean), *q))) {
                *s += v / all.len() as f64;
            }
        }
        mean = multiply(mean, exponential(step));
        if step.iter().all(|s| s.abs() < 1e-14) {
            break;
        }
    }
    mean
}
