//! The worker's body as tubes and blobs.

use nalgebra::{Isometry3, Point3};

use super::look::{HairCut, Look, slot};
use super::mesh::{Mesh, Part, Ring, V3, unit};
use crate::worker::{HandPose, Keypoint, WorkerPose};

pub(crate) fn v3(p: Point3<f64>) -> V3 {
    p.coords.cast()
}

/// One station of a limb: centre, radius, part, material.
#[derive(Clone, Copy)]
struct Station {
    centre: V3,
    radius: f32,
    part: Part,
    material: u8,
}

/// Turns stations into rings perpendicular to the path, carrying the first frame along without twist.
fn rings(stations: &[Station]) -> Vec<Ring> {
    let mut side = V3::new(0.31, 0.72, 0.17);
    let mut along = 0.0;
    let last = stations.len() - 1;
    (0..stations.len())
        .map(|k| {
            let tangent = unit(stations[(k + 1).min(last)].centre - stations[k.saturating_sub(1)].centre);
            side = unit(side - tangent * side.dot(&tangent));
            if k > 0 {
                along += (stations[k].centre - stations[k - 1].centre).norm();
            }
            Ring {
                centre: stations[k].centre,
                a: side * stations[k].radius,
                b: tangent.cross(&side) * stations[k].radius,
                along,
                material: stations[k].material,
                part: stations[k].part,
            }
        })
        .collect()
}

/// A limb of two bones with a rounded middle joint. `profile` lists `(place, radius)`: place 0 to 1 on the first
/// bone, 1 to 2 on the second.
struct Limb<'a> {
    joints: [V3; 3],
    parts: [Part; 2],
    profile: &'a [(f32, f32)],
    girth: f32,
    /// Share of the limb that is clothed, and by which material.
    clothed: f32,
    cloth: u8,
    loose_m: f32,
}

fn limb(mesh: &mut Mesh, l: &Limb) {
    let [p, q, r] = l.joints;
    let on_path = |place: f32| {
        // Quadratic corner of half width 0.15 bone lengths about the middle joint.
        let w = 0.15;
        if place < 1.0 - w {
            p + (q - p) * place
        } else if place > 1.0 + w {
            q + (r - q) * (place - 1.0)
        } else {
            let s = (place - (1.0 - w)) / (2.0 * w);
            let (a, b) = (q + (p - q) * w, q + (r - q) * w);
            (a * (1.0 - s) + q * s) * (1.0 - s) + (q * (1.0 - s) + b * s) * s
        }
    };
    let mut stations: Vec<Station> = Vec::with_capacity(l.profile.len() + 2);
    let hem = 2.0 * l.clothed;
    let mut bare = l.clothed <= 0.0;
    for &(place, radius) in l.profile {
        let part = if place < 1.0 { l.parts[0] } else { l.parts[1] };
        let station = |place: f32, radius: f32, material: u8| Station {
            centre: on_path(place),
            radius: radius * l.girth,
            part,
            material,
        };
        if !bare && place > hem {
            // The hem: cloth ends, skin begins.
            stations.push(station(hem, radius + l.loose_m * 1.3, slot::SKIN));
            stations.push(station(hem + 0.004, radius, slot::SKIN));
            bare = true;
        }
        if bare {
            stations.push(station(place, radius, slot::SKIN));
        } else {
            stations.push(station(place, radius + l.loose_m, l.cloth));
        }
    }
    mesh.tube(&rings(&stations), 12);
}

const ARM: [(f32, f32); 13] = [
    (-0.13, 0.030),
    (-0.09, 0.046),
    (-0.02, 0.055),
    (0.12, 0.057),
    (0.35, 0.050),
    (0.65, 0.045),
    (0.88, 0.041),
    (1.0, 0.041),
    (1.12, 0.043),
    (1.35, 0.044),
    (1.65, 0.036),
    (1.9, 0.028),
    (2.04, 0.026),
];

const LEG: [(f32, f32); 10] = [
    (-0.08, 0.075),
    (0.02, 0.092),
    (0.4, 0.082),
    (0.8, 0.064),
    (0.95, 0.058),
    (1.05, 0.057),
    (1.3, 0.056),
    (1.6, 0.046),
    (1.9, 0.038),
    (2.02, 0.036),
];

/// Place along the spine, half width, half depth and forward shift of the trunk.
const TRUNK: [[f32; 4]; 12] = [
    [-0.20, 0.120, 0.090, 0.0],
    [-0.14, 0.168, 0.125, 0.0],
    [0.0, 0.172, 0.130, 0.004],
    [0.2, 0.152, 0.116, 0.010],
    [0.42, 0.150, 0.112, 0.010],
    [0.62, 0.162, 0.118, 0.006],
    [0.78, 0.168, 0.116, 0.0],
    [0.86, 0.165, 0.104, -0.004],
    [0.93, 0.138, 0.086, -0.006],
    [0.98, 0.092, 0.070, -0.004],
    [1.02, 0.062, 0.060, 0.0],
    [1.035, 0.054, 0.054, 0.0],
];

fn trunk(mesh: &mut Mesh, pose: &WorkerPose, look: &Look) {
    let b = &pose.body;
    let wide = (b.shoulder_half_width_m / 0.18) as f32;
    let (girth, spine) = (b.girth as f32, b.spine_m as f32);
    let upright = pose.world_from_pelvis.rotation;
    let hip = pose.world_from_pelvis.translation.vector;
    let rings: Vec<Ring> = TRUNK
        .iter()
        .map(|&[place, w, d, forward]| {
            let blend = f64::from((place / 0.35).clamp(0.0, 1.0));
            let turn = upright.slerp(&pose.world_from_chest.rotation, blend);
            let frame =
                Isometry3::from_parts(hip.into(), if place > 0.35 { pose.world_from_chest.rotation } else { turn });
            let top = (place / 0.9).clamp(0.0, 1.0);
            let w = w * (girth + (wide - girth) * top) + look.loose_m * 0.5;
            let d = d * (girth + (1.0 - girth) * 0.3 * top) + look.loose_m * 0.7;
            let centre = v3(frame * Point3::new(f64::from(forward), 0.0, f64::from(place * spine)));
            let axis = |x: f64, y: f64| (frame.rotation * nalgebra::Vector3::new(x, y, 0.0)).cast::<f32>();
            Ring {
                centre,
                a: axis(0.0, 1.0) * w,
                b: axis(1.0, 0.0) * d,
                along: place * spine,
                material: slot::SHIRT,
                part: Part::Torso,
            }
        })
        .collect();
    mesh.tube(&rings, 20);
}

/// A blob with half axes `radii` about `centre` in the frame.
fn ellipsoid(
    mesh: &mut Mesh,
    frame: &Isometry3<f32>,
    (part, material): (Part, u8),
    centre: V3,
    radii: V3,
    detail: (u32, u32),
) {
    mesh.blob(part, material, detail, |p| {
        let local = centre + p.component_mul(&radii);
        ((frame * Point3::from(local)).coords, local)
    });
}

fn hand(mesh: &mut Mesh, hand: &HandPose, part: Part, length: f32, thumb_side: f32) {
    let frame = hand.world_from_hand.cast::<f32>();
    let s = length / 0.18;
    let place = |x: f32, y: f32, z: f32| (frame * Point3::new(x * s, y * s, z * s)).coords;
    mesh.blob(part, slot::SKIN, (10, 8), |p| {
        // Boxy palm: the fourth power rounds the corners less than a sphere does.
        let boxy = p.map(|c| c.signum() * c.abs().powf(0.7));
        let local = V3::new(0.052 + 0.052 * boxy.x, 0.040 * boxy.y * (1.0 + 0.1 * boxy.x), 0.016 * boxy.z - 0.002);
        (place(local.x, local.y, local.z), local)
    });
    let finger = |mesh: &mut Mesh, points: [V3; 4], radius: f32| {
        let stations: Vec<Station> = points
            .iter()
            .zip([1.0, 1.0, 0.9, 0.55])
            .map(|(&centre, k)| Station { centre, radius: radius * k * s, part, material: slot::SKIN })
            .collect();
        mesh.tube(&rings(&stations), 6);
    };
    for (k, reach) in [0.155, 0.175, 0.180, 0.165].into_iter().enumerate() {
        let y = -(thumb_side * (0.030 - 0.020 * k as f32));
        let reach = if k == 0 { 0.150 } else { reach };
        let points = [
            place(0.085, y, 0.0),
            place(0.085 + 0.45 * (reach - 0.085), y * 1.05, 0.002),
            place(0.085 + 0.85 * (reach - 0.085), y * 1.0, -0.016),
            place(reach - 0.008, y * 0.95, -0.030),
        ];
        finger(mesh, points, 0.0095);
    }
    let points = [
        place(0.018, thumb_side * 0.026, -0.004),
        place(0.062, thumb_side * 0.052, -0.012),
        place(0.095, thumb_side * 0.052, -0.022),
        place(0.118, thumb_side * 0.046, -0.027),
    ];
    finger(mesh, points, 0.0115);
}

fn head(mesh: &mut Mesh, pose: &WorkerPose, look: &Look) {
    let frame = pose.world_from_head.cast::<f32>();
    let s = pose.body.head_scale as f32;
    let neck = |p: Point3<f32>| (frame * p).coords;
    let base = pose.world_from_chest.cast::<f32>() * Point3::new(-0.004, 0.0, -0.035);
    let stations = [
        (base.coords, 0.060),
        ((base.coords * 2.0 + neck(Point3::new(-0.03 * s, 0.0, -0.07 * s))) / 3.0, 0.052),
        (neck(Point3::new(-0.028 * s, 0.0, -0.075 * s)), 0.052),
        (neck(Point3::new(-0.02 * s, 0.0, -0.03 * s)), 0.050),
    ]
    .map(|(centre, radius)| Station {
        centre,
        radius: radius * (0.5 + 0.5 * pose.body.girth as f32),
        part: Part::Head,
        material: slot::SKIN,
    });
    mesh.tube(&rings(&stations), 12);

    // Skull and jaw: x forward, the lower half narrows and its back recedes.
    let skull = |p: V3, grow: f32| {
        let low = (-p.z).max(0.0);
        let narrow = 1.0 - 0.30 * low * low.sqrt();
        let recede = if p.x < 0.0 { 1.0 - 0.45 * low } else { 1.0 };
        V3::new(0.099 * p.x * recede * (1.0 - 0.1 * low) + 0.014 * low, 0.077 * p.y * narrow, 0.120 * p.z) * (s * grow)
    };
    mesh.blob(Part::Head, slot::SKIN, (20, 14), |p| {
        let local = skull(p, 1.0);
        ((frame * Point3::from(local)).coords, local)
    });
    let mut feature = |kind: (Part, u8), centre: [f32; 3], radii: [f32; 3], detail: (u32, u32)| {
        ellipsoid(mesh, &frame, kind, V3::from(centre) * s, V3::from(radii) * s, detail);
    };
    feature((Part::Head, slot::SKIN), [0.101, 0.0, -0.020], [0.021, 0.0135, 0.018], (8, 6));
    feature((Part::Head, slot::SKIN), [0.092, 0.0, 0.0], [0.014, 0.0095, 0.030], (8, 6));
    feature((Part::Head, slot::LIPS), [0.086, 0.0, -0.060], [0.013, 0.023, 0.0065], (8, 6));
    for side in [-1.0, 1.0] {
        feature((Part::Head, slot::EYE_WHITE), [0.0785, side * 0.032, 0.017], [0.012, 0.0155, 0.0085], (8, 6));
        feature((Part::Head, slot::IRIS), [0.0845, side * 0.031, 0.016], [0.0075, 0.0078, 0.0078], (8, 6));
        feature((Part::Head, slot::HAIR), [0.0835, side * 0.033, 0.036], [0.010, 0.020, 0.0045], (8, 5));
        feature((Part::Head, slot::SKIN), [-0.004, side * 0.077, 0.0], [0.019, 0.011, 0.031], (8, 6));
    }
    hair(mesh, &frame, s, look.hair, skull);
}

fn hair(mesh: &mut Mesh, frame: &Isometry3<f32>, s: f32, cut: HairCut, skull: impl Fn(V3, f32) -> V3) {
    let (line, thick) = match cut {
        HairCut::Bald => return,
        HairCut::Short | HairCut::Bun => (0.16, 1.09),
        HairCut::Long => (0.10, 1.13),
        HairCut::Cap => (0.34, 1.12),
    };
    mesh.blob(Part::Hair, slot::HAIR, (24, 18), |p| {
        // Above the hairline the shell lies outside the skull, below it vanishes inside.
        let over = p.z - line - 0.42 * p.x + if p.x < 0.1 { 0.25 * (0.1 - p.x) } else { 0.0 };
        let share = (over / 0.12 + 0.5).clamp(0.0, 1.0);
        let grow = 0.9 + (thick - 0.9) * share * share * (3.0 - 2.0 * share);
        let local = skull(p, grow);
        ((frame * Point3::from(local)).coords, local)
    });
    let mut extra = |centre: [f32; 3], radii: [f32; 3]| {
        ellipsoid(mesh, frame, (Part::Hair, slot::HAIR), V3::from(centre) * s, V3::from(radii) * s, (12, 10));
    };
    match cut {
        HairCut::Long => extra([-0.055, 0.0, -0.075], [0.062, 0.088, 0.135]),
        HairCut::Bun => extra([-0.115, 0.0, 0.055], [0.042, 0.045, 0.042]),
        HairCut::Cap => extra([0.105, 0.0, 0.058], [0.055, 0.062, 0.008]),
        HairCut::Bald | HairCut::Short => {}
    }
}

/// Adds the whole worker.
pub(crate) fn add(mesh: &mut Mesh, pose: &WorkerPose, look: &Look) {
    let at = |k: Keypoint| v3(pose.joint(k));
    let girth = pose.body.girth as f32;
    let limb_girth = 0.5 + 0.5 * girth;
    trunk(mesh, pose, look);
    let arms = [
        (
            [Keypoint::RightShoulder, Keypoint::RightElbow, Keypoint::RightWrist],
            [Part::RightUpperArm, Part::RightForearm],
        ),
        ([Keypoint::LeftShoulder, Keypoint::LeftElbow, Keypoint::LeftWrist], [Part::LeftUpperArm, Part::LeftForearm]),
    ];
    for (joints, parts) in arms {
        limb(
            mesh,
            &Limb {
                joints: joints.map(at),
                parts,
                profile: &ARM,
                girth: limb_girth,
                clothed: look.sleeve,
                cloth: slot::SHIRT,
                loose_m: look.loose_m,
            },
        );
    }
    let legs = [
        ([Keypoint::RightHip, Keypoint::RightKnee, Keypoint::RightAnkle], [Part::RightThigh, Part::RightShin]),
        ([Keypoint::LeftHip, Keypoint::LeftKnee, Keypoint::LeftAnkle], [Part::LeftThigh, Part::LeftShin]),
    ];
    for (joints, parts) in legs {
        limb(
            mesh,
            &Limb {
                joints: joints.map(at),
                parts,
                profile: &LEG,
                girth: limb_girth,
                clothed: 1.0,
                cloth: slot::TROUSERS,
                loose_m: look.loose_m,
            },
        );
        let foot = Isometry3::from_parts(at(joints[2]).into(), nalgebra::UnitQuaternion::identity());
        ellipsoid(mesh, &foot, (parts[1], slot::SHOE), V3::new(0.06, 0.0, -0.04), V3::new(0.13, 0.048, 0.042), (10, 8));
    }
    let length = pose.body.hand_m as f32;
    hand(mesh, &pose.right_hand, Part::RightHand, length, 1.0);
    hand(mesh, &pose.left_hand, Part::LeftHand, length, -1.0);
    head(mesh, pose, look);
}

/// Spheres that stand for the body where soft light is blocked: centre and radius.
pub(crate) fn blockers(pose: &WorkerPose, spheres: &mut Vec<(V3, f32)>) {
    let at = |k: Keypoint| v3(pose.joint(k));
    let girth = pose.body.girth as f32;
    spheres.clear();
    let arms = [
        [Keypoint::RightShoulder, Keypoint::RightElbow, Keypoint::RightWrist],
        [Keypoint::LeftShoulder, Keypoint::LeftElbow, Keypoint::LeftWrist],
    ];
    for arm in arms {
        let [s, e, w] = arm.map(at);
        spheres.extend([
            ((s + e) * 0.5, 0.055 * girth),
            (e, 0.047 * girth),
            ((e + w) * 0.5, 0.042 * girth),
            (w, 0.034),
        ]);
    }
    for hand in [&pose.right_hand, &pose.left_hand] {
        let tip = v3(hand.grip_m);
        let wrist = hand.world_from_hand.translation.vector.cast::<f32>();
        spheres.push((wrist * 0.45 + tip * 0.55, 0.036));
    }
    spheres.push((v3(Point3::from(pose.world_from_head.translation.vector)), 0.10));
    let hip = pose.world_from_pelvis.translation.vector.cast::<f32>();
    let neck = pose.world_from_chest.translation.vector.cast::<f32>();
    for share in [0.1, 0.4, 0.7] {
        spheres.push((hip + (neck - hip) * share, 0.145 * girth));
    }
}
