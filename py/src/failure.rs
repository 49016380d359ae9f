//! Every error of the crates below as one exception of `ogg_rs.errors`, with its variant and fields kept.

use std::fmt::Debug;
use std::path::PathBuf;

use pyo3::PyErr;

mod classes {
    pyo3::import_exception!(ogg_rs.errors, DeviceError);
    pyo3::import_exception!(ogg_rs.errors, InvalidParameter);
    pyo3::import_exception!(ogg_rs.errors, NumericalError);
    pyo3::import_exception!(ogg_rs.errors, OggError);
}

/// What can go wrong on the way between Python and the crates.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// Mixtures, regression, time series.
    #[error(transparent)]
    Mixture(#[from] gmr_core::Error),
    /// Kinematics.
    #[error(transparent)]
    Kin(#[from] kin::Error),
    /// Tracking.
    #[error(transparent)]
    Motion(#[from] motion::Error),
    /// Motion models.
    #[error(transparent)]
    Follow(#[from] follow::Error),
    /// Networks, targets, evaluation.
    #[error(transparent)]
    Pose(#[from] pose::Error),
    /// The simulated arm and worker.
    #[error(transparent)]
    Sim(#[from] sim::Error),
    /// The joint protocol.
    #[error(transparent)]
    Can(#[from] can_driver::Error),
    /// Recordings.
    #[error(transparent)]
    Record(#[from] ogg::record::Error),
    /// A frame under one of the protocol's identifiers that is none of its messages.
    #[error("frame {id:03X}: expected a message of the joint protocol, got a wrong length, checksum or field")]
    CorruptFrame { id: u16 },
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    File { path: PathBuf, source: std::io::Error },
    /// An array is not laid out as the Python half promises.
    #[error("{what}: expected a C-contiguous array")]
    Layout { what: &'static str },
    /// An argument is outside its domain.
    #[error("{what}: expected {expected}, got {got}")]
    Argument { what: &'static str, expected: String, got: String },
}

/// The exception classes that an error can become.
#[derive(Clone, Copy)]
enum Class {
    Base,
    Parameter,
    Numerical,
    Device,
}

fn class_of_mixture(error: &gmr_core::Error) -> Class {
    use gmr_core::Error as E;
    match error {
        E::InvalidParameter { .. }
        | E::Length { .. }
        | E::TooFewSamples { .. }
        | E::NotFinite { .. }
        | E::OutOfRange { .. }
        | E::Dimension { .. }
        | E::WeightsNotNormalised { .. }
        | E::TimeNotIncreasing { .. } => Class::Parameter,
        E::NotPositiveDefinite { .. }
        | E::NoSupport { .. }
        | E::AllRestartsFailed { .. }
        | E::Degenerate { .. }
        | E::NotConverged { .. } => Class::Numerical,
        _ => Class::Base,
    }
}

fn class_of_kin(error: &kin::Error) -> Class {
    use kin::Error as E;
    match error {
        E::Read { .. } => Class::Device,
        E::TooFewViews { .. }
        | E::ParallelRays { .. }
        | E::InconsistentViews { .. }
        | E::PlaneMissed { .. }
        | E::Homography { .. }
        | E::NoDepth { .. } => Class::Numerical,
        E::UrdfSyntax { .. }
        | E::UrdfDuplicate { .. }
        | E::UrdfDangling { .. }
        | E::UrdfTree { .. }
        | E::UrdfJointKind { .. }
        | E::UrdfLimit { .. }
        | E::UrdfValue { .. }
        | E::UrdfMesh { .. }
        | E::UnknownLink { .. }
        | E::UnknownJoint { .. }
        | E::Length { .. }
        | E::Domain { .. }
        | E::EmptyChain { .. }
        | E::CalibrationSyntax { .. }
        | E::Calibration { .. } => Class::Parameter,
        _ => Class::Base,
    }
}

fn class_of_motion(error: &motion::Error) -> Class {
    use motion::Error as E;
    match error {
        E::InvalidParameter { .. }
        | E::InvalidLimit { .. }
        | E::Count { .. }
        | E::NotFinite { .. }
        | E::Age { .. }
        | E::OutOfOrder { .. }
        | E::HorizonTooLong { .. }
        | E::ZeroStep
        | E::EngageWhileMoving { .. }
        | E::EngageGap { .. } => Class::Parameter,
        _ => Class::Base,
    }
}

fn class_of_follow(error: &follow::Error) -> Class {
    use follow::Error as E;
    match error {
        E::Motion(inner) => class_of_motion(inner),
        E::Mixture(inner) => class_of_mixture(inner),
        E::Kin(inner) => class_of_kin(inner),
        E::NotPositiveDefinite { .. } => Class::Numerical,
        E::Parameter { .. }
        | E::NotFinite { .. }
        | E::TimeRunsBackwards { .. }
        | E::TooLittleSeen { .. }
        | E::ModelFile { .. }
        | E::ViewCount { .. }
        | E::JointCount { .. }
        | E::HomeOutsideLimits { .. }
        | E::UnknownJoint { .. } => Class::Parameter,
        _ => Class::Base,
    }
}

fn class_of_pose(error: &pose::Error) -> Class {
    use pose::Error as E;
    match error {
        E::Read { .. } | E::NotFound { .. } | E::Library { .. } | E::RuntimeConflict { .. } | E::Provider { .. } => {
            Class::Device
        }
        E::Inference { .. } | E::NonFinite { .. } => Class::Numerical,
        E::CardSyntax { .. }
        | E::CardValue { .. }
        | E::NoCard { .. }
        | E::WrongHash { .. }
        | E::RefusedFile { .. }
        | E::BadNetwork { .. }
        | E::WrongShape { .. }
        | E::Image { .. }
        | E::Parameter { .. }
        | E::Length { .. }
        | E::UnknownModel { .. } => Class::Parameter,
        _ => Class::Base,
    }
}

fn class_of_sim(error: &sim::Error) -> Class {
    use sim::Error as E;
    match error {
        E::Camera(inner) => class_of_kin(inner),
        E::OutOfRange { .. } | E::Zero { .. } | E::JointCount { .. } | E::Mimic { .. } | E::Massless { .. } => {
            Class::Parameter
        }
        _ => Class::Base,
    }
}

fn class_of_can(error: &can_driver::Error) -> Class {
    use can_driver::Error as E;
    match error {
        E::Io { .. } | E::Down { .. } => Class::Device,
        E::FrameTooLong { .. }
        | E::AngleOutOfRange { .. }
        | E::InvalidParameter { .. }
        | E::InvalidLimit { .. }
        | E::JointCount { .. }
        | E::NothingToReset
        | E::Candump { .. }
        | E::Dbc(_) => Class::Parameter,
        _ => Class::Base,
    }
}

fn class_of_record(error: &ogg::record::Error) -> Class {
    use ogg::record::Error as E;
    match error {
        E::NotMcap { .. } => Class::Parameter,
        E::Create { .. }
        | E::Write { .. }
        | E::DiskFull { .. }
        | E::Spawn { .. }
        | E::Panicked { .. }
        | E::Read { .. } => Class::Device,
        _ => Class::Base,
    }
}

/// `NotFinite { what: "samples", .. }` without the names of the enums around it.
fn detail_of(failure: &Failure) -> String {
    fn debug(error: &impl Debug) -> String {
        format!("{error:?}")
    }
    match failure {
        Failure::Mixture(e) | Failure::Follow(follow::Error::Mixture(e)) => debug(e),
        Failure::Kin(e) | Failure::Follow(follow::Error::Kin(e)) | Failure::Sim(sim::Error::Camera(e)) => debug(e),
        Failure::Motion(e) | Failure::Follow(follow::Error::Motion(e)) => debug(e),
        Failure::Follow(e) => debug(e),
        Failure::Pose(e) => debug(e),
        Failure::Sim(e) => debug(e),
        Failure::Can(e) => debug(e),
        Failure::Record(e) => debug(e),
        Failure::CorruptFrame { .. } | Failure::File { .. } | Failure::Layout { .. } | Failure::Argument { .. } => {
            debug(failure)
        }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let class = match &failure {
            Failure::Mixture(e) => class_of_mixture(e),
            Failure::Kin(e) => class_of_kin(e),
            Failure::Motion(e) => class_of_motion(e),
            Failure::Follow(e) => class_of_follow(e),
            Failure::Pose(e) => class_of_pose(e),
            Failure::Sim(e) => class_of_sim(e),
            Failure::Can(e) => class_of_can(e),
            Failure::Record(e) => class_of_record(e),
            Failure::File { .. } => Class::Device,
            Failure::CorruptFrame { .. } | Failure::Layout { .. } | Failure::Argument { .. } => Class::Parameter,
        };
        let detail = detail_of(&failure);
        let kind: String = detail.chars().take_while(|c| c.is_alphanumeric()).collect();
        let arguments = (failure.to_string(), kind, detail);
        match class {
            Class::Base => classes::OggError::new_err(arguments),
            Class::Parameter => classes::InvalidParameter::new_err(arguments),
            Class::Numerical => classes::NumericalError::new_err(arguments),
            Class::Device => classes::DeviceError::new_err(arguments),
        }
    }
}
