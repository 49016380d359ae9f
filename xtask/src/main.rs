//! Developer tasks: `cargo xtask <task>`.

mod bench;
mod gate;
mod layers;
mod process;
mod python;
mod vcan;

use anyhow::{Result, bail};

const HELP: &str = "\
cargo xtask <task>

  test                     every test: Rust, documentation examples, Python, vcan; installs what it needs
  ci                       the gate: fmt, lint, layers, docs, then test
  fmt | lint | layers | docs
                           one step of the gate
  wheel                    build the Python wheel into target/wheels
  wheel-test PYTHON...     install the wheel into empty environments of these interpreters and run the examples there
  vcan-test                the tests that need a real SocketCAN interface
  bench AREA [--json FILE] [-- ARGUMENTS OF THE BENCHMARK]
                           measure an area beside its peers and print a table
                           areas: gmr, kin, motion, can, sim, pose, capture, follow, python
";

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (task, rest) = match arguments.split_first() {
        Some((task, rest)) => (task.as_str(), rest),
        None => ("help", &[][..]),
    };
    std::env::set_current_dir(process::workspace_root())?;
    match task {
        "test" => gate::test(),
        "ci" => gate::ci(),
        "fmt" => gate::fmt(),
        "lint" => gate::lint(),
        "layers" => layers::check(),
        "docs" => gate::docs(),
        "wheel" => python::wheel().map(drop),
        "wheel-test" => python::wheel_test(rest),
        "vcan-test" => vcan::vcan_test(rest),
        "bench" => bench::run(rest),
        "help" | "--help" | "-h" => {
            eprint!("{HELP}");
            Ok(())
        }
        other => bail!("no task named {other:?}\n\n{HELP}"),
    }
}
