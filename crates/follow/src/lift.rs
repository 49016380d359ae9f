//! From pixels of one or more cameras to joints in `world` metres.

use core::time::Duration;

use kin::{Camera, TriangulateOptions, View, triangulate};
use nalgebra::Point2;

use crate::error::Error;
use crate::sample::{ArmSample, Evidence, JointSample};

/// A joint in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelSample {
    /// Column, px, from the centre of the left column.
    pub u_px: f64,
    /// Row, px, from the centre of the top row.
    pub v_px: f64,
    /// Standard deviation along each axis, px.
    pub sigma_px: f64,
    /// Seen or bridged.
    pub evidence: Evidence,
}

/// The worker's arm in one picture; a lost joint is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ArmPixels {
    /// Shoulder centre.
    pub shoulder: Option<PixelSample>,
    /// Elbow centre.
    pub elbow: Option<PixelSample>,
    /// Wrist centre.
    pub wrist: Option<PixelSample>,
}

/// A horizontal plane of `world` on which a joint lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Height above the bench top, m.
    pub height_m: f64,
    /// How far the joint strays from it, m.
    pub sigma_m: f64,
}

/// How pixels become metres.
#[derive(Debug, Clone)]
pub enum Lift {
    /// One camera; shoulder, elbow and wrist lie on planes of their own.
    Planes {
        /// The camera.
        camera: Box<Camera>,
        /// Planes of shoulder, elbow and wrist.
        planes: [Plane; 3],
    },
    /// Two or more cameras; the rays are intersected, and a view that disagrees is left out.
    MultiView {
        /// The cameras, in the order of the pictures.
        cameras: Vec<Camera>,
    },
}

impl Lift {
    /// The cameras, in the order of the pictures.
    pub fn cameras(&self) -> &[Camera] {
        match self {
            Self::Planes { camera, .. } => core::slice::from_ref(&**camera),
            Self::MultiView { cameras } => cameras,
        }
    }

    /// Lifts the arm seen in one set of pictures, one entry per camera. A joint that cannot be lifted (lost, seen by too
    /// few cameras, or looking past its plane) is `None` in the sample.
    ///
    /// # Errors
    /// [`Error::ViewCount`] unless there is one entry per camera.
    pub fn lift(&self, captured: Duration, views: &[ArmPixels]) -> Result<ArmSample, Error> {
        if views.len() != self.cameras().len() {
            return Err(Error::ViewCount { got: views.len(), expected: self.cameras().len() });
        }
        let joint = |index: usize, pick: fn(&ArmPixels) -> Option<PixelSample>| match self {
            Self::Planes { camera, planes } => on_plane(camera, planes[index], pick(&views[0])?),
            Self::MultiView { cameras } => across_views(cameras, views, pick),
        };
        Ok(ArmSample {
            captured,
            shoulder: joint(0, |arm| arm.shoulder),
            elbow: joint(1, |arm| arm.elbow),
            wrist: joint(2, |arm| arm.wrist),
        })
    }
}

fn on_plane(camera: &Camera, plane: Plane, seen: PixelSample) -> Option<JointSample> {
    let pixel = Point2::new(seen.u_px, seen.v_px);
    // A ray that misses the plane, or meets it behind the camera, is a joint that is not where the plane says: lost.
    let lifted = camera.lift_to_plane(&pixel, seen.sigma_px, plane.height_m, plane.sigma_m).ok()?;
    Some(JointSample { position_m: lifted.point_m, covariance_m2: lifted.covariance_m2, evidence: seen.evidence })
}

fn across_views(
    cameras: &[Camera],
    views: &[ArmPixels],
    pick: fn(&ArmPixels) -> Option<PixelSample>,
) -> Option<JointSample> {
    let mut evidence = Vec::with_capacity(cameras.len());
    let mut rays = Vec::with_capacity(cameras.len());
    for (camera, arm) in cameras.iter().zip(views) {
        if let Some(seen) = pick(arm) {
            rays.push(View { camera, pixel: Point2::new(seen.u_px, seen.v_px), sigma_px: seen.sigma_px });
            evidence.push(seen.evidence);
        }
    }
    // Fewer than two views, parallel rays, or no two that agree: the joint is lost in this set.
    let found = triangulate(&rays, &TriangulateOptions::default()).ok()?;
    let measured = found.views.iter().zip(&evidence).filter(|(view, e)| view.used && **e == Evidence::Measured).count();
    Some(JointSample {
        position_m: found.point_m,
        covariance_m2: found.covariance_m2,
        evidence: if measured >= 2 { Evidence::Measured } else { Evidence::Inferred },
    })
}
