//! Rotations about one axis that satisfy one equation.

use nalgebra::{Matrix3, Vector3};

/// How far beyond its largest value a cosine may lie and still count as that value: rounding of a stretched arm.
const SLACK: f64 = 1e-9;
/// Vectors shorter than this (relative to those they came from) have no direction.
const VANISHING: f64 = 1e-8;

/// None, one or two angles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Roots {
    count: usize,
    values: [f64; 2],
}

impl Roots {
    const NONE: Self = Self { count: 0, values: [0.0; 2] };

    pub(super) fn as_slice(&self) -> &[f64] {
        &self.values[..self.count]
    }

    /// Angles where `amplitude * cos(angle - phase) = value`.
    fn of_cosine(phase: f64, amplitude: f64, value: f64) -> Self {
        if !(amplitude > 0.0) {
            return Self::NONE;
        }
        let cosine = value / amplitude;
        if !(cosine.abs() <= 1.0 + SLACK) {
            return Self::NONE;
        }
        let spread = cosine.clamp(-1.0, 1.0).acos();
        if cosine.abs() >= 1.0 {
            return Self { count: 1, values: [phase + spread; 2] };
        }
        Self { count: 2, values: [phase + spread, phase - spread] }
    }
}

/// Rotation by an angle about a unit axis (Rodrigues).
pub(super) fn axis_angle(k: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    let v = 1.0 - c;
    Matrix3::new(
        c + k.x * k.x * v,
        k.x * k.y * v - k.z * s,
        k.x * k.z * v + k.y * s,
        k.y * k.x * v + k.z * s,
        c + k.y * k.y * v,
        k.y * k.z * v - k.x * s,
        k.z * k.x * v - k.y * s,
        k.z * k.y * v + k.x * s,
        c + k.z * k.z * v,
    )
}

/// Some unit vector at right angles to a unit vector.
pub(super) fn across(k: &Vector3<f64>) -> Vector3<f64> {
    let other = if k.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let across = k.cross(&other);
    across / across.norm()
}

/// The angle with `R(k, angle) from` nearest to `to` (subproblem 1); `None` when one of them lies along `k`.
pub(super) fn align(k: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<f64> {
    let across_from = from - k * k.dot(from);
    let across_to = to - k * k.dot(to);
    if !(across_from.norm() > VANISHING * from.norm() && across_to.norm() > VANISHING * to.norm()) {
        return None;
    }
    Some(k.dot(&across_from.cross(&across_to)).atan2(across_from.dot(&across_to)))
}

/// The angles with `h . R(k, angle) p = d` (subproblem 4).
pub(super) fn slide(h: &Vector3<f64>, p: &Vector3<f64>, k: &Vector3<f64>, d: f64) -> Roots {
    // h . R p = h . k (k . p) + cos (h . p_across) + sin (h . (k x p))
    let along = k.dot(p);
    let across = p - k * along;
    let (a, b) = (h.dot(&across), h.dot(&k.cross(p)));
    Roots::of_cosine(b.atan2(a), a.hypot(b), d - h.dot(k) * along)
}

/// The angles with `|first + R(k, angle) second| = length` (subproblem 3).
pub(super) fn reach(k: &Vector3<f64>, first: &Vector3<f64>, second: &Vector3<f64>, length: f64) -> Roots {
    let wanted = 0.5 * (length * length - first.norm_squared() - second.norm_squared());
    slide(first, second, k, wanted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Unit};

    #[test]
    fn the_rotation_is_that_of_nalgebra() {
        let k = Unit::new_normalize(Vector3::new(0.3, -0.7, 0.2));
        for angle in [-3.0, -0.4, 0.0, 1.0, 2.9] {
            let expected = Rotation3::from_axis_angle(&k, angle);
            assert!((axis_angle(&k, angle) - expected.matrix()).norm() < 1e-15);
        }
    }

    #[test]
    fn every_root_satisfies_its_equation() {
        let k = Unit::new_normalize(Vector3::new(0.3, -0.7, 0.2)).into_inner();
        let (p, h) = (Vector3::new(0.2, 0.5, -0.1), Vector3::new(-0.4, 0.1, 0.8));
        for step in -30..30 {
            let angle = 0.1 * f64::from(step);
            let turned = axis_angle(&k, angle) * p;
            let aligned = align(&k, &p, &turned).unwrap();
            assert!((axis_angle(&k, aligned) * p - turned).norm() < 1e-14);
            let slides = slide(&h, &p, &k, h.dot(&turned));
            assert!(slides.as_slice().iter().any(|root| (crate::wrap_rad(root - angle)).abs() < 1e-6));
            for root in slides.as_slice() {
                assert!((h.dot(&(axis_angle(&k, *root) * p)) - h.dot(&turned)).abs() < 1e-14);
            }
            let length = (h + turned).norm();
            for root in reach(&k, &h, &p, length).as_slice() {
                assert!(((h + axis_angle(&k, *root) * p).norm() - length).abs() < 1e-14);
            }
        }
        assert!(slide(&h, &p, &k, 10.0).as_slice().is_empty());
        assert!(reach(&k, &h, &p, 10.0).as_slice().is_empty());
        assert!(align(&k, &k, &p).is_none());
    }
}
