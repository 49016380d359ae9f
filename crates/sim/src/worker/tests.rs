use std::time::Duration;

use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

use super::{Action, BodyShape, Keypoint, Script, Worker, WorkerParams};
use crate::error::Error;

const ARM: [Keypoint; 3] = [Keypoint::RightShoulder, Keypoint::RightElbow, Keypoint::RightWrist];

fn worker(action: Action, variation: f64) -> Worker {
    Worker::new(WorkerParams { script: Script::Repeat(action), variation, ..WorkerParams::default() }).unwrap()
}

/// Positions of one joint at 100 Hz over `seconds`.
fn track(worker: &Worker, keypoint: Keypoint, seconds: u64) -> Vec<Point3<f64>> {
    (0..seconds * 100).map(|k| worker.pose_at(Duration::from_millis(10 * k)).joint(keypoint)).collect()
}

/// Extent along x, y, z.
fn extent(track: &[Point3<f64>]) -> Vector3<f64> {
    let low = track.iter().fold(track[0].coords, |a, p| a.inf(&p.coords));
    let high = track.iter().fold(track[0].coords, |a, p| a.sup(&p.coords));
    high - low
}

/// Extents of shoulder, elbow and wrist over one cycle without variation.
fn extents(action: Action) -> [Vector3<f64>; 3] {
    ARM.map(|k| extent(&track(&worker(action, 0.0), k, 3)))
}

#[test]
fn moving_goes_far_over_the_bench_and_hardly_up() {
    let [shoulder, elbow, wrist] = extents(Action::Move);
    for (joint, least) in [(shoulder, 0.05), (elbow, 0.12), (wrist, 0.19)] {
        assert!(joint.xy().norm() > least, "{joint}");
    }
    assert!(shoulder.z < 0.035 && wrist.z < 0.035, "{shoulder} {wrist}");
}

#[test]
fn aligning_raises_the_wrist_more_than_moving_and_leaves_the_shoulder() {
    let [shoulder, _, wrist] = extents(Action::Align);
    let [.., wrist_of_move] = extents(Action::Move);
    assert!(wrist.z > 3.0 * wrist_of_move.z && wrist.z > 0.1, "{wrist}");
    assert!(shoulder.norm() < 0.03, "{shoulder}");
}

#[test]
fn flipping_raises_all_three_joints_most() {
    let flip = extents(Action::Flip);
    for other in [Action::Move, Action::Align] {
        for (joint, (mine, theirs)) in flip.iter().zip(extents(other)).enumerate() {
            assert!(mine.z > 1.5 * theirs.z, "joint {joint} {other:?}: {mine} {theirs}");
        }
    }
    assert!(flip[2].z > 0.2 && flip[1].z > 0.12 && flip[0].z > 0.04, "{flip:?}");
}

#[test]
fn the_default_worker_never_reaches_the_end_of_the_arm() {
    for action in Action::ALL {
        let worker = worker(action, 1.0);
        for k in 0..6000 {
            let pose = worker.pose_at(Duration::from_millis(10 * k));
            for side in [ARM, [Keypoint::LeftShoulder, Keypoint::LeftElbow, Keypoint::LeftWrist]] {
                let reach = (pose.joint(side[2]) - pose.joint(side[0])).norm();
                assert!(reach < 0.94 * worker.params().body.arm_m(), "{action:?} at {k}: {reach}");
            }
        }
    }
}

#[test]
fn acceleration_has_no_jumps() {
    // Central differences over 2 ms. A kink in velocity of 1 mm/s would show as 0.5 m/s^2 between two samples, a
    // smooth jerk of 120 m/s^3 as 0.12 m/s^2 per millisecond.
    let h = 2e-3;
    for script in [Script::Round { repetitions: 1 }, Script::Repeat(Action::Flip)] {
        let worker = Worker::new(WorkerParams { script, ..WorkerParams::default() }).unwrap();
        for keypoint in
            [Keypoint::RightWrist, Keypoint::RightElbow, Keypoint::RightShoulder, Keypoint::LeftElbow, Keypoint::Nose]
        {
            let at = |ms: u64| worker.pose_at(Duration::from_millis(ms)).joint(keypoint).coords;
            let acceleration = |ms: u64| (at(ms + 2) - 2.0 * at(ms) + at(ms - 2)) / (h * h);
            let mut before = acceleration(10);
            for ms in 11..12_000 {
                let now = acceleration(ms);
                assert!((now - before).norm() < 0.4, "{keypoint:?} at {ms} ms: {}", (now - before).norm());
                before = now;
            }
        }
    }
}

#[test]
fn a_round_does_each_action_as_often_as_told() {
    use Action::{Align, Flip, Move};
    let script = Script::Round { repetitions: 2 };
    let worker = Worker::new(WorkerParams { script, variation: 0.0, ..WorkerParams::default() }).unwrap();
    let seen: Vec<Action> = (0..7).map(|k| worker.action_at(Duration::from_millis(1500 + 3000 * k))).collect();
    assert_eq!(seen, [Move, Move, Align, Align, Flip, Flip, Move]);
}

#[test]
fn without_variation_every_cycle_is_the_same_and_with_it_none() {
    let distance = |variation: f64| {
        let worker = worker(Action::Align, variation);
        let at = |ms: u64| worker.pose_at(Duration::from_millis(ms)).joint(Keypoint::RightWrist);
        (at(800) - at(3800)).norm()
    };
    assert!(distance(0.0) < 1e-12);
    let varied = distance(1.0);
    assert!(varied > 1e-4 && varied < 0.06, "{varied}");
}

#[test]
fn the_seed_alone_decides() {
    let at = |seed: u64| {
        let worker = Worker::new(WorkerParams { seed, ..WorkerParams::default() }).unwrap();
        worker.pose_at(Duration::from_millis(4321))
    };
    assert_eq!(at(1), at(1));
    assert_ne!(at(1), at(2));
}

#[test]
fn impossible_parameters_are_refused_by_name() {
    let refused = |params: WorkerParams| Worker::new(params).unwrap_err().to_string();
    let base = WorkerParams::default;
    assert!(refused(WorkerParams { period_s: f64::NAN, ..base() }).contains("period_s"));
    assert!(refused(WorkerParams { variation: -0.1, ..base() }).contains("variation"));
    let body = BodyShape { forearm_m: 2.0, ..BodyShape::default() };
    assert_eq!(refused(WorkerParams { body, ..base() }), "body.forearm_m: 2 outside [0.15, 0.4]");
    let never = Worker::new(WorkerParams { script: Script::Round { repetitions: 0 }, ..base() });
    assert!(matches!(never, Err(Error::Zero { field: "script.repetitions" })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn bones_keep_their_length(seed: u64, ms in 0_u64..100_000, which in 0_usize..3, variation in 0.0..4.0_f64) {
        use rand::SeedableRng;
        let body = BodyShape::random(&mut rand_chacha::ChaCha8Rng::seed_from_u64(seed));
        let params = WorkerParams {
            seed, body, variation, script: Script::Repeat(Action::ALL[which]), ..WorkerParams::default()
        };
        let pose = Worker::new(params).unwrap().pose_at(Duration::from_millis(ms));
        let bone = |a: Keypoint, b: Keypoint| (pose.joint(a) - pose.joint(b)).norm();
        for (a, b, length) in [
            (Keypoint::RightShoulder, Keypoint::RightElbow, body.upper_arm_m),
            (Keypoint::RightElbow, Keypoint::RightWrist, body.forearm_m),
            (Keypoint::LeftShoulder, Keypoint::LeftElbow, body.upper_arm_m),
            (Keypoint::LeftElbow, Keypoint::LeftWrist, body.forearm_m),
            (Keypoint::RightHip, Keypoint::RightKnee, body.thigh_m),
            (Keypoint::LeftKnee, Keypoint::LeftAnkle, body.shin_m),
        ] {
            prop_assert!((bone(a, b) - length).abs() < 1e-9);
        }
        prop_assert!(pose.joint(Keypoint::RightShoulder).y < pose.joint(Keypoint::LeftShoulder).y);
    }
}
