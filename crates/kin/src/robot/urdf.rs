//! From URDF text to a checked [`Robot`]. The XML is read by `urdf-rs`; everything it lets through and a moving
//! robot must not be built on (missing limits, loops, dangling names, masses below zero) is refused here.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Point3, SymmetricEigen, Translation3, Unit, UnitQuaternion, Vector3};

use super::{Error, Geometry, Inertial, Joint, JointId, JointKind, JointLimits, Link, LinkId, Mimic, Robot, Shape};
use crate::LimitKind;

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

    fn link(&self, link: &urdf_rs::Link, colours: &BTreeMap<&str, [f64; 4]>) -> Result<Link, Error> {
        let mut visuals = Vec::with_capacity(link.visual.len());
        for visual in &link.visual {
            let rgba = visual.material.as_ref().and_then(|material| match &material.color {
                Some(color) => Some(color.rgba.0),
                None => colours.get(material.name.as_str()).copied(),
            });
            visuals.push(self.shape(&link.name, &visual.geometry, &visual.origin, rgba)?);
        }
        let mut collisions = Vec::with_capacity(link.collision.len());
        for collision in &link.collision {
            collisions.push(self.shape(&link.name, &collision.geometry, &collision.origin, None)?);
        }
        Ok(Link { name: link.name.clone(), inertial: self.inertial(link)?, visuals, collisions, parent_joint: None })
    }

    fn inertial(&self, link: &urdf_rs::Link) -> Result<Option<Inertial>, Error> {
        let raw = &link.inertial;
        let mass_kg = raw.mass.value;
        if !(mass_kg >= 0.0 && mass_kg.is_finite()) {
            return Err(self.value("link", &link.name, "mass (kg)", "a finite value >= 0", mass_kg.to_string()));
        }
        if mass_kg == 0.0 {
            return Ok(None);
        }
        let i = &raw.inertia;
        let inertia = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
        let smallest = if inertia.iter().all(|value| value.is_finite()) {
            SymmetricEigen::new(inertia).eigenvalues.min()
        } else {
            f64::NAN
        };
        // Published files round their inertias; a negative moment beyond rounding is a mistake.
        if !(smallest >= -1e-6 * inertia.amax()) {
            return Err(self.value(
                "link",
                &link.name,
                "inertia (kg m^2)",
                "finite, with no negative principal moment",
                format!("{smallest}"),
            ));
        }
        let link_from_com = self.pose("link", &link.name, &raw.origin)?;
        let rotation = link_from_com.rotation.to_rotation_matrix();
        Ok(Some(Inertial {
            mass_kg,
            com_m: Point3::from(link_from_com.translation.vector),
            inertia_kg_m2: rotation.matrix() * inertia * rotation.matrix().transpose(),
        }))
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

    fn shape(
        &self,
        link: &str,
        geometry: &urdf_rs::Geometry,
        origin: &urdf_rs::Pose,
        rgba: Option<[f64; 4]>,
    ) -> Result<Shape, Error> {
        let geometry = match geometry {
            urdf_rs::Geometry::Box { size } => Geometry::Box { size_m: Vector3::from(size.0) },
            urdf_rs::Geometry::Cylinder { radius, length } => {
                Geometry::Cylinder { radius_m: *radius, length_m: *length }
            }
            urdf_rs::Geometry::Capsule { radius, length } => Geometry::Capsule { radius_m: *radius, length_m: *length },
            urdf_rs::Geometry::Sphere { radius } => Geometry::Sphere { radius_m: *radius },
            urdf_rs::Geometry::Mesh { filename, scale } => Geometry::Mesh {
                uri: filename.clone(),
                path: self.mesh(link, filename)?,
                scale: scale.map_or(Vector3::repeat(1.0), |scale| Vector3::from(scale.0)),
            },
        };
        let sizes: &[f64] = match &geometry {
            Geometry::Box { size_m } => size_m.as_slice(),
            Geometry::Cylinder { radius_m, length_m } | Geometry::Capsule { radius_m, length_m } => {
                &[*radius_m, *length_m]
            }
            Geometry::Sphere { radius_m } => &[*radius_m],
            Geometry::Mesh { .. } => &[],
        };
        if !sizes.iter().all(|&size| size >= 0.0 && size.is_finite()) {
            return Err(self.value("link", link, "geometry (m)", "finite sizes >= 0", format!("{sizes:?}")));
        }
        Ok(Shape { geometry, link_from_shape: self.pose("link", link, origin)?, rgba })
    }

    /// Where a mesh file is. `package://NAME/REST` is looked for in the configured folder of NAME; without one, as
    /// `NAME/REST` and `REST` beside the URDF and in each folder above it (packages hold their URDF in a subfolder).
    fn mesh(&self, link: &str, uri: &str) -> Result<Option<PathBuf>, Error> {
        let wanted = self.options.resolve_meshes.unwrap_or(self.folder.is_some());
        if !wanted || uri.starts_with("http://") || uri.starts_with("https://") {
            return Ok(None);
        }
        let mut tried = Vec::new();
        if let Some(rest) = uri.strip_prefix("package://") {
            let (package, file) = rest.split_once('/').unwrap_or((rest, ""));
            if let Some(folder) = self.options.packages.get(package) {
                tried.push(folder.join(file));
            } else {
                for folder in self.folder.iter().flat_map(|folder| folder.ancestors()) {
                    tried.push(folder.join(package).join(file));
                    tried.push(folder.join(file));
                }
            }
        } else {
            let plain = Path::new(uri.strip_prefix("file://").unwrap_or(uri));
            tried.push(self.folder.as_ref().map_or(plain.to_owned(), |folder| folder.join(plain)));
        }
        match tried.iter().find(|path| path.is_file()) {
            Some(path) => Ok(Some(path.clone())),
            None => {
                Err(Error::UrdfMesh { origin: self.origin.clone(), link: link.to_owned(), uri: uri.to_owned(), tried })
            }
        }
    }

    fn joint(
        &self,
        joint: &urdf_rs::Joint,
        link_ids: &BTreeMap<&str, usize>,
        joint_ids: &BTreeMap<&str, usize>,
    ) -> Result<Joint, Error> {
        let kind = match joint.joint_type {
            urdf_rs::JointType::Fixed => JointKind::Fixed,
            urdf_rs::JointType::Revolute => JointKind::Revolute,
            urdf_rs::JointType::Continuous => JointKind::Continuous,
            urdf_rs::JointType::Prismatic => JointKind::Prismatic,
            urdf_rs::JointType::Floating => return Err(self.kind(joint, "floating")),
            urdf_rs::JointType::Planar => return Err(self.kind(joint, "planar")),
            urdf_rs::JointType::Spherical => return Err(self.kind(joint, "spherical")),
        };
        let find = |attribute: &'static str, name: &str, ids: &BTreeMap<&str, usize>| {
            ids.get(name).copied().ok_or_else(|| Error::UrdfDangling {
                origin: self.origin.clone(),
                joint: joint.name.clone(),
                attribute,
                name: name.to_owned(),
            })
        };
        let axis = Vector3::from(joint.axis.xyz.0);
        let axis = match (kind, Unit::try_new(axis, 1e-9)) {
            (JointKind::Fixed, _) => Vector3::x_axis(),
            (_, Some(unit)) if unit.iter().all(|value| value.is_finite()) => unit,
            _ => {
                return Err(self.value(
                    "joint",
                    &joint.name,
                    "axis",
                    "a finite vector that is not zero",
                    format!("{axis:?}"),
                ));
            }
        };
        let mimic = match &joint.mimic {
            None => None,
            Some(mimic) => Some(Mimic {
                master: JointId(find("mimic", &mimic.joint, joint_ids)?),
                multiplier: mimic.multiplier.unwrap_or(1.0),
                offset: mimic.offset.unwrap_or(0.0),
            }),
        };
        let (damping, friction) = joint.dynamics.as_ref().map_or((0.0, 0.0), |d| (d.damping, d.friction));
        for (what, value) in [("damping", damping), ("friction", friction)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(self.value("joint", &joint.name, what, "a finite value >= 0", value.to_string()));
            }
        }
        Ok(Joint {
            name: joint.name.clone(),
            kind,
            parent: LinkId(find("parent", &joint.parent.link, link_ids)?),
            child: LinkId(find("child", &joint.child.link, link_ids)?),
            parent_from_joint: self.pose("joint", &joint.name, &joint.origin)?,
            axis,
            limits: self.limits(joint, kind, mimic.is_some())?,
            mimic,
            damping,
            friction,
        })
    }

    fn kind(&self, joint: &urdf_rs::Joint, kind: &'static str) -> Error {
        Error::UrdfJointKind { origin: self.origin.clone(), joint: joint.name.clone(), kind }
    }

    /// `urdf-rs` reads an absent limit as zero, so zero (and an empty range) counts as absent here.
    fn limits(&self, joint: &urdf_rs::Joint, kind: JointKind, mimics: bool) -> Result<JointLimits, Error> {
        let raw = &joint.limit;
        // A mimic joint is bounded by its master; a fixed one needs no bound.
        let required = self.options.limits == LimitPolicy::Required && kind.moves() && !mimics;
        let refuse = |kind: LimitKind, expected: &'static str, got: String| {
            Err(Error::UrdfLimit { origin: self.origin.clone(), joint: joint.name.clone(), kind, expected, got })
        };
        let (lower, upper) = match kind {
            JointKind::Continuous | JointKind::Fixed => (f64::NEG_INFINITY, f64::INFINITY),
            JointKind::Revolute | JointKind::Prismatic => {
                if raw.lower < raw.upper && (!required || (raw.lower.is_finite() && raw.upper.is_finite())) {
                    (raw.lower, raw.upper)
                } else if required {
                    return refuse(
                        LimitKind::Position,
                        "finite lower < upper",
                        format!("lower {} and upper {}", raw.lower, raw.upper),
                    );
                } else {
                    (f64::NEG_INFINITY, f64::INFINITY)
                }
            }
        };
        let mut bounds = [f64::INFINITY; 2];
        for (bound, (kind, value)) in
            bounds.iter_mut().zip([(LimitKind::Velocity, raw.velocity), (LimitKind::Effort, raw.effort)])
        {
            if value > 0.0 && (!required || value.is_finite()) {
                *bound = value;
            } else if required {
                return refuse(kind, "a finite value > 0", value.to_string());
            }
        }
        Ok(JointLimits { lower, upper, velocity: bounds[0], effort: bounds[1] })
    }
}
