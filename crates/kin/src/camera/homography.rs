//! The projective map from pixels to a plane, from marked points.
//!
//! Direct linear transform with normalised coordinates (Hartley and Zisserman 2004, algorithm 4.2), then
//! Gauss-Newton on the distances in the plane. It knows no lens: undistort first where distortion matters.

use nalgebra::{DMatrix, Matrix2, Matrix3, Point2, SMatrix, SVector, Vector2, Vector3};

use crate::Error;

/// A map from pixels to plane coordinates (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homography {
    plane_from_pixel: Matrix3<f64>,
    pixel_from_plane: Matrix3<f64>,
    rms_m: f64,
}

impl Homography {
    /// Fits the map to pairs of pixel and plane point.
    ///
    /// # Errors
    /// [`Error::Homography`] with fewer than four pairs, or when they do not fix the map (three of four on a line).
    ///
    /// ```
    /// use kin::Homography;
    /// use nalgebra::Point2;
    /// // A sheet of 0.6 m x 0.4 m seen squarely at 1000 px/m.
    /// let corners = [(100.0, 500.0), (700.0, 500.0), (700.0, 100.0), (100.0, 100.0)];
    /// let plane = [(0.0, 0.0), (0.6, 0.0), (0.6, 0.4), (0.0, 0.4)];
    /// let pairs: Vec<_> =
    ///     corners.iter().zip(&plane).map(|(c, p)| (Point2::new(c.0, c.1), Point2::new(p.0, p.1))).collect();
    /// let homography = Homography::from_correspondences(&pairs)?;
    /// let (point, covariance) = homography.map(&Point2::new(400.0, 300.0), 2.0).unwrap();
    /// assert!((point - Point2::new(0.3, 0.2)).norm() < 1e-12);
    /// assert!((covariance[(0, 0)].sqrt() - 0.002).abs() < 1e-12);
    /// # Ok::<(), kin::Error>(())
    /// ```
    pub fn from_correspondences(pairs: &[(Point2<f64>, Point2<f64>)]) -> Result<Self, Error> {
        let refuse = |reason: &'static str| Error::Homography { count: pairs.len(), reason };
        if pairs.len() < 4 {
            return Err(refuse("too few points"));
        }
        if !pairs.iter().all(|(a, b)| a.coords.iter().chain(b.coords.iter()).all(|value| value.is_finite())) {
            return Err(refuse("a coordinate is not finite"));
        }
        let pixel_norm = normaliser(pairs.iter().map(|pair| pair.0)).ok_or_else(|| refuse("all pixels coincide"))?;
        let plane_norm =
            normaliser(pairs.iter().map(|pair| pair.1)).ok_or_else(|| refuse("all plane points coincide"))?;
        let mut design = DMatrix::zeros((2 * pairs.len()).max(9), 9);
        for (i, (pixel, plane)) in pairs.iter().enumerate() {
            let from = pixel_norm * pixel.to_homogeneous();
            let to = plane_norm * plane.to_homogeneous();
            for column in 0..3 {
                design[(2 * i, column)] = from[column];
                design[(2 * i, 6 + column)] = -to.x * from[column];
                design[(2 * i + 1, 3 + column)] = from[column];
                design[(2 * i + 1, 6 + column)] = -to.y * from[column];
            }
        }
        let svd = design.svd(false, true);
        let rows = svd.v_t.ok_or_else(|| refuse("no singular vectors"))?;
        let mut order: Vec<usize> = (0..9).collect();
        order.sort_by(|&a, &b| svd.singular_values[a].total_cmp(&svd.singular_values[b]));
        // A second vanishing singular value: a whole family of maps fits.
        if !(svd.singular_values[order[1]] > 1e-7 * svd.singular_values[order[8]]) {
            return Err(refuse("three of the points lie on a line"));
        }
        let h = rows.row(order[0]);
        let normalised = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
        let denormalise = plane_norm.try_inverse().ok_or_else(|| refuse("all plane points coincide"))?;
        let refined = refine(normalised, pairs, &pixel_norm, &plane_norm);
        let plane_from_pixel = denormalise * refined * pixel_norm;
        let plane_from_pixel = plane_from_pixel / plane_from_pixel.norm();
        let pixel_from_plane = plane_from_pixel
            .try_inverse()
            .filter(|inverse| inverse.iter().all(|value| value.is_finite()))
            .ok_or_else(|| refuse("three of the points lie on a line"))?;
        // Signs such that the marked points have positive depth: the other side is beyond the horizon.
        let plane_from_pixel = plane_from_pixel * (plane_from_pixel * pairs[0].0.to_homogeneous()).z.signum();
        let pixel_from_plane = pixel_from_plane * (pixel_from_plane * pairs[0].1.to_homogeneous()).z.signum();
        let mut fitted = Self { plane_from_pixel, pixel_from_plane, rms_m: 0.0 };
        let mut sum = 0.0;
        for (pixel, plane) in pairs {
            let (mapped, _) = fitted.map(pixel, 0.0).ok_or_else(|| refuse("the horizon runs between the points"))?;
            sum += (mapped - plane).norm_squared();
        }
        fitted.rms_m = (sum / pairs.len() as f64).sqrt();
        Ok(fitted)
    }

    /// Root mean square distance of the fitted pairs in the plane (m).
    pub fn rms_m(&self) -> f64 {
        self.rms_m
    }

    /// The 3x3 matrix, scaled to Frobenius norm 1.
    pub fn plane_from_pixel(&self) -> &Matrix3<f64> {
        &self.plane_from_pixel
    }

    /// The plane point of a pixel and its covariance (m^2) for a pixel error of `sigma_px` per axis; `None` for a
    /// pixel on or beyond the horizon of the plane.
    pub fn map(&self, pixel: &Point2<f64>, sigma_px: f64) -> Option<(Point2<f64>, Matrix2<f64>)> {
        let h = &self.plane_from_pixel;
        let (point, jacobian) = apply(h, pixel).filter(|_| in_front(h, pixel))?;
        Some((point, jacobian * jacobian.transpose() * (sigma_px * sigma_px)))
    }

    /// The pixel of a plane point; `None` where it has none.
    pub fn unmap(&self, plane_m: &Point2<f64>) -> Option<Point2<f64>> {
        let h = &self.pixel_from_plane;
        apply(h, plane_m).filter(|_| in_front(h, plane_m)).map(|(pixel, _)| pixel)
    }
}

fn in_front(h: &Matrix3<f64>, from: &Point2<f64>) -> bool {
    (h * from.to_homogeneous()).z > 0.0
}

fn apply(h: &Matrix3<f64>, from: &Point2<f64>) -> Option<(Point2<f64>, Matrix2<f64>)> {
    let to = h * Vector3::new(from.x, from.y, 1.0);
    let size = h.row(2).norm() * from.coords.norm().max(1.0);
    if !(to.z.abs() > 1e-12 * size) {
        return None;
    }
    let point = Vector2::new(to.x / to.z, to.y / to.z);
    let jacobian = Matrix2::new(
        h[(0, 0)] - point.x * h[(2, 0)],
        h[(0, 1)] - point.x * h[(2, 1)],
        h[(1, 0)] - point.y * h[(2, 0)],
        h[(1, 1)] - point.y * h[(2, 1)],
    ) / to.z;
    Some((point.into(), jacobian))
}

/// Moves the centroid to the origin and the mean distance to sqrt(2).
fn normaliser(points: impl Iterator<Item = Point2<f64>> + Clone) -> Option<Matrix3<f64>> {
    let count = points.clone().count() as f64;
    let centre = points.clone().map(|point| point.coords).sum::<Vector2<f64>>() / count;
    let spread = points.map(|point| (point.coords - centre).norm()).sum::<f64>() / count;
    if !(spread > 0.0) {
        return None;
    }
    let scale = std::f64::consts::SQRT_2 / spread;
    Some(Matrix3::new(scale, 0.0, -scale * centre.x, 0.0, scale, -scale * centre.y, 0.0, 0.0, 1.0))
}

/// Gauss-Newton on the transfer error in normalised plane coordinates, with the largest entry held fixed.
fn refine(
    start: Matrix3<f64>,
    pairs: &[(Point2<f64>, Point2<f64>)],
    pixel_norm: &Matrix3<f64>,
    plane_norm: &Matrix3<f64>,
) -> Matrix3<f64> {
    let cost = |h: &Matrix3<f64>| -> f64 {
        pairs
            .iter()
            .map(|(pixel, plane)| {
                let from = pixel_norm * pixel.to_homogeneous();
                let to = plane_norm * plane.to_homogeneous();
                apply(h, &Point2::new(from.x, from.y))
                    .map_or(f64::INFINITY, |(p, _)| (p.coords - to.xy()).norm_squared())
            })
            .sum()
    };
    let mut h = start;
    let mut best = cost(&h);
    for _ in 0..10 {
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        let mut gradient = SVector::<f64, 9>::zeros();
        for (pixel, plane) in pairs {
            let from = pixel_norm * pixel.to_homogeneous();
            let to = plane_norm * plane.to_homogeneous();
            let Some((mapped, _)) = apply(&h, &Point2::new(from.x, from.y)) else { return h };
            let depth = (h * from).z;
            let mut rows = SMatrix::<f64, 2, 9>::zeros();
            for column in 0..3 {
                rows[(0, column)] = from[column] / depth;
                rows[(1, 3 + column)] = from[column] / depth;
                rows[(0, 6 + column)] = -mapped.x * from[column] / depth;
                rows[(1, 6 + column)] = -mapped.y * from[column] / depth;
            }
            normal += rows.transpose() * rows;
            gradient += rows.transpose() * (to.xy() - mapped.coords);
        }
        // The scale of h is free: hold the norm by adding the direction h itself.
        let direction = SVector::<f64, 9>::from_row_slice(h.transpose().as_slice());
        normal += direction * direction.transpose();
        let Some(step) = normal.cholesky().map(|factor| factor.solve(&gradient)) else { return h };
        let next = h + Matrix3::from_row_slice(step.as_slice());
        let next_cost = cost(&next);
        if !(next_cost < best) {
            return h;
        }
        let done = best - next_cost <= 1e-15 * best;
        (h, best) = (next, next_cost);
        if done {
            break;
        }
    }
    h
}
