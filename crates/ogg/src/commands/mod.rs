//! One function per command.

mod describe;
mod follow_daemon;
mod follow_run;
mod inspect;
mod options;

use std::error::Error as _;
use std::io::IsTerminal as _;

use crate::cli::{Cli, Command, Follow};
use crate::config::BUILTIN_CELL;
use crate::error::Error;

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

/// A line on standard output.
#[expect(clippy::print_stdout, reason = "this is a command's result")]
pub(crate) fn say(line: impl std::fmt::Display) {
    println!("{line}");
}
