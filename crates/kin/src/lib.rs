#![doc = include_str!("../README.md")]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "`!(x > 0.0)` refuses NaN; that is the point of writing it so")]
#![allow(clippy::needless_range_loop, reason = "matrix kernels read best with the indices of their equations")]

mod camera;
mod chain;
mod error;
mod ik;
mod retarget;
mod robot;

pub use camera::{
    Calibration, CalibrationFormat, Camera, Distortion, Homography, Intrinsics, Lifted, Ray, TriangulateOptions,
    Triangulated, View, ViewResidual, parse_calibration, read_calibration, read_cameras, triangulate,
};
pub use chain::{Chain, Dexterity};
pub use error::{Error, LimitKind};
pub use ik::{IkOptions, IkReason, IkReport};
pub use retarget::{
    AngleRetarget, ArmAngles, ArmPoints, FollowOptions, FollowStatus, FollowStep, JointMap, ReachStatus, Retargeted,
    SingularityLadder, ToolOrientation, Unwrap, WristRetarget, WristTarget, wrap_rad,
};
pub use robot::{
    Geometry, Inertial, Joint, JointId, JointKind, JointLimits, LimitPolicy, Link, LinkId, Mimic, Robot, Shape,
    UrdfOptions, builtin_arm_urdf,
};
