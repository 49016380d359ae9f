//! Inverse kinematics: success, time, and whether the nearest pose is the nearest.

use std::time::Instant;

use k::InverseKinematicsSolver;
use kin::{Chain, IkMethod, IkOptions, Robot};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rs_opw_kinematics::kinematic_traits::Kinematics;
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;
use serde_json::Value;

use crate::{SEVEN, Spread, serial, single, within};

pub(crate) fn rows(full: bool) -> Vec<Value> {
    let six = Robot::builtin().chain("base_link", "tool0").unwrap();
    let seven = serial(SEVEN, [0.0, 0.0, 0.05]);
    let (many, some) = if full { (1_000_000, 100_000) } else { (100_000, 20_000) };
    let numeric = IkOptions::default().method(IkMethod::Numeric);
    let k_six = peer_k(1000);
    let mut rows = Vec::new();
    rows.extend(measure("ik_numeric_6dof", &six, &numeric, many, Some(k_six), "target: median under 20"));
    rows.extend(measure("ik_numeric_7dof", &seven, &numeric, some, None, ""));
    rows.extend(measure("ik_closed_form_6dof", &six, &IkOptions::default(), many, None, "target: median under 3"));
    rows.push(opw(some));
    rows.extend(nearest(&six, if full { 500 } else { 60 }));
    rows
}

fn measure(
    name: &str,
    chain: &Chain,
    options: &IkOptions,
    count: usize,
    peer: Option<(f64, f64)>,
    note: &str,
) -> [Value; 2] {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut times = Vec::with_capacity(count);
    let mut reached = 0;
    for _ in 0..count {
        let target = chain.fk(&within(chain, &mut random));
        let mut q = within(chain, &mut random);
        let start = Instant::now();
        let report = chain.ik(&target, options, &mut q);
        times.push(start.elapsed().as_secs_f64() * 1e6);
        // Judged by the pose and the limits, not by the report.
        let pose = chain.fk(&q);
        let near = (pose.translation.vector - target.translation.vector).norm() <= 1e-6
            && pose.rotation.angle_to(&target.rotation) <= 1.01e-6;
        let allowed = q.iter().zip(chain.limits()).all(|(q, limits)| *q >= limits.lower && *q <= limits.upper);
        reached += usize::from(near && allowed && report.reached());
    }
    let success = 100.0 * reached as f64 / count as f64;
    [
        Spread::of(times).row(name, "us", peer.map(|(time, _)| ("k", time)), note),
        single(
            &format!("{name}_success"),
            "%",
            success,
            peer.map(|(_, success)| ("k", success)),
            count,
            "random reachable poses within limits from random seeds, 1e-6 m and 1e-6 rad; target: 99.99",
        ),
    ]
}

/// Median time and success of `k` on the same arm and the same kind of question.
fn peer_k(count: usize) -> (f64, f64) {
    let urdf = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/ogg-arm-6.urdf");
    let tree = k::Chain::<f64>::from_urdf_file(urdf).unwrap();
    let arm = k::SerialChain::from_end(tree.find("tool0_joint").unwrap());
    let chain = Robot::builtin().chain("base_link", "tool0").unwrap();
    let solver = k::JacobianIkSolver::new(1e-6, 1e-6, 0.5, 200);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut times = Vec::new();
    let mut reached = 0;
    for _ in 0..count {
        arm.set_joint_positions_unchecked(&within(&chain, &mut random));
        let target = arm.end_transform();
        arm.set_joint_positions_unchecked(&within(&chain, &mut random));
        let start = Instant::now();
        let solved = solver.solve(&arm, &target).is_ok();
        times.push(start.elapsed().as_secs_f64() * 1e6);
        reached += usize::from(solved);
    }
    (Spread::of(times).p50, 100.0 * reached as f64 / count as f64)
}

/// All branches of an arm with spherical wrist, beside rs-opw-kinematics, which must agree on the forward kinematics.
fn opw(count: usize) -> Value {
    let parameters = Parameters {
        a1: 0.15,
        a2: -0.11,
        b: 0.0,
        c1: 0.55,
        c2: 0.61,
        c3: 0.66,
        c4: 0.11,
        offsets: [0.0; 6],
        sign_corrections: [1; 6],
        dof: 6,
    };
    let p = &parameters;
    let (y, z) = ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let ours = serial(
        &[
            ([0.0; 3], z, 3.1),
            ([p.a1, p.b, p.c1], y, 3.1),
            ([0.0, 0.0, p.c2], y, 3.1),
            ([p.a2, 0.0, 0.0], z, 3.1),
            ([0.0, 0.0, p.c3], y, 3.1),
            ([0.0, 0.0, p.c4], z, 3.1),
        ],
        [0.0; 3],
    );
    let peer = OPWKinematics::new(parameters);
    let analytic = ours.analytic().unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let (mut own_times, mut peer_times) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let q: [f64; 6] = std::array::from_fn(|_| random.random_range(-3.0..3.0));
        let theirs = peer.forward(&q);
        let pose: Isometry3<f64> = ours.fk(&q);
        let place = theirs.translation;
        let off = nalgebra::Vector3::new(place.x, place.y, place.z) - pose.translation.vector;
        assert!(off.norm() < 1e-9, "both libraries must mean the same arm: {off}");
        let start = Instant::now();
        std::hint::black_box(peer.inverse(&theirs));
        peer_times.push(start.elapsed().as_secs_f64() * 1e6);
        let start = Instant::now();
        std::hint::black_box(analytic.all(&pose, &q));
        own_times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    let peer_time = Spread::of(peer_times).p50;
    Spread::of(own_times).row(
        "ik_all_branches_spherical_wrist",
        "us",
        Some(("rs-opw-kinematics", peer_time)),
        "all branches of one pose",
    )
}

/// Targets out of reach: how much farther the answer is than the best that a search without derivatives finds.
fn nearest(chain: &Chain, count: usize) -> [Value; 2] {
    let mut random = ChaCha8Rng::seed_from_u64(13);
    let mut worst = f64::NEG_INFINITY;
    let mut times = Vec::new();
    for _ in 0..count {
        let mut target = chain.fk(&within(chain, &mut random));
        target.translation.vector *= random.random_range(1.2..3.0) / target.translation.vector.norm();
        let mut q = within(chain, &mut random);
        let start = Instant::now();
        chain.ik(&target, &IkOptions::default(), &mut q);
        times.push(start.elapsed().as_secs_f64() * 1e6);
        worst = worst.max(distance(chain, &target, &q) - brute_force(chain, &target, &q, &mut random));
    }
    [
        single(
            "ik_nearest_pose_excess",
            "m",
            worst,
            None,
            count,
            "largest d(answer) - d(brute force); target: under 1e-4",
        ),
        Spread::of(times).row("ik_out_of_reach", "us", None, "with all restarts"),
    ]
}

fn distance(chain: &Chain, target: &Isometry3<f64>, q: &[f64]) -> f64 {
    let pose = chain.fk(q);
    let position = (pose.translation.vector - target.translation.vector).norm();
    position.hypot(IkOptions::default().rotation_weight_m_per_rad * pose.rotation.angle_to(&target.rotation))
}

/// Random directions with shrinking steps, from many places, the answer among them.
fn brute_force(chain: &Chain, target: &Isometry3<f64>, answer: &[f64], random: &mut ChaCha8Rng) -> f64 {
    let mut best = f64::INFINITY;
    for start in 0..40 {
        let mut q = if start == 0 { answer.to_vec() } else { within(chain, random) };
        let mut least = distance(chain, target, &q);
        let mut step = 0.5;
        while step > 1e-7 {
            let mut better = false;
            for _ in 0..24 {
                let mut trial = q.clone();
                for (value, limits) in trial.iter_mut().zip(chain.limits()) {
                    *value = (*value + step * random.random_range(-1.0..1.0)).clamp(limits.lower, limits.upper);
                }
                let d = distance(chain, target, &trial);
                if d < least {
                    (least, q, better) = (d, trial, true);
                }
            }
            step *= if better { 1.3 } else { 0.6 };
            step = f64::min(step, 0.5);
        }
        best = best.min(least);
    }
    best
}
