//! The Python side: one virtual environment under the target folder, the wheel, and its tests.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::process::{output, run, target_dir, workspace_root};

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

/// Installs the wheel and runs the Python tests.
pub(crate) fn test() -> Result<()> {
    let wheel = wheel()?;
    let python = environment()?;
    run(Command::new(&python)
        .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--force-reinstall", "--no-deps"])
        .arg(&wheel))?;
    // Away from the source folder, so that the installed package is tested and not the files beside the tests.
    run(Command::new(&python)
        .args(["-m", "pytest", "-q", "--import-mode=importlib", "-p", "no:cacheprovider"])
        .arg(workspace_root().join("py/tests"))
        .env("OGG_BIN", target_dir().join("release/ogg"))
        .current_dir(target_dir()))
}
