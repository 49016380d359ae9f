//! What ends a command, and with which exit code.

use std::path::PathBuf;

/// Errors of the command.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}; expected {expected}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What should be there.
        expected: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file was read, and holds something else than expected.
    #[error("{}: {message}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Where, what it holds, and what was expected.
        message: String,
    },
    /// A configuration is wrong.
    #[error("{}: {message}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// Line and key, what it holds, and what was expected.
        message: String,
    },
    /// A combination of options makes no sense.
    #[error("{0}")]
    Usage(String),
    /// Pictures.
    #[error(transparent)]
    Capture(#[from] crate::capture::Error),
    /// The pose network.
    #[error(transparent)]
    Pose(#[from] pose::Error),
    /// The robot description or the camera calibration.
    #[error(transparent)]
    Kin(#[from] kin::Error),
    /// Teaching, learning and following.
    #[error(transparent)]
    Follow(#[from] follow::Error),
    /// The simulated arm or worker.
    #[error(transparent)]
    Sim(#[from] sim::Error),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] can_driver::Error),
    /// The recording.
    #[error(transparent)]
    Record(#[from] crate::record::Error),
    /// A thread ended by itself.
    #[error("the {thread} thread ended: {message}")]
    Thread {
        /// Which.
        thread: &'static str,
        /// Its last word.
        message: String,
    },
}

impl Error {
    /// The exit code: 2 for bad input, 1 for what failed on the way.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Bus(_) | Self::Record(_) | Self::Thread { .. } => 1,
            _ => 2,
        }
    }
}
