/// What the simulator refuses or cannot do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number lies outside the interval its field allows.
    #[error("{field}: {value} outside [{min}, {max}]")]
    OutOfRange {
        /// Name of the field, with its unit.
        field: &'static str,
        /// What was given.
        value: f64,
        /// Smallest allowed value.
        min: f64,
        /// Largest allowed value.
        max: f64,
    },
    /// A count must be at least one.
    #[error("{field}: expected at least 1, got 0")]
    Zero {
        /// Name of the field.
        field: &'static str,
    },
    /// A camera that cannot be.
    #[error("camera: {0}")]
    Camera(#[from] kin::Error),
    /// A list has another length than the robot has joints.
    #[error("joints: expected {expected} values, got {got}")]
    JointCount {
        /// Number of joints.
        expected: usize,
        /// Number of values.
        got: usize,
    },
    /// The robot has a joint that copies another one, which the plant does not model.
    #[error("joint {joint}: mimic joints cannot be simulated")]
    Mimic {
        /// Name of the joint.
        joint: String,
    },
    /// A moving joint carries nothing that has a mass.
    #[error("joint {joint}: the links it carries have no mass, expected more than 0 kg")]
    Massless {
        /// Name of the joint.
        joint: String,
    },
}

/// Checks `min <= value <= max`, written so that NaN fails.
pub(crate) fn within(field: &'static str, value: f64, min: f64, max: f64) -> Result<(), Error> {
    if value >= min && value <= max { Ok(()) } else { Err(Error::OutOfRange { field, value, min, max }) }
}
