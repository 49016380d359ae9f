//! Links: masses, inertias, shapes, and where their mesh files are.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::Reader;
use crate::robot::{Error, Geometry, Inertial, Link, Shape};

impl Reader<'_> {
    pub(super) fn link(&self, link: &urdf_rs::Link, colours: &BTreeMap<&str, [f64; 4]>) -> Result<Link, Error> {
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
}
