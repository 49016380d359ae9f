//! A path of links from a base to a tip, prepared for fast kinematics.
//!
//! Every moving joint is rewritten so that its axis is the z axis of a frame of its own; the fixed transforms in
//! between (fixed joints included) are multiplied out once. The path may run up and down the tree. A joint vector
//! of a chain has one value per independent joint that moves the tip relative to the base, in the order met from
//! base to tip ([`Chain::joint_names`]).
//!
//! Jacobians are geometric, taken at the tip and written in the axes of the base: rows 0 to 2 are the linear
//! velocity (m/s), rows 3 to 5 the angular velocity (rad/s) per unit joint speed. This is Pinocchio's
//! `LOCAL_WORLD_ALIGNED` and KDL's convention.

mod frame;
mod kernel;
mod measures;
mod rates;
mod sincos;

use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::analytic::Analytic;
use crate::ik::Starts;
use crate::simd::Machine;
use crate::{Error, JointId, JointLimits, LinkId, Robot};
pub(crate) use frame::{Frame, cross};
pub use measures::Dexterity;

/// The longest joint vector of a chain.
pub(crate) const MAX_DOF: usize = 32;
/// The most moving joints of a chain, mimic joints included.
pub(crate) const MAX_STAGES: usize = 64;

/// One moving joint of the path.
#[derive(Debug, Clone)]
struct Stage {
    /// From the frame after the previous joint to this joint's frame, whose z is the axis.
    fixed: Frame,
    turns: bool,
    /// Position in the joint vector.
    dof: usize,
    /// Joint value = multiplier * q + offset (1 and 0 but for mimic joints).
    multiplier: f64,
    offset: f64,
    mimics: bool,
}

/// A prepared path from one link to another.
///
/// ```
/// use kin::Robot;
/// let chain = Robot::builtin().chain("base_link", "tool0")?;
/// let q = [0.0, 1.0, -1.5, 0.3, 0.2, 0.1];
/// let base_from_tip = chain.fk(&q);
/// let jacobian = chain.jacobian(&q);
/// // Turning joint1 (about z) moves the tip by z x p.
/// assert!((jacobian[(0, 0)] + base_from_tip.translation.y).abs() < 1e-12);
/// assert!((jacobian[(1, 0)] - base_from_tip.translation.x).abs() < 1e-12);
/// # Ok::<(), kin::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Chain {
    base: String,
    tip: String,
    joints: Vec<JointId>,
    names: Vec<String>,
    limits: Vec<JointLimits>,
    stages: Vec<Stage>,
    /// From the frame after the last joint to the tip.
    end: Frame,
    /// Stage `i` belongs to joint value `i`, one to one, without multiplier: the usual arm.
    plain: bool,
    pub(crate) machine: Machine,
    /// All stages turn, as well as `plain`.
    plain_turns: bool,
    analytic: Option<Box<Analytic>>,
    pub(crate) starts: Arc<Starts>,
}

impl Robot {
    /// Prepares the path between two links.
    ///
    /// # Errors
    /// [`Error::UnknownLink`]; [`Error::EmptyChain`] when no joint moves the tip relative to the base;
    /// [`Error::Length`] for more than 32 joints.
    pub fn chain(&self, base: &str, tip: &str) -> Result<Chain, Error> {
        let up = self.ancestry(self.link_id(base)?);
        let down = self.ancestry(self.link_id(tip)?);
        // Drop what both share: the path from their last common link to the root.
        let shared = up.iter().rev().zip(down.iter().rev()).take_while(|(a, b)| a == b).count();
        let up = &up[..up.len() - shared];
        let down = &down[..down.len() - shared];

        let mut builder =
            Builder { robot: self, stages: Vec::new(), joints: Vec::new(), pending: Isometry3::identity() };
        for &joint in up {
            builder.backward(joint);
        }
        for &joint in down.iter().rev() {
            builder.forward(joint);
        }
        let Builder { stages, joints, pending, .. } = builder;
        if joints.is_empty() {
            return Err(Error::EmptyChain { base: base.to_owned(), tip: tip.to_owned() });
        }
        if joints.len() > MAX_DOF {
            return Err(Error::Length { what: "joints of a chain (at most)", expected: MAX_DOF, got: joints.len() });
        }
        if stages.len() > MAX_STAGES {
            return Err(Error::Length {
                what: "moving joints of a chain (at most)",
                expected: MAX_STAGES,
                got: stages.len(),
            });
        }
        let plain = stages.len() == joints.len() && stages.iter().enumerate().all(|(i, s)| s.dof == i && !s.mimics);
        let plain_turns = plain && stages.iter().all(|stage| stage.turns);
        let mut chain = Chain {
            base: base.to_owned(),
            tip: tip.to_owned(),
            names: joints.iter().map(|id| self.joints()[id.index()].name.clone()).collect(),
            limits: joints.iter().map(|id| self.joints()[id.index()].limits).collect(),
            joints,
            stages,
            end: Frame::from_isometry(&pending),
            plain,
            machine: Machine::detect(),
            plain_turns,
            analytic: None,
            starts: Arc::default(),
        };
        chain.starts = Arc::new(Starts::of(&chain));
        chain.analytic = crate::analytic::recognise(&chain).map(Box::new);
        Ok(chain)
    }

    /// The joints from a link to the root, nearest first.
    fn ancestry(&self, mut link: LinkId) -> Vec<JointId> {
        let mut path = Vec::new();
        while let Some(joint) = self.links()[link.index()].parent_joint {
            path.push(joint);
            link = self.joints()[joint.index()].parent;
        }
        path
    }
}

struct Builder<'a> {
    robot: &'a Robot,
    stages: Vec<Stage>,
    joints: Vec<JointId>,
    /// Fixed motion since the last stage.
    pending: Isometry3<f64>,
}

impl Builder<'_> {
    fn forward(&mut self, id: JointId) {
        let joint = &self.robot.joints()[id.index()];
        self.pending *= joint.parent_from_joint;
        if joint.kind.moves() {
            self.push(id, joint.axis.into_inner());
        }
    }

    fn backward(&mut self, id: JointId) {
        let joint = &self.robot.joints()[id.index()];
        if joint.kind.moves() {
            // The inverse of a motion about an axis is the motion about the opposite axis.
            self.push(id, -joint.axis.into_inner());
        }
        self.pending *= joint.parent_from_joint.inverse();
    }

    fn push(&mut self, id: JointId, axis: Vector3<f64>) {
        let joint = &self.robot.joints()[id.index()];
        let (master, multiplier, offset) =
            joint.mimic.map_or((id, 1.0, 0.0), |mimic| (mimic.master, mimic.multiplier, mimic.offset));
        let dof = self.joints.iter().position(|&known| known == master).unwrap_or_else(|| {
            self.joints.push(master);
            self.joints.len() - 1
        });
        let joint_from_stage = z_onto(axis);
        self.stages.push(Stage {
            fixed: Frame::from_isometry(&(self.pending * joint_from_stage)),
            turns: joint.kind.turns(),
            dof,
            multiplier,
            offset,
            mimics: joint.mimic.is_some(),
        });
        self.pending = Isometry3::from_parts(Translation3::identity(), joint_from_stage.inverse());
    }
}

/// A rotation that takes z onto the axis; the shortest, or a half turn about x.
pub(crate) fn z_onto(axis: Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::z(), &axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))
}

impl Chain {
    /// Name of the base link.
    pub fn base(&self) -> &str {
        &self.base
    }

    /// Name of the tip link.
    pub fn tip(&self) -> &str {
        &self.tip
    }

    /// Length of a joint vector.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// The joints behind a joint vector, in its order.
    pub fn joints(&self) -> &[JointId] {
        &self.joints
    }

    /// Names of the joints behind a joint vector, in its order.
    pub fn joint_names(&self) -> &[String] {
        &self.names
    }

    /// Limits of the joints behind a joint vector, in its order.
    pub fn limits(&self) -> &[JointLimits] {
        &self.limits
    }

    /// Where a joint stands in a joint vector of this chain.
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    pub(crate) fn is_plain_turning(&self) -> bool {
        self.plain_turns
    }

    pub(crate) fn closed_form(&self) -> Option<&Analytic> {
        self.analytic.as_deref()
    }

    /// Clamps each value to its position limits; says whether anything changed.
    pub fn clamp(&self, q: &mut [f64]) -> bool {
        let mut changed = false;
        for (value, limits) in q.iter_mut().zip(&self.limits) {
            changed |= *value < limits.lower || *value > limits.upper;
            *value = value.clamp(limits.lower, limits.upper);
        }
        changed
    }

    fn assert_length(&self, q: &[f64]) {
        assert_eq!(q.len(), self.dof(), "joint vector of chain {} -> {}", self.base, self.tip);
    }
}
