//! Programs on a CAN bus: the controller's end with a simulated arm, and tools to look at, log and replay a bus.

mod controller;
mod log;
mod monitor;
mod replay;

use std::io::Write as _;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::{Args, Subcommand};

use crate::error::Error;

pub use controller::controller;

/// What the controller is to run with.
#[derive(Debug, Clone, Args)]
pub struct ControllerArgs {
    /// SocketCAN interface, such as `can0` or `vcan0`.
    #[arg(long, value_name = "IFACE")]
    pub bus: String,
    /// Configuration of the cell, for the arm and its limits; the built-in cell where absent.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// End by itself after this time.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
}

/// Tools for a CAN bus.
#[derive(Debug, Clone, Subcommand)]
pub enum CanCommand {
    /// Show every message of the joint protocol, decoded, as it changes.
    Monitor {
        /// SocketCAN interface.
        #[arg(long, value_name = "IFACE")]
        bus: String,
        /// Another DBC file to decode with; checksums are then not judged.
        #[arg(long, value_name = "FILE")]
        dbc: Option<PathBuf>,
        /// One line per frame instead of a table; the default where standard output is no terminal.
        #[arg(long)]
        lines: bool,
        /// End by itself after this time.
        #[arg(long, value_name = "S")]
        duration: Option<f64>,
    },
    /// Write the frames of a bus in candump format.
    Log {
        /// SocketCAN interface.
        #[arg(long, value_name = "IFACE")]
        bus: String,
        /// File to write; standard output where absent.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
        /// End by itself after this time.
        #[arg(long, value_name = "S")]
        duration: Option<f64>,
    },
    /// Send the frames of a candump log with their timing. Not for a bus with a real arm on it.
    Replay {
        /// The log.
        file: PathBuf,
        /// SocketCAN interface.
        #[arg(long, value_name = "IFACE")]
        bus: String,
        /// How many times as fast as logged.
        #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
        speed: f64,
        /// Whose frames to send.
        #[arg(long, value_enum, default_value_t = Sender::All)]
        sender: Sender,
    },
}

/// Whose frames a replay sends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Sender {
    /// All frames of the log.
    All,
    /// The host's.
    Host,
    /// The controller's.
    Controller,
}

/// Runs a tool.
///
/// # Errors
/// [`Error::Bus`] for the interface, [`Error::File`] and [`Error::Usage`] for files and numbers.
pub fn can(command: &CanCommand) -> Result<(), Error> {
    match command {
        CanCommand::Monitor { bus, dbc, lines, duration } => {
            monitor::run(bus, dbc.as_deref(), *lines, &Until::new(*duration)?)
        }
        CanCommand::Log { bus, out, duration } => log::run(bus, out.as_deref(), &Until::new(*duration)?),
        CanCommand::Replay { file, bus, speed, sender } => replay::run(file, bus, *speed, *sender, &Until::new(None)?),
    }
}

/// When a program ends: at a signal, or after a time.
struct Until {
    start: Instant,
    limit: Option<Duration>,
    signal: Arc<AtomicBool>,
}

impl Until {
    fn new(seconds: Option<f64>) -> Result<Self, Error> {
        let limit = match seconds {
            None => None,
            Some(s) => Some(Duration::try_from_secs_f64(s).map_err(|e| Error::Usage(format!("--duration {s}: {e}")))?),
        };
        let signal = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&signal);
        ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))
            .map_err(|e| Error::Usage(format!("signals cannot be handled: {e}")))?;
        Ok(Self { start: Instant::now(), limit, signal })
    }

    fn now(&self) -> Duration {
        self.start.elapsed()
    }

    fn over(&self) -> bool {
        self.signal.load(Ordering::Relaxed) || self.limit.is_some_and(|limit| self.now() >= limit)
    }
}

/// Writes to standard output; a reader that has gone away ends the program without noise.
fn put(text: &str) -> Result<bool, Error> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(false),
        Err(source) => {
            Err(Error::File { path: PathBuf::from("standard output"), expected: "a place to write to", source })
        }
    }
}
