#![doc = include_str!("../README.md")]
#![allow(clippy::needless_range_loop, reason = "matrix kernels read best with the indices of their equations")]

mod analytic;
mod camera;
mod chain;
mod dynamics;
mod error;
mod ik;
mod retarget;
mod robot;
mod simd;

pub use analytic::{Analytic, Branches};
pub use camera::{
    Calibration, CalibrationFormat, Camera, DepthImage, DepthPatch, Distortion, Homography, Intrinsics, Lifted, Ray,
    TriangulateOptions, Triangulated, View, ViewResidual, parse_calibration, read_calibration, read_cameras,
    triangulate,
};
pub use chain::{Chain, Dexterity};
pub use dynamics::{Dynamics, DynamicsScratch};
pub use error::{Error, LimitKind};
pub use ik::{IkMethod, IkOptions, IkReason, IkReport};
pub use retarget::{
    AngleRetarget, ArmAngles, ArmPoints, FollowOptions, FollowStatus, FollowStep, JointMap, ReachStatus, Retargeted,
    SingularityLadder, ToolOrientation, Unwrap, WristRetarget, WristTarget, wrap_rad,
};
pub use robot::{
    Geometry, Inertial, Joint, JointId, JointKind, JointLimits, LimitPolicy, Link, LinkId, Mimic, Robot, Shape,
    UrdfOptions, builtin_arm_urdf,
};
