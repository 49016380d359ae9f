//! What can go wrong, as one enum.

use std::path::PathBuf;

/// Which of the mandatory joint limits is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LimitKind {
    /// `lower` and `upper` of a revolute or prismatic joint.
    Position,
    /// `velocity`.
    Velocity,
    /// `effort`.
    Effort,
}

impl std::fmt::Display for LimitKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Effort => "effort",
        })
    }
}

/// Every failure of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The text is no URDF.
    #[error("{origin}: expected a URDF <robot>: {reason}")]
    UrdfSyntax {
        /// File, or `<string>`.
        origin: String,
        /// What the XML reader said.
        reason: String,
    },
    /// A link or joint name occurs twice.
    #[error("{origin}: {element} `{name}` is defined twice, expected unique names")]
    UrdfDuplicate {
        /// File, or `<string>`.
        origin: String,
        /// `link` or `joint`.
        element: &'static str,
        /// The name.
        name: String,
    },
    /// A joint names a link or joint that does not exist.
    #[error("{origin}: joint `{joint}`: {attribute} names `{name}`, which is not defined")]
    UrdfDangling {
        /// File, or `<string>`.
        origin: String,
        /// The joint that names it.
        joint: String,
        /// `parent`, `child` or `mimic`.
        attribute: &'static str,
        /// The missing name.
        name: String,
    },
    /// The links do not form one tree.
    #[error("{origin}: expected one tree of links: {reason}")]
    UrdfTree {
        /// File, or `<string>`.
        origin: String,
        /// Where the tree breaks.
        reason: String,
    },
    /// A joint type with more than one degree of freedom.
    #[error("{origin}: joint `{joint}` is {kind}, expected fixed, revolute, continuous or prismatic")]
    UrdfJointKind {
        /// File, or `<string>`.
        origin: String,
        /// The joint.
        joint: String,
        /// Its type as written.
        kind: &'static str,
    },
    /// A moving joint lacks a mandatory limit.
    #[error("{origin}: joint `{joint}`: <limit> has no {kind} limit: expected {expected}, got {got}")]
    UrdfLimit {
        /// File, or `<string>`.
        origin: String,
        /// The joint.
        joint: String,
        /// The limit that is missing.
        kind: LimitKind,
        /// What would be accepted.
        expected: &'static str,
        /// What was found.
        got: String,
    },
    /// A number in the URDF is not usable.
    #[error("{origin}: {element} `{name}`: {what}: expected {expected}, got {got}")]
    UrdfValue {
        /// File, or `<string>`.
        origin: String,
        /// `link` or `joint`.
        element: &'static str,
        /// Its name.
        name: String,
        /// The quantity.
        what: &'static str,
        /// What would be accepted.
        expected: &'static str,
        /// What was found.
        got: String,
    },
    /// A mesh file could not be resolved.
    #[error("{origin}: link `{link}`: mesh `{uri}`: expected a file at one of {tried:?}")]
    UrdfMesh {
        /// File, or `<string>`.
        origin: String,
        /// The link.
        link: String,
        /// The `filename` attribute.
        uri: String,
        /// The places that were looked at.
        tried: Vec<PathBuf>,
    },
    /// No link of this name.
    #[error("robot `{robot}` has no link `{name}`; its links are {known:?}")]
    UnknownLink {
        /// The robot.
        robot: String,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// No joint of this name.
    #[error("robot `{robot}` has no joint `{name}`; its joints are {known:?}")]
    UnknownJoint {
        /// The robot.
        robot: String,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// A slice has the wrong length.
    #[error("{what}: expected {expected} values, got {got}")]
    Length {
        /// The quantity.
        what: &'static str,
        /// The length asked for.
        expected: usize,
        /// The length received.
        got: usize,
    },
    /// A number is outside its domain (NaN included).
    #[error("{what}: expected {expected}, got {got}")]
    Domain {
        /// The quantity, with its unit.
        what: &'static str,
        /// The allowed interval.
        expected: &'static str,
        /// The value received.
        got: f64,
    },
}
