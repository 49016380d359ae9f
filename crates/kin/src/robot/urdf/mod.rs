//! From URDF text to a checked [`Robot`]. The XML is read by `urdf-rs`; everything it lets through and a moving
//! robot must not be built on (missing limits, loops, dangling names, masses below zero) is refused here.

mod joints;
mod links;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::{Error, Joint, JointId, Link, LinkId, Robot};

/// Whether moving joints may come without limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LimitPolicy {
    /// Refuse the file: what a robot that will move needs.
    #[default]
    Required,
    /// Take a missing limit as infinite: for kinematics on paper only.
    AllowMissing,
}

/// How a URDF is read.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct UrdfOptions {
    /// Whether moving joints may come without limits (default: refused).
    pub limits: LimitPolicy,
    /// Package name to folder, for `package://NAME/...` mesh files. A package that is not listed is looked for
    /// beside the URDF and in the folders above it.
    pub packages: BTreeMap<String, PathBuf>,
    /// Whether mesh files must exist (default: yes for files, no for strings, which have no folder).
    pub resolve_meshes: Option<bool>,
}

impl UrdfOptions {
    /// Sets [`UrdfOptions::limits`].
    #[must_use]
    pub fn limits(mut self, limits: LimitPolicy) -> Self {
        self.limits = limits;
        self
    }

    /// Says where a package lies.
    #[must_use]
    pub fn package(mut self, name: impl Into<String>, folder: impl Into<PathBuf>) -> Self {
        self.packages.insert(name.into(), folder.into());
        self
    }

    /// Sets [`UrdfOptions::resolve_meshes`].
    #[must_use]
    pub fn resolve_meshes(mut self, resolve: bool) -> Self {
        self.resolve_meshes = Some(resolve);
        self
    }
}

impl Robot {
    /// Reads a URDF file.
    ///
    /// # Errors
    /// [`Error::Read`] and the `Urdf*` variants of [`Error`].
    pub fn from_urdf_file(path: impl AsRef<Path>, options: &UrdfOptions) -> Result<Self, Error> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|source| Error::Read { path: path.to_owned(), source })?;
        let folder = path.parent().unwrap_or(Path::new(".")).to_owned();
        Reader { origin: path.display().to_string(), folder: Some(folder), options }.read(&text)
    }

    /// Reads URDF text. Mesh files with a relative path cannot be resolved from here and are left as they are,
    /// unless [`UrdfOptions::resolve_meshes`] asks for them.
    ///
    /// # Errors
    /// The `Urdf*` variants of [`Error`].
    ///
    /// ```
    /// use kin::{Error, LimitKind, Robot, UrdfOptions};
    /// let without_limits = r#"<robot name="r"><link name="a"/><link name="b"/>
    ///     <joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint></robot>"#;
    /// let refused = Robot::from_urdf_str(without_limits, &UrdfOptions::default()).unwrap_err();
    /// assert!(matches!(refused, Error::UrdfLimit { kind: LimitKind::Position, .. }));
    /// ```
    pub fn from_urdf_str(text: &str, options: &UrdfOptions) -> Result<Self, Error> {
        Reader { origin: "<string>".to_owned(), folder: None, options }.read(text)
    }
}

struct Reader<'a> {
    origin: String,
    folder: Option<PathBuf>,
    options: &'a UrdfOptions,
}

impl Reader<'_> {
    fn read(&self, text: &str) -> Result<Robot, Error> {
        let raw = urdf_rs::read_from_string(text)
            .map_err(|error| Error::UrdfSyntax { origin: self.origin.clone(), reason: error.to_string() })?;
        let link_ids = self.names("link", raw.links.iter().map(|link| link.name.as_str()))?;
        let joint_ids = self.names("joint", raw.joints.iter().map(|joint| joint.name.as_str()))?;
        let colours: BTreeMap<&str, [f64; 4]> = raw
            .materials
            .iter()
            .filter_map(|material| Some((material.name.as_str(), material.color.as_ref()?.rgba.0)))
            .collect();

        let mut links = Vec::with_capacity(raw.links.len());
        for link in &raw.links {
            links.push(self.link(link, &colours)?);
        }
        let mut joints = Vec::with_capacity(raw.joints.len());
        for joint in &raw.joints {
            joints.push(self.joint(joint, &link_ids, &joint_ids)?);
        }
        for (index, joint) in joints.iter().enumerate() {
            let slot = &mut links[joint.child.0].parent_joint;
            if let Some(first) = slot {
                return Err(self.tree(format!(
                    "link `{}` is the child of both joint `{}` and joint `{}`",
                    raw.links[joint.child.0].name, joints[first.0].name, joint.name
                )));
            }
            *slot = Some(JointId(index));
        }
        let (root, order) = self.order(&links, &joints)?;
        let dofs: Vec<JointId> = (0..joints.len())
            .map(JointId)
            .filter(|id| joints[id.0].kind.moves() && joints[id.0].mimic.is_none())
            .collect();
        let mut dof_of_joint = vec![None; joints.len()];
        for (index, id) in dofs.iter().enumerate() {
            dof_of_joint[id.0] = Some(index);
        }
        for (index, joint) in joints.iter().enumerate() {
            if let Some(mimic) = joint.mimic {
                dof_of_joint[index] = dof_of_joint[mimic.master.0];
                if joints[mimic.master.0].mimic.is_some() || dof_of_joint[index].is_none() {
                    return Err(Error::UrdfDangling {
                        origin: self.origin.clone(),
                        joint: joint.name.clone(),
                        attribute: "mimic (of a joint that moves on its own)",
                        name: joints[mimic.master.0].name.clone(),
                    });
                }
            }
        }
        Ok(Robot { name: raw.name, urdf: text.to_owned(), links, joints, root, order, dofs, dof_of_joint })
    }

    fn names<'n>(
        &self,
        element: &'static str,
        names: impl Iterator<Item = &'n str>,
    ) -> Result<BTreeMap<&'n str, usize>, Error> {
        let mut ids = BTreeMap::new();
        for (index, name) in names.enumerate() {
            if ids.insert(name, index).is_some() {
                return Err(Error::UrdfDuplicate { origin: self.origin.clone(), element, name: name.to_owned() });
            }
        }
        Ok(ids)
    }

    fn tree(&self, reason: String) -> Error {
        Error::UrdfTree { origin: self.origin.clone(), reason }
    }

    fn value(
        &self,
        element: &'static str,
        name: &str,
        what: &'static str,
        expected: &'static str,
        got: String,
    ) -> Error {
        Error::UrdfValue { origin: self.origin.clone(), element, name: name.to_owned(), what, expected, got }
    }

    /// The root, and the joints parent before child.
    fn order(&self, links: &[Link], joints: &[Joint]) -> Result<(LinkId, Vec<JointId>), Error> {
        let roots: Vec<usize> = (0..links.len()).filter(|&index| links[index].parent_joint.is_none()).collect();
        let [root] = roots[..] else {
            let names: Vec<&str> = roots.iter().map(|&index| links[index].name.as_str()).collect();
            return Err(self.tree(format!("expected one link without a parent joint, got {names:?}")));
        };
        let mut reached = vec![false; links.len()];
        reached[root] = true;
        let mut order = Vec::with_capacity(joints.len());
        let mut grew = true;
        while grew {
            grew = false;
            for (index, joint) in joints.iter().enumerate() {
                if reached[joint.parent.0] && !reached[joint.child.0] {
                    reached[joint.child.0] = true;
                    order.push(JointId(index));
                    grew = true;
                }
            }
        }
        match reached.iter().position(|&reached| !reached) {
            None => Ok((LinkId(root), order)),
            Some(index) => {
                Err(self.tree(format!("link `{}` is part of a loop and hangs on nothing", links[index].name)))
            }
        }
    }

    fn pose(&self, element: &'static str, name: &str, pose: &urdf_rs::Pose) -> Result<Isometry3<f64>, Error> {
        let (xyz, rpy) = (pose.xyz.0, pose.rpy.0);
        if !xyz.iter().chain(&rpy).all(|value| value.is_finite()) {
            return Err(self.value(element, name, "origin", "finite numbers", format!("xyz {xyz:?} rpy {rpy:?}")));
        }
        Ok(Isometry3::from_parts(
            Translation3::new(xyz[0], xyz[1], xyz[2]),
            UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]),
        ))
    }
}
