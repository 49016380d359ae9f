//! Forces: inverse dynamics, gravity, mass matrix.
//!
//! One body per moving joint; whatever is fixed to it is lumped into it. Inverse dynamics is the recursive
//! Newton-Euler method (Luh, Walker and Paul 1980) in body frames, the mass matrix the composite rigid body method
//! (Walker and Orin 1982). Joint damping and friction are not part of either: they act on a drive, see
//! [`crate::Joint`]. The root link stands still. No allocation in the calls; scratch space is the caller's.
//!
//! Units: N m for joints that turn, N for joints that slide; the mass matrix is kg m^2, kg m or kg.

mod composite;
mod newton_euler;
#[cfg(test)]
mod tests;

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::chain::z_onto;
use crate::{Error, JointId, Robot};

/// Mass, first moment and inertia about the body's origin, in body axes.
#[derive(Debug, Clone, Copy)]
struct Mass {
    kg: f64,
    moment: Vector3<f64>,
    inertia: Matrix3<f64>,
}

impl Mass {
    fn zero() -> Self {
        Self { kg: 0.0, moment: Vector3::zeros(), inertia: Matrix3::zeros() }
    }

    fn add(&mut self, other: &Self) {
        self.kg += other.kg;
        self.moment += other.moment;
        self.inertia += other.inertia;
    }

    /// The same matter seen from a parent frame, with rotation `r` and origin `p` in it.
    fn seen_from(&self, r: &Matrix3<f64>, p: &Vector3<f64>) -> Self {
        let moment = r * self.moment;
        // Steiner's rule about a point that is not the centre of mass.
        let cross = p * moment.transpose() + moment * p.transpose();
        let square = self.kg * p * p.transpose();
        let trace = 2.0 * p.dot(&moment) + self.kg * p.norm_squared();
        Self {
            kg: self.kg,
            moment: moment + self.kg * p,
            inertia: r * self.inertia * r.transpose() + Matrix3::from_diagonal_element(trace) - cross - square,
        }
    }
}

#[derive(Debug, Clone)]
struct Body {
    parent: Option<usize>,
    /// Rotation and origin of the joint frame (z is the axis) in the parent body, at value zero.
    rotation: Matrix3<f64>,
    origin: Vector3<f64>,
    turns: bool,
    dof: usize,
    multiplier: f64,
    offset: f64,
    mass: Mass,
}

/// The dynamics of a robot. Joint vectors are those of [`Robot`].
///
/// ```
/// use kin::Robot;
/// use nalgebra::Vector3;
/// let robot = Robot::builtin();
/// let dynamics = robot.dynamics(Vector3::new(0.0, 0.0, -9.81));
/// let mut scratch = dynamics.scratch();
/// let mut torque = [0.0; 6];
/// dynamics.gravity(&[0.0, std::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0, 0.0], &mut scratch, &mut torque)?;
/// // Straight up: only the wrist, 90 mm off the arm's line, pulls at the shoulder.
/// assert!(torque[1].abs() < 3.0);
/// dynamics.gravity(&[0.0; 6], &mut scratch, &mut torque)?;
/// // Stretched out: 13.7 kg at a mean of some 0.4 m.
/// assert!(torque[1] > 40.0 && torque[1] < 70.0);
/// # Ok::<(), kin::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Dynamics {
    /// Parents before children.
    bodies: Vec<Body>,
    dof: usize,
    gravity_m_s2: Vector3<f64>,
}

/// Working space for [`Dynamics`], sized by [`Dynamics::scratch`].
#[derive(Debug, Clone)]
pub struct DynamicsScratch {
    motions: Vec<Motion>,
    masses: Vec<Mass>,
}

#[derive(Debug, Clone, Copy)]
struct Motion {
    /// Parent from body.
    rotation: Matrix3<f64>,
    origin: Vector3<f64>,
    angular_velocity: Vector3<f64>,
    angular_acceleration: Vector3<f64>,
    acceleration: Vector3<f64>,
    force: Vector3<f64>,
    torque: Vector3<f64>,
}

impl Robot {
    /// Prepares the dynamics, with the gravity vector in axes of the root link.
    pub fn dynamics(&self, gravity_m_s2: Vector3<f64>) -> Dynamics {
        let mut bodies: Vec<Body> = Vec::new();
        // For each link: the body it is fixed to, and its pose in that body.
        let mut home: Vec<(Option<usize>, Isometry3<f64>)> = vec![(None, Isometry3::identity()); self.links().len()];
        for id in self.joints_from_root() {
            let joint = &self.joints()[id.index()];
            let (parent, body_from_parent) = home[joint.parent.index()];
            let body_from_joint = body_from_parent * joint.parent_from_joint;
            home[joint.child.index()] = if joint.kind.moves() {
                let joint_from_body = z_onto(joint.axis.into_inner());
                bodies.push(self.body(id, parent, body_from_joint * joint_from_body));
                (Some(bodies.len() - 1), Isometry3::from_parts(Vector3::zeros().into(), joint_from_body.inverse()))
            } else {
                (parent, body_from_joint)
            };
        }
        for (link, (body, body_from_link)) in self.links().iter().zip(&home) {
            if let (Some(body), Some(inertial)) = (*body, &link.inertial) {
                let rotation = body_from_link.rotation.to_rotation_matrix();
                let com = inertial.com_m.coords;
                let at_com = Mass { kg: inertial.mass_kg, moment: Vector3::zeros(), inertia: inertial.inertia_kg_m2 };
                let at_link = at_com.seen_from(&Matrix3::identity(), &com);
                bodies[body].mass.add(&at_link.seen_from(rotation.matrix(), &body_from_link.translation.vector));
            }
        }
        Dynamics { bodies, dof: self.dof(), gravity_m_s2 }
    }

    fn body(&self, id: JointId, parent: Option<usize>, parent_from_body: Isometry3<f64>) -> Body {
        let joint = &self.joints()[id.index()];
        let (multiplier, offset) = joint.mimic.map_or((1.0, 0.0), |mimic| (mimic.multiplier, mimic.offset));
        Body {
            parent,
            rotation: *matrix(parent_from_body.rotation).matrix(),
            origin: parent_from_body.translation.vector,
            turns: joint.kind.turns(),
            dof: self.dof_index(id).expect("a moving joint has a value"),
            multiplier,
            offset,
            mass: Mass::zero(),
        }
    }
}

fn matrix(rotation: UnitQuaternion<f64>) -> Rotation3<f64> {
    rotation.to_rotation_matrix()
}

impl Dynamics {
    /// Length of a joint vector.
    pub fn dof(&self) -> usize {
        self.dof
    }

    /// Working space of the right size.
    pub fn scratch(&self) -> DynamicsScratch {
        let motion = Motion {
            rotation: Matrix3::identity(),
            origin: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
            angular_acceleration: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            force: Vector3::zeros(),
            torque: Vector3::zeros(),
        };
        DynamicsScratch { motions: vec![motion; self.bodies.len()], masses: vec![Mass::zero(); self.bodies.len()] }
    }

    fn check(&self, what: &'static str, got: usize) -> Result<(), Error> {
        if got == self.dof { Ok(()) } else { Err(Error::Length { what, expected: self.dof, got }) }
    }

    fn check_scratch(&self, scratch: &DynamicsScratch) -> Result<(), Error> {
        if scratch.motions.len() == self.bodies.len() {
            Ok(())
        } else {
            Err(Error::Length {
                what: "scratch of another robot: bodies",
                expected: self.bodies.len(),
                got: scratch.motions.len(),
            })
        }
    }
}

impl Body {
    /// Rotation and origin in the parent body for a joint vector.
    fn placed(&self, q: &[f64]) -> (Matrix3<f64>, Vector3<f64>) {
        let value = self.multiplier * q[self.dof] + self.offset;
        if !self.turns {
            return (self.rotation, self.origin + self.rotation.column(2) * value);
        }
        let (sine, cosine) = value.sin_cos();
        let (x, y) = (self.rotation.column(0), self.rotation.column(1));
        let rotation = Matrix3::from_columns(&[
            x * cosine + y * sine,
            y * cosine - x * sine,
            self.rotation.column(2).into_owned(),
        ]);
        (rotation, self.origin)
    }
}
