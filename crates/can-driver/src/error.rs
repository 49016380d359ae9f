//! What can go wrong outside a control tick.

use crate::dbc::DbcError;

/// Errors of this crate. A tick of a session never returns one: it reports states and causes.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A payload that does not fit a frame.
    #[error("frame payload: {bytes} bytes, at most {limit_bytes}")]
    FrameTooLong {
        /// Length given.
        bytes: usize,
        /// Length allowed.
        limit_bytes: usize,
    },
    /// An angle that the wire cannot carry, not-a-number included.
    #[error("angle: {angle_rad} rad outside [-6.28317, 6.28317] rad")]
    AngleOutOfRange {
        /// The angle given.
        angle_rad: f64,
    },
    /// A parameter outside its interval.
    #[error("{field}: {value} outside {allowed}")]
    InvalidParameter {
        /// Name of the parameter, with the joint where it belongs to one.
        field: String,
        /// The interval or set that is allowed.
        allowed: &'static str,
        /// The value given.
        value: f64,
    },
    /// A limit of one joint that is missing, not finite, empty, or too big for the wire.
    #[error("joint {joint}: {field} {value}, expected {expected}")]
    InvalidLimit {
        /// Joint, from 0.
        joint: usize,
        /// Name of the limit.
        field: &'static str,
        /// The value given.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// A number of joints other than 1 to 6, or other than that of the session.
    #[error("{found} joints, expected {expected}")]
    JointCount {
        /// Number given.
        found: usize,
        /// Number or interval expected.
        expected: &'static str,
    },
    /// An operator reset while nothing is latched.
    #[error("nothing to reset: the session is not stopped")]
    NothingToReset,
    /// A line of a candump log that cannot be read.
    #[error("candump line {line}: {reason}: {text:?}")]
    Candump {
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        reason: &'static str,
        /// The line.
        text: String,
    },
    /// A DBC file that cannot be read.
    #[error(transparent)]
    Dbc(#[from] DbcError),
    /// The operating system refused something.
    #[error("can interface {interface}: {action}: {source}")]
    Io {
        /// Name of the interface.
        interface: String,
        /// What was tried.
        action: &'static str,
        /// The operating system's answer.
        source: std::io::Error,
    },
    /// The interface is down or gone.
    #[error("can interface {interface} is down")]
    Down {
        /// Name of the interface.
        interface: String,
    },
}
