//! The crate's one error type.

use crate::gmm::RestartReport;

/// What went wrong, in three families: rejected input, numerical failure, and a model file that
/// does not describe a model.
///
/// ```
/// let refused = gmr_core::Samples::new(&[1.0, f64::INFINITY], 1).map(|s| s.len());
/// let Err(error) = refused else { panic!() };
/// assert_eq!(error.to_string(), "samples: value inf at index 1 is not finite");
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A parameter lies outside its allowed interval. NaN lies outside every interval.
    #[error("parameter {name}: expected {allowed}, got {value}")]
    InvalidParameter {
        /// Field name.
        name: &'static str,
        /// The allowed interval in words.
        allowed: &'static str,
        /// The value that was given.
        value: f64,
    },
    /// A slice has the wrong length.
    #[error("{what}: expected length {expected}, got {got}")]
    Length {
        /// Which slice.
        what: &'static str,
        /// Length wanted.
        expected: usize,
        /// Length given.
        got: usize,
    },
    /// There are not enough samples for the job.
    #[error("{what}: expected at least {needed} samples, got {got}")]
    TooFewSamples {
        /// The job.
        what: &'static str,
        /// Samples needed.
        needed: usize,
        /// Samples given.
        got: usize,
    },
    /// An input value is NaN or infinite where a finite number is needed.
    #[error("{what}: value {value} at index {index} is not finite")]
    NotFinite {
        /// Which input.
        what: &'static str,
        /// Flat index of the first offending value.
        index: usize,
        /// The value.
        value: f64,
    },
    /// An input value is so large that a second moment of it would overflow.
    #[error("{what}: magnitude {value:e} at index {index} exceeds {limit:e}, second moments would overflow")]
    OutOfRange {
        /// Which input.
        what: &'static str,
        /// Flat index of the first offending value.
        index: usize,
        /// The value.
        value: f64,
        /// Largest magnitude accepted.
        limit: f64,
    },
    /// A dimension index is out of bounds or listed twice.
    #[error("{what}: dimension {index} is repeated or not below {dim}")]
    Dimension {
        /// Which list of dimensions.
        what: &'static str,
        /// The offending index.
        index: usize,
        /// Number of dimensions of the model.
        dim: usize,
    },
    /// A matrix that must be positive definite is not.
    #[error("{what} {index}: not positive definite, pivot {pivot} is {value:e}")]
    NotPositiveDefinite {
        /// What the matrix is.
        what: &'static str,
        /// Which of several (component index, 0 for a single matrix).
        index: usize,
        /// Row of the failing Cholesky pivot.
        pivot: usize,
        /// Value of the failing pivot.
        value: f64,
    },
    /// The query lies so far out that no component has a finite log density there.
    #[error("query has no finite log density under any of the {components} components")]
    NoSupport {
        /// Number of components.
        components: usize,
    },
    /// Every restart of the EM ended in an empty or collapsed component.
    #[error("all {} restarts failed, the last with {:?}", .restarts.len(), .restarts.last().map(|r| &r.outcome))]
    AllRestartsFailed {
        /// What happened to each restart.
        restarts: Vec<RestartReport>,
    },
    /// Weights must be non-negative and sum to one.
    #[error("mixture weights sum to {sum}, expected 1 within {tolerance:e}")]
    WeightsNotNormalised {
        /// The sum found.
        sum: f64,
        /// Deviation tolerated.
        tolerance: f64,
    },
    /// Times must increase strictly.
    #[error("time at index {index} is {time_s} s, not after {previous_s} s")]
    TimeNotIncreasing {
        /// Index of the offending sample.
        index: usize,
        /// Its time.
        time_s: f64,
        /// Time of the sample before.
        previous_s: f64,
    },
    /// The data carry no information about what was asked, so the likelihood is unbounded or flat.
    #[error("{what}: constant or exactly predictable, the likelihood is unbounded")]
    Degenerate {
        /// What is degenerate.
        what: &'static str,
    },
    /// A numerical search ended without an acceptable point.
    #[error("{what} did not converge after {iterations} iterations, residual {residual:e}")]
    NotConverged {
        /// The search.
        what: &'static str,
        /// Iterations spent.
        iterations: usize,
        /// Size of the remaining residual.
        residual: f64,
    },
}

/// Result with this crate's [`Error`].
///
/// ```
/// # fn main() -> Result<(), gmr_core::Error> {
/// fn rows(values: &[f64]) -> gmr_core::Result<usize> {
///     Ok(gmr_core::Samples::new(values, 2)?.len())
/// }
/// assert_eq!(rows(&[1.0, 2.0]), Ok(1));
/// # Ok(())
/// # }
/// ```
pub type Result<T> = std::result::Result<T, Error>;

/// Largest magnitude of an input value: its square, times any sample count, stays finite.
pub(crate) const MAX_MAGNITUDE: f64 = 1e140;

/// Checks that every value is finite and small enough to be squared.
pub(crate) fn check_values(what: &'static str, values: &[f64]) -> Result<()> {
    for (index, &value) in values.iter().enumerate() {
        if !value.is_finite() {
            return Err(Error::NotFinite { what, index, value });
        }
        if value.abs() > MAX_MAGNITUDE {
            return Err(Error::OutOfRange { what, index, value, limit: MAX_MAGNITUDE });
        }
    }
    Ok(())
}

/// Checks a length.
pub(crate) fn check_len(what: &'static str, expected: usize, got: usize) -> Result<()> {
    if expected == got { Ok(()) } else { Err(Error::Length { what, expected, got }) }
}
