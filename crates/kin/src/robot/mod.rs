//! A robot as a tree of links and joints, read from a URDF.
//!
//! The model is immutable. Joint vectors hold one value per *independent moving* joint, in the order of
//! [`Robot::dofs`] (the order of the joints in the file); mimic joints follow their master and fixed joints
//! have no value. Angles are radians, prismatic travel is metres.

mod tree;
mod urdf;

use std::path::PathBuf;

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use crate::Error;
pub use urdf::{LimitPolicy, UrdfOptions};

/// The project's own robot: a six-joint arm with 850 mm reach, as URDF text.
///
/// ```
/// assert!(kin::builtin_arm_urdf().contains(r#"<robot name="ogg_arm_6">"#));
/// ```
pub fn builtin_arm_urdf() -> &'static str {
    include_str!("../../assets/ogg-arm-6.urdf")
}

/// Index of a link in [`Robot::links`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LinkId(usize);

impl LinkId {
    /// Position in [`Robot::links`].
    pub fn index(self) -> usize {
        self.0
    }
}

/// Index of a joint in [`Robot::joints`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JointId(usize);

impl JointId {
    /// Position in [`Robot::joints`].
    pub fn index(self) -> usize {
        self.0
    }
}

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Does not move.
    Fixed,
    /// Turns about its axis between two limits.
    Revolute,
    /// Turns about its axis without end.
    Continuous,
    /// Slides along its axis between two limits.
    Prismatic,
}

impl JointKind {
    /// Whether the joint moves at all.
    pub fn moves(self) -> bool {
        self != Self::Fixed
    }

    /// Whether the joint value is an angle.
    pub fn turns(self) -> bool {
        matches!(self, Self::Revolute | Self::Continuous)
    }
}

/// What a joint may do. Units are those of the joint: rad, rad/s and N m where it turns, m, m/s and N where it
/// slides. Limits that a URDF read with [`LimitPolicy::AllowMissing`] does not give are infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLimits {
    /// Smallest position (rad or m); minus infinity for a continuous joint.
    pub lower: f64,
    /// Largest position (rad or m); infinity for a continuous joint.
    pub upper: f64,
    /// Largest speed, either way (rad/s or m/s).
    pub velocity: f64,
    /// Largest torque or force, either way (N m or N).
    pub effort: f64,
}

impl JointLimits {
    /// The positions to choose from where no other is known: the limits, or one turn where there are none.
    pub(crate) fn finite_range(&self) -> (f64, f64) {
        (self.lower.max(-std::f64::consts::PI), self.upper.min(std::f64::consts::PI))
    }
}

/// A joint that copies another one: `q = multiplier * q_master + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mimic {
    /// The joint that is copied.
    pub master: JointId,
    /// Factor.
    pub multiplier: f64,
    /// Offset (rad or m).
    pub offset: f64,
}

/// A joint between two links.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// The link nearer to the root.
    pub parent: LinkId,
    /// The link that the joint carries.
    pub child: LinkId,
    /// Pose of the joint (at value zero: of the child link) in the parent link.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis in the joint's own frame.
    pub axis: Unit<Vector3<f64>>,
    /// What it may do.
    pub limits: JointLimits,
    /// Present when the joint copies another one.
    pub mimic: Option<Mimic>,
    /// Viscous damping (N m s/rad or N s/m).
    pub damping: f64,
    /// Static friction (N m or N).
    pub friction: f64,
}

/// Mass properties of a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertial {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Centre of mass in the link frame (m).
    pub com_m: Point3<f64>,
    /// Rotational inertia about the centre of mass, in axes of the link frame (kg m^2).
    pub inertia_kg_m2: Matrix3<f64>,
}

/// A shape to draw or to collide with.
#[derive(Debug, Clone, PartialEq)]
pub enum Geometry {
    /// A box, centred.
    Box {
        /// Edge lengths along x, y, z (m).
        size_m: Vector3<f64>,
    },
    /// A cylinder along z, centred.
    Cylinder {
        /// Radius (m).
        radius_m: f64,
        /// Length along z (m).
        length_m: f64,
    },
    /// A capsule along z, centred.
    Capsule {
        /// Radius (m).
        radius_m: f64,
        /// Length of the cylindrical part along z (m).
        length_m: f64,
    },
    /// A sphere, centred.
    Sphere {
        /// Radius (m).
        radius_m: f64,
    },
    /// A mesh file.
    Mesh {
        /// `filename` as the URDF has it.
        uri: String,
        /// The file it stands for; `None` when [`UrdfOptions::resolve_meshes`] is off.
        path: Option<PathBuf>,
        /// Scale along x, y, z.
        scale: Vector3<f64>,
    },
}

/// A placed shape of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// The shape.
    pub geometry: Geometry,
    /// Pose of the shape in the link frame.
    pub link_from_shape: Isometry3<f64>,
    /// Red, green, blue, alpha in [0, 1], where the URDF gives a colour.
    pub rgba: Option<[f64; 4]>,
}

/// A rigid body of the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name in the URDF.
    pub name: String,
    /// Mass properties; `None` for a mere frame.
    pub inertial: Option<Inertial>,
    /// What to draw.
    pub visuals: Vec<Shape>,
    /// What to collide with.
    pub collisions: Vec<Shape>,
    /// The joint that carries this link; `None` for the root.
    pub parent_joint: Option<JointId>,
}

/// A robot: links, joints and the text they came from.
///
/// ```
/// let robot = kin::Robot::builtin();
/// assert_eq!(robot.dof(), 6);
/// assert_eq!(robot.root_link().name, "base_link");
/// let elbow = robot.joint("joint3")?;
/// assert!((elbow.parent_from_joint.translation.x - 0.450).abs() < 1e-12);
/// # Ok::<(), kin::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Robot {
    name: String,
    urdf: String,
    links: Vec<Link>,
    joints: Vec<Joint>,
    root: LinkId,
    /// Joints parent before child.
    order: Vec<JointId>,
    /// Independent moving joints in file order.
    dofs: Vec<JointId>,
    /// Joint index to position in a joint vector (masters and mimics).
    dof_of_joint: Vec<Option<usize>>,
}
