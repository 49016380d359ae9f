//! The mass matrix by composite rigid bodies.

use nalgebra::{DMatrix, Vector3};

use super::{Dynamics, DynamicsScratch};
use crate::Error;

impl Dynamics {
    /// The symmetric matrix `M(q)` of `torque = M qdd + ...`, `dof x dof`.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn mass_matrix(
        &self,
        q: &[f64],
        scratch: &mut DynamicsScratch,
        mass_matrix: &mut DMatrix<f64>,
    ) -> Result<(), Error> {
        self.check("joint vector", q.len())?;
        self.check("rows of the mass matrix", mass_matrix.nrows())?;
        self.check("columns of the mass matrix", mass_matrix.ncols())?;
        self.check_scratch(scratch)?;
        for (index, body) in self.bodies.iter().enumerate() {
            let motion = &mut scratch.motions[index];
            (motion.rotation, motion.origin) = body.placed(q);
            scratch.masses[index] = body.mass;
        }
        mass_matrix.fill(0.0);
        for (index, body) in self.bodies.iter().enumerate().rev() {
            let mass = scratch.masses[index];
            let motion = scratch.motions[index];
            if let Some(parent) = body.parent {
                let seen = mass.seen_from(&motion.rotation, &motion.origin);
                scratch.masses[parent].add(&seen);
            }
            // Force and torque that accelerate everything from here outwards by one unit of this joint.
            let z = Vector3::z();
            let (mut force, mut torque) = if body.turns {
                (z.cross(&mass.moment), mass.inertia * z)
            } else {
                (z * mass.kg, mass.moment.cross(&z))
            };
            let own = if body.turns { torque.z } else { force.z };
            mass_matrix[(body.dof, body.dof)] += body.multiplier * body.multiplier * own;
            let mut at = index;
            while let Some(parent) = self.bodies[at].parent {
                let motion = &scratch.motions[at];
                force = motion.rotation * force;
                torque = motion.rotation * torque + motion.origin.cross(&force);
                at = parent;
                let other = &self.bodies[at];
                let value = body.multiplier * other.multiplier * if other.turns { torque.z } else { force.z };
                mass_matrix[(body.dof, other.dof)] += value;
                mass_matrix[(other.dof, body.dof)] += value;
            }
        }
        Ok(())
    }
}
