//! The closed form against forward kinematics, and its branches against one another.
#![allow(clippy::unwrap_used, clippy::float_cmp, clippy::format_push_string, reason = "tests: a panic is a failure")]

use kin::{Chain, IkMethod, IkOptions, IkReason, Robot, UrdfOptions, wrap_rad};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn arm() -> Chain {
    Robot::builtin().chain("base_link", "tool0").unwrap()
}

/// An arm from its axes and the offsets between its joints, all turned by a skew base and with a skew tool.
fn made_of(joints: &[([f64; 3], [f64; 3]); 6]) -> Chain {
    let mut text = String::from(r#"<robot name="r"><link name="l0"/>"#);
    for (i, (offset, axis)) in joints.iter().enumerate() {
        let rpy = if i == 0 { "0.3 -0.2 0.7" } else { "0 0 0" };
        text += &format!(
            r#"<link name="l{n}"/><joint name="j{n}" type="revolute"><parent link="l{i}"/><child link="l{n}"/>
            <origin xyz="{} {} {}" rpy="{rpy}"/><axis xyz="{} {} {}"/>
            <limit lower="-6.3" upper="6.3" effort="1" velocity="1"/></joint>"#,
            offset[0],
            offset[1],
            offset[2],
            axis[0],
            axis[1],
            axis[2],
            n = i + 1,
        );
    }
    text += r#"<link name="tip"/><joint name="t" type="fixed"><parent link="l6"/><child link="tip"/><origin xyz="0.02 0.05 0.1" rpy="0.5 0.6 0.7"/></joint></robot>"#;
    Robot::from_urdf_str(&text, &UrdfOptions::default()).unwrap().chain("l0", "tip").unwrap()
}

/// A Puma-like arm: shoulder offset, forearm offset, spherical wrist.
fn spherical() -> Chain {
    made_of(&[
        ([0.0, 0.0, 0.4], [0.0, 0.0, 1.0]),
        ([0.15, 0.1, 0.05], [0.0, 1.0, 0.0]),
        ([0.0, 0.02, 0.6], [0.0, -1.0, 0.0]),
        ([0.2, -0.03, 0.12], [1.0, 0.0, 0.0]),
        ([0.35, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
    ])
}

/// A UR-like arm with an axis turned round and a skew angle between joints 4 and 5.
fn parallel() -> Chain {
    made_of(&[
        ([0.0, 0.0, 0.1], [0.0, 0.0, 1.0]),
        ([0.05, 0.13, 0.0], [0.0, 1.0, 0.0]),
        ([0.02, -0.1, 0.42], [0.0, -1.0, 0.0]),
        ([0.1, 0.01, 0.39], [0.0, 1.0, 0.0]),
        ([0.0, 0.09, 0.0], [0.0, 0.5, 1.0]),
        ([0.0, 0.0475, 0.095], [0.0, 1.0, 0.0]),
    ])
}

fn errors(chain: &Chain, q: &[f64], target: &Isometry3<f64>) -> (f64, f64) {
    let reached = chain.fk(q);
    ((reached.translation.vector - target.translation.vector).norm(), reached.rotation.angle_to(&target.rotation))
}

#[test]
fn every_branch_reaches_the_pose_and_one_of_them_is_where_it_came_from() {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for chain in [arm(), spherical(), parallel()] {
        let analytic = chain.analytic().unwrap();
        let mut eights = 0;
        for _ in 0..20_000 {
            let q: [f64; 6] = std::array::from_fn(|_| random.random_range(-3.1..3.1));
            let target = chain.fk(&q);
            let branches = analytic.all(&target, &q);
            let mut found = false;
            for branch in branches.as_slice() {
                let (position_m, rotation_rad) = errors(&chain, branch, &target);
                // Near a fold of the arm a cosine loses half its digits, and the pose with it.
                assert!(position_m < 1e-7 && rotation_rad < 1e-6, "{position_m} {rotation_rad} {q:?} {branch:?}");
                found |= branch.iter().zip(&q).all(|(a, b)| wrap_rad(a - b).abs() < 1e-5);
            }
            assert!(found, "{q:?} {branches:?}");
            for (i, one) in branches.as_slice().iter().enumerate() {
                for other in &branches.as_slice()[..i] {
                    assert!(one.iter().zip(other).any(|(a, b)| wrap_rad(a - b).abs() > 1e-9), "{one:?} twice");
                }
            }
            eights += usize::from(branches.as_slice().len() == 8);
        }
        assert!(eights > 2000, "{eights}");
    }
}

#[test]
fn wrist_and_shoulder_singularities_have_answers_too() {
    let wild = arm()
        .analytic()
        .unwrap()
        .all(&arm().fk(&[0.3, 1.0, -1.4, 0.2, std::f64::consts::FRAC_PI_2, 0.5]), &[f64::INFINITY; 6]);
    assert!(wild.as_slice().iter().flatten().all(|value| value.is_finite()));
    // Joint 5 at a quarter turn points joint 6 along joint 4 on the built-in arm.
    let chain = arm();
    let quarter = std::f64::consts::FRAC_PI_2;
    for (q, seed_matters) in [([0.3, 1.0, -1.4, 0.2, quarter, 0.5], true), ([0.3, 1.0, 0.0, 0.2, 0.4, 0.5], false)] {
        let target = chain.fk(&q);
        let near = chain.analytic().unwrap().nearest(&target, &q).unwrap();
        let (position_m, rotation_rad) = errors(&chain, &near, &target);
        assert!(position_m < 1e-6 && rotation_rad < 1e-6, "{position_m} {rotation_rad}");
        if seed_matters {
            assert!(near.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-3), "{near:?} {q:?}");
        }
    }
}

#[test]
fn the_nearest_branch_respects_the_limits() {
    let chain = arm();
    let mut random = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..5000 {
        let within = || -> Vec<f64> { chain.limits().iter().map(|l| random.random_range(l.lower..l.upper)).collect() };
        let mut within = within;
        let (goal, seed) = (within(), within());
        let target = chain.fk(&goal);
        let seed: [f64; 6] = seed.try_into().unwrap();
        let near = chain.analytic().unwrap().nearest(&target, &seed).unwrap();
        let largest = |q: &[f64]| q.iter().zip(&seed).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(largest(&near) <= largest(&goal) + 1e-5);
        for (value, limits) in near.iter().zip(chain.limits()) {
            assert!(*value >= limits.lower && *value <= limits.upper);
        }
        // The general entry takes this way, and the least-squares one agrees that the pose can be reached.
        let mut q = seed;
        let report = chain.ik(&target, &IkOptions::default(), &mut q);
        assert_eq!((report.reason, report.iterations), (IkReason::Reached, 0));
        assert_eq!(q, near);
    }
    let target = chain.fk(&[0.3, 1.0, -1.4, 0.2, 0.4, 0.5]);
    let mut q = [0.0, 1.2, -1.0, 0.0, 0.1, 0.0];
    let report = chain.ik(&target, &IkOptions::default().method(IkMethod::Numeric), &mut q);
    assert!(report.reached() && report.iterations > 0);
}

#[test]
fn a_pose_out_of_reach_has_no_branch() {
    let chain = arm();
    let far = Isometry3::from_parts(Translation3::new(3.0, 0.0, 0.0), UnitQuaternion::identity());
    assert!(chain.analytic().unwrap().all(&far, &[0.0; 6]).as_slice().is_empty());
    let nan = Isometry3::from_parts(Translation3::new(f64::NAN, 0.0, 0.0), UnitQuaternion::identity());
    assert!(chain.analytic().unwrap().all(&nan, &[0.0; 6]).as_slice().is_empty());
}

#[test]
fn other_geometries_are_not_mistaken_for_these() {
    let robot = Robot::builtin();
    assert!(robot.chain("base_link", "link_5").unwrap().analytic().is_none());
    assert!(robot.chain("tool0", "base_link").is_ok());
    // A bent third axis.
    let bent = made_of(&[
        ([0.0, 0.0, 0.1], [0.0, 0.0, 1.0]),
        ([0.0, 0.13, 0.0], [0.0, 1.0, 0.0]),
        ([0.0, -0.1, 0.42], [0.0, 1.0, 0.1]),
        ([0.0, 0.0, 0.39], [0.0, 1.0, 0.0]),
        ([0.0, 0.09, 0.0], [0.0, 0.0, 1.0]),
        ([0.0, 0.0, 0.095], [0.0, 1.0, 0.0]),
    ]);
    assert!(bent.analytic().is_none());
}
