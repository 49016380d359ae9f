//! Joints: kinds, axes, limits, and joints that follow others.

use std::collections::BTreeMap;

use nalgebra::{Unit, Vector3};

use super::{LimitPolicy, Reader};
use crate::LimitKind;
use crate::robot::{Error, Joint, JointId, JointKind, JointLimits, LinkId, Mimic};

impl Reader<'_> {
    pub(super) fn joint(
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
