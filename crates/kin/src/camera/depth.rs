//! A pixel and a depth image: the robust patch.
//!
//! The depth at a keypoint is that of the nearest surface of the patch around it, so that the background seen past an
//! arm does not pull the arm away: readings that are no number, zero, negative or out of range are dropped; the rest are
//! ordered; the median of those within `jump_m` of the patch's 20th percentile is the depth, and 1.4826 times the median
//! absolute deviation (floored by `sigma_floor_m`), over the square root of their number, its uncertainty together with the
//! floor. Depth is along the optical axis, as depth cameras give it.

use nalgebra::{Matrix3, Point2, Vector3};

use super::{Camera, Lifted};
use crate::Error;

/// A depth image aligned with the camera's own image.
#[derive(Debug, Clone, Copy)]
pub struct DepthImage<'a> {
    /// Depth along the optical axis (m), row by row; zero or NaN where there is none.
    pub depth_m: &'a [f32],
    /// Width (px).
    pub width_px: usize,
}

/// How a patch is read.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct DepthPatch {
    /// Half the side of the square patch (px). Default 4.
    pub radius_px: usize,
    /// The least share of readings that must be usable. Default 0.2.
    pub least_share: f64,
    /// Readings farther behind the near surface than this belong to something else (m). Default 0.10, an arm's width.
    pub jump_m: f64,
    /// The error all readings share (m). Default 0.005.
    pub sigma_floor_m: f64,
    /// Accepted depths (m). Default 0.1 to 10.
    pub range_m: [f64; 2],
}

impl Default for DepthPatch {
    fn default() -> Self {
        Self { radius_px: 4, least_share: 0.2, jump_m: 0.10, sigma_floor_m: 0.005, range_m: [0.1, 10.0] }
    }
}

impl DepthPatch {
    /// Depth (m) and its standard deviation (m) at a pixel.
    ///
    /// # Errors
    /// [`Error::NoDepth`] when the pixel is off the image or too few readings are usable.
    pub fn read(&self, image: &DepthImage, pixel: &Point2<f64>) -> Result<(f64, f64), Error> {
        let height = image.depth_m.len().checked_div(image.width_px).unwrap_or(0);
        let no_depth = |usable: usize, needed: usize| Error::NoDepth { u_px: pixel.x, v_px: pixel.y, usable, needed };
        let (u, v) = (pixel.x.round(), pixel.y.round());
        if !(u >= 0.0 && v >= 0.0 && u < image.width_px as f64 && v < height as f64) {
            return Err(no_depth(0, 1));
        }
        let (u, v) = (u as usize, v as usize);
        let rows = v.saturating_sub(self.radius_px)..=(v + self.radius_px).min(height - 1);
        let columns = u.saturating_sub(self.radius_px)..=(u + self.radius_px).min(image.width_px - 1);
        let total = rows.clone().count() * columns.clone().count();
        let mut depths: Vec<f64> = rows
            .flat_map(|row| columns.clone().map(move |column| row * image.width_px + column))
            .map(|index| f64::from(image.depth_m[index]))
            .filter(|depth| *depth >= self.range_m[0] && *depth <= self.range_m[1])
            .collect();
        let needed = ((self.least_share * total as f64).ceil() as usize).max(1);
        if depths.len() < needed {
            return Err(no_depth(depths.len(), needed));
        }
        depths.sort_by(f64::total_cmp);
        let near = depths[depths.len() / 5];
        depths.retain(|depth| (depth - near).abs() <= self.jump_m);
        let depth_m = median(&depths);
        let mut deviations: Vec<f64> = depths.iter().map(|depth| (depth - depth_m).abs()).collect();
        deviations.sort_by(f64::total_cmp);
        let spread_m = 1.4826 * median(&deviations);
        // The readings of a patch are not independent and share the calibration's error: the floor does not average.
        let sigma_m = (spread_m * spread_m / depths.len() as f64 + self.sigma_floor_m * self.sigma_floor_m).sqrt();
        Ok((depth_m, sigma_m))
    }
}

fn median(sorted: &[f64]) -> f64 {
    let middle = sorted.len() / 2;
    if sorted.len() % 2 == 1 { sorted[middle] } else { f64::midpoint(sorted[middle - 1], sorted[middle]) }
}

impl Camera {
    /// Lifts a pixel of known depth: `depth_m` along the optical axis with standard deviation `sigma_depth_m`.
    ///
    /// # Errors
    /// [`Error::Domain`] for a depth that is not positive or a sigma that is negative; [`Error::PlaneMissed`] for a pixel
    /// without ray.
    ///
    /// ```
    /// use kin::{Camera, Distortion, Intrinsics};
    /// use nalgebra::{Point2, Point3, Vector3};
    /// let camera = Camera::look_at(
    ///     Intrinsics { fx_px: 800.0, fy_px: 800.0, cx_px: 320.0, cy_px: 240.0, skew_px: 0.0 },
    ///     Distortion::default(), [640, 480], Point3::new(0.0, 0.0, 2.0), Point3::origin(), Vector3::y(),
    /// )?;
    /// let lifted = camera.lift_with_depth(&Point2::new(360.0, 240.0), 4.0, 1.6, 0.02)?;
    /// assert!((lifted.point_m - Point3::new(0.08, 0.0, 0.4)).norm() < 1e-9);
    /// // Straight down: the depth error is the height error.
    /// assert!((lifted.covariance_m2[(2, 2)].sqrt() - 0.02).abs() < 1e-9);
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn lift_with_depth(
        &self,
        pixel: &Point2<f64>,
        sigma_px: f64,
        depth_m: f64,
        sigma_depth_m: f64,
    ) -> Result<Lifted, Error> {
        if !(depth_m > 0.0 && depth_m.is_finite()) {
            return Err(Error::Domain { what: "depth (m)", expected: "finite and > 0", got: depth_m });
        }
        for (what, got) in [("sigma (px)", sigma_px), ("sigma of the depth (m)", sigma_depth_m)] {
            if !(got >= 0.0 && got.is_finite()) {
                return Err(Error::Domain { what, expected: "finite and >= 0", got });
            }
        }
        let missed = || Error::PlaneMissed { u_px: pixel.x, v_px: pixel.y, reason: "the lens model has no ray there" };
        let normalised = self.undistort(pixel).ok_or_else(missed)?;
        let world_from_camera = self.camera_from_world.inverse();
        let per_depth = Vector3::new(normalised.x, normalised.y, 1.0);
        let point_m = world_from_camera * nalgebra::Point3::from(per_depth * depth_m);
        // Sideways by the pixel, outwards along the ray by the depth.
        let by_normalised = self.lens_jacobian(normalised).try_inverse().ok_or_else(missed)?;
        let planar = by_normalised * by_normalised.transpose() * (sigma_px * depth_m).powi(2);
        let mut in_camera = per_depth * per_depth.transpose() * (sigma_depth_m * sigma_depth_m);
        let mut corner = in_camera.fixed_view_mut::<2, 2>(0, 0);
        corner += planar;
        let rotation: Matrix3<f64> = *world_from_camera.rotation.to_rotation_matrix().matrix();
        Ok(Lifted { point_m, covariance_m2: rotation * in_camera * rotation.transpose() })
    }

    /// Lifts a pixel through the depth image that belongs to this camera.
    ///
    /// # Errors
    /// As [`DepthPatch::read`] and [`Camera::lift_with_depth`].
    pub fn lift_from_depth_image(
        &self,
        pixel: &Point2<f64>,
        sigma_px: f64,
        image: &DepthImage,
        patch: &DepthPatch,
    ) -> Result<Lifted, Error> {
        let (depth_m, sigma_depth_m) = patch.read(image, pixel)?;
        self.lift_with_depth(pixel, sigma_px, depth_m, sigma_depth_m)
    }

    /// Derivative of the pixel by the normalised coordinates (px).
    fn lens_jacobian(&self, normalised: nalgebra::Vector2<f64>) -> nalgebra::Matrix2<f64> {
        self.intrinsics.matrix2() * self.distortion.distort_with_jacobian(normalised).1
    }
}
