//! The arrows of docs/ARCHITECTURE.md, checked against what cargo says the crates depend on.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use serde::Deserialize;

use crate::process::{cargo, output};

/// What each crate may depend on, in normal and build dependencies. Tests may use more.
const ALLOWED: &[(&str, &[&str])] = &[
    ("gmr-core", &[]),
    ("pose", &[]),
    ("kin", &[]),
    ("motion", &[]),
    ("can-driver", &[]),
    ("sim", &["can-driver", "kin"]),
    ("follow", &["gmr-core", "kin", "motion"]),
    ("ogg", &["can-driver", "follow", "gmr-core", "kin", "motion", "pose", "sim"]),
    ("ogg-rs-py", &["can-driver", "follow", "gmr-core", "kin", "motion", "ogg", "pose", "sim"]),
    ("system-tests", &["can-driver"]),
    ("xtask", &[]),
];

#[derive(Deserialize)]
struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    dependencies: Vec<Dependency>,
}

#[derive(Deserialize)]
struct Dependency {
    name: String,
    kind: Option<String>,
}

/// Fails, naming each forbidden arrow and each crate without a place in the table.
pub(crate) fn check() -> Result<()> {
    let text = output(&mut cargo(&["metadata", "--format-version", "1", "--no-deps"]))?;
    let metadata: Metadata = serde_json::from_str(&text).context("cargo metadata")?;
    let wrong = violations(&metadata, &ALLOWED.iter().copied().collect());
    if !wrong.is_empty() {
        bail!("the layers of docs/ARCHITECTURE.md are broken:\n  {}", wrong.join("\n  "));
    }
    eprintln!("layers: {} crates, every arrow points down", metadata.packages.len());
    Ok(())
}

fn violations(metadata: &Metadata, allowed: &BTreeMap<&str, &[&str]>) -> Vec<String> {
    let mut wrong = Vec::new();
    for package in &metadata.packages {
        let Some(may) = allowed.get(package.name.as_str()) else {
            wrong.push(format!("{} has no place in the table of xtask/src/layers.rs", package.name));
            continue;
        };
        for dependency in package.dependencies.iter().filter(|d| d.kind.as_deref() != Some("dev")) {
            let ours = allowed.contains_key(dependency.name.as_str());
            if ours && !may.contains(&dependency.name.as_str()) {
                wrong.push(format!("{} must not depend on {}", package.name, dependency.name));
            }
        }
    }
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metadata(kind: Option<&str>) -> Metadata {
        let dependency = Dependency { name: "kin".into(), kind: kind.map(Into::into) };
        Metadata { packages: vec![Package { name: "gmr-core".into(), dependencies: vec![dependency] }] }
    }

    #[test]
    fn a_domain_crate_that_imports_another_is_named() {
        let allowed = ALLOWED.iter().copied().collect();
        assert_eq!(violations(&metadata(None), &allowed), ["gmr-core must not depend on kin"]);
    }

    #[test]
    fn tests_may_use_more() {
        assert!(violations(&metadata(Some("dev")), &ALLOWED.iter().copied().collect()).is_empty());
    }

    #[test]
    fn a_new_crate_needs_a_place() {
        let wrong = violations(&metadata(None), &BTreeMap::from([("kin", &[][..])]));
        assert_eq!(wrong, ["gmr-core has no place in the table of xtask/src/layers.rs"]);
    }
}
