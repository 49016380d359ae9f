//! The fabric in the hands and, in training pictures, a second cloth over wrist and forearm.
//!
//! The sheet hangs from the point the right hand grips: within the length that the height allows it runs down a
//! steep cone with folds, beyond that it lies on the bench. Distances along the sheet are kept, so the fabric
//! neither stretches nor tears as the hand rises.

use super::body::v3;
use super::look::{Look, slot};
use super::material::lattice_noise;
use super::mesh::{Mesh, Part, V3};
use crate::worker::{Keypoint, WorkerPose};

/// Cells of the sheet along its sides.
const CELLS: [usize; 2] = [22, 14];
/// Gap between bench and cloth, metres: below 2 mm the two surfaces share depth-buffer steps.
const CLEARANCE_M: f32 = 0.003;

/// Adds the fabric.
pub(crate) fn add(mesh: &mut Mesh, pose: &WorkerPose, look: &Look) {
    let grip = v3(pose.right_hand.grip_m);
    let other = v3(pose.left_hand.grip_m);
    let yaw = pose.fabric_turn_rad as f32 + 0.35 * (other.x - grip.x) / (other.y - grip.y).abs().max(0.1);
    let [long, wide] = look.fabric_m;
    let height = (grip.z - 0.012).max(0.0);
    let steep = 0.35 + 1.1 * (height / 0.12).min(1.0);
    let (sin_steep, cos_steep) = steep.sin_cos();
    let slope_m = height / sin_steep;
    let (sin, cos) = yaw.sin_cos();
    let (columns, rows) = (CELLS[0] + 1, CELLS[1] + 1);
    let mut points = Vec::with_capacity(columns * rows);
    let swing = (height / 0.15).min(1.0);
    // Share of the long side that lies to the right of the grip. It passes to the other end in a half turn, so
    // that the sheet lies under both hands before and after.
    let held = 0.5 - 0.38 * (pose.fabric_turn_rad as f32).cos();
    for j in 0..rows {
        for i in 0..columns {
            let tex =
                V3::new((j as f32 / CELLS[1] as f32 - 0.5) * wide, (i as f32 / CELLS[0] as f32 - held) * long, 0.0);
            let flat = V3::new(cos * tex.x - sin * tex.y, sin * tex.x + cos * tex.y, 0.0);
            let distance = flat.norm().max(1e-5);
            let out = flat / distance;
            let angle = out.y.atan2(out.x);
            let fold = (4.0 * angle + yaw).sin() + 0.5 * (7.0 * angle + 1.3).sin();
            let (reach, z) = if distance < slope_m {
                let sunk = distance / slope_m.max(1e-5);
                (distance * cos_steep, height * (1.0 - sunk))
            } else {
                (slope_m * cos_steep + (distance - slope_m), 0.0)
            };
            let folded = 0.10 * swing * fold * distance.min(slope_m);
            let wrinkle = 0.006 * lattice_noise(tex * 28.0 + V3::new(3.0, 7.0, yaw)) * (0.4 + swing);
            let side = V3::new(-out.y, out.x, 0.0);
            let mut at = V3::new(grip.x, grip.y, 0.0) + out * reach + side * folded;
            at.z = z.max(0.0) + CLEARANCE_M + wrinkle;
            points.push((at, tex));
        }
    }
    soften(&mut points, columns);
    mesh.cloth(Part::Fabric, slot::FABRIC, columns, &points);
    if let Some(half) = look.cover_m {
        cover(mesh, pose, look, half);
    }
}

/// One smoothing pass over heights and places, so that the foot of the cone is rounded.
fn soften(points: &mut [(V3, V3)], columns: usize) {
    let before: Vec<V3> = points.iter().map(|p| p.0).collect();
    let rows = before.len() / columns;
    for j in 1..rows.saturating_sub(1) {
        for i in 1..columns - 1 {
            let k = j * columns + i;
            let around = before[k - 1] + before[k + 1] + before[k - columns] + before[k + columns];
            points[k].0 = before[k] * 0.4 + around * 0.15;
        }
    }
}

/// A cloth thrown over the right forearm and hand: the envelope of cones of slope 1.1 over points of the arm.
fn cover(mesh: &mut Mesh, pose: &WorkerPose, look: &Look, half: [f32; 2]) {
    let elbow = v3(pose.joint(Keypoint::RightElbow));
    let wrist = v3(pose.joint(Keypoint::RightWrist));
    let tip = v3(pose.right_hand.grip_m);
    let along_arm = |s: f32| {
        if s < 1.0 { elbow + (wrist - elbow) * s } else { wrist + (tip - wrist) * (s - 1.0) }
    };
    let centre = along_arm(look.cover_at);
    let props: Vec<(V3, f32)> = (0..=24)
        .map(|k| {
            let s = k as f32 / 12.0;
            (along_arm(s), if s < 1.0 { 0.052 - 0.014 * s } else { 0.038 - 0.016 * (s - 1.0) })
        })
        .collect();
    let direction = wrist - elbow;
    let yaw = direction.y.atan2(direction.x) + look.cover_at;
    let (sin, cos) = yaw.sin_cos();
    let (columns, rows) = (17, 17);
    let mut points = Vec::with_capacity(columns * rows);
    for j in 0..rows {
        for i in 0..columns {
            let tex = V3::new((j as f32 / 8.0 - 1.0) * half[0], (i as f32 / 8.0 - 1.0) * half[1], 0.0);
            let mut at = centre + V3::new(cos * tex.x - sin * tex.y, sin * tex.x + cos * tex.y, 0.0);
            let mut z = 0.0_f32;
            for (p, r) in &props {
                let gap = ((p - at).xy().norm() - r).max(0.0);
                z = z.max(p.z + r - 1.1 * gap);
            }
            at.z = z + CLEARANCE_M + 0.008 * lattice_noise(tex * 22.0 + V3::new(yaw, 1.0, 5.0));
            points.push((at, tex));
        }
    }
    soften(&mut points, columns);
    mesh.cloth(Part::Fabric, slot::FABRIC_BACK, columns, &points);
}
