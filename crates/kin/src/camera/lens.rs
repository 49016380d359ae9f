//! Intrinsics and the OpenCV rational distortion model, both ways.

use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

/// Focal lengths, principal point and skew of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Focal length along u (px).
    pub fx_px: f64,
    /// Focal length along v (px).
    pub fy_px: f64,
    /// Principal point, u (px).
    pub cx_px: f64,
    /// Principal point, v (px).
    pub cy_px: f64,
    /// Skew (px), zero for nearly every camera.
    pub skew_px: f64,
}

impl Intrinsics {
    /// The 3x3 camera matrix K.
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(self.fx_px, self.skew_px, self.cx_px, 0.0, self.fy_px, self.cy_px, 0.0, 0.0, 1.0)
    }

    pub(crate) fn matrix2(&self) -> Matrix2<f64> {
        Matrix2::new(self.fx_px, self.skew_px, 0.0, self.fy_px)
    }

    pub(crate) fn pixel(&self, distorted: Vector2<f64>) -> Point2<f64> {
        Point2::new(
            self.fx_px * distorted.x + self.skew_px * distorted.y + self.cx_px,
            self.fy_px * distorted.y + self.cy_px,
        )
    }

    pub(crate) fn distorted(&self, pixel: &Point2<f64>) -> Vector2<f64> {
        let y = (pixel.y - self.cy_px) / self.fy_px;
        Vector2::new((pixel.x - self.cx_px - self.skew_px * y) / self.fx_px, y)
    }
}

/// Coefficients of the rational lens model; all zero is a perfect pinhole.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[expect(missing_docs, reason = "the names are those of the equation in the module documentation and of OpenCV")]
pub struct Distortion {
    pub k1: f64,
    pub k2: f64,
    pub p1: f64,
    pub p2: f64,
    pub k3: f64,
    pub k4: f64,
    pub k5: f64,
    pub k6: f64,
}

/// Newton steps allowed for undistortion; the usual lens needs three to five, a folding one never ends.
const UNDISTORT_STEPS: usize = 30;
/// Accepted remainder of undistortion in normalised units: 1e-12 of the focal length is far below any pixel.
const UNDISTORT_TOLERANCE: f64 = 1e-12;

impl Distortion {
    /// From OpenCV's vector `k1 k2 p1 p2 [k3 [k4 k5 k6]]` (length 0, 4, 5 or 8; further values must be zero).
    /// `None` for any other length or content.
    ///
    /// ```
    /// let d = kin::Distortion::from_opencv(&[-0.1, 0.01, 0.0, 0.0]).unwrap();
    /// assert_eq!((d.k1, d.k2, d.k3), (-0.1, 0.01, 0.0));
    /// assert!(kin::Distortion::from_opencv(&[0.1]).is_none());
    /// ```
    pub fn from_opencv(values: &[f64]) -> Option<Self> {
        let tail_is_zero = values.iter().skip(8).all(|&value| value == 0.0);
        if !matches!(values.len(), 0 | 4 | 5 | 8 | 12 | 14) || !tail_is_zero {
            return None;
        }
        if !values.iter().all(|value| value.is_finite()) {
            return None;
        }
        let at = |index: usize| values.get(index).copied().unwrap_or(0.0);
        Some(Self { k1: at(0), k2: at(1), p1: at(2), p2: at(3), k3: at(4), k4: at(5), k5: at(6), k6: at(7) })
    }

    fn radial(&self, r2: f64) -> f64 {
        (1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))) / (1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6)))
    }

    /// d radial / d r2.
    fn radial_slope(&self, r2: f64) -> f64 {
        let numerator = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let denominator = 1.0 + r2 * (self.k4 + r2 * (self.k5 + r2 * self.k6));
        let numerator_slope = self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3);
        let denominator_slope = self.k4 + r2 * (2.0 * self.k5 + r2 * 3.0 * self.k6);
        (numerator_slope * denominator - numerator * denominator_slope) / (denominator * denominator)
    }

    /// Whether the distorted radius still grows at this radius: d(r radial)/dr = radial + 2 r2 radial' > 0.
    pub(crate) fn is_monotonic_at(&self, r2: f64) -> bool {
        self.radial(r2) + 2.0 * r2 * self.radial_slope(r2) > 0.0
    }

    /// Applies the lens to normalised coordinates.
    pub fn distort(&self, normalised: Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (normalised.x, normalised.y);
        let r2 = x * x + y * y;
        let radial = self.radial(r2);
        Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * radial + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    /// Applies the lens and differentiates it.
    pub(crate) fn distort_with_jacobian(&self, normalised: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let (x, y) = (normalised.x, normalised.y);
        let r2 = x * x + y * y;
        let radial = self.radial(r2);
        let slope = self.radial_slope(r2);
        let cross = 2.0 * x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        let jacobian = Matrix2::new(
            radial + 2.0 * x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            cross,
            cross,
            radial + 2.0 * y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        );
        (self.distort(normalised), jacobian)
    }

    /// Inverts the lens by Newton's method with step halving; `None` where it has no inverse.
    pub fn undistort(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        if *self == Self::default() {
            return distorted.iter().all(|value| value.is_finite()).then_some(distorted);
        }
        let mut guess = distorted;
        let mut error = self.distort(guess) - distorted;
        for _ in 0..UNDISTORT_STEPS {
            let size = error.norm();
            if size <= UNDISTORT_TOLERANCE * (1.0 + distorted.norm()) {
                return self.is_monotonic_at(guess.norm_squared()).then_some(guess);
            }
            let (_, jacobian) = self.distort_with_jacobian(guess);
            let step = jacobian.try_inverse()? * error;
            let mut scale = 1.0;
            loop {
                let next = guess - scale * step;
                let next_error = self.distort(next) - distorted;
                if next_error.norm() < size {
                    (guess, error) = (next, next_error);
                    break;
                }
                scale *= 0.5;
                if !(scale > 1e-6) {
                    return None;
                }
            }
        }
        None
    }
}
