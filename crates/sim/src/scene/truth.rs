//! Ground truth of a rendered picture.

use kin::Camera;
use nalgebra::{Point2, Point3};

use super::mesh::{Part, Triangle};
use super::raster::{Buffer, Window};
use crate::worker::{KEYPOINT_COUNT, Keypoint, WorkerPose};

/// Whether a keypoint can be seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// Outside the picture or behind the camera.
    OutOfView,
    /// Inside the picture, behind something.
    Occluded,
    /// Inside the picture, nothing but its own body part before it.
    Visible,
}

impl Visibility {
    /// COCO's flag: 0 not in the picture, 1 hidden, 2 visible.
    pub fn coco_flag(self) -> u8 {
        match self {
            Self::OutOfView => 0,
            Self::Occluded => 1,
            Self::Visible => 2,
        }
    }
}

/// Where the worker truly is in a picture. Arrays are in OpenPose-18 order.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundTruth {
    /// Joint centres in `world`, metres.
    pub points_m: [Point3<f64>; KEYPOINT_COUNT],
    /// Joint centres in the picture (pixel centres at integers); `None` behind the camera. May lie outside.
    pub points_px: [Option<Point2<f64>>; KEYPOINT_COUNT],
    /// Visibility by depth test.
    pub visibility: [Visibility; KEYPOINT_COUNT],
    /// Smallest box about the visible pixels of the worker: left, top, width, height in pixels.
    pub box_px: Option<[f64; 4]>,
    /// Number of pixels on which the worker is seen.
    pub area_px: f64,
}

impl GroundTruth {
    /// Pixel of one keypoint, if it is inside the picture.
    pub fn pixel(&self, keypoint: Keypoint) -> Option<Point2<f64>> {
        let k = keypoint.index();
        (self.visibility[k] != Visibility::OutOfView).then_some(self.points_px[k]).flatten()
    }
}

/// Parts that may lie before a keypoint without hiding it, and how deep under their surface it sits (metres).
fn own_parts(keypoint: Keypoint) -> ([Part; 3], f64) {
    use Part::{
        Hair, Head, LeftForearm, LeftHand, LeftShin, LeftThigh, LeftUpperArm, RightForearm, RightHand, RightShin,
        RightThigh, RightUpperArm, Torso,
    };
    match keypoint {
        Keypoint::Nose | Keypoint::RightEye | Keypoint::LeftEye => ([Head, Head, Head], 0.03),
        Keypoint::RightEar | Keypoint::LeftEar => ([Head, Hair, Head], 0.045),
        Keypoint::Neck => ([Torso, Head, Hair], 0.16),
        Keypoint::RightShoulder => ([Torso, RightUpperArm, RightUpperArm], 0.13),
        Keypoint::LeftShoulder => ([Torso, LeftUpperArm, LeftUpperArm], 0.13),
        Keypoint::RightElbow => ([RightUpperArm, RightForearm, RightForearm], 0.095),
        Keypoint::LeftElbow => ([LeftUpperArm, LeftForearm, LeftForearm], 0.095),
        Keypoint::RightWrist => ([RightForearm, RightHand, RightHand], 0.075),
        Keypoint::LeftWrist => ([LeftForearm, LeftHand, LeftHand], 0.075),
        Keypoint::RightHip => ([Torso, RightThigh, RightThigh], 0.19),
        Keypoint::LeftHip => ([Torso, LeftThigh, LeftThigh], 0.19),
        Keypoint::RightKnee => ([RightThigh, RightShin, RightShin], 0.12),
        Keypoint::LeftKnee => ([LeftThigh, LeftShin, LeftShin], 0.12),
        Keypoint::RightAnkle => ([RightShin; 3], 0.12),
        Keypoint::LeftAnkle => ([LeftShin; 3], 0.12),
    }
}

/// Compares every joint with the surface drawn at its pixel.
pub(super) fn examine(
    camera: &Camera,
    pose: &WorkerPose,
    buffer: &Buffer,
    drawn: Window,
    triangles: &[Triangle],
) -> GroundTruth {
    let girth = pose.body.girth.max(1.0);
    let mut points_px = [None; KEYPOINT_COUNT];
    let mut visibility = [Visibility::OutOfView; KEYPOINT_COUNT];
    for keypoint in Keypoint::ALL {
        let k = keypoint.index();
        let point = pose.joint(keypoint);
        let Some(pixel) = camera.project(&point) else {
            continue;
        };
        points_px[k] = Some(pixel);
        if !camera.sees(&pixel) {
            continue;
        }
        let depth = (camera.camera_from_world * point).z;
        let column = (2.0 * pixel.x + 0.5).round().clamp(0.0, buffer.width as f64 - 1.0) as usize;
        let row = (2.0 * pixel.y + 0.5).round().clamp(0.0, buffer.height as f64 - 1.0) as usize;
        let index = row * buffer.width + column;
        let surface = 1.0 / f64::from(buffer.near[index]);
        let above = depth - surface;
        let (own, slack) = own_parts(keypoint);
        let part = match buffer.owner[index] {
            0 => Part::Background,
            owner => triangles[owner as usize - 1].part,
        };
        let allowed = if own.contains(&part) { slack * girth } else { 0.005 };
        visibility[k] =
            if above <= allowed || !surface.is_finite() { Visibility::Visible } else { Visibility::Occluded };
    }
    // The neck is the middle of the shoulders and counts as seen when both are.
    let seen = |k: Keypoint| visibility[k.index()] == Visibility::Visible;
    let both = seen(Keypoint::RightShoulder) && seen(Keypoint::LeftShoulder);
    let neck = &mut visibility[Keypoint::Neck.index()];
    if *neck != Visibility::OutOfView {
        *neck = if both { Visibility::Visible } else { Visibility::Occluded };
    }
    let (box_px, area_px) = outline(buffer, drawn, triangles);
    GroundTruth { points_m: pose.joints_m, points_px, visibility, box_px, area_px }
}

fn outline(buffer: &Buffer, drawn: Window, triangles: &[Triangle]) -> (Option<[f64; 4]>, f64) {
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    let mut samples = 0_u32;
    for row in drawn.top..drawn.bottom {
        let start = row * buffer.width;
        let owners = &buffer.owner[start + drawn.left..start + drawn.right.max(drawn.left)];
        let mut found = false;
        for (column, &owner) in (drawn.left..).zip(owners) {
            if owner > 0 && triangles[owner as usize - 1].part.is_body() {
                left = left.min(column);
                right = right.max(column);
                samples += 1;
                found = true;
            }
        }
        if found {
            top = top.min(row);
            bottom = row;
        }
    }
    let area_px = f64::from(samples) / 4.0;
    if samples == 0 {
        return (None, area_px);
    }
    let pixel = |sample: usize| (sample / 2) as f64;
    let (x, y) = (pixel(left), pixel(top));
    (Some([x, y, pixel(right) - x + 1.0, pixel(bottom) - y + 1.0]), area_px)
}
