//! Turns about one axis that satisfy one equation.
//!
//! A turn is its sine and cosine: turns are composed, applied and found without a trigonometric function, and only the answer
//! is made an angle.

use nalgebra::Vector3;

/// How far beyond its largest value a cosine may lie and still count as that value: rounding of a stretched arm.
const SLACK: f64 = 1e-9;
/// Vectors shorter than this (relative to those they came from) have no direction.
const VANISHING: f64 = 1e-8;

/// A turn about an axis that is known from elsewhere.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    sine: f64,
    cosine: f64,
}

impl Turn {
    pub(super) const NONE: Self = Self { sine: 0.0, cosine: 1.0 };

    pub(super) fn by(angle: f64) -> Self {
        let (sine, cosine) = angle.sin_cos();
        Self { sine, cosine }
    }

    /// The direction of `(x, y)`, of which one is not zero.
    #[inline(always)]
    fn towards(y: f64, x: f64) -> Self {
        let length = (x * x + y * y).sqrt();
        Self { sine: y / length, cosine: x / length }
    }

    /// The angle in [-pi, pi].
    #[inline(always)]
    pub(super) fn angle(self) -> f64 {
        self.sine.atan2(self.cosine)
    }

    #[inline(always)]
    pub(super) fn back(self) -> Self {
        Self { sine: -self.sine, ..self }
    }

    /// The sum of two turns about one axis.
    #[inline(always)]
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            sine: self.sine * other.cosine + self.cosine * other.sine,
            cosine: self.cosine * other.cosine - self.sine * other.sine,
        }
    }

    /// Turns a vector about a unit axis (Rodrigues).
    #[inline(always)]
    pub(super) fn of(self, k: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        let along = (1.0 - self.cosine) * dot(k, v);
        let across = cross(k, v);
        Vector3::new(
            self.cosine * v.x + self.sine * across.x + along * k.x,
            self.cosine * v.y + self.sine * across.y + along * k.y,
            self.cosine * v.z + self.sine * across.z + along * k.z,
        )
    }

    /// Turns a vector about z.
    #[inline(always)]
    pub(super) fn about_z(self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(self.cosine * v.x - self.sine * v.y, self.sine * v.x + self.cosine * v.y, v.z)
    }
}

/// None, one or two turns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Roots {
    count: usize,
    turns: [Turn; 2],
}

impl Roots {
    pub(super) fn as_slice(&self) -> &[Turn] {
        &self.turns[..self.count]
    }
}

/// The turns with `h . R(k, turn) p = d` (subproblem 4), prepared for many `d`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slide {
    phase: Turn,
    amplitude: f64,
    fixed: f64,
}

impl Slide {
    #[inline(always)]
    pub(super) fn new(h: &Vector3<f64>, p: &Vector3<f64>, k: &Vector3<f64>) -> Self {
        // h . R p = h . k (k . p) + cos (h . p_across) + sin (h . (k x p))
        let along = dot(k, p);
        let fixed = dot(h, k) * along;
        let (a, b) = (dot(h, p) - fixed, dot(h, &cross(k, p)));
        let amplitude = (a * a + b * b).sqrt();
        let phase = if amplitude > 0.0 { Turn { sine: b / amplitude, cosine: a / amplitude } } else { Turn::NONE };
        Self { phase, amplitude, fixed }
    }

    #[inline(always)]
    pub(super) fn turns(&self, d: f64) -> Roots {
        let cosine = (d - self.fixed) / self.amplitude;
        if !(self.amplitude > 0.0 && cosine.abs() <= 1.0 + SLACK) {
            return Roots { count: 0, turns: [Turn::NONE; 2] };
        }
        if cosine.abs() >= 1.0 {
            let spread = Turn { sine: 0.0, cosine: cosine.signum() };
            return Roots { count: 1, turns: [self.phase.and(spread); 2] };
        }
        let spread = Turn { sine: ((1.0 - cosine) * (1.0 + cosine)).sqrt(), cosine };
        Roots { count: 2, turns: [self.phase.and(spread), self.phase.and(spread.back())] }
    }
}

/// The turns about z with `|first + R(turn) second| = length` in the plane (subproblem 3), prepared for many lengths.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    slide: Slide,
    squares: f64,
}

impl Reach {
    pub(super) fn new(first: &Vector3<f64>, second: &Vector3<f64>) -> Self {
        let (first, second) = (flat(first), flat(second));
        Self {
            slide: Slide::new(&first, &second, &Vector3::z()),
            squares: first.norm_squared() + second.norm_squared(),
        }
    }

    #[inline(always)]
    pub(super) fn turns(&self, length_squared: f64) -> Roots {
        self.slide.turns(0.5 * (length_squared - self.squares))
    }
}

/// Without its z.
pub(super) fn flat(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, v.y, 0.0)
}

#[inline(always)]
pub(super) fn dot(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

#[inline(always)]
pub(super) fn cross(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

/// Some unit vector at right angles to a unit vector.
pub(super) fn across(k: &Vector3<f64>) -> Vector3<f64> {
    let other = if k.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let across = k.cross(&other);
    across / across.norm()
}

/// The turn with `R(k, turn) from` nearest to `to` (subproblem 1); `None` when one of them lies along `k`.
#[inline(always)]
pub(super) fn align(k: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> Option<Turn> {
    let beside = |v: &Vector3<f64>| {
        let along = dot(k, v);
        Vector3::new(v.x - k.x * along, v.y - k.y * along, v.z - k.z * along)
    };
    let (across_from, across_to) = (beside(from), beside(to));
    let vanishes = |across: &Vector3<f64>, v: &Vector3<f64>| !(dot(across, across) > VANISHING * VANISHING * dot(v, v));
    if vanishes(&across_from, from) || vanishes(&across_to, to) {
        return None;
    }
    Some(Turn::towards(dot(k, &cross(&across_from, &across_to)), dot(&across_from, &across_to)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Unit};

    fn skew_axis() -> Unit<Vector3<f64>> {
        Unit::new_normalize(Vector3::new(0.3, -0.7, 0.2))
    }

    #[test]
    fn a_turn_is_the_rotation_of_nalgebra() {
        let v = Vector3::new(0.2, 0.5, -0.1);
        for angle in [-3.0, -0.4, 0.0, 1.0, 2.9] {
            let turn = Turn::by(angle);
            assert!((turn.of(&skew_axis(), &v) - Rotation3::from_axis_angle(&skew_axis(), angle) * v).norm() < 1e-15);
            assert!((turn.about_z(&v) - Rotation3::from_axis_angle(&Vector3::z_axis(), angle) * v).norm() < 1e-15);
            assert!((turn.angle() - angle).abs() < 1e-15);
            assert!((turn.and(turn.back()).angle()).abs() < 1e-15);
        }
    }

    #[test]
    fn every_root_satisfies_its_equation() {
        let k = skew_axis().into_inner();
        let (p, h) = (Vector3::new(0.2, 0.5, -0.1), Vector3::new(-0.4, 0.1, 0.8));
        for step in -30..30 {
            let angle = 0.1 * f64::from(step);
            let turned = Turn::by(angle).of(&k, &p);
            let aligned = align(&k, &p, &turned).unwrap();
            assert!((aligned.of(&k, &p) - turned).norm() < 1e-14);
            let slides = Slide::new(&h, &p, &k).turns(h.dot(&turned));
            assert!(slides.as_slice().iter().any(|root| (crate::wrap_rad(root.angle() - angle)).abs() < 1e-6));
            for root in slides.as_slice() {
                assert!((h.dot(&root.of(&k, &p)) - h.dot(&turned)).abs() < 1e-14);
            }
            let length = (flat(&h) + Turn::by(angle).about_z(&flat(&p))).norm();
            let reaches = Reach::new(&h, &p).turns(length * length);
            assert!(!reaches.as_slice().is_empty());
            for root in reaches.as_slice() {
                assert!(((flat(&h) + root.about_z(&flat(&p))).norm() - length).abs() < 1e-14);
            }
        }
        assert!(Slide::new(&h, &p, &k).turns(10.0).as_slice().is_empty());
        assert!(Reach::new(&h, &p).turns(100.0).as_slice().is_empty());
        assert!(align(&k, &k, &p).is_none());
    }
}
