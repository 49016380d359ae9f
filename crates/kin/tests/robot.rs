//! Robots from URDF: what is read, what is refused, and where the links are.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::disallowed_methods,
    reason = "tests: a panic is a failure, exact values are meant"
)]

use kin::{Error, Geometry, JointKind, LimitKind, LimitPolicy, Robot, UrdfOptions, builtin_arm_urdf};
use nalgebra::{Matrix4, Vector3};
use proptest::prelude::*;

fn read(text: &str) -> Result<Robot, Error> {
    Robot::from_urdf_str(text, &UrdfOptions::default())
}

/// Homogeneous transform from first principles (URDF: R = Rz(yaw) Ry(pitch) Rx(roll)); no code of the crate.
fn homogeneous(xyz: [f64; 3], rpy: [f64; 3]) -> Matrix4<f64> {
    let [(sr, cr), (sp, cp), (sy, cy)] = rpy.map(f64::sin_cos);
    let rz = Matrix4::new(cy, -sy, 0., 0., sy, cy, 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.);
    let ry = Matrix4::new(cp, 0., sp, 0., 0., 1., 0., 0., -sp, 0., cp, 0., 0., 0., 0., 1.);
    let rx = Matrix4::new(1., 0., 0., 0., 0., cr, -sr, 0., 0., sr, cr, 0., 0., 0., 0., 1.);
    let mut result = rz * ry * rx;
    for row in 0..3 {
        result[(row, 3)] = xyz[row];
    }
    result
}

#[test]
fn the_built_in_arm_has_six_limited_joints_and_850_mm_reach() {
    let robot = Robot::builtin();
    assert_eq!(robot.dof_names(), ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6"]);
    let names: Vec<&str> = robot.links().iter().map(|link| link.name.as_str()).collect();
    assert_eq!(names, ["base_link", "link_1", "link_2", "link_3", "link_4", "link_5", "link_6", "flange", "tool0"]);
    for joint in robot.dof_joints() {
        assert_eq!(joint.kind, JointKind::Revolute);
        assert!(joint.limits.velocity > 0.0 && joint.limits.effort > 0.0 && joint.damping > 0.0);
    }
    // Stretched out, the first wrist axis is 850 mm in front of the shoulder axis.
    let q = [0.0; 6];
    let shoulder = robot.link_transform("link_2", &q).unwrap();
    let wrist = robot.link_transform("link_4", &q).unwrap();
    assert!((wrist.translation.x - shoulder.translation.x - 0.850).abs() < 1e-12);
    let mass_kg: f64 = robot.links().iter().filter_map(|link| link.inertial).map(|i| i.mass_kg).sum();
    assert!((mass_kg - 21.5).abs() < 1e-9, "{mass_kg}");
}

#[test]
fn positive_angles_of_joints_2_3_4_raise_the_built_in_arm() {
    let robot = Robot::builtin();
    // Upper arm 30 degrees up, forearm a further 20: height by hand.
    let (a, b) = (30f64.to_radians(), 50f64.to_radians());
    let q = [0.0, a, 20f64.to_radians(), 0.0, 0.0, 0.0];
    let wrist = robot.link_transform("link_4", &q).unwrap();
    assert!((wrist.translation.z - (0.140 + 0.450 * a.sin() + 0.400 * b.sin())).abs() < 1e-12);
    assert!((wrist.translation.x - (0.450 * a.cos() + 0.400 * b.cos())).abs() < 1e-12);
    // Tool straight down when the three pitches sum to -90 degrees; tool0 z points out of the flange.
    let q = [0.4, 1.0, -1.5, -std::f64::consts::FRAC_PI_2 + 0.5, 0.0, 0.7];
    let tool = robot.link_transform("tool0", &q).unwrap();
    assert!((tool.rotation * Vector3::z() + Vector3::z()).norm() < 1e-12);
}

#[test]
fn the_inertia_of_a_built_in_link_is_that_of_its_cylinder() {
    // link_6 is one cylinder along x: 0.3 kg, r = 36 mm, l = 30 mm.
    let inertial = Robot::builtin().link("link_6").unwrap().inertial.unwrap();
    let (m, r, l) = (0.3, 0.036f64, 0.030f64);
    assert!((inertial.inertia_kg_m2[(0, 0)] - m * r * r / 2.0).abs() < 1e-8);
    assert!((inertial.inertia_kg_m2[(1, 1)] - m * (3.0 * r * r + l * l) / 12.0).abs() < 1e-8);
}

#[test]
fn visuals_carry_shape_place_and_colour() {
    let robot = Robot::builtin();
    let link = robot.link("link_2").unwrap();
    assert_eq!(link.visuals.len(), 3);
    assert_eq!(link.visuals[1].geometry, Geometry::Cylinder { radius_m: 0.047, length_m: 0.45 });
    assert_eq!(link.visuals[1].rgba, Some([0.55, 0.57, 0.60, 1.0]));
    // The cylinder's own z lies along the link's x.
    let along = link.visuals[1].link_from_shape.rotation * Vector3::z();
    assert!((along - Vector3::x()).norm() < 1e-12);
}

proptest! {
    #[test]
    fn link_transforms_equal_a_product_of_plain_matrices(q in prop::array::uniform6(-3.0..3.0f64)) {
        let robot = Robot::builtin();
        let all = robot.link_transforms(&q).unwrap();
        let raw = urdf_rs::read_from_string(builtin_arm_urdf()).unwrap();
        let mut expected = Matrix4::identity();
        let mut next = 0;
        for joint in &raw.joints {
            expected *= homogeneous(joint.origin.xyz.0, joint.origin.rpy.0);
            if joint.joint_type == urdf_rs::JointType::Revolute {
                // The axes of this arm are coordinate axes, so rotation vectors are roll, pitch or yaw.
                expected *= homogeneous([0.0; 3], joint.axis.xyz.0.map(|a| a * q[next]));
                next += 1;
            }
            let id = robot.link_id(&joint.child.link).unwrap();
            prop_assert!((all[id.index()].to_homogeneous() - expected).norm() < 1e-12);
            let single = robot.link_transform(&joint.child.link, &q).unwrap();
            prop_assert!((single.to_homogeneous() - expected).norm() < 1e-12);
        }
    }
}

fn two_links(joint: &str) -> String {
    format!(r#"<robot name="r"><link name="a"/><link name="b"/><link name="c"/>{joint}</robot>"#)
}

const LIMIT: &str = r#"<limit lower="-1" upper="1" effort="5" velocity="2"/>"#;

fn joint(name: &str, kind: &str, parent: &str, child: &str, inside: &str) -> String {
    format!(r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>"#)
}

fn limit_error(limit: &str) -> (LimitKind, String) {
    let text = two_links(&(joint("elbow", "revolute", "a", "b", limit) + &joint("j2", "fixed", "b", "c", "")));
    let error = read(&text).unwrap_err();
    let message = error.to_string();
    match error {
        Error::UrdfLimit { kind, joint, .. } if joint == "elbow" => (kind, message),
        other => panic!("{other}"),
    }
}

#[test]
fn a_moving_joint_without_limits_is_refused_by_name() {
    assert_eq!(limit_error("").0, LimitKind::Position);
    assert_eq!(limit_error(r#"<limit effort="5" velocity="2"/>"#).0, LimitKind::Position);
    assert_eq!(limit_error(r#"<limit lower="-1" upper="1" velocity="2"/>"#).0, LimitKind::Effort);
    let (kind, message) = limit_error(r#"<limit lower="-1" upper="1" effort="5" velocity="0"/>"#);
    assert_eq!(kind, LimitKind::Velocity);
    assert!(message.contains("elbow") && message.contains("velocity"), "{message}");
    let (kind, _) = limit_error(r#"<limit lower="NaN" upper="1" effort="5" velocity="1"/>"#);
    assert_eq!(kind, LimitKind::Position);
}

#[test]
fn missing_limits_can_be_allowed_on_purpose() {
    let text = two_links(&(joint("j", "revolute", "a", "b", "") + &joint("k", "fixed", "b", "c", "")));
    let robot = Robot::from_urdf_str(&text, &UrdfOptions::default().limits(LimitPolicy::AllowMissing)).unwrap();
    let limits = robot.joint("j").unwrap().limits;
    assert!(limits.lower.is_infinite() && limits.velocity.is_infinite() && limits.effort.is_infinite());
}

#[test]
fn broken_trees_are_refused() {
    let fixed = |name: &str, parent: &str, child: &str| joint(name, "fixed", parent, child, "");
    // Two roots.
    assert!(matches!(read(&two_links(&fixed("j", "a", "b"))), Err(Error::UrdfTree { .. })));
    // A loop beside the root.
    let looped = two_links(&(fixed("j", "b", "c") + &fixed("k", "c", "b")));
    assert!(matches!(read(&looped), Err(Error::UrdfTree { .. })));
    // Two parents.
    let twice = two_links(&(fixed("j", "a", "c") + &fixed("k", "b", "c")));
    assert!(matches!(read(&twice), Err(Error::UrdfTree { .. })));
    // Names.
    let duplicate = two_links(&(fixed("j", "a", "b") + &fixed("j", "b", "c")));
    assert!(matches!(read(&duplicate), Err(Error::UrdfDuplicate { .. })));
    let dangling = two_links(&(fixed("j", "a", "b") + &fixed("k", "b", "nobody")));
    assert!(matches!(read(&dangling), Err(Error::UrdfDangling { attribute: "child", .. })));
    // Joint kinds and axes.
    let planar = two_links(&(joint("j", "planar", "a", "b", LIMIT) + &fixed("k", "b", "c")));
    assert!(matches!(read(&planar), Err(Error::UrdfJointKind { kind: "planar", .. })));
    let axis = format!(r#"{LIMIT}<axis xyz="0 0 0"/>"#);
    let no_axis = two_links(&(joint("j", "revolute", "a", "b", &axis) + &fixed("k", "b", "c")));
    assert!(matches!(read(&no_axis), Err(Error::UrdfValue { what: "axis", .. })));
    // Not a URDF.
    assert!(matches!(read("{}"), Err(Error::UrdfSyntax { .. })));
    assert!(matches!(read(""), Err(Error::UrdfSyntax { .. })));
}

#[test]
fn negative_masses_and_inertias_are_refused() {
    let with = |mass: &str, ixx: &str| {
        format!(
            r#"<robot name="r"><link name="a"><inertial><mass value="{mass}"/><inertia ixx="{ixx}" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>"#
        )
    };
    assert!(read(&with("1", "1")).is_ok());
    assert!(matches!(read(&with("-1", "1")), Err(Error::UrdfValue { what: "mass (kg)", .. })));
    assert!(matches!(read(&with("NaN", "1")), Err(Error::UrdfValue { .. })));
    assert!(matches!(read(&with("1", "-0.1")), Err(Error::UrdfValue { what: "inertia (kg m^2)", .. })));
}

#[test]
fn mimic_and_prismatic_joints_follow_their_master() {
    let slide = r#"<axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="5" velocity="2"/>"#;
    let mimic = r#"<axis xyz="0 1 0"/><mimic joint="left" multiplier="-1" offset="0.01"/>"#;
    let text =
        two_links(&(joint("left", "prismatic", "a", "b", slide) + &joint("right", "prismatic", "a", "c", mimic)));
    let robot = read(&text).unwrap();
    assert_eq!(robot.dof_names(), ["left"]);
    let all = robot.link_transforms(&[0.03]).unwrap();
    assert!((all[1].translation.y - 0.03).abs() < 1e-15);
    assert!((all[2].translation.y - (0.01 - 0.03)).abs() < 1e-15);
    assert_eq!(robot.dof_index(robot.joint_id("right").unwrap()), Some(0));
}

#[test]
fn meshes_are_found_beside_the_file_and_through_packages() {
    let folder = tempfile::tempdir().unwrap();
    let arm = folder.path().join("arm_description");
    std::fs::create_dir_all(arm.join("urdf")).unwrap();
    std::fs::create_dir_all(arm.join("meshes")).unwrap();
    std::fs::write(arm.join("meshes/l.stl"), "solid").unwrap();
    let with = |uri: &str| {
        let text = format!(
            r#"<robot name="r"><link name="a"><visual><geometry><mesh filename="{uri}" scale="0.001 0.001 0.001"/></geometry></visual></link></robot>"#
        );
        let path = arm.join("urdf/r.urdf");
        std::fs::write(&path, text).unwrap();
        path
    };
    for uri in ["../meshes/l.stl", "package://arm_description/meshes/l.stl"] {
        let robot = Robot::from_urdf_file(with(uri), &UrdfOptions::default()).unwrap();
        let Geometry::Mesh { path: Some(path), scale, .. } = &robot.links()[0].visuals[0].geometry else {
            panic!("a mesh with a path");
        };
        assert_eq!(std::fs::read_to_string(path).unwrap(), "solid");
        assert!((scale.x - 0.001).abs() < 1e-15);
    }
    let elsewhere = with("package://other/meshes/l.stl");
    let found = UrdfOptions::default().package("other", &arm);
    assert!(Robot::from_urdf_file(&elsewhere, &found).is_ok());
    let wrong = UrdfOptions::default().package("other", folder.path());
    let error = Robot::from_urdf_file(&elsewhere, &wrong).unwrap_err();
    assert!(matches!(&error, Error::UrdfMesh { link, tried, .. } if link == "a" && tried.len() == 1), "{error}");
    assert!(Robot::from_urdf_file(&elsewhere, &wrong.resolve_meshes(false)).is_ok());
    assert!(matches!(Robot::from_urdf_file("/nowhere.urdf", &UrdfOptions::default()), Err(Error::Read { .. })));
}

proptest! {
    #[test]
    fn damaged_urdf_text_never_panics(cut in 0usize..6000, byte in 0usize..6000, to in any::<u8>()) {
        let mut bytes = builtin_arm_urdf().as_bytes().to_vec();
        let len = bytes.len();
        bytes[byte % len] = to;
        bytes.truncate(len - cut % len);
        let _ = read(&String::from_utf8_lossy(&bytes));
    }
}
