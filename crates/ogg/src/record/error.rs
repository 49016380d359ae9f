//! Why a recording could not be written or read.

use std::io;
use std::path::PathBuf;

/// A failure of a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file could not be made.
    #[error("{}: cannot create the recording: {source}", path.display())]
    Create {
        /// The recording.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A write failed; nothing after it is in the file.
    #[error("{}: cannot write the recording: {source}", path.display())]
    Write {
        /// The recording.
        path: PathBuf,
        /// The writer's reason.
        source: mcap::McapError,
    },
    /// The disk is nearly full, so recording stopped before it was.
    #[error(
        "{}: recording stopped: expected at least {reserve_bytes} bytes free on the disk, got {free_bytes}",
        path.display()
    )]
    DiskFull {
        /// The recording.
        path: PathBuf,
        /// Bytes that stay free for everything else.
        reserve_bytes: u64,
        /// Bytes that are free.
        free_bytes: u64,
    },
    /// The writing thread could not be started.
    #[error("cannot start the recording thread: {source}")]
    Spawn {
        /// The system's reason.
        source: io::Error,
    },
    /// The writing thread panicked.
    #[error("{}: the recording thread panicked; the file ends with its last whole chunk", path.display())]
    Panicked {
        /// The recording.
        path: PathBuf,
    },
    /// The file could not be read.
    #[error("{}: cannot read the recording: {source}; expected an MCAP file", path.display())]
    Read {
        /// The recording.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file is no recording.
    #[error("{}: byte 0: expected an MCAP file, got {message}", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// The reader's words.
        message: String,
    },
}
