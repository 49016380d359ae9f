//! The tests that need a real SocketCAN interface.
//!
//! Where the kernel has vcan they run natively; otherwise in a guest kernel, which
//! `tests/vcan/guest` fetches and boots. A kernel that cannot be had either way is a failure.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};

use crate::process::{cargo, output, run, target_dir, workspace_root};
use crate::python;

/// Every test has an interface of its own.
const INTERFACES: usize = 11;

/// `cargo xtask vcan-test [--native | --guest uml|qemu] [--kills N] [--exchange S] [TEST...]`
pub(crate) fn vcan_test(arguments: &[String]) -> Result<()> {
    let options = Options::parse(arguments)?;
    let guest = workspace_root().join("tests/vcan/guest");
    let native = match options.place {
        Place::Native => true,
        Place::Guest(_) => false,
        Place::Any => native_interfaces(),
    };
    if native && !native_interfaces() {
        bail!("this kernel has no vcan, or interfaces cannot be made; leave --native out to use a guest kernel");
    }
    let setup = |what: &str| run(Command::new(guest.join("vcan-setup")).arg(what));
    let backend = if let Place::Guest(backend) = &options.place { backend.as_str() } else { "uml" };
    setup("tools").context("can-utils are needed (Debian: apt-get install can-utils)")?;
    if !native {
        setup(backend)?;
    }
    let python = python::virtual_environment("vcan", &workspace_root().join("tests/vcan/requirements.txt"))?;
    let binary = test_binary()?;

    let mut command = if native {
        Command::new(&binary)
    } else {
        let names: Vec<String> = (0..INTERFACES).map(|n| format!("vcan{n}")).collect();
        let mut command = Command::new(guest.join("vcan-run"));
        command.args(["-b", backend, "-r", "-t", &options.limit_s().to_string(), "-i", &names.join(" "), "--"]);
        command.arg(&binary);
        command
    };
    command
        .args(["--test-threads=1", "--nocapture"])
        .args(&options.tests)
        .env("OGG_REQUIRE_VCAN", "1")
        .env("OGG_BIN", target_dir().join("release/ogg"))
        .env("VCAN_TOOLS", cache().join("tools"))
        .env("VCAN_PYTHON", python);
    if let Some(kills) = &options.kills {
        command.env("VCAN_KILLS", kills);
    }
    if let Some(seconds) = &options.exchange_s {
        command.env("VCAN_EXCHANGE_S", seconds);
    }
    run(&mut command)
}

enum Place {
    Any,
    Native,
    Guest(String),
}

struct Options {
    place: Place,
    kills: Option<String>,
    exchange_s: Option<String>,
    tests: Vec<String>,
}

impl Options {
    fn parse(arguments: &[String]) -> Result<Self> {
        let mut options = Self { place: Place::Any, kills: None, exchange_s: None, tests: Vec::new() };
        let mut rest = arguments.iter();
        while let Some(argument) = rest.next() {
            let mut value = || rest.next().cloned().with_context(|| format!("{argument} needs a value"));
            match argument.as_str() {
                "--native" => options.place = Place::Native,
                "--guest" => options.place = Place::Guest(value()?),
                "--kills" => options.kills = Some(value()?),
                "--exchange" => options.exchange_s = Some(value()?),
                flag if flag.starts_with('-') => {
                    bail!("vcan-test knows --native, --guest uml|qemu, --kills N, --exchange S; not {flag}")
                }
                test => options.tests.push(test.to_owned()),
            }
        }
        Ok(options)
    }

    /// Time for the guest: what the tests take, and two seconds for each kill asked for.
    fn limit_s(&self) -> u64 {
        let number = |text: &Option<String>| text.as_ref().and_then(|t| t.parse::<f64>().ok()).unwrap_or(0.0);
        (300.0 + 3.0 * number(&self.kills) + 2.0 * number(&self.exchange_s)).ceil() as u64
    }
}

/// Whether vcan interfaces exist or can be made on this machine.
fn native_interfaces() -> bool {
    (0..INTERFACES).all(|n| {
        let name = format!("vcan{n}");
        if Path::new("/sys/class/net").join(&name).exists() {
            return true;
        }
        let ip = |arguments: &[&str]| {
            let status = Command::new("ip").args(arguments).stderr(Stdio::null()).status();
            status.is_ok_and(|s| s.success())
        };
        ip(&["link", "add", &name, "type", "vcan"])
            && ip(&["link", "set", &name, "mtu", "72"])
            && ip(&["link", "set", &name, "up"])
    })
}

/// Where the guest's kernel and the tools are kept, as in `vcan-setup`.
fn cache() -> PathBuf {
    let variable = |name| std::env::var_os(name).map(PathBuf::from);
    variable("VCAN_HOME")
        .or_else(|| variable("XDG_CACHE_HOME").map(|c| c.join("vcan")))
        .or_else(|| variable("HOME").map(|h| h.join(".cache/vcan")))
        .unwrap_or_else(|| PathBuf::from(".cache/vcan"))
}

/// Builds the test program and gives its path.
fn test_binary() -> Result<PathBuf> {
    // The whole workspace is named, so that dependencies are built with the features that `cargo xtask test` uses; the test
    // `bad_input` stands for the `ogg` command, which is built with it.
    let arguments = [
        "test",
        "--release",
        "--workspace",
        "--test",
        "vcan",
        "--test",
        "bad_input",
        "--no-run",
        "--message-format=json",
    ];
    let messages = output(&mut cargo(&arguments))?;
    for line in messages.lines() {
        let message: serde_json::Value = serde_json::from_str(line).context("a message of cargo")?;
        if message["target"]["name"] == "vcan"
            && let Some(path) = message["executable"].as_str()
        {
            return Ok(PathBuf::from(path));
        }
    }
    bail!("cargo built no test program named vcan")
}
