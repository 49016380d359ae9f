//! Looking things up in the tree, and where every link is for a joint vector.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::{Joint, JointId, Link, LinkId, Robot, UrdfOptions, builtin_arm_urdf};
use crate::Error;

impl Robot {
    /// The project's own arm, see [`builtin_arm_urdf`].
    pub fn builtin() -> Self {
        Self::from_urdf_str(builtin_arm_urdf(), &UrdfOptions::default()).expect("the built-in URDF is tested")
    }

    /// Name of the robot.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The URDF text this robot was read from.
    pub fn urdf(&self) -> &str {
        &self.urdf
    }

    /// All links.
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// All joints, in file order.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// Number of independent moving joints: the length of a joint vector.
    pub fn dof(&self) -> usize {
        self.dofs.len()
    }

    /// The joints behind a joint vector, in its order.
    pub fn dofs(&self) -> &[JointId] {
        &self.dofs
    }

    /// The joints behind a joint vector, in its order.
    pub fn dof_joints(&self) -> impl Iterator<Item = &Joint> {
        self.dofs.iter().map(|id| &self.joints[id.0])
    }

    /// Names of the joints behind a joint vector, in its order.
    pub fn dof_names(&self) -> Vec<&str> {
        self.dof_joints().map(|joint| joint.name.as_str()).collect()
    }

    /// All joints, parents before children.
    pub fn joints_from_root(&self) -> impl Iterator<Item = JointId> {
        self.order.iter().copied()
    }

    /// Where the value of a joint stands in a joint vector; for a mimic joint, where its master stands.
    /// `None` for a fixed joint.
    pub fn dof_index(&self, joint: JointId) -> Option<usize> {
        self.dof_of_joint[joint.0]
    }

    /// The link that everything hangs on.
    pub fn root(&self) -> LinkId {
        self.root
    }

    /// The link that everything hangs on.
    pub fn root_link(&self) -> &Link {
        &self.links[self.root.0]
    }

    /// Finds a link.
    ///
    /// # Errors
    /// [`Error::UnknownLink`].
    pub fn link_id(&self, name: &str) -> Result<LinkId, Error> {
        self.links.iter().position(|link| link.name == name).map(LinkId).ok_or_else(|| Error::UnknownLink {
            robot: self.name.clone(),
            name: name.to_owned(),
            known: self.links.iter().map(|link| link.name.clone()).collect(),
        })
    }

    /// Finds a joint.
    ///
    /// # Errors
    /// [`Error::UnknownJoint`].
    pub fn joint_id(&self, name: &str) -> Result<JointId, Error> {
        self.joints.iter().position(|joint| joint.name == name).map(JointId).ok_or_else(|| Error::UnknownJoint {
            robot: self.name.clone(),
            name: name.to_owned(),
            known: self.joints.iter().map(|joint| joint.name.clone()).collect(),
        })
    }

    /// A link by name.
    ///
    /// # Errors
    /// [`Error::UnknownLink`].
    pub fn link(&self, name: &str) -> Result<&Link, Error> {
        Ok(&self.links[self.link_id(name)?.0])
    }

    /// A joint by name.
    ///
    /// # Errors
    /// [`Error::UnknownJoint`].
    pub fn joint(&self, name: &str) -> Result<&Joint, Error> {
        Ok(&self.joints[self.joint_id(name)?.0])
    }

    /// Pose of a joint's child link in its parent link, for the joint vector `q`: what `/tf` carries.
    ///
    /// # Panics
    /// When `q` is shorter than [`Robot::dof`].
    pub fn parent_from_child(&self, joint: JointId, q: &[f64]) -> Isometry3<f64> {
        let model = &self.joints[joint.0];
        let Some(dof) = self.dof_of_joint[joint.0] else {
            return model.parent_from_joint;
        };
        let value = match model.mimic {
            Some(mimic) => mimic.multiplier * q[dof] + mimic.offset,
            None => q[dof],
        };
        let motion = if model.kind.turns() {
            Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&model.axis, value))
        } else {
            Isometry3::from_parts(Translation3::from(model.axis.into_inner() * value), UnitQuaternion::identity())
        };
        model.parent_from_joint * motion
    }

    /// Pose of every link in the root link, in the order of [`Robot::links`], for the joint vector `q`.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn link_transforms(&self, q: &[f64]) -> Result<Vec<Isometry3<f64>>, Error> {
        let mut root_from_link = vec![Isometry3::identity(); self.links.len()];
        self.link_transforms_into(q, &mut root_from_link)?;
        Ok(root_from_link)
    }

    /// As [`Robot::link_transforms`], into a buffer of one entry per link, without allocation.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn link_transforms_into(&self, q: &[f64], root_from_link: &mut [Isometry3<f64>]) -> Result<(), Error> {
        self.check_joint_vector(q)?;
        if root_from_link.len() != self.links.len() {
            return Err(Error::Length {
                what: "link transforms",
                expected: self.links.len(),
                got: root_from_link.len(),
            });
        }
        root_from_link[self.root.0] = Isometry3::identity();
        for &id in &self.order {
            let joint = &self.joints[id.0];
            root_from_link[joint.child.0] = root_from_link[joint.parent.0] * self.parent_from_child(id, q);
        }
        Ok(())
    }

    /// Pose of one link in the root link, for the joint vector `q`.
    ///
    /// # Errors
    /// [`Error::UnknownLink`], [`Error::Length`].
    pub fn link_transform(&self, link: &str, q: &[f64]) -> Result<Isometry3<f64>, Error> {
        self.check_joint_vector(q)?;
        let mut current = self.link_id(link)?;
        let mut current_from_link = Isometry3::identity();
        while let Some(joint) = self.links[current.0].parent_joint {
            current_from_link = self.parent_from_child(joint, q) * current_from_link;
            current = self.joints[joint.0].parent;
        }
        Ok(current_from_link)
    }

    /// Refuses a joint vector of the wrong length.
    ///
    /// # Errors
    /// [`Error::Length`].
    pub fn check_joint_vector(&self, q: &[f64]) -> Result<(), Error> {
        if q.len() == self.dof() {
            Ok(())
        } else {
            Err(Error::Length { what: "joint vector", expected: self.dof(), got: q.len() })
        }
    }
}
