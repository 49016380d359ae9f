//! Kinematics and dynamics against figures that Pinocchio computed (see `fixtures/origin.toml`).
#![allow(clippy::unwrap_used, reason = "tests: a panic is a failure")]

use kin::{Robot, UrdfOptions, builtin_arm_urdf};
use nalgebra::{DMatrix, Matrix6xX, Vector3};
use serde_json::Value;

/// Both sides compute in doubles; figures reach some 1e2.
const TOLERANCE: f64 = 1e-10;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn assert_near(what: &str, got: &[f64], expected: &[f64]) {
    assert_eq!(got.len(), expected.len(), "{what}");
    for (got, expected) in got.iter().zip(expected) {
        assert!((got - expected).abs() <= TOLERANCE * expected.abs().max(1.0), "{what}: {got} {expected}");
    }
}

/// A `6 x chain` matrix row by row, with zero columns for joints off the path.
fn spread(matrix: &Matrix6xX<f64>, columns: &[usize], dof: usize) -> Vec<f64> {
    let mut full = DMatrix::<f64>::zeros(6, dof);
    for (column, &at) in columns.iter().enumerate() {
        full.set_column(at, &matrix.column(column));
    }
    full.transpose().as_slice().to_vec()
}

#[test]
fn kinematics_and_dynamics_agree_with_pinocchio() {
    let cases: Value = serde_json::from_str(include_str!("fixtures/pinocchio.json")).unwrap();
    let mut states = 0;
    for case in cases.as_array().unwrap() {
        let text = match case["urdf"].as_str().unwrap() {
            "ogg-arm-6.urdf" => builtin_arm_urdf(),
            "tree.urdf" => include_str!("fixtures/tree.urdf"),
            other => panic!("{other}"),
        };
        let robot = Robot::from_urdf_str(text, &UrdfOptions::default()).unwrap();
        let names: Vec<&str> = case["names"].as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
        assert_eq!(robot.dof_names(), names);
        let chain = robot.chain(&robot.root_link().name, case["tip"].as_str().unwrap()).unwrap();
        let columns: Vec<usize> = chain.joints().iter().map(|&id| robot.dof_index(id).unwrap()).collect();
        let dynamics = robot.dynamics(Vector3::new(0.0, 0.0, -9.81));
        let mut scratch = dynamics.scratch();
        let dof = robot.dof();
        for state in case["states"].as_array().unwrap() {
            let (q, qd, qdd) = (numbers(&state["q"]), numbers(&state["qd"]), numbers(&state["qdd"]));
            let pick = |values: &[f64]| columns.iter().map(|&i| values[i]).collect::<Vec<_>>();
            let mut jacobian = Matrix6xX::zeros(chain.dof());
            let mut rate = Matrix6xX::zeros(chain.dof());
            let pose = chain.fk_jacobian_into(&pick(&q), &mut jacobian);
            chain.jacobian_rate_into(&pick(&q), &pick(&qd), &mut rate);
            let mut flat = pose.rotation.matrix().transpose().as_slice().to_vec();
            flat.extend(pose.translation.vector.iter());
            assert_near("pose", &flat, &numbers(&state["pose"]));
            assert_near("jacobian", &spread(&jacobian, &columns, dof), &numbers(&state["jacobian"]));
            assert_near("rate", &spread(&rate, &columns, dof), &numbers(&state["rate"]));
            let mut mass = DMatrix::zeros(dof, dof);
            dynamics.mass_matrix(&q, &mut scratch, &mut mass).unwrap();
            assert_near("mass matrix", mass.transpose().as_slice(), &numbers(&state["mass"]));
            let mut torque = vec![0.0; dof];
            dynamics.inverse_dynamics(&q, &qd, &qdd, &mut scratch, &mut torque).unwrap();
            assert_near("torque", &torque, &numbers(&state["torque"]));
            states += 1;
        }
    }
    assert_eq!(states, 40);
}
