//! The `ogg` command. Everything it does lives in the library of the same name.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(ogg::commands::main(std::env::args_os()))
}
