//! How far a pose is from a singularity.
//!
//! Rows are taken as they are, metres beside radians: the choice of MoveIt Servo, whose thresholds (17 and 30) are
//! made for arms of about one metre.

use nalgebra::{Matrix6, SMatrix};

use super::{Chain, MAX_DOF};

/// Singular values of a Jacobian, and what follows from them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dexterity {
    /// Largest over smallest singular value; infinite in a singularity.
    pub condition: f64,
    /// Product of the singular values, `sqrt(det(J J^T))` (Yoshikawa 1985).
    pub manipulability: f64,
    /// Smallest singular value.
    pub smallest: f64,
}

impl Chain {
    /// Condition number and manipulability at `q`, with rows in SI units. For a chain of fewer than six joints the
    /// singular values are those of its `dof` columns.
    ///
    /// # Panics
    /// When `q` does not have [`Chain::dof`] values.
    pub fn dexterity(&self, q: &[f64]) -> Dexterity {
        let dof = self.dof();
        let mut columns = [0.0; 6 * MAX_DOF];
        self.tip_frame_and_jacobian(q, &mut columns[..6 * dof]);
        let columns = &columns[..6 * dof];
        let mut singular = [0.0; 6];
        let count = dof.min(6);
        if dof < 6 {
            // J^T J, padded with zeros, has the squares of the wanted values as its largest eigenvalues.
            let mut gram = Matrix6::zeros();
            for i in 0..dof {
                for j in 0..dof {
                    gram[(i, j)] = (0..6).map(|r| columns[6 * i + r] * columns[6 * j + r]).sum();
                }
            }
            for (value, eigenvalue) in singular.iter_mut().zip(sorted_eigenvalues(&gram)) {
                *value = eigenvalue.max(0.0).sqrt();
            }
        } else {
            let mut jacobian = SMatrix::<f64, 6, MAX_DOF>::zeros();
            jacobian.as_mut_slice()[..6 * dof].copy_from_slice(columns);
            let gram = jacobian.fixed_columns::<6>(0).into_owned();
            if dof == 6 {
                let values = gram.singular_values();
                singular.copy_from_slice(values.as_slice());
                singular.sort_by(|a, b| b.total_cmp(a));
            } else {
                let gram = jacobian * jacobian.transpose();
                for (value, eigenvalue) in singular.iter_mut().zip(sorted_eigenvalues(&gram)) {
                    *value = eigenvalue.max(0.0).sqrt();
                }
            }
        }
        let singular = &singular[..count];
        let (largest, smallest) = (singular[0], singular[count - 1]);
        Dexterity {
            condition: if smallest > 0.0 { largest / smallest } else { f64::INFINITY },
            manipulability: singular.iter().product(),
            smallest,
        }
    }
}

fn sorted_eigenvalues(gram: &Matrix6<f64>) -> [f64; 6] {
    let mut values = [0.0; 6];
    values.copy_from_slice(gram.symmetric_eigenvalues().as_slice());
    values.sort_by(|a, b| b.total_cmp(a));
    values
}
