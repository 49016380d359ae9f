//! Computes kinematics and dynamics of many states for `benches/pinocchio_check.py`, which compares them with Pinocchio.
//!
//! `names URDF` prints the joint names of a joint vector, one a line. `run URDF TIP IN OUT` reads joint vectors, speeds and
//! accelerations (f64, little endian, one state after another) and writes per state: the pose of TIP in the root (rotation
//! row by row, then position), the Jacobian and its rate (`6 x chain`, row by row, columns of joints off the path zero), the
//! mass matrix (row by row) and the torques of inverse dynamics with gravity 9.81 m/s^2.
#![allow(clippy::print_stdout, reason = "a command-line program")]

use std::io::{BufReader, BufWriter, Read, Write};

use kin::{LimitPolicy, Robot, UrdfOptions};
use nalgebra::{DMatrix, Matrix6xX, Vector3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let read = |path: &str| {
        let options = UrdfOptions::default().limits(LimitPolicy::AllowMissing).resolve_meshes(false);
        Robot::from_urdf_file(path, &options)
    };
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["names", urdf] => println!("{}", read(urdf)?.dof_names().join("\n")),
        ["run", urdf, tip, input, output] => run(&read(urdf)?, tip, input, output)?,
        _ => return Err("usage: names URDF | run URDF TIP IN OUT".into()),
    }
    Ok(())
}

fn run(robot: &Robot, tip: &str, input: &str, output: &str) -> Result<(), Box<dyn std::error::Error>> {
    let dof = robot.dof();
    let chain = robot.chain(&robot.root_link().name, tip)?;
    let columns: Vec<usize> = chain.joints().iter().filter_map(|&id| robot.dof_index(id)).collect();
    let dynamics = robot.dynamics(Vector3::new(0.0, 0.0, -9.81));
    let mut scratch = dynamics.scratch();
    let mut reader = BufReader::new(std::fs::File::open(input)?);
    let mut writer = BufWriter::new(std::fs::File::create(output)?);
    let mut bytes = vec![0u8; 24 * dof];
    let mut torque = vec![0.0; dof];
    let mut mass = DMatrix::zeros(dof, dof);
    let mut jacobian = Matrix6xX::zeros(chain.dof());
    let mut rate = Matrix6xX::zeros(chain.dof());
    while reader.read_exact(&mut bytes).is_ok() {
        let state: Vec<f64> = bytes.as_chunks::<8>().0.iter().map(|chunk| f64::from_le_bytes(*chunk)).collect();
        let (q, rest) = state.split_at(dof);
        let (qd, qdd) = rest.split_at(dof);
        let pick = |values: &[f64]| columns.iter().map(|&i| values[i]).collect::<Vec<_>>();
        let pose = chain.fk_jacobian_into(&pick(q), &mut jacobian);
        chain.jacobian_rate_into(&pick(q), &pick(qd), &mut rate);
        dynamics.mass_matrix(q, &mut scratch, &mut mass)?;
        dynamics.inverse_dynamics(q, qd, qdd, &mut scratch, &mut torque)?;
        let mut out: Vec<f64> = pose.rotation.matrix().transpose().iter().copied().collect();
        out.extend(pose.translation.vector.iter());
        for matrix in [&jacobian, &rate] {
            for row in 0..6 {
                let mut full = vec![0.0; dof];
                for (column, &at) in columns.iter().enumerate() {
                    full[at] = matrix[(row, column)];
                }
                out.extend(full);
            }
        }
        out.extend(mass.transpose().iter());
        out.extend(&torque);
        for value in out {
            writer.write_all(&value.to_le_bytes())?;
        }
    }
    writer.flush()?;
    Ok(())
}
