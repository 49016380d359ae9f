//! One function per command.

mod describe;
mod follow_daemon;
mod follow_run;
mod inspect;
mod options;
mod pose;

use std::error::Error as _;
use std::ffi::OsString;
use std::io::IsTerminal as _;

use clap::Parser as _;

use crate::cli::{Cli, Command, Follow};
use crate::config::BUILTIN_CELL;
use crate::error::Error;

pub use pose::PoseCommand;

/// The whole command: arguments, the program's name first, to exit code. Ends no process, so that a host program may call it.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(answer) => {
            // Help and version are answers, too; where nobody reads them there is nobody to tell.
            let _ = answer.print();
            return u8::try_from(answer.exit_code()).unwrap_or(2);
        }
    };
    init_log();
    match run(cli) {
        Ok(()) => 0,
        Err(error) => {
            print_error(&error);
            error.exit_code()
        }
    }
}

/// Runs what the command line asks for.
///
/// # Errors
/// Whatever ends the command; [`Error::exit_code`] says with which code.
pub fn run(cli: Cli) -> Result<(), Error> {
    match cli.command {
        Command::Follow(Follow::Daemon(args)) => follow_daemon::run(&args),
        Command::Follow(Follow::Run(args)) => follow_run::run(&args),
        Command::Follow(Follow::Config) => {
            say(BUILTIN_CELL.trim_end());
            Ok(())
        }
        Command::Follow(Follow::CheckConfig(args)) => options::check(&args),
        Command::Describe { urdf, base, tip } => describe::run(urdf.as_deref(), base.as_deref(), tip.as_deref()),
        Command::Inspect { file } => inspect::run(&file),
        Command::Pose(command) => pose::run(&command),
        Command::Controller(args) => Ok(crate::can_tools::controller(&args)?),
        Command::Can(command) => Ok(crate::can_tools::can(&command)?),
    }
}

/// Log lines go to standard error; `RUST_LOG` chooses them.
pub fn init_log() {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("warn,ort=error"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .init();
}

/// The error and what caused it, on one line each.
pub fn print_error(error: &Error) {
    eprintln!("error: {error}");
    let mut printed = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        let text = cause.to_string();
        if !printed.contains(&text) {
            eprintln!("  because: {text}");
            printed.push_str(&text);
        }
        source = cause.source();
    }
}

/// A line on standard output. A reader that has closed its end (`ogg describe | head`) has read enough, and a robot does not stop
/// for it.
#[expect(clippy::print_stderr, reason = "the last place to say that the result cannot be written")]
pub(crate) fn say(line: impl std::fmt::Display) {
    use std::io::{ErrorKind, Write as _};
    match writeln!(std::io::stdout(), "{line}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => eprintln!("standard output: {error}"),
        _ => {}
    }
}
