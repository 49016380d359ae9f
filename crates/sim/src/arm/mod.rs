//! The plant: a robot arm of rigid bodies with servo drives.
//!
//! Bodies and joints are a rapier multibody (reduced coordinates, f32). Every joint has a servo in cascade, as
//! industrial drives are built: the position error `e` asks for a speed, the speed error for a torque,
//!
//! ```text
//! speed  = clamp(v + e k / d, -limit, limit)
//! torque = clamp(d (speed - qd) + known, -effort, effort)
//! k = max(J w^2, effort / 0.05 rad),   d = 2 z sqrt(k J)
//! ```
//!
//! where `v` is the speed of the setpoint, `J` the inertia of the joint at the start pose with the others locked, `w`
//! the natural frequency and `z` the damping ratio; the second bound on the stiffness `k` keeps friction from moving
//! light wrist joints. `known` are the arm's weight at the measured position and the viscous damping at the speed of
//! the setpoint. Effort and speed limits, viscous damping and static friction are the URDF's; its position limits
//! are hard stops. Where nothing saturates, a constant torque t moves a joint by t / k.
//!
//! Fixed substeps: `step` runs as many whole substeps as have come due and keeps the rest, so the trajectory does
//! not depend on how time is cut into calls, only on the setpoints in force at each substep.
//!
//! Differences from a real drive: no gear backlash, no cogging, no current ripple, no self-collision.

#[cfg(test)]
mod tests;
mod tree;

use std::time::Duration;

use can_driver::{Drive, JointState, Setpoint};
use kin::Robot;
use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};
use rapier3d::prelude as rp;

use crate::error::{Error, within};
use tree::Tree;

/// Settings of an [`Arm`].
#[derive(Debug, Clone, PartialEq)]
pub struct ArmParams {
    /// Joint positions at the start, in the order of the robot's joint vector (rad or m).
    pub start: Vec<f64>,
    /// Gravity in the base frame. A robot on a wall has another direction here.
    pub gravity_m_s2: [f64; 3],
    /// Lowest natural frequency of the servos. An acceleration a leaves an error of a / (2 pi f)^2: 1.4 mrad for
    /// 5 rad/s^2 at the default of 9.5 Hz. Industrial arms have 5 to 20 Hz.
    pub servo_hz: f64,
    /// Damping ratio of the servo; 1 is the fastest without overshoot.
    pub damping_ratio: f64,
    /// Share of the weight that the drives carry by feed-forward, 1 for all.
    pub gravity_compensation: f64,
    /// Fixed substep.
    pub substep: Duration,
}

impl ArmParams {
    /// Defaults for a robot that starts at `start`.
    pub fn new(start: Vec<f64>) -> Self {
        Self {
            start,
            gravity_m_s2: [0.0, 0.0, -9.81],
            servo_hz: 9.5,
            damping_ratio: 1.0,
            gravity_compensation: 1.0,
            substep: Duration::from_millis(1),
        }
    }
}

/// Error at which a drive gives all its effort, where its stiffness is not higher by natural frequency (rad or m).
const FULL_EFFORT_AT: f64 = 0.05;

/// What one drive needs to know of its joint.
#[derive(Debug, Clone, Copy)]
struct Servo {
    axis: rp::JointAxis,
    /// Index into rapier's spatial coordinates.
    coordinate: usize,
    stiffness: f64,
    damping: f64,
    /// Viscous damping of the joint, fed forward.
    viscous: f64,
    velocity: f64,
    lower: f64,
    upper: f64,
    link: usize,
    /// Where the drive pulls to; moves no faster than the velocity limit.
    reference: f64,
}

/// A simulated robot arm.
///
/// ```
/// use can_driver::{Drive, Setpoint};
/// use sim::{Arm, ArmParams};
/// use std::time::Duration;
///
/// let home = [0.0, 0.6, -1.2, 0.3, 0.0, 0.0];
/// let mut arm = Arm::new(&kin::Robot::builtin(), ArmParams::new(home.to_vec()))?;
/// let hold = home.map(|position_rad| Setpoint { position_rad, velocity_rad_s: 0.0 });
/// arm.step(Duration::from_millis(500), &hold, Drive::Servo)?;
/// for (joint, want) in arm.measured().iter().zip(home) {
///     assert!((joint.position_rad - want).abs() < 1e-3); // the weight is compensated
/// }
/// # Ok::<(), sim::Error>(())
/// ```
#[expect(missing_debug_implementations, reason = "rapier's world has none")]
pub struct Arm {
    world: rp::PhysicsWorld,
    tree: Tree,
    params: ArmParams,
    servos: Vec<Servo>,
    base: rp::RigidBodyHandle,
    measured: Vec<JointState>,
    load: Vec<f64>,
    braked: bool,
    pending: Duration,
}

impl Arm {
    /// Builds the plant at its start pose, at rest, brakes on.
    ///
    /// # Errors
    /// [`Error::JointCount`] for a start of the wrong length, [`Error::OutOfRange`] for a parameter or a start
    /// outside the position limits, [`Error::Mimic`] and [`Error::Massless`] for a robot that cannot be simulated.
    pub fn new(robot: &Robot, params: ArmParams) -> Result<Self, Error> {
        within("servo_hz", params.servo_hz, 0.5, 50.0)?;
        within("damping_ratio", params.damping_ratio, 0.1, 5.0)?;
        within("gravity_compensation", params.gravity_compensation, 0.0, 1.5)?;
        within("substep (s)", params.substep.as_secs_f64(), 1e-4, 5e-3)?;
        for g in params.gravity_m_s2 {
            within("gravity_m_s2", g, -100.0, 100.0)?;
        }
        if params.start.len() != robot.dof() {
            return Err(Error::JointCount { expected: robot.dof(), got: params.start.len() });
        }
        for (joint, &q) in robot.dof_joints().zip(&params.start) {
            within("start position", q, joint.limits.lower, joint.limits.upper)?;
        }
        let tree = Tree::new(robot)?;
        let inertia = tree.joint_inertia(&params.start);
        let omega = std::f64::consts::TAU * params.servo_hz;
        let mut world = rp::PhysicsWorld::new();
        world.gravity = vector(&Vector3::from(params.gravity_m_s2));
        world.integration_parameters.dt = params.substep.as_secs_f64() as f32;
        let base = world.bodies.insert(rp::RigidBodyBuilder::fixed());
        let mut handles = vec![base; tree.bodies.len()];
        let mut servos: Vec<Option<Servo>> = vec![None; tree.bodies.len()];
        for (link, &k) in (1..).zip(&tree.order) {
            let body = &tree.bodies[k];
            let m = &body.inertia_kg_m2;
            let inertia_matrix = rp::Matrix::from_cols(
                vector(&m.column(0).into_owned()),
                vector(&m.column(1).into_owned()),
                vector(&m.column(2).into_owned()),
            );
            let mass = rp::MassProperties::with_inertia_matrix(
                vector(&body.com_m.coords),
                body.mass_kg as f32,
                inertia_matrix,
            );
            handles[k] =
                world.bodies.insert(rp::RigidBodyBuilder::dynamic().additional_mass_properties(mass).can_sleep(false));
            // Rapier's joints move about (or along) the x axis of their frames.
            let turn = Rotation3::rotation_between(&Vector3::x(), &body.axis)
                .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
            let turn =
                Isometry3::from_parts(nalgebra::Translation3::identity(), UnitQuaternion::from_rotation_matrix(&turn));
            let (locked, axis, coordinate) = if body.turns {
                (rp::JointAxesMask::LOCKED_REVOLUTE_AXES, rp::JointAxis::AngX, 3)
            } else {
                (rp::JointAxesMask::LOCKED_PRISMATIC_AXES, rp::JointAxis::LinX, 0)
            };
            let joint_of_robot = &robot.joints()[robot.dofs()[k].index()];
            let limits = joint_of_robot.limits;
            let by_effort = if limits.effort.is_finite() { limits.effort / FULL_EFFORT_AT } else { 0.0 };
            let stiffness = (inertia[k] * omega * omega).max(by_effort);
            let servo = Servo {
                axis,
                coordinate,
                stiffness,
                damping: 2.0 * params.damping_ratio * (stiffness * inertia[k]).sqrt(),
                viscous: joint_of_robot.damping,
                velocity: limits.velocity,
                lower: limits.lower,
                upper: limits.upper,
                link,
                reference: params.start[k],
            };
            let mut joint = rp::GenericJointBuilder::new(locked)
                .local_frame1(pose(&(body.parent_from_joint * turn)))
                .local_frame2(pose(&turn))
                .motor_model(axis, rp::MotorModel::ForceBased)
                .set_motor(axis, 0.0, 0.0, 0.0, servo.damping as f32)
                .motor_max_force(axis, limits.effort.min(f64::from(f32::MAX)) as f32);
            if limits.lower.is_finite() && limits.upper.is_finite() {
                joint = joint.limits(axis, [limits.lower as f32, limits.upper as f32]);
            }
            let carrier = body.parent.map_or(base, |p| handles[p]);
            world.multibody_joints.insert(carrier, handles[k], joint.build(), true);
            servos[k] = Some(servo);
        }
        let mut arm = Self {
            world,
            servos: servos.into_iter().flatten().collect(),
            base,
            measured: vec![JointState::default(); tree.bodies.len()],
            load: vec![0.0; tree.bodies.len()],
            braked: true,
            pending: Duration::ZERO,
            tree,
            params,
        };
        arm.place(robot);
        Ok(arm)
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.servos.len()
    }

    /// Measured positions and velocities, in the order of the robot's joint vector.
    pub fn measured(&self) -> &[JointState] {
        &self.measured
    }

    /// Measured positions (rad or m).
    pub fn positions(&self) -> Vec<f64> {
        self.measured.iter().map(|j| j.position_rad).collect()
    }

    /// Servo stiffness of each joint (N m/rad or N/m).
    pub fn stiffness(&self) -> Vec<f64> {
        self.servos.iter().map(|s| s.stiffness).collect()
    }

    /// Torque or force that holds the arm still at `q` (N m or N).
    pub fn gravity_load(&self, q: &[f64]) -> Vec<f64> {
        let mut load = vec![0.0; self.joints()];
        self.tree.gravity_load(q, Vector3::from(self.params.gravity_m_s2), &mut load);
        load
    }

    /// Advances by `dt`. A setpoint's position is meant for the beginning of the call and moves on at its velocity.
    /// With [`Drive::Braked`] the setpoints are ignored and the brakes hold each joint where they closed.
    ///
    /// # Errors
    /// [`Error::JointCount`] for a wrong number of setpoints, [`Error::OutOfRange`] for one that is not finite.
    pub fn step(&mut self, dt: Duration, setpoints: &[Setpoint], drive: Drive) -> Result<(), Error> {
        if drive == Drive::Servo {
            if setpoints.len() != self.joints() {
                return Err(Error::JointCount { expected: self.joints(), got: setpoints.len() });
            }
            for s in setpoints {
                within("setpoint position", s.position_rad, -1e6, 1e6)?;
                within("setpoint velocity", s.velocity_rad_s, -1e6, 1e6)?;
            }
        }
        let before = self.pending.as_secs_f64();
        self.pending += dt;
        let h = self.params.substep.as_secs_f64();
        let mut passed = h - before;
        while self.pending >= self.params.substep {
            self.pending -= self.params.substep;
            match drive {
                Drive::Servo => self.aim(setpoints, passed, h),
                Drive::Braked => self.brake(),
            }
            self.world.step();
            self.measure();
            passed += h;
        }
        Ok(())
    }

    /// Sets the drives' targets for a substep that ends `after` seconds into the call.
    fn aim(&mut self, setpoints: &[Setpoint], after: f64, h: f64) {
        if self.braked {
            for (servo, joint) in self.servos.iter_mut().zip(&self.measured) {
                servo.reference = joint.position_rad;
            }
            self.braked = false;
        }
        for (k, setpoint) in setpoints.iter().enumerate() {
            let servo = &mut self.servos[k];
            let velocity = setpoint.velocity_rad_s.clamp(-servo.velocity, servo.velocity);
            let wanted = (setpoint.position_rad + velocity * after).clamp(servo.lower, servo.upper);
            let most = servo.velocity * h;
            let moved = (wanted - servo.reference).clamp(-most, most);
            servo.reference += moved;
            // While the reference is held back by the velocity limit, it moves at that limit.
            let speed = if moved.abs() >= most { moved / h } else { velocity };
            self.drive(k, speed);
        }
    }

    fn brake(&mut self) {
        if !self.braked {
            for (servo, joint) in self.servos.iter_mut().zip(&self.measured) {
                servo.reference = joint.position_rad;
            }
            self.braked = true;
        }
        for k in 0..self.joints() {
            self.drive(k, 0.0);
        }
    }

    /// Hands the wanted speed to rapier's motor, whose damper is integrated implicitly: a known torque t is a shift of
    /// the speed by t / d, so that rapier's limit on the motor's force limits the whole effort.
    fn drive(&mut self, k: usize, speed: f64) {
        let servo = self.servos[k];
        let share = if self.braked { 1.0 } else { self.params.gravity_compensation };
        let error = servo.reference - self.measured[k].position_rad;
        let asked = (speed + error * servo.stiffness / servo.damping).clamp(-servo.velocity, servo.velocity);
        let known = share * self.load[k] + servo.viscous * speed;
        let target = asked + known / servo.damping;
        let base = self.base;
        if let Some((multibody, _)) = multibody(&mut self.world, base)
            && let Some(link) = multibody.link_mut(servo.link)
        {
            link.joint.data.set_motor(servo.axis, 0.0, target as f32, 0.0, servo.damping as f32);
        }
    }

    /// Puts the bodies at the start pose and replaces rapier's default damping by the URDF's.
    fn place(&mut self, robot: &Robot) {
        let start = self.params.start.clone();
        let links: Vec<usize> = self.servos.iter().map(|s| s.link).collect();
        if let Some((multibody, bodies)) = multibody(&mut self.world, self.base) {
            // A new multibody has a free root; this takes over that the base is fixed, so that no coordinate belongs to it.
            multibody.forward_kinematics(bodies, true);
            // Generalised coordinates run in the order of the links, one for each moving joint.
            let mut displacement = vec![0.0; start.len()];
            for (k, joint) in robot.dof_joints().enumerate() {
                displacement[links[k] - 1] = start[k] as f32;
                multibody.damping_mut()[links[k] - 1] = joint.damping as f32;
                multibody.frictions_mut()[links[k] - 1] = joint.friction as f32;
            }
            multibody.apply_displacements(&displacement);
            multibody.forward_kinematics(bodies, true);
            multibody.update_rigid_bodies(bodies, true);
        }
        self.measure();
    }

    fn measure(&mut self) {
        let Self { world, servos, measured, base, .. } = self;
        if let Some((multibody, _)) = multibody(world, *base) {
            for (servo, out) in servos.iter().zip(measured.iter_mut()) {
                if let Some(link) = multibody.link(servo.link) {
                    out.position_rad = f64::from(link.joint.coords()[servo.coordinate]);
                    out.velocity_rad_s = f64::from(multibody.joint_velocity(link)[0]);
                }
            }
        }
        let q: Vec<f64> = self.measured.iter().map(|j| j.position_rad).collect();
        self.tree.gravity_load(&q, Vector3::from(self.params.gravity_m_s2), &mut self.load);
    }
}

/// The multibody that hangs on `base`, and the bodies.
fn multibody(
    world: &mut rp::PhysicsWorld,
    base: rp::RigidBodyHandle,
) -> Option<(&mut rp::Multibody, &mut rp::RigidBodySet)> {
    let index = world.multibody_joints.rigid_body_link(base)?.multibody;
    let multibody = world.multibody_joints.get_multibody_mut(index)?;
    Some((multibody, &mut world.bodies))
}

fn vector(v: &Vector3<f64>) -> rp::Vector {
    rp::Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

fn pose(p: &Isometry3<f64>) -> rp::Pose {
    let q = p.rotation.coords;
    rp::Pose::from_parts(
        vector(&p.translation.vector),
        rp::Rotation::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32),
    )
}
