//! Dynamics against closed forms and against energy.
#![allow(clippy::unwrap_used, reason = "tests")]

use nalgebra::{DMatrix, DVector, Vector3};
use proptest::prelude::*;

use crate::{Robot, UrdfOptions};

const G: f64 = 9.81;

fn down() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -G)
}

/// Two bars in a vertical plane, mass in their middles: the textbook arm.
const TWO_BARS: &str = r#"<robot name="bars">
 <link name="base"/>
 <link name="one"><inertial><origin xyz="0.3 0 0"/><mass value="2"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.06"/></inertial></link>
 <link name="two"><inertial><origin xyz="0.2 0 0"/><mass value="1.5"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
 <joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
 <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.6 0 0"/><axis xyz="0 -1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
</robot>"#;

proptest! {
    #[test]
    fn two_bars_obey_the_textbook(q in prop::array::uniform2(-3.0..3.0f64), qd in prop::array::uniform2(-2.0..2.0f64), qdd in prop::array::uniform2(-5.0..5.0f64)) {
        let robot = Robot::from_urdf_str(TWO_BARS, &UrdfOptions::default()).unwrap();
        let dynamics = robot.dynamics(down());
        let mut torque = [0.0; 2];
        dynamics.inverse_dynamics(&q, &qd, &qdd, &mut dynamics.scratch(), &mut torque).unwrap();
        // Spong and Vidyasagar (1989), two-link arm with angles from the horizontal.
        let (m1, m2, l1, c1, c2, i1, i2) = (2.0, 1.5, 0.6, 0.3, 0.2, 0.06, 0.02);
        let d12 = m2 * (c2 * c2 + l1 * c2 * q[1].cos()) + i2;
        let d11 = m1 * c1 * c1 + m2 * (l1 * l1 + c2 * c2 + 2.0 * l1 * c2 * q[1].cos()) + i1 + i2;
        let d22 = m2 * c2 * c2 + i2;
        let h = -m2 * l1 * c2 * q[1].sin();
        let g2 = m2 * c2 * G * (q[0] + q[1]).cos();
        let g1 = (m1 * c1 + m2 * l1) * G * q[0].cos() + g2;
        let one = d11 * qdd[0] + d12 * qdd[1] + h * (2.0 * qd[0] * qd[1] + qd[1] * qd[1]) + g1;
        let two = d12 * qdd[0] + d22 * qdd[1] - h * qd[0] * qd[0] + g2;
        prop_assert!((torque[0] - one).abs() < 1e-12 && (torque[1] - two).abs() < 1e-12, "{torque:?} {one} {two}");
        let mut mass = DMatrix::zeros(2, 2);
        dynamics.mass_matrix(&q, &mut dynamics.scratch(), &mut mass).unwrap();
        prop_assert!((mass - DMatrix::from_row_slice(2, 2, &[d11, d12, d12, d22])).norm() < 1e-13);
    }

    #[test]
    fn the_mass_matrix_is_what_inverse_dynamics_says(q in prop::array::uniform6(-3.0..3.0f64)) {
        let dynamics = Robot::builtin().dynamics(down());
        let mut scratch = dynamics.scratch();
        let mut mass = DMatrix::zeros(6, 6);
        dynamics.mass_matrix(&q, &mut scratch, &mut mass).unwrap();
        let (mut bias, mut torque) = ([0.0; 6], [0.0; 6]);
        dynamics.gravity(&q, &mut scratch, &mut bias).unwrap();
        for column in 0..6 {
            let mut unit = [0.0; 6];
            unit[column] = 1.0;
            dynamics.inverse_dynamics(&q, &[0.0; 6], &unit, &mut scratch, &mut torque).unwrap();
            for row in 0..6 {
                prop_assert!((mass[(row, column)] - (torque[row] - bias[row])).abs() < 1e-11);
            }
        }
        prop_assert!(mass.cholesky().is_some());
    }

    #[test]
    fn power_is_the_change_of_energy(q in prop::array::uniform6(-3.0..3.0f64), qd in prop::array::uniform6(-2.0..2.0f64), qdd in prop::array::uniform6(-5.0..5.0f64)) {
        let robot = Robot::builtin();
        let dynamics = robot.dynamics(down());
        let mut scratch = dynamics.scratch();
        // Kinetic energy from the mass matrix; potential energy from the centres of mass of the links.
        let mut energy = |q: &[f64], qd: &[f64]| -> f64 {
            let mut mass = DMatrix::zeros(6, 6);
            dynamics.mass_matrix(q, &mut scratch, &mut mass).unwrap();
            let qd = DVector::from_row_slice(qd);
            let potential: f64 = robot.link_transforms(q).unwrap().iter().zip(robot.links())
                .filter_map(|(pose, link)| link.inertial.map(|i| i.mass_kg * G * (pose * i.com_m).z))
                .sum();
            0.5 * (qd.transpose() * mass * &qd)[(0, 0)] + potential
        };
        let h = 1e-5;
        let at = |t: f64| -> (Vec<f64>, Vec<f64>) {
            ((0..6).map(|i| q[i] + t * qd[i] + 0.5 * t * t * qdd[i]).collect(), (0..6).map(|i| qd[i] + t * qdd[i]).collect())
        };
        let ((q1, v1), (q0, v0)) = (at(h), at(-h));
        let change = (energy(&q1, &v1) - energy(&q0, &v0)) / (2.0 * h);
        let mut torque = [0.0; 6];
        dynamics.inverse_dynamics(&q, &qd, &qdd, &mut dynamics.scratch(), &mut torque).unwrap();
        let power: f64 = torque.iter().zip(&qd).map(|(t, v)| t * v).sum();
        // Central differences of an energy of some 1e2 J: rounding 1e-14 * 1e2 / h, curvature h^2 * 1e4.
        prop_assert!((change - power).abs() < 1e-5 * (1.0 + power.abs()), "{change} {power}");
    }
}

#[test]
fn a_slider_and_its_mimic_share_one_force() {
    let text = r#"<robot name="gripper"><link name="base"/>
      <link name="l"><inertial><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
      <link name="r"><inertial><mass value="0.3"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
      <joint name="left" type="prismatic"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
      <joint name="right" type="prismatic"><parent link="base"/><child link="r"/><axis xyz="0 0 -1"/><mimic joint="left" multiplier="2"/></joint>
    </robot>"#;
    let dynamics = Robot::from_urdf_str(text, &UrdfOptions::default()).unwrap().dynamics(down());
    let mut scratch = dynamics.scratch();
    let mut mass = DMatrix::zeros(1, 1);
    dynamics.mass_matrix(&[0.1], &mut scratch, &mut mass).unwrap();
    assert!((mass[(0, 0)] - (0.2 + 4.0 * 0.3)).abs() < 1e-15);
    let mut force = [0.0];
    dynamics.gravity(&[0.1], &mut scratch, &mut force).unwrap();
    // The left one is lifted, the right one lowered twice as fast.
    assert!((force[0] - G * (0.2 - 2.0 * 0.3)).abs() < 1e-14);
}

#[test]
fn wrong_lengths_are_errors() {
    let dynamics = Robot::builtin().dynamics(down());
    let mut scratch = dynamics.scratch();
    assert!(dynamics.gravity(&[0.0; 5], &mut scratch, &mut [0.0; 6]).is_err());
    assert!(dynamics.gravity(&[0.0; 6], &mut scratch, &mut [0.0; 5]).is_err());
    assert!(dynamics.mass_matrix(&[0.0; 6], &mut scratch, &mut DMatrix::zeros(6, 5)).is_err());
    let bars = Robot::from_urdf_str(TWO_BARS, &UrdfOptions::default()).unwrap().dynamics(down());
    assert!(dynamics.gravity(&[0.0; 6], &mut bars.scratch(), &mut [0.0; 6]).is_err());
}
