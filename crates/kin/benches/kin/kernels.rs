//! Forward kinematics, Jacobian, dynamics, triangulation: microseconds per call.

use std::hint::black_box;

use kin::{Camera, Distortion, Intrinsics, Robot, TriangulateOptions, View, triangulate};
use nalgebra::{DMatrix, Matrix6xX, Point3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

use crate::{blocks, within};

pub(crate) fn rows() -> Vec<Value> {
    let robot = Robot::builtin();
    let chain = robot.chain("base_link", "tool0").unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let states: Vec<Vec<f64>> = (0..200).map(|_| within(&chain, &mut random)).collect();
    let mut jacobian = Matrix6xX::zeros(6);
    let mut rate = Matrix6xX::zeros(6);

    let urdf = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/ogg-arm-6.urdf");
    let peer = k::Chain::<f64>::from_urdf_file(urdf).unwrap();
    let arm = k::SerialChain::from_end(peer.find("tool0_joint").unwrap());
    let k_fk = blocks(&states, 200, |q| {
        arm.set_joint_positions_unchecked(q);
        black_box(arm.end_transform());
    });
    let k_both = blocks(&states, 200, |q| {
        arm.set_joint_positions_unchecked(q);
        black_box(arm.end_transform());
        black_box(k::jacobian(&arm));
    });
    let mut rows = vec![
        blocks(&states, 2000, |q| {
            black_box(chain.fk_matrix(q));
        })
        .row("fk_6dof", "us", Some(("k", k_fk.p50)), "pose of the tool"),
        blocks(&states, 2000, |q| {
            black_box(chain.fk_jacobian_into(q, &mut jacobian));
        })
        .row("fk_jacobian_6dof", "us", Some(("k", k_both.p50)), "target: under 0.3"),
        blocks(&states, 500, |q| chain.jacobian_rate_into(q, q, &mut rate)).row("jacobian_rate_6dof", "us", None, ""),
    ];
    let dynamics = robot.dynamics(Vector3::new(0.0, 0.0, -9.81));
    let mut scratch = dynamics.scratch();
    let mut torque = [0.0; 6];
    let mut mass = DMatrix::zeros(6, 6);
    rows.push(blocks(&states, 500, |q| dynamics.inverse_dynamics(q, q, q, &mut scratch, &mut torque).unwrap()).row(
        "inverse_dynamics_6dof",
        "us",
        None,
        "",
    ));
    rows.push(blocks(&states, 500, |q| dynamics.mass_matrix(q, &mut scratch, &mut mass).unwrap()).row(
        "mass_matrix_6dof",
        "us",
        None,
        "",
    ));
    let cameras: Vec<Camera> = (0..4)
        .map(|i| {
            let angle = 0.3 + 1.5 * f64::from(i);
            Camera::look_at(
                Intrinsics { fx_px: 1400.0, fy_px: 1400.0, cx_px: 960.0, cy_px: 540.0, skew_px: 0.0 },
                Distortion { k1: -0.1, k2: 0.02, ..Distortion::default() },
                [1920, 1080],
                Point3::new(2.5 * angle.cos(), 2.5 * angle.sin(), 1.5),
                Point3::new(0.0, 0.0, 0.8),
                Vector3::z(),
            )
            .unwrap()
        })
        .collect();
    let points: Vec<Point3<f64>> =
        states.iter().map(|q| Point3::new(0.1 * q[0], 0.1 * q[1], 0.7 + 0.05 * q[2])).collect();
    rows.push(
        blocks(&points, 100, |point| {
            let views: [View; 4] = std::array::from_fn(|i| View {
                camera: &cameras[i],
                pixel: cameras[i].project(point).unwrap() + nalgebra::Vector2::new(1.0, -1.0) * i as f64,
                sigma_px: 2.0,
            });
            black_box(triangulate(&views, &TriangulateOptions::default()).unwrap());
        })
        .row("triangulate_4_views", "us", None, "distorted views, outlier rejection, covariance"),
    );
    rows
}
