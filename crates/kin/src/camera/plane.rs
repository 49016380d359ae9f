//! A pixel on a level plane: the bench, or any height above it.
//!
//! With `project(x, y, z)` and its derivatives `A = d pixel / d(x, y)` and `b = d pixel / dz`, errors of the pixel
//! (sigma per axis) and of the height spread as
//!
//! ```text
//! cov_xy = A^-1 (sigma_px^2 I + b b^T sigma_height^2) A^-T,  cov_xy_z = -A^-1 b sigma_height^2,  var_z = sigma_height^2
//! ```

use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use super::{Camera, Lifted};
use crate::Error;

/// Rays flatter than this to the plane say nothing about it: at 0.01 rad one pixel is metres.
const LEAST_SLOPE: f64 = 0.01;

impl Camera {
    /// Lifts a pixel to the plane `z = height_m` of `world`.
    ///
    /// `sigma_px` is the standard deviation of the pixel per axis, `sigma_height_m` that of the true height of the
    /// point about the plane.
    ///
    /// # Errors
    /// [`Error::PlaneMissed`] when the pixel has no ray, or its ray runs away from the plane or within 0.01 rad
    /// along it; [`Error::Domain`] for a sigma that is negative or not finite.
    ///
    /// ```
    /// use kin::{Camera, Distortion, Intrinsics};
    /// use nalgebra::{Point2, Point3, Vector3};
    /// let camera = Camera::look_at(
    ///     Intrinsics { fx_px: 800.0, fy_px: 800.0, cx_px: 320.0, cy_px: 240.0, skew_px: 0.0 },
    ///     Distortion::default(), [640, 480], Point3::new(0.0, 0.0, 2.0), Point3::origin(), Vector3::y(),
    /// )?;
    /// let lifted = camera.lift_to_plane(&Point2::new(360.0, 240.0), 4.0, 0.0, 0.02)?;
    /// assert!((lifted.point_m - Point3::new(0.1, 0.0, 0.0)).norm() < 1e-9);
    /// // 4 px * 2 m / 800 px = 10 mm; and 20 mm of height shift x by 20 mm * 0.1 m / 2 m = 1 mm.
    /// assert!((lifted.covariance_m2[(0, 0)] - (0.010f64.powi(2) + 0.001f64.powi(2))).abs() < 1e-9);
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn lift_to_plane(
        &self,
        pixel: &Point2<f64>,
        sigma_px: f64,
        height_m: f64,
        sigma_height_m: f64,
    ) -> Result<Lifted, Error> {
        for (what, got) in [("sigma (px)", sigma_px), ("sigma of the height (m)", sigma_height_m)] {
            if !(got >= 0.0 && got.is_finite()) {
                return Err(Error::Domain { what, expected: "finite and >= 0", got });
            }
        }
        let missed = |reason: &'static str| Error::PlaneMissed { u_px: pixel.x, v_px: pixel.y, reason };
        let ray = self.ray(pixel).ok_or_else(|| missed("the lens model has no ray there"))?;
        if !(ray.direction.z.abs() > LEAST_SLOPE) {
            return Err(missed("its ray runs along the plane"));
        }
        let distance_m = (height_m - ray.origin_m.z) / ray.direction.z;
        let point_m = ray.origin_m + ray.direction.into_inner() * distance_m;
        let (_, jacobian) =
            self.project_with_jacobian(&point_m).ok_or_else(|| missed("the plane is behind the camera"))?;
        let inverse = jacobian
            .fixed_columns::<2>(0)
            .into_owned()
            .try_inverse()
            .ok_or_else(|| missed("its ray runs along the plane"))?;
        let by_height: Vector2<f64> = -(inverse * jacobian.column(2));
        let variance_height = sigma_height_m * sigma_height_m;
        let planar: Matrix2<f64> =
            inverse * inverse.transpose() * (sigma_px * sigma_px) + by_height * by_height.transpose() * variance_height;
        let mut covariance_m2 = Matrix3::zeros();
        covariance_m2.fixed_view_mut::<2, 2>(0, 0).copy_from(&planar);
        for axis in 0..2 {
            covariance_m2[(axis, 2)] = by_height[axis] * variance_height;
            covariance_m2[(2, axis)] = by_height[axis] * variance_height;
        }
        covariance_m2[(2, 2)] = variance_height;
        Ok(Lifted { point_m, covariance_m2 })
    }
}
