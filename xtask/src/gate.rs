//! The gate, step by step.

use std::time::Instant;

use anyhow::Result;

use crate::process::{cargo, run};
use crate::{layers, python, vcan};

/// fmt, lint, layers, docs, then `cargo xtask test`.
pub(crate) fn ci() -> Result<()> {
    let started = Instant::now();
    step("fmt", fmt)?;
    step("layers", layers::check)?;
    step("lint", lint)?;
    step("docs", docs)?;
    run(&mut cargo(&["xtask", "test"]))?;
    eprintln!("\nthe gate passed in {:.1} min", started.elapsed().as_secs_f64() / 60.0);
    Ok(())
}

/// Every test there is.
pub(crate) fn test() -> Result<()> {
    step("python environment", || python::environment().map(drop))?;
    step("rust", || run(&mut cargo(&["test", "--release", "--workspace", "--no-fail-fast"])))?;
    step("vcan", || vcan::vcan_test(&[]))?;
    step("python", python::test)
}

pub(crate) fn fmt() -> Result<()> {
    run(&mut cargo(&["fmt", "--all", "--check"]))
}

pub(crate) fn lint() -> Result<()> {
    run(&mut cargo(&["clippy", "--release", "--workspace", "--all-targets", "--", "-D", "warnings"]))
}

pub(crate) fn docs() -> Result<()> {
    run(cargo(&["doc", "--release", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"))
}

fn step(name: &str, work: impl FnOnce() -> Result<()>) -> Result<()> {
    let started = Instant::now();
    work()?;
    eprintln!("{name}: done in {:.0} s", started.elapsed().as_secs_f64());
    Ok(())
}
