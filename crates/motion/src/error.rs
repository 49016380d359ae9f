//! The one error type of this crate.

/// Why a parameter set, a target or a call is refused. The motion itself never fails: an
/// [`update`](crate::Tracker::update) with a valid time step always yields a command.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter lies outside its allowed interval.
    #[error("{field}: {value} outside {allowed}")]
    InvalidParameter {
        /// Name of the field, with its unit.
        field: &'static str,
        /// Interval that the field must lie in.
        allowed: &'static str,
        /// Value that was given.
        value: f64,
    },
    /// A joint limit lies outside its allowed interval.
    #[error("joint {joint}: {field} is {value}, expected {allowed}")]
    InvalidLimit {
        /// Index of the joint.
        joint: usize,
        /// Name of the field, with its unit.
        field: &'static str,
        /// What is allowed.
        allowed: &'static str,
        /// Value that was given.
        value: f64,
    },
    /// A slice has another number of entries than the tracker has joints.
    #[error("{what}: expected {expected} entries, got {got}")]
    Count {
        /// Which slice.
        what: &'static str,
        /// Entries expected.
        expected: usize,
        /// Entries given.
        got: usize,
    },
    /// A value is NaN or infinite. Nothing of the target or state is taken over.
    #[error("joint {joint}: {what} is not finite ({value})")]
    NotFinite {
        /// Index of the joint.
        joint: usize,
        /// Which quantity.
        what: &'static str,
        /// Value that was given.
        value: f64,
    },
    /// The age of a target is not finite, or lies further in the future than the tracker looks.
    #[error("target age {age_s} s outside [-{lead_s}, inf) s")]
    Age {
        /// Age that was given.
        age_s: f64,
        /// Furthest lead that is accepted.
        lead_s: f64,
    },
    /// The target was sampled no later than the one already in use.
    #[error("target of age {age_s} s is not newer than the one in use, of age {newest_age_s} s")]
    OutOfOrder {
        /// Age of the target that was given.
        age_s: f64,
        /// Age of the target in use.
        newest_age_s: f64,
    },
    /// More horizon points than the tracker was built for.
    #[error("horizon: {got} points exceed the capacity of {capacity}")]
    HorizonTooLong {
        /// Points given.
        got: usize,
        /// Points that fit.
        capacity: usize,
    },
    /// The time step is zero.
    #[error("time step of zero length")]
    ZeroStep,
    /// Engaging needs the last command to be at rest.
    #[error("joint {joint}: cannot engage while the command moves at {velocity_rad_s} rad/s")]
    EngageWhileMoving {
        /// Index of the joint.
        joint: usize,
        /// Speed of the last command.
        velocity_rad_s: f64,
    },
    /// The measured pose is too far from the last command.
    #[error("joint {joint}: measured pose is {gap_rad} rad from the command, allowed {allowed_rad} rad")]
    EngageGap {
        /// Index of the joint.
        joint: usize,
        /// Distance between measured pose and last command.
        gap_rad: f64,
        /// Largest distance accepted.
        allowed_rad: f64,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;
