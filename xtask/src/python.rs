//! The Python side: one virtual environment under the target folder, the wheel, and its tests.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::process::{cargo, output, run, target_dir, workspace_root};

/// The environment the tests run in, made or completed at need; returns its interpreter.
pub(crate) fn environment() -> Result<PathBuf> {
    virtual_environment("test", &workspace_root().join("py/requirements-test.txt"))
}

/// A virtual environment of its own per purpose, filled from a requirements file once and again when the file changes.
pub(crate) fn virtual_environment(name: &str, requirements: &Path) -> Result<PathBuf> {
    let folder = target_dir().join("python").join(name);
    let python = folder.join("bin/python");
    let wanted = std::fs::read_to_string(requirements).with_context(|| format!("{}", requirements.display()))?;
    let stamp = folder.join("installed.txt");
    if python.exists() && std::fs::read_to_string(&stamp).is_ok_and(|have| have == wanted) {
        return Ok(python);
    }
    output(Command::new("python3").arg("--version"))
        .context("Python 3.10 or newer with venv is needed (Debian: apt-get install python3-venv)")?;
    run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    run(Command::new(&python)
        .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r"])
        .arg(requirements))?;
    std::fs::write(&stamp, wanted)?;
    Ok(python)
}

/// Builds the wheel into `target/wheels` and returns its path.
pub(crate) fn wheel() -> Result<PathBuf> {
    check_features()?;
    let python = environment()?;
    let wheels = target_dir().join("wheels");
    if wheels.exists() {
        std::fs::remove_dir_all(&wheels)?;
    }
    run(Command::new(&python)
        .args(["-m", "maturin", "build", "--release", "--manifest-path", "py/Cargo.toml", "--out"])
        .arg(&wheels)
        .arg("--interpreter")
        .arg(&python))?;
    let mut found = Vec::new();
    for entry in std::fs::read_dir(&wheels)? {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "whl") {
            found.push(path);
        }
    }
    match found.as_slice() {
        [wheel] => Ok(wheel.clone()),
        other => bail!("{} wheels in {}, expected one", other.len(), wheels.display()),
    }
}

/// The wheel is linked from what `cargo test --release --workspace` compiled. A crate with other features would be
/// compiled a second time, and with it all that depends on it; tract alone takes minutes.
fn check_features() -> Result<()> {
    let tree = |what: &[&str], edges: &str| {
        let format = ["--prefix", "none", "--no-dedupe", "--edges", edges, "--format", "{p} [{f}]"];
        output(cargo(&["tree"]).args(what).args(format))
    };
    let shared = tree(&["--workspace"], "normal,build,dev")?;
    let module = tree(&["--package", "ogg-rs-py"], "normal,build")?;
    let known: BTreeSet<&str> = shared.lines().collect();
    let others: BTreeSet<&str> = module.lines().filter(|line| !known.contains(line)).collect();
    if others.is_empty() {
        return Ok(());
    }
    bail!("the wheel would compile these again; name the missing features in py/Cargo.toml: {others:#?}")
}

/// The interpreter of the environment, with the wheel installed.
pub(crate) fn installed() -> Result<PathBuf> {
    let wheel = wheel()?;
    let python = environment()?;
    run(Command::new(&python)
        .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--force-reinstall", "--no-deps"])
        .arg(&wheel))?;
    Ok(python)
}

/// Runs the Python tests on the installed wheel.
pub(crate) fn test() -> Result<()> {
    pytest(&installed()?, &["py/tests"])
}

/// Installs the wheel into an empty environment of each interpreter, and runs the examples, the documentation and the
/// command there, without a Rust toolchain on the path.
pub(crate) fn wheel_test(interpreters: &[String]) -> Result<()> {
    if interpreters.is_empty() {
        bail!("usage: cargo xtask wheel-test PYTHON...   (the oldest and the newest supported interpreter)");
    }
    let wheel = wheel()?;
    for interpreter in interpreters {
        let version =
            output(Command::new(interpreter).args(["-c", "import sys; print('%d.%d' % sys.version_info[:2])"]))?;
        let folder = target_dir().join("python").join(format!("wheel-{}", version.trim()));
        if folder.exists() {
            std::fs::remove_dir_all(&folder)?;
        }
        run(Command::new(interpreter).args(["-m", "venv"]).arg(&folder))?;
        let python = folder.join("bin/python");
        run(Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--constraint"])
            .arg(workspace_root().join("py/requirements-test.txt"))
            .arg(format!("{}[plot,lerobot]", wheel.display()))
            .args(["pandas", "polars", "scikit-learn", "pytest", "hypothesis", "cantools"]))?;
        run(Command::new(&python).args(["-c", "import ogg_rs, sys; print(ogg_rs.__name__, sys.version)"]))?;
        let parts =
            ["package", "examples", "errors", "mixture", "regressor", "arima", "kin", "motion", "pose", "sim", "can"];
        let files: Vec<String> = parts.iter().map(|part| format!("py/tests/test_{part}.py")).collect();
        pytest(&python, &files.iter().map(String::as_str).collect::<Vec<_>>())?;
    }
    Ok(())
}

/// Away from the source folder, so that the installed package is tested and not the files beside the tests. Tests that
/// compare with the `ogg` binary find it by `OGG_BIN`.
fn pytest(python: &Path, tests: &[&str]) -> Result<()> {
    let root = workspace_root();
    run(Command::new(python)
        .args(["-m", "pytest", "-q", "--import-mode=importlib", "-p", "no:cacheprovider"])
        .args(tests.iter().map(|test| root.join(test)))
        .env("OGG_BIN", target_dir().join("release/ogg"))
        .env("PATH", "/usr/bin:/bin")
        .current_dir(target_dir()))
}
