//! The `ogg` command. Everything it does lives in the library of the same name.

use std::process::ExitCode;

use clap::Parser as _;

fn main() -> ExitCode {
    let cli = ogg::cli::Cli::parse();
    ogg::commands::init_log();
    match ogg::commands::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            ogg::commands::print_error(&error);
            ExitCode::from(error.exit_code())
        }
    }
}
