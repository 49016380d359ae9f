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
    /// No joint moves one link relative to the other.
    #[error("no joint moves `{tip}` relative to `{base}`")]
    EmptyChain {
        /// Base link.
        base: String,
        /// Tip link.
        tip: String,
    },
    /// A calibration file is not in the format its name promises.
    #[error("{origin}: expected a camera calibration ({format}): {reason}")]
    CalibrationSyntax {
        /// File, or `<string>`.
        origin: String,
        /// The expected format.
        format: &'static str,
        /// What the reader said.
        reason: String,
    },
    /// A value of a calibration file is missing or unusable.
    #[error("{origin}: key `{key}`: expected {expected}, got {got}")]
    Calibration {
        /// File, or `<string>`.
        origin: String,
        /// Path of the key, as `cam01.matrix`.
        key: String,
        /// What would be accepted.
        expected: String,
        /// What was found.
        got: String,
    },
    /// Not enough views to triangulate a point.
    #[error("triangulation needs 2 usable views, got {usable}")]
    TooFewViews {
        /// Views whose pixel belongs to a ray.
        usable: usize,
    },
    /// All views look along nearly the same line.
    #[error("triangulation needs an angle between rays of at least {least_rad} rad, got {largest_rad}")]
    ParallelRays {
        /// The required angle.
        least_rad: f64,
        /// The largest angle there is.
        largest_rad: f64,
    },
    /// No two views agree on a point.
    #[error("triangulation: the best two views miss each other by {residual_sigma} sigma, allowed {gate_sigma}")]
    InconsistentViews {
        /// Distance of the better view from the common point, in its own sigma.
        residual_sigma: f64,
        /// The allowed distance.
        gate_sigma: f64,
    },
    /// A pixel does not look at the plane.
    #[error("pixel ({u_px}, {v_px}) does not look at the plane: {reason}")]
    PlaneMissed {
        /// The pixel.
        u_px: f64,
        /// The pixel.
        v_px: f64,
        /// Why.
        reason: &'static str,
    },
    /// The points of a homography do not determine it.
    #[error("a homography needs 4 points of which no 3 are on a line, got {count} points: {reason}")]
    Homography {
        /// How many points there were.
        count: usize,
        /// What is wrong.
        reason: &'static str,
    },
    /// The depth image says too little around a pixel.
    #[error("pixel ({u_px}, {v_px}): {usable} usable depth readings, needed {needed}")]
    NoDepth {
        /// The pixel.
        u_px: f64,
        /// The pixel.
        v_px: f64,
        /// Readings within range.
        usable: usize,
        /// Readings needed.
        needed: usize,
    },
}
