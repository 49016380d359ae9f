//! From wrist targets and trunk angles to every joint and frame.

use std::f64::consts::PI;

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, UnitVector3, Vector3};

use super::action::{Action, Displacement};
use super::keypoint::{KEYPOINT_COUNT, Keypoint};
use super::{BodyShape, WorkerParams};
use crate::smooth::soft_limit;

/// One hand: where it is and where the fingers hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandPose {
    /// Wrist frame in `world`: x along the fingers, z out of the back of the hand.
    pub world_from_hand: Isometry3<f64>,
    /// Point between thumb and forefinger, in `world`, metres.
    pub grip_m: Point3<f64>,
}

/// The worker at one instant. All points are in `world`, metres.
#[derive(Debug, Clone, PartialEq)]
pub struct WorkerPose {
    /// The body the pose belongs to.
    pub body: BodyShape,
    /// Joint centres in OpenPose-18 order.
    pub joints_m: [Point3<f64>; KEYPOINT_COUNT],
    /// The action under way.
    pub action: Action,
    /// Phase within the cycle of the action, `[0, 1)`.
    pub phase: f64,
    /// Pelvis frame (x forward, y left, z up), at the middle of the hips.
    pub world_from_pelvis: Isometry3<f64>,
    /// Chest frame, at the base of the neck.
    pub world_from_chest: Isometry3<f64>,
    /// Head frame, at the centre of the skull.
    pub world_from_head: Isometry3<f64>,
    /// The right hand.
    pub right_hand: HandPose,
    /// The left hand.
    pub left_hand: HandPose,
    /// Angle the fabric has been turned by, radians, growing with every flip.
    pub fabric_turn_rad: f64,
}

impl WorkerPose {
    /// Centre of one joint in `world`, metres.
    pub fn joint(&self, keypoint: Keypoint) -> Point3<f64> {
        self.joints_m[keypoint.index()]
    }
}

/// Elbow of a two-link arm. The wrist is first drawn in to 98 % of the reach where it lies beyond; returned is
/// `(elbow, wrist)`. The elbow lies on the circle about the line from shoulder to wrist, in the direction of
/// `pole`, turned by `swivel` (radians, right-handed) about that line.
fn two_link(
    shoulder: Point3<f64>,
    wrist: Point3<f64>,
    upper: f64,
    fore: f64,
    pole: Vector3<f64>,
    swivel: f64,
) -> (Point3<f64>, Point3<f64>) {
    let to_wrist = wrist - shoulder;
    let wanted = to_wrist.norm();
    let reach = upper + fore;
    let shortest = (upper - fore).abs() + 0.05 * reach;
    let along = to_wrist / wanted.max(1e-9);
    let distance = soft_limit(wanted, 0.94 * reach, 0.98 * reach).max(shortest);
    let foot = (distance * distance + upper * upper - fore * fore) / (2.0 * distance);
    let height = (upper * upper - foot * foot).max(0.0).sqrt();
    let side = pole - along * pole.dot(&along);
    let side = side / side.norm().max(1e-9);
    let turn = Rotation3::from_scaled_axis(along * swivel);
    let elbow = shoulder + along * foot + turn * side * height;
    (elbow, shoulder + along * distance)
}

/// Hand frame: fingers between the forearm's direction and `rest`, back of the hand upwards.
fn hand(elbow: Point3<f64>, wrist: Point3<f64>, length: f64, rest: Vector3<f64>, pitch: f64) -> HandPose {
    let forearm = (wrist - elbow) / (wrist - elbow).norm().max(1e-9);
    let rest = Vector3::new(rest.x, rest.y, rest.z + pitch);
    let mut x = 0.35 * forearm + 0.65 * rest / rest.norm().max(1e-9);
    x /= x.norm().max(1e-9);
    let up = Vector3::z() + 0.25 * Vector3::new(0.0, rest.y.signum(), 0.0);
    let mut z = up - x * up.dot(&x);
    z /= z.norm().max(1e-9);
    let y = z.cross(&x);
    let rotation = Rotation3::from_basis_unchecked(&[x, y, z]);
    let world_from_hand =
        Isometry3::from_parts(Translation3::from(wrist.coords), UnitQuaternion::from_rotation_matrix(&rotation));
    let grip_m = world_from_hand * Point3::new(0.86 * length, 0.0, -0.12 * length);
    HandPose { world_from_hand, grip_m }
}

/// Puts the whole worker together.
pub(super) fn assemble(
    p: &WorkerParams,
    action: Action,
    phase: f64,
    right: Vector3<f64>,
    left: Vector3<f64>,
    d: &Displacement,
    half_turns: f64,
) -> WorkerPose {
    let b = &p.body;
    let hip = Point3::from(p.hip_m);
    let trunk = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), d.twist)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -d.tilt)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), p.lean_rad + d.lean);
    let world_from_pelvis = Isometry3::translation(hip.x, hip.y, hip.z);
    let neck_base = hip + trunk * Vector3::new(0.0, 0.0, b.spine_m);
    let world_from_chest = Isometry3::from_parts(Translation3::from(neck_base.coords), trunk);

    // Collarbones turn about the breastbone; the shoulder centres hang a little below the base of the neck.
    let clavicle = |sign: f64, shrug: f64| {
        let root = Vector3::new(0.0, sign * 0.02, -0.045);
        let bone = Vector3::new(0.0, sign * (b.shoulder_half_width_m - 0.02), 0.0);
        let raise = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), sign * shrug);
        world_from_chest * Point3::from(root + raise * bone)
    };
    let right_shoulder = clavicle(-1.0, d.shrug);
    let left_shoulder = clavicle(1.0, 0.15 * d.shrug);

    let (right_elbow, right_wrist) = two_link(
        right_shoulder,
        Point3::from(p.right_home_m) + right,
        b.upper_arm_m,
        b.forearm_m,
        Vector3::new(-0.25, -0.75, -1.0),
        -0.1 - d.swivel,
    );
    let (left_elbow, left_wrist) = two_link(
        left_shoulder,
        Point3::from(p.left_home_m) + left,
        b.upper_arm_m,
        b.forearm_m,
        Vector3::new(-0.25, 0.75, -1.0),
        0.1,
    );
    let right_hand = hand(right_elbow, right_wrist, b.hand_m, Vector3::new(0.86, 0.38, -0.30), d.hand_pitch);
    let left_hand = hand(left_elbow, left_wrist, b.hand_m, Vector3::new(0.88, -0.35, -0.27), 0.0);

    // The head looks at the work: down, and a part of the way towards the right hand.
    let head_centre = neck_base + trunk * Vector3::new(0.025, 0.0, 0.155 * b.head_scale);
    let gaze = Point3::from(right_hand.grip_m.coords * 0.6 + left_hand.grip_m.coords * 0.4) - head_centre;
    let yaw = 0.8 * (gaze.y / gaze.x.max(0.05)).atan();
    let pitch = 0.62 * (-gaze.z / gaze.xy().norm().max(0.05)).atan();
    let look = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
        * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), pitch);
    let world_from_head = Isometry3::from_parts(Translation3::from(head_centre.coords), look);
    let face = |x: f64, y: f64, z: f64| world_from_head * Point3::from(Vector3::new(x, y, z) * b.head_scale);

    let hip_at = |sign: f64| hip + Vector3::new(0.0, sign * b.hip_half_width_m, 0.0);
    let knee_at = |sign: f64| {
        hip_at(sign) + b.thigh_m * UnitVector3::new_normalize(Vector3::new(0.985, sign * 0.17, -0.03)).into_inner()
    };
    let ankle_at =
        |sign: f64| knee_at(sign) + b.shin_m * UnitVector3::new_normalize(Vector3::new(-0.12, 0.0, -0.99)).into_inner();

    let joints_m = [
        face(0.118, 0.0, -0.022),
        nalgebra::center(&right_shoulder, &left_shoulder),
        right_shoulder,
        right_elbow,
        right_wrist,
        left_shoulder,
        left_elbow,
        left_wrist,
        hip_at(-1.0),
        knee_at(-1.0),
        ankle_at(-1.0),
        hip_at(1.0),
        knee_at(1.0),
        ankle_at(1.0),
        face(0.086, -0.032, 0.018),
        face(0.086, 0.032, 0.018),
        face(-0.004, -0.076, 0.0),
        face(-0.004, 0.076, 0.0),
    ];
    WorkerPose {
        body: *b,
        joints_m,
        action,
        phase,
        world_from_pelvis,
        world_from_chest,
        world_from_head,
        right_hand,
        left_hand,
        fabric_turn_rad: PI * half_turns,
    }
}
