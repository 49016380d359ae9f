//! Pinhole cameras with OpenCV lens distortion.
//!
//! A point `p` in the camera's optical frame (x right, y down, z forward, metres) has the normalised coordinates
//! `x = p_x / p_z`, `y = p_y / p_z`. With `r2 = x^2 + y^2` the lens moves them to
//!
//! ```text
//! radial = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
//! x_d = x radial + 2 p1 x y + p2 (r2 + 2 x^2)
//! y_d = y radial + p1 (r2 + 2 y^2) + 2 p2 x y
//! u = fx x_d + skew y_d + cx,   v = fy y_d + cy
//! ```
//!
//! which is the rational model of OpenCV (`calib3d`), after Brown (1966) and Claus and Fitzgibbon (2005). Pixels
//! count from the centre of the top-left pixel.

mod calibration;
mod depth;
mod homography;
mod lens;
mod plane;
mod triangulate;

use nalgebra::{Isometry3, Matrix2x3, Point2, Point3, Unit, Vector2, Vector3};

pub use calibration::{Calibration, CalibrationFormat, parse_calibration, read_calibration, read_cameras};
pub use depth::{DepthImage, DepthPatch};
pub use homography::Homography;
pub use lens::{Distortion, Intrinsics};
pub use triangulate::{Lifted, TriangulateOptions, Triangulated, View, ViewResidual, triangulate};

/// A half-line in `world`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// The camera centre (m).
    pub origin_m: Point3<f64>,
    /// Where the pixel looks.
    pub direction: Unit<Vector3<f64>>,
}

/// A calibrated camera in `world`.
///
/// ```
/// use kin::{Camera, Distortion, Intrinsics};
/// use nalgebra::{Point2, Point3};
/// // Two metres above the bench, looking straight down.
/// let camera = Camera::look_at(
///     Intrinsics { fx_px: 800.0, fy_px: 800.0, cx_px: 320.0, cy_px: 240.0, skew_px: 0.0 },
///     Distortion::default(),
///     [640, 480],
///     Point3::new(0.0, 0.0, 2.0),
///     Point3::origin(),
///     nalgebra::Vector3::y(),
/// )?;
/// let pixel = camera.project(&Point3::new(0.1, 0.0, 0.0)).unwrap();
/// assert!((pixel - Point2::new(360.0, 240.0)).norm() < 1e-9); // 0.1 m * 800 px / 2 m = 40 px
/// # Ok::<(), kin::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Name in the calibration file.
    pub name: String,
    /// Image width and height (px).
    pub size_px: [u32; 2],
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// Lens distortion.
    pub distortion: Distortion,
    /// Takes `world` coordinates to the optical frame.
    pub camera_from_world: Isometry3<f64>,
}

impl Camera {
    /// A camera at `eye_m` that looks at `target_m`, with `up` pointing upwards in the picture.
    ///
    /// # Errors
    /// [`crate::Error::Domain`] when eye and target coincide or `up` is parallel to the line of sight.
    pub fn look_at(
        intrinsics: Intrinsics,
        distortion: Distortion,
        size_px: [u32; 2],
        eye_m: Point3<f64>,
        target_m: Point3<f64>,
        up: Vector3<f64>,
    ) -> Result<Self, crate::Error> {
        let gap_m = (target_m - eye_m).norm();
        let forward = Unit::try_new(target_m - eye_m, 1e-9).ok_or(crate::Error::Domain {
            what: "distance from eye to target (m)",
            expected: "> 1e-9",
            got: gap_m,
        })?;
        let right = Unit::try_new(forward.cross(&up), 1e-9).ok_or(crate::Error::Domain {
            what: "sine of the angle between line of sight and up",
            expected: "> 1e-9",
            got: forward.cross(&up).norm(),
        })?;
        let down = forward.cross(&right);
        let world_from_camera = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[
            right.into_inner(),
            down,
            forward.into_inner(),
        ]));
        Ok(Self {
            name: "camera".to_owned(),
            size_px,
            intrinsics,
            distortion,
            camera_from_world: Isometry3::from_parts(
                eye_m.into(),
                nalgebra::UnitQuaternion::from_rotation_matrix(&world_from_camera),
            )
            .inverse(),
        })
    }

    /// The pixel of a point in `world`; `None` when the point is not in front of the camera, or so far off the
    /// axis that the lens polynomial folds back there. The pixel may lie outside the image.
    pub fn project(&self, world_m: &Point3<f64>) -> Option<Point2<f64>> {
        let p = self.camera_from_world * world_m;
        if !(p.z > 1e-9) {
            return None;
        }
        let normalised = Vector2::new(p.x / p.z, p.y / p.z);
        if !self.distortion.is_monotonic_at(normalised.norm_squared()) {
            return None;
        }
        Some(self.intrinsics.pixel(self.distortion.distort(normalised)))
    }

    /// The pixel of a point in `world`, and its derivative by the point (px/m). `None` as in [`Camera::project`].
    pub fn project_with_jacobian(&self, world_m: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let p = self.camera_from_world * world_m;
        if !(p.z > 1e-9) {
            return None;
        }
        let normalised = Vector2::new(p.x / p.z, p.y / p.z);
        if !self.distortion.is_monotonic_at(normalised.norm_squared()) {
            return None;
        }
        let (distorted, distorted_by_normalised) = self.distortion.distort_with_jacobian(normalised);
        let normalised_by_point =
            Matrix2x3::new(1.0 / p.z, 0.0, -normalised.x / p.z, 0.0, 1.0 / p.z, -normalised.y / p.z);
        let rotation = self.camera_from_world.rotation.to_rotation_matrix();
        let jacobian = self.intrinsics.matrix2() * distorted_by_normalised * normalised_by_point * rotation.matrix();
        Some((self.intrinsics.pixel(distorted), jacobian))
    }

    /// The normalised coordinates (x, y at depth 1) that the lens maps to this pixel; `None` where the lens model
    /// has no such point.
    pub fn undistort(&self, pixel: &Point2<f64>) -> Option<Vector2<f64>> {
        self.distortion.undistort(self.intrinsics.distorted(pixel))
    }

    /// The half-line of points seen at this pixel; `None` where the lens model has no such point.
    pub fn ray(&self, pixel: &Point2<f64>) -> Option<Ray> {
        let normalised = self.undistort(pixel)?;
        let world_from_camera = self.camera_from_world.inverse();
        let direction = world_from_camera.rotation * Vector3::new(normalised.x, normalised.y, 1.0);
        Some(Ray { origin_m: world_from_camera.translation.vector.into(), direction: Unit::new_normalize(direction) })
    }

    /// The camera centre in `world` (m).
    pub fn centre_m(&self) -> Point3<f64> {
        self.camera_from_world.inverse().translation.vector.into()
    }

    /// Whether a pixel lies on the image.
    pub fn sees(&self, pixel: &Point2<f64>) -> bool {
        let [width, height] = self.size_px.map(f64::from);
        pixel.x >= -0.5 && pixel.y >= -0.5 && pixel.x < width - 0.5 && pixel.y < height - 0.5
    }
}
