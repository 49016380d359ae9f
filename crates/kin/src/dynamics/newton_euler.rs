//! Recursive Newton-Euler: out with the motion, back with the forces.

use nalgebra::Vector3;

use super::{Dynamics, DynamicsScratch};
use crate::Error;

impl Dynamics {
    /// Joint torques (forces) that produce the accelerations `qdd` at `q` with speeds `qd`.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn inverse_dynamics(
        &self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        scratch: &mut DynamicsScratch,
        torque: &mut [f64],
    ) -> Result<(), Error> {
        self.check("joint vector", q.len())?;
        self.check("joint speeds", qd.len())?;
        self.check("joint accelerations", qdd.len())?;
        self.check("joint torques", torque.len())?;
        self.check_scratch(scratch)?;
        self.outwards(q, Some((qd, qdd)), scratch);
        self.inwards(scratch, torque);
        Ok(())
    }

    /// Joint torques (forces) that hold the robot still at `q`.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn gravity(&self, q: &[f64], scratch: &mut DynamicsScratch, torque: &mut [f64]) -> Result<(), Error> {
        self.check("joint vector", q.len())?;
        self.check("joint torques", torque.len())?;
        self.check_scratch(scratch)?;
        self.outwards(q, None, scratch);
        self.inwards(scratch, torque);
        Ok(())
    }

    fn outwards(&self, q: &[f64], rates: Option<(&[f64], &[f64])>, scratch: &mut DynamicsScratch) {
        for (index, body) in self.bodies.iter().enumerate() {
            // Gravity is an upward acceleration of the root.
            let (angular_velocity, angular_acceleration, acceleration) = match body.parent {
                Some(parent) => {
                    let parent = &scratch.motions[parent];
                    (parent.angular_velocity, parent.angular_acceleration, parent.acceleration)
                }
                None => (Vector3::zeros(), Vector3::zeros(), -self.gravity_m_s2),
            };
            let (speed, rate) =
                rates.map_or((0.0, 0.0), |(qd, qdd)| (body.multiplier * qd[body.dof], body.multiplier * qdd[body.dof]));
            let (rotation, origin) = body.placed(q);
            let z = Vector3::z();
            let inwards = rotation.transpose();
            let mut omega = inwards * angular_velocity;
            let mut alpha = inwards * angular_acceleration;
            let mut linear = inwards
                * (acceleration
                    + angular_acceleration.cross(&origin)
                    + angular_velocity.cross(&angular_velocity.cross(&origin)));
            if body.turns {
                alpha += z * rate + omega.cross(&z) * speed;
                omega += z * speed;
            } else {
                linear += z * rate + omega.cross(&z) * (2.0 * speed);
            }
            // Newton and Euler about the body's origin, with first moment h and inertia I there.
            let mass = &body.mass;
            let force = linear * mass.kg + alpha.cross(&mass.moment) + omega.cross(&omega.cross(&mass.moment));
            let torque = mass.inertia * alpha + omega.cross(&(mass.inertia * omega)) + mass.moment.cross(&linear);
            let motion = &mut scratch.motions[index];
            motion.rotation = rotation;
            motion.origin = origin;
            motion.angular_velocity = omega;
            motion.angular_acceleration = alpha;
            motion.acceleration = linear;
            motion.force = force;
            motion.torque = torque;
        }
    }

    fn inwards(&self, scratch: &mut DynamicsScratch, torque: &mut [f64]) {
        torque.fill(0.0);
        for (index, body) in self.bodies.iter().enumerate().rev() {
            let motion = scratch.motions[index];
            torque[body.dof] += body.multiplier * if body.turns { motion.torque.z } else { motion.force.z };
            if let Some(parent) = body.parent {
                let force = motion.rotation * motion.force;
                let parent = &mut scratch.motions[parent];
                parent.force += force;
                parent.torque += motion.rotation * motion.torque + motion.origin.cross(&force);
            }
        }
    }
}
