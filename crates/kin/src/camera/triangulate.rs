//! A point from several pixels, with covariance, in spite of one bad view.
//!
//! 1. Every pair of rays that is not parallel proposes the middle of its shortest connection, refined over the
//!    views within twice the gate of it.
//! 2. Each proposal is scored over all views by `sum min(e^2, gate^2)`, `e` the distance between the pixel and the
//!    reprojection in units of that view's sigma. The best proposal wins, and with it the views inside the gate.
//! 3. Gauss-Newton on the reprojection errors of those views: `min sum |u - project(p)|^2 / sigma^2`.
//!
//! The covariance is the inverse of the normal matrix, `(sum J^T J / sigma^2)^-1` (m^2): right if the sigmas are
//! right and the errors of the views independent. It is not inflated by the residuals; [`Triangulated::chi2`] and
//! [`Triangulated::freedom`] let the caller judge that. Cost: views^2 / 2 proposals; a few microseconds for four views.

use nalgebra::{Matrix3, Point2, Point3, Vector3};

use super::{Camera, Ray};
use crate::Error;

/// A pixel seen by a camera.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Where it saw the point.
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel along u and along v (px).
    pub sigma_px: f64,
}

/// What counts as agreement.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct TriangulateOptions {
    /// A view farther from the common point than this many of its own sigma is left out. Default 4: a right view
    /// exceeds it once in 3000 times.
    pub gate_sigma: f64,
    /// Rays at a smaller angle than this propose no point (rad). Default 0.02, about 1 degree.
    pub least_angle_rad: f64,
}

impl Default for TriangulateOptions {
    fn default() -> Self {
        Self { gate_sigma: 4.0, least_angle_rad: 0.02 }
    }
}

impl TriangulateOptions {
    /// Sets [`TriangulateOptions::gate_sigma`].
    #[must_use]
    pub fn gate_sigma(mut self, gate_sigma: f64) -> Self {
        self.gate_sigma = gate_sigma;
        self
    }

    /// Sets [`TriangulateOptions::least_angle_rad`].
    #[must_use]
    pub fn least_angle_rad(mut self, least_angle_rad: f64) -> Self {
        self.least_angle_rad = least_angle_rad;
        self
    }
}

/// A lifted point and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lifted {
    /// The point in `world` (m).
    pub point_m: Point3<f64>,
    /// Covariance (m^2).
    pub covariance_m2: Matrix3<f64>,
}

/// What became of one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewResidual {
    /// Distance between the pixel and the projected point (px); `None` when the point has no pixel there.
    pub residual_px: Option<f64>,
    /// Whether the view took part.
    pub used: bool,
}

/// A triangulated point.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulated {
    /// The point in `world` (m).
    pub point_m: Point3<f64>,
    /// Covariance (m^2).
    pub covariance_m2: Matrix3<f64>,
    /// One entry per view, in the order given.
    pub views: Vec<ViewResidual>,
    /// Sum of squared residuals in units of sigma, over the views used.
    pub chi2: f64,
    /// Its degrees of freedom: two per view used, less three.
    pub freedom: usize,
}

/// Gauss-Newton steps; it ends when a step is below a nanometre, after three to five.
const STEPS: usize = 20;

/// Rounds in which views may join or leave.
const ROUNDS: u32 = 3;

/// Triangulates one point.
///
/// # Errors
/// [`Error::Domain`] for a sigma that is not positive, [`Error::TooFewViews`], [`Error::ParallelRays`],
/// [`Error::InconsistentViews`].
///
/// ```
/// use kin::{Camera, Distortion, Intrinsics, TriangulateOptions, View, triangulate};
/// use nalgebra::{Point3, Vector3};
/// let intrinsics = Intrinsics { fx_px: 1000.0, fy_px: 1000.0, cx_px: 640.0, cy_px: 360.0, skew_px: 0.0 };
/// let point = Point3::new(0.1, 0.2, 0.9);
/// let cameras: Vec<Camera> = [(2.0, 0.0), (0.0, 2.0), (-2.0, 0.5)]
///     .into_iter()
///     .map(|(x, y)| {
///         let eye = Point3::new(x, y, 1.5);
///         Camera::look_at(intrinsics, Distortion::default(), [1280, 720], eye, Point3::new(0.0, 0.0, 1.0), Vector3::z())
///     })
///     .collect::<Result<_, _>>()?;
/// let views: Vec<View> = cameras
///     .iter()
///     .map(|camera| View { camera, pixel: camera.project(&point).unwrap(), sigma_px: 2.0 })
///     .collect();
/// let found = triangulate(&views, &TriangulateOptions::default())?;
/// assert!((found.point_m - point).norm() < 1e-9);
/// assert!(found.covariance_m2[(0, 0)].sqrt() < 0.005); // 2 px at 2 m and 1000 px focal length: 4 mm per view
/// # Ok::<(), kin::Error>(())
/// ```
pub fn triangulate(views: &[View], options: &TriangulateOptions) -> Result<Triangulated, Error> {
    for view in views {
        if !(view.sigma_px > 0.0 && view.sigma_px.is_finite()) {
            return Err(Error::Domain { what: "sigma (px)", expected: "finite and > 0", got: view.sigma_px });
        }
    }
    let rays: Vec<Option<Ray>> = views.iter().map(|view| view.camera.ray(&view.pixel)).collect();
    let usable = rays.iter().flatten().count();
    if usable < 2 {
        return Err(Error::TooFewViews { usable });
    }
    let mut best: Option<(f64, Point3<f64>)> = None;
    let mut largest_rad = 0.0f64;
    for (i, first) in rays.iter().enumerate() {
        let Some(first) = first else { continue };
        for second in rays[i + 1..].iter().flatten() {
            let angle_rad = first.direction.angle(&second.direction);
            let angle_rad = angle_rad.min(std::f64::consts::PI - angle_rad);
            largest_rad = largest_rad.max(angle_rad);
            if angle_rad < options.least_angle_rad {
                continue;
            }
            // The middle is crude: let the views near it have a say before it is judged.
            let proposal = midpoint(first, second);
            let near = inliers(views, &proposal, 2.0 * options.gate_sigma);
            let point = if near.iter().filter(|&&near| near).count() >= 2 {
                gauss_newton(views, &near, proposal).0
            } else {
                proposal
            };
            let score = score(views, &point, options.gate_sigma);
            if best.is_none_or(|(least, _)| score < least) {
                best = Some((score, point));
            }
        }
    }
    let Some((_, mut point)) = best else {
        return Err(Error::ParallelRays { least_rad: options.least_angle_rad, largest_rad });
    };

    let mut used = inliers(views, &point, options.gate_sigma);
    let mut normal = Matrix3::zeros();
    let mut rounds = 0;
    let count = loop {
        let count = used.iter().filter(|&&used| used).count();
        if count < 2 {
            return Err(inconsistent(views, &point, options.gate_sigma));
        }
        if rounds == ROUNDS {
            break count;
        }
        (point, normal) = gauss_newton(views, &used, point);
        let next = inliers(views, &point, options.gate_sigma);
        rounds = if next == used { ROUNDS } else { rounds + 1 };
        used = next;
    };
    let Some(covariance_m2) = normal.try_inverse() else {
        return Err(Error::ParallelRays { least_rad: options.least_angle_rad, largest_rad });
    };
    let mut chi2 = 0.0;
    let residuals = views
        .iter()
        .zip(&used)
        .map(|(view, &used)| {
            let residual_px = residual_px(view, &point);
            if used {
                chi2 += residual_px.map_or(0.0, |residual| (residual / view.sigma_px).powi(2));
            }
            ViewResidual { residual_px, used }
        })
        .collect();
    Ok(Triangulated { point_m: point, covariance_m2, views: residuals, chi2, freedom: 2 * count - 3 })
}

fn residual_px(view: &View, point: &Point3<f64>) -> Option<f64> {
    view.camera.project(point).map(|pixel| (pixel - view.pixel).norm())
}

fn error_sigma(view: &View, point: &Point3<f64>) -> f64 {
    residual_px(view, point).map_or(f64::INFINITY, |residual| residual / view.sigma_px)
}

fn inliers(views: &[View], point: &Point3<f64>, gate_sigma: f64) -> Vec<bool> {
    views.iter().map(|view| error_sigma(view, point) <= gate_sigma).collect()
}

fn score(views: &[View], point: &Point3<f64>, gate_sigma: f64) -> f64 {
    views.iter().map(|view| error_sigma(view, point).min(gate_sigma).powi(2)).sum()
}

fn inconsistent(views: &[View], point: &Point3<f64>, gate_sigma: f64) -> Error {
    let mut errors: Vec<f64> = views.iter().map(|view| error_sigma(view, point)).collect();
    errors.sort_by(f64::total_cmp);
    Error::InconsistentViews { residual_sigma: errors[1], gate_sigma }
}

/// The middle of the shortest connection of two rays that are not parallel.
fn midpoint(first: &Ray, second: &Ray) -> Point3<f64> {
    let between = second.origin_m - first.origin_m;
    let cosine = first.direction.dot(&second.direction);
    let (along_first, along_second) = (between.dot(&first.direction), between.dot(&second.direction));
    let scale = 1.0 / (1.0 - cosine * cosine);
    let s = (along_first - cosine * along_second) * scale;
    let t = (cosine * along_first - along_second) * scale;
    let on_first = first.origin_m + first.direction.into_inner() * s;
    let on_second = second.origin_m + second.direction.into_inner() * t;
    nalgebra::center(&on_first, &on_second)
}

fn gauss_newton(views: &[View], used: &[bool], start: Point3<f64>) -> (Point3<f64>, Matrix3<f64>) {
    let mut point = start;
    let mut normal = Matrix3::zeros();
    for _ in 0..STEPS {
        normal = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        for (view, _) in views.iter().zip(used).filter(|(_, used)| **used) {
            if let Some((pixel, jacobian)) = view.camera.project_with_jacobian(&point) {
                let weight = 1.0 / (view.sigma_px * view.sigma_px);
                normal += jacobian.transpose() * jacobian * weight;
                gradient += jacobian.transpose() * (view.pixel - pixel) * weight;
            }
        }
        let Some(step) = normal.cholesky().map(|factor| factor.solve(&gradient)) else { break };
        point += step;
        if step.norm() < 1e-9 {
            break;
        }
    }
    (point, normal)
}
