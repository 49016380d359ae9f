//! The moving bodies of a robot: links without a moving joint between them are one rigid body.

use kin::{JointKind, Robot};
use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use crate::error::Error;

/// A rigid body and the joint that carries it.
#[derive(Debug, Clone)]
pub(super) struct Body {
    /// Index of the carrying body in [`Tree::bodies`]; `None` for one carried by the fixed base.
    pub(super) parent: Option<usize>,
    /// Pose of the joint at rest in the carrying body.
    pub(super) parent_from_joint: Isometry3<f64>,
    pub(super) axis: Unit<Vector3<f64>>,
    pub(super) turns: bool,
    pub(super) mass_kg: f64,
    pub(super) com_m: Point3<f64>,
    /// About the centre of mass, in axes of the body.
    pub(super) inertia_kg_m2: Matrix3<f64>,
}

/// One body per moving joint, in the order of the robot's joint vector.
#[derive(Debug, Clone)]
pub(super) struct Tree {
    pub(super) bodies: Vec<Body>,
    /// Bodies, the carrying before the carried.
    pub(super) order: Vec<usize>,
}

impl Tree {
    pub(super) fn new(robot: &Robot) -> Result<Self, Error> {
        let mut home: Vec<(Option<usize>, Isometry3<f64>)> = vec![(None, Isometry3::identity()); robot.links().len()];
        let mut bodies: Vec<Option<Body>> = vec![None; robot.dof()];
        let mut order = Vec::with_capacity(robot.dof());
        for index in from_root(robot) {
            let joint = &robot.joints()[index];
            let (parent, body_from_parent) = home[joint.parent.index()];
            if joint.kind == JointKind::Fixed {
                home[joint.child.index()] = (parent, body_from_parent * joint.parent_from_joint);
                continue;
            }
            let dof = robot.dofs().iter().position(|id| id.index() == index);
            let (None, Some(dof)) = (joint.mimic, dof) else {
                return Err(Error::Mimic { joint: joint.name.clone() });
            };
            bodies[dof] = Some(Body {
                parent,
                parent_from_joint: body_from_parent * joint.parent_from_joint,
                axis: joint.axis,
                turns: joint.kind.turns(),
                mass_kg: 0.0,
                com_m: Point3::origin(),
                inertia_kg_m2: Matrix3::zeros(),
            });
            order.push(dof);
            home[joint.child.index()] = (Some(dof), Isometry3::identity());
        }
        let mut bodies: Vec<Body> = bodies.into_iter().flatten().collect();
        for (link, &(body, body_from_link)) in robot.links().iter().zip(&home) {
            if let (Some(body), Some(inertial)) = (body, &link.inertial) {
                let turn = body_from_link.rotation.to_rotation_matrix();
                let inertia = turn * inertial.inertia_kg_m2 * turn.transpose();
                bodies[body].add(inertial.mass_kg, body_from_link * inertial.com_m, inertia);
            }
        }
        for (dof, body) in bodies.iter().enumerate() {
            if !(body.mass_kg > 0.0) {
                let joint = robot.dof_joints().nth(dof).map_or_else(String::new, |j| j.name.clone());
                return Err(Error::Massless { joint });
            }
        }
        Ok(Self { bodies, order })
    }

    /// Torque or force that holds every joint still at `q` under `gravity`: the moment of all carried masses.
    pub(super) fn gravity_load(&self, q: &[f64], gravity: Vector3<f64>, load: &mut [f64]) {
        let n = self.bodies.len();
        let mut base_from_body = vec![Isometry3::identity(); n];
        let mut base_from_joint = vec![Isometry3::identity(); n];
        for &k in &self.order {
            let body = &self.bodies[k];
            let carrier = body.parent.map_or_else(Isometry3::identity, |p| base_from_body[p]);
            base_from_joint[k] = carrier * body.parent_from_joint;
            base_from_body[k] = base_from_joint[k] * body.motion(q[k]);
        }
        load.fill(0.0);
        for (k, body) in self.bodies.iter().enumerate() {
            let com = base_from_body[k] * body.com_m;
            let weight = gravity * body.mass_kg;
            let mut carrier = Some(k);
            while let Some(j) = carrier {
                let axis = base_from_joint[j].rotation * self.bodies[j].axis.into_inner();
                let lever = com.coords - base_from_joint[j].translation.vector;
                load[j] -= if self.bodies[j].turns { axis.dot(&lever.cross(&weight)) } else { axis.dot(&weight) };
                carrier = self.bodies[j].parent;
            }
        }
    }

    /// Inertia that every joint sees with all others locked, at `q` (kg m^2 or kg).
    pub(super) fn joint_inertia(&self, q: &[f64]) -> Vec<f64> {
        let n = self.bodies.len();
        let mut base_from_body = vec![Isometry3::identity(); n];
        let mut base_from_joint = vec![Isometry3::identity(); n];
        for &k in &self.order {
            let body = &self.bodies[k];
            let carrier = body.parent.map_or_else(Isometry3::identity, |p| base_from_body[p]);
            base_from_joint[k] = carrier * body.parent_from_joint;
            base_from_body[k] = base_from_joint[k] * body.motion(q[k]);
        }
        let mut inertia = vec![0.0; n];
        for (k, body) in self.bodies.iter().enumerate() {
            let com = base_from_body[k] * body.com_m;
            let turn = base_from_body[k].rotation.to_rotation_matrix();
            let own = turn * body.inertia_kg_m2 * turn.transpose();
            let mut carrier = Some(k);
            while let Some(j) = carrier {
                let axis = base_from_joint[j].rotation * self.bodies[j].axis.into_inner();
                let lever = com.coords - base_from_joint[j].translation.vector;
                inertia[j] += if self.bodies[j].turns {
                    body.mass_kg * axis.cross(&lever).norm_squared() + axis.dot(&(own * axis))
                } else {
                    body.mass_kg
                };
                carrier = self.bodies[j].parent;
            }
        }
        inertia
    }
}

/// Indices of all joints, the carrying before the carried.
fn from_root(robot: &Robot) -> Vec<usize> {
    let mut reached = vec![false; robot.links().len()];
    reached[robot.root().index()] = true;
    let mut order = Vec::with_capacity(robot.joints().len());
    let mut left: Vec<usize> = (0..robot.joints().len()).collect();
    while !left.is_empty() {
        let before = left.len();
        left.retain(|&index| {
            let joint = &robot.joints()[index];
            let ready = reached[joint.parent.index()];
            if ready {
                reached[joint.child.index()] = true;
                order.push(index);
            }
            !ready
        });
        assert!(left.len() < before, "a robot is a tree, so every joint hangs on the root");
    }
    order
}

impl Body {
    /// Motion of the joint at value `q`.
    fn motion(&self, q: f64) -> Isometry3<f64> {
        if self.turns {
            Isometry3::rotation(self.axis.into_inner() * q)
        } else {
            let t = self.axis.into_inner() * q;
            Isometry3::translation(t.x, t.y, t.z)
        }
    }

    /// Joins a further mass to the body (parallel axis theorem).
    fn add(&mut self, mass_kg: f64, com_m: Point3<f64>, inertia: Matrix3<f64>) {
        let total = self.mass_kg + mass_kg;
        if !(total > 0.0) {
            return;
        }
        let joined = Point3::from((self.com_m.coords * self.mass_kg + com_m.coords * mass_kg) / total);
        let shifted = |mass: f64, from: Point3<f64>| {
            let d = from - joined;
            (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * mass
        };
        self.inertia_kg_m2 += shifted(self.mass_kg, self.com_m) + inertia + shifted(mass_kg, com_m);
        self.mass_kg = total;
        self.com_m = joined;
    }
}
