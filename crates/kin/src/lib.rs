#![doc = include_str!("../README.md")]
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "`!(x > 0.0)` refuses NaN; that is the point of writing it so")]

mod camera;
mod error;
mod robot;

pub use camera::{Camera, Distortion, Intrinsics, Ray};
pub use error::{Error, LimitKind};
pub use robot::{
    Geometry, Inertial, Joint, JointId, JointKind, JointLimits, LimitPolicy, Link, LinkId, Mimic, Robot, Shape,
    UrdfOptions, builtin_arm_urdf,
};
