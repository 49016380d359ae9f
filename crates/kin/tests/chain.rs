//! Chains against the tree, against finite differences, and inverse kinematics against forward kinematics.
#![allow(
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::disallowed_methods,
    reason = "tests: a panic is a failure, exact values are meant"
)]

use kin::{Chain, FollowOptions, FollowStatus, IkMethod, IkOptions, IkReason, Robot, UrdfOptions};
use nalgebra::{Isometry3, Matrix6xX, Vector3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A tree with everything: two branches, skew axes, a slider, a mimic joint and an endless one.
const TREE: &str = r#"<robot name="tree">
 <link name="root"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="r1"/><link name="r2"/>
 <joint name="a" type="revolute"><parent link="root"/><child link="l1"/><origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/>
  <axis xyz="1 2 -0.5"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
 <joint name="b" type="prismatic"><parent link="l1"/><child link="l2"/><origin xyz="0 0.2 0" rpy="0 0.4 0"/>
  <axis xyz="0 -1 0.2"/><limit lower="-0.2" upper="0.3" effort="1" velocity="1"/></joint>
 <joint name="c" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.3 0 0" rpy="0 0 -1"/>
  <axis xyz="0 0 -1"/><mimic joint="a" multiplier="-0.5" offset="0.2"/></joint>
 <joint name="d" type="continuous"><parent link="l3"/><child link="l4"/><origin xyz="0.25 0.1 0"/>
  <axis xyz="0 1 0"/><limit effort="1" velocity="1"/></joint>
 <joint name="e" type="revolute"><parent link="root"/><child link="r1"/><origin xyz="-0.4 0 0.1"/>
  <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
 <joint name="f" type="fixed"><parent link="r1"/><child link="r2"/><origin xyz="0 -0.3 0.2" rpy="1 0 0"/></joint>
</robot>"#;

fn tree() -> Robot {
    Robot::from_urdf_str(TREE, &UrdfOptions::default()).unwrap()
}

fn arm() -> Chain {
    Robot::builtin().chain("base_link", "tool0").unwrap()
}

/// The joint vector of the chain out of that of the robot.
fn part(robot: &Robot, chain: &Chain, q: &[f64]) -> Vec<f64> {
    chain.joints().iter().map(|&id| q[robot.dof_index(id).unwrap()]).collect()
}

fn numeric_jacobian(chain: &Chain, q: &[f64]) -> Matrix6xX<f64> {
    let h = 1e-6;
    let mut jacobian = Matrix6xX::zeros(q.len());
    for i in 0..q.len() {
        let shifted = |by: f64| {
            let mut q = q.to_vec();
            q[i] += by;
            chain.fk(&q)
        };
        let (plus, minus) = (shifted(h), shifted(-h));
        let linear = (plus.translation.vector - minus.translation.vector) / (2.0 * h);
        let angular = (plus.rotation * minus.rotation.inverse()).scaled_axis() / (2.0 * h);
        jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&linear);
        jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&angular);
    }
    jacobian
}

proptest! {
    #[test]
    fn every_chain_of_a_tree_agrees_with_the_tree(q in prop::array::uniform4(-1.5..1.5f64)) {
        let robot = tree();
        prop_assert_eq!(robot.dof_names(), ["a", "b", "d", "e"]);
        let all = robot.link_transforms(&q).unwrap();
        for base in robot.links() {
            for tip in robot.links() {
                let Ok(chain) = robot.chain(&base.name, &tip.name) else {
                    prop_assert!(base.name == tip.name || ["r1", "r2"].contains(&base.name.as_str()));
                    continue;
                };
                let at = |name: &str| all[robot.link_id(name).unwrap().index()];
                let expected = at(&base.name).inverse() * at(&tip.name);
                let q = part(&robot, &chain, &q);
                let got = chain.fk(&q);
                prop_assert!((got.to_homogeneous() - expected.to_homogeneous()).norm() < 1e-13);
                // Central differences: h^2 and rounding over h.
                prop_assert!((chain.jacobian(&q) - numeric_jacobian(&chain, &q)).norm() < 1e-8);
            }
        }
    }

    #[test]
    fn the_jacobian_of_the_built_in_arm_equals_central_differences(q in prop::array::uniform6(-3.0..3.0f64)) {
        let chain = arm();
        prop_assert!((chain.jacobian(&q) - numeric_jacobian(&chain, &q)).norm() < 1e-8);
        let mut jacobian = Matrix6xX::zeros(6);
        let pose = chain.fk_jacobian_into(&q, &mut jacobian);
        prop_assert!((pose.to_homogeneous() - chain.fk(&q).to_homogeneous()).norm() < 1e-14);
    }
}

#[test]
fn a_chain_without_joints_is_refused() {
    let robot = tree();
    assert!(matches!(robot.chain("r1", "r2"), Err(kin::Error::EmptyChain { .. })));
    assert!(matches!(robot.chain("root", "nothing"), Err(kin::Error::UnknownLink { .. })));
}

fn random_within(chain: &Chain, random: &mut ChaCha8Rng) -> Vec<f64> {
    chain.limits().iter().map(|limits| random.random_range(limits.lower..limits.upper)).collect()
}

#[test]
fn inverse_kinematics_finds_every_reachable_pose() {
    let chain = arm();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut steps = 0;
    for _ in 0..2000 {
        let target = chain.fk(&random_within(&chain, &mut random));
        let mut q = random_within(&chain, &mut random);
        let report = chain.ik(&target, &IkOptions::default().method(IkMethod::Numeric), &mut q);
        assert_eq!(report.reason, IkReason::Reached, "{report:?}");
        steps += report.iterations;
        let reached = chain.fk(&q);
        assert!((reached.translation.vector - target.translation.vector).norm() <= 1e-6);
        assert!(reached.rotation.angle_to(&target.rotation) <= 1.1e-6);
        for (value, limits) in q.iter().zip(chain.limits()) {
            assert!(*value >= limits.lower && *value <= limits.upper);
        }
    }
    // 18 on average; a hopeless attempt that is not abandoned takes 60.
    assert!(steps < 2000 * 22, "{steps}");
}

#[test]
fn a_seed_outside_the_limits_or_without_a_number_still_leads_within() {
    let chain = arm();
    let within = |q: &[f64]| q.iter().zip(chain.limits()).all(|(q, l)| *q >= l.lower && *q <= l.upper);
    // Already there, but with joint 3 beyond 2.75 rad.
    let beyond = [0.3, 1.2, 2.9, -1.1, 0.2, 0.0];
    let mut q = beyond;
    let report = chain.ik(&chain.fk(&beyond), &IkOptions::on_branch(), &mut q);
    assert!(within(&q) && !report.reached(), "{report:?}");
    let target = chain.fk(&[0.3, 1.2, -1.6, -1.1, 0.2, 0.0]);
    for method in [IkMethod::Numeric, IkMethod::Auto] {
        let mut q = [0.0, f64::NAN, -1.0, f64::INFINITY, 0.0, 0.0];
        let report = chain.ik(&target, &IkOptions::default().method(method), &mut q);
        assert!(report.reached() && within(&q), "{report:?}");
    }
}

#[test]
fn a_pose_out_of_reach_gets_the_best_of_all_attempts() {
    let chain = arm();
    let mut random = ChaCha8Rng::seed_from_u64(19);
    let rho = IkOptions::default().rotation_weight_m_per_rad;
    for _ in 0..10 {
        let mut target = chain.fk(&random_within(&chain, &mut random));
        target.translation.vector *= 1.6 / target.translation.vector.norm();
        let mut solve = |options: &IkOptions| {
            let mut q = random_within(&chain, &mut random);
            let report = chain.ik(&target, options, &mut q);
            (report.position_error_m.hypot(rho * report.rotation_error_rad), report.reason)
        };
        let (best, reason) = solve(&IkOptions::default());
        assert!(reason == IkReason::OutOfReach || reason == IkReason::JointLimit, "{reason:?}");
        for _ in 0..20 {
            assert!(best <= solve(&IkOptions::on_branch().iterations(400)).0 + 1e-7);
        }
    }
}

#[test]
fn the_closed_form_answers_only_what_it_can() {
    let chain = arm();
    let goal = [0.3, 1.2, -1.6, -1.1, 0.2, 0.0];
    let target = chain.fk(&goal);
    // On a branch the answer comes from the seed, step by step.
    let mut q = [0.4, 1.1, -1.5, -1.0, 0.3, 0.1];
    let report = chain.ik(&target, &IkOptions::on_branch(), &mut q);
    assert!(report.reached() && report.iterations > 0);
    // For a position alone a seed that is there already stays, however it is turned.
    let mut turned = target;
    turned.rotation = nalgebra::UnitQuaternion::identity();
    let mut q = goal;
    let report = chain.ik(&turned, &IkOptions::default().position_only(), &mut q);
    assert!(report.reached());
    assert_eq!(q, goal);
    // No answer is within a tolerance that rounding exceeds.
    let mut q = [0.4, 1.1, -1.5, -1.0, 0.3, 0.1];
    let report = chain.ik(&target, &IkOptions::default().tolerances(-1.0, -1.0), &mut q);
    assert!(!report.reached(), "{report:?}");
}

#[test]
fn the_same_question_has_the_same_answer_bit_for_bit() {
    let chain = arm();
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let target = chain.fk(&random_within(&chain, &mut random));
    let seed = random_within(&chain, &mut random);
    let solve = || {
        let mut q = seed.clone();
        let report = chain.ik(&target, &IkOptions::default().method(IkMethod::Numeric), &mut q);
        (report, q)
    };
    assert_eq!(solve(), solve());
}

#[test]
fn a_position_out_of_reach_gets_the_stretched_arm() {
    let chain = Robot::builtin().chain("base_link", "link_4").unwrap();
    // The wrist of the stretched arm at joint1 = 0, joint2 = a is p; its two free directions there are z x p and
    // (-sin a, 0, cos a). A target on the line through p at right angles to both has p as its nearest point.
    let (sine, cosine) = 0.4f64.sin_cos();
    let p = Vector3::new(0.850 * cosine, -0.015, 0.140 + 0.850 * sine);
    let outwards = Vector3::new(0.850 * cosine, -0.015, 0.850 * sine).normalize();
    let target = Isometry3::from_parts((p + 2.0 * outwards).into(), nalgebra::UnitQuaternion::identity());
    let mut q = [0.2, 0.8, -1.0, 0.0];
    let report = chain.ik(&target, &IkOptions::default().position_only(), &mut q);
    assert_eq!(report.reason, IkReason::OutOfReach);
    assert!((chain.fk(&q).translation.vector - p).norm() < 1e-6, "{}", chain.fk(&q));
    assert!((report.position_error_m - 2.0).abs() < 1e-9);
}

/// At the edge of the workspace `J` loses a rank, and Gauss-Newton alone creeps: only the curvature of the motion makes the
/// error that is left shrink quadratically.
#[test]
fn the_nearest_pose_at_the_edge_of_the_workspace_is_found_in_few_steps() {
    let chain = Robot::builtin().chain("base_link", "link_4").unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..200 {
        let direction = Vector3::new(random.random_range(0.5..1.0), random.random_range(-0.5..0.5), 0.6).normalize();
        let target = Isometry3::from_parts((direction * 2.0).into(), nalgebra::UnitQuaternion::identity());
        let mut q =
            [random.random_range(-0.5..0.5), random.random_range(0.3..0.9), random.random_range(-0.6..-0.2), 0.0];
        let report = chain.ik(&target, &IkOptions::on_branch().position_only(), &mut q);
        assert_eq!(report.reason, IkReason::OutOfReach, "{report:?}");
        assert!(report.iterations <= 25, "{report:?}");
        // Straight towards the target.
        let elbow_rad = q[2];
        assert!(elbow_rad.abs() < 1e-6, "{q:?}");
    }
}

#[test]
fn the_budget_of_iterations_ends_the_search() {
    let chain = arm();
    let target = chain.fk(&[0.3, 1.2, -1.6, -1.1, 0.2, 0.0]);
    for budget in [0, 1, 3] {
        let mut q = [2.0, 2.0, 1.0, 0.0, 1.0, 0.0];
        let options = IkOptions::default().method(IkMethod::Numeric).iterations(budget);
        let report = chain.ik(&target, &options, &mut q);
        assert_eq!((report.reason, report.iterations), (IkReason::Budget, budget));
    }
}

#[test]
fn a_target_behind_a_joint_limit_ends_at_the_limit() {
    let robot = Robot::builtin();
    let chain = robot.chain("base_link", "link_3").unwrap();
    // Straight below the shoulder: joint2 stops at -0.65 rad; joint1 may turn but does not help.
    let target = chain.fk(&[0.0, -1.2, 0.0]);
    let mut q = [0.0, 0.5, 0.0];
    let report = chain.ik(&target, &IkOptions::on_branch().position_only(), &mut q);
    assert_eq!(report.reason, IkReason::JointLimit);
    assert!((q[1] + 0.65).abs() < 1e-9, "{q:?}");
}

#[test]
fn a_target_that_is_no_pose_leaves_the_seed() {
    let chain = arm();
    let mut q = [0.1; 6];
    let report = chain.ik(&Isometry3::translation(f64::NAN, 0.0, 0.0), &IkOptions::default(), &mut q);
    assert_eq!((report.reason, q), (IkReason::BadTarget, [0.1; 6]));
}

#[test]
fn the_caller_can_end_the_search() {
    let chain = arm();
    let target = chain.fk(&[0.3, 1.2, -1.6, -1.1, 0.2, 0.0]);
    let mut q = [2.0, 2.0, 1.0, 0.0, 1.0, 0.0];
    let mut left = 3;
    let report = chain.ik_while(&target, &IkOptions::default().method(IkMethod::Numeric), &mut q, &mut || {
        left -= 1;
        assert!(left >= -1, "asked again after no");
        left >= 0
    });
    assert_eq!((report.reason, report.iterations), (IkReason::Budget, 3));
}

#[test]
fn following_through_singularities_keeps_the_joint_speeds() {
    let chain = arm();
    let dt_s = 0.005;
    let mut random = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..40 {
        let start = random_within(&chain, &mut random);
        let end = random_within(&chain, &mut random);
        let mut q = start.clone();
        for step in 0..200 {
            let part = f64::from(step) / 200.0;
            let target = chain.fk(&start.iter().zip(&end).map(|(a, b)| a + part * (b - a)).collect::<Vec<_>>());
            let before = q.clone();
            chain.follow_pose(&target, dt_s, &FollowOptions::default(), &mut q).unwrap();
            for ((now, before), limits) in q.iter().zip(&before).zip(chain.limits()) {
                assert!((now - before).abs() <= limits.velocity * dt_s);
                assert!(*now >= limits.lower && *now <= limits.upper);
            }
        }
    }
}

#[test]
fn condition_and_manipulability_agree_with_the_singular_values() {
    let chain = arm();
    let q = [0.3, 1.2, -1.6, -1.1, 0.2, 0.4];
    let values = chain.jacobian(&q).singular_values();
    let dexterity = chain.dexterity(&q);
    assert!((dexterity.condition / (values.max() / values.min()) - 1.0).abs() < 1e-9);
    assert!((dexterity.manipulability / values.product() - 1.0).abs() < 1e-9);
    // Stretched out is singular.
    assert!(chain.dexterity(&[0.0, 0.3, 0.0, 0.2, 0.1, 0.0]).condition > 1e12);
    // Fewer joints than rows.
    let short = Robot::builtin().chain("base_link", "link_3").unwrap();
    let values = short.jacobian(&q[..3]).singular_values();
    assert!((short.dexterity(&q[..3]).condition / (values[0] / values[2]) - 1.0).abs() < 1e-6);
}

proptest! {
    #[test]
    fn the_rate_of_the_jacobian_equals_central_differences(
        q in prop::array::uniform4(-1.5..1.5f64), qd in prop::array::uniform4(-2.0..2.0f64)
    ) {
        let robot = tree();
        for (base, tip) in [("root", "l4"), ("r2", "l4"), ("l4", "r2"), ("l3", "root")] {
            let chain = robot.chain(base, tip).unwrap();
            let (q, qd) = (part(&robot, &chain, &q), part(&robot, &chain, &qd));
            let mut rates = Matrix6xX::zeros(q.len());
            chain.jacobian_rate_into(&q, &qd, &mut rates);
            let h = 1e-6;
            let at = |t: f64| chain.jacobian(&q.iter().zip(&qd).map(|(q, qd)| q + t * qd).collect::<Vec<_>>());
            prop_assert!((rates - (at(h) - at(-h)) / (2.0 * h)).norm() < 1e-8);
        }
    }
}

#[test]
fn a_path_into_the_stretched_elbow_ends_before_it() {
    let chain = arm();
    let ladder = FollowOptions::default().ladder;
    let mut q = vec![0.3, 1.0, -0.9, -1.1, 0.4, 0.0];
    let target = chain.fk(&[0.3, 1.0, 0.0, -1.1, 0.4, 0.0]);
    let mut slowed = 0;
    for _ in 0..2000 {
        let step = chain.follow_pose(&target, 0.005, &FollowOptions::default(), &mut q).unwrap();
        slowed += usize::from(step.status == FollowStatus::Singular);
        assert!(chain.dexterity(&q).condition <= ladder.stop, "{}", chain.dexterity(&q).condition);
    }
    assert!(slowed > 0);
}

#[test]
fn a_step_uses_its_part_of_the_joint_speed_and_no_part_that_makes_no_sense() {
    let chain = arm();
    let start = [0.0, 1.2, -1.6, -1.1, 0.1, 0.0];
    let target = chain.fk(&[0.5, 1.3, -1.7, -1.1, 0.1, 0.0]);
    let follow = |part: f64, dt_s: f64| {
        let mut q = start;
        chain.follow_pose(&target, dt_s, &FollowOptions::default().speed_fraction(part), &mut q).map(|_| q)
    };
    for part in [1.0, 0.25] {
        // Joint 1 has the longest way, at 3 rad/s.
        assert!((follow(part, 0.005).unwrap()[0] - part * 3.0 * 0.005).abs() < 1e-12);
    }
    for (part, dt_s) in
        [(0.0, 0.005), (1.5, 0.005), (f64::NAN, 0.005), (1.0, 0.0), (1.0, f64::NAN), (1.0, f64::INFINITY)]
    {
        assert!(matches!(follow(part, dt_s), Err(kin::Error::Domain { .. })), "{part} {dt_s}");
    }
    let ladder = FollowOptions::default().ladder;
    assert!((ladder.scale(40.0, 39.0) - 1.0).abs() < 1e-12 && ladder.scale(25.0, 40.0).abs() < 1e-12);
}
