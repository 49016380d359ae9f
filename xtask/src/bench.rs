//! `cargo xtask bench AREA`: one way to measure. Runs the area's benchmark, its peers in Python where there are any, joins
//! their rows by name, and adds what the machine is.
//!
//! What follows `--` goes to the benchmark program, such as `-- --full` for the published counts.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};

use crate::process::{cargo, output, target_dir, workspace_root};
use crate::python::{self, virtual_environment};

/// Areas, and the crate whose `benches/<area>.rs` measures each.
const AREAS: &[(&str, &str)] = &[
    ("gmr", "gmr-core"),
    ("kin", "kin"),
    ("motion", "motion"),
    ("can", "can-driver"),
    ("sim", "sim"),
    ("pose", "pose"),
    ("capture", "ogg"),
    ("follow", "follow"),
];

/// One measured figure.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    unit: String,
    /// Median of ours.
    ours: Option<f64>,
    /// Median of the peer, measured in the same run.
    #[serde(default)]
    peer: Option<f64>,
    #[serde(default)]
    peer_name: Option<String>,
    /// Peer over ours.
    #[serde(default)]
    ratio: Option<f64>,
    /// Median processor time of ours, in the row's unit: what a busy machine does not lengthen.
    #[serde(default)]
    ours_processor: Option<f64>,
    #[serde(default)]
    peer_processor: Option<f64>,
    /// Processor time of the peer over ours.
    #[serde(default)]
    ratio_processor: Option<f64>,
    #[serde(default)]
    p50: Option<f64>,
    #[serde(default)]
    p99: Option<f64>,
    #[serde(default)]
    min: Option<f64>,
    #[serde(default)]
    max: Option<f64>,
    #[serde(default)]
    n: Option<u64>,
    #[serde(default)]
    note: Option<String>,
    #[serde(default)]
    peer_note: Option<String>,
}

#[derive(Debug, Serialize, Deserialize)]
struct Report {
    area: String,
    rows: Vec<Row>,
    #[serde(default)]
    machine: Option<Machine>,
}

/// What the figures were measured on.
#[derive(Debug, Serialize, Deserialize)]
struct Machine {
    cpu: String,
    cores: usize,
    memory_gib: f64,
    kernel: String,
    rustc: String,
    load_before: String,
    load_after: String,
}

/// `bench AREA [--json FILE] [-- ARGUMENTS]`.
pub(crate) fn run(arguments: &[String]) -> Result<()> {
    let split = arguments.iter().position(|a| a == "--").unwrap_or(arguments.len());
    let (own, passed) = (&arguments[..split], arguments.get(split + 1..).unwrap_or_default());
    let (area, json) = match own {
        [area] => (area.as_str(), None),
        [area, flag, file] if flag == "--json" => (area.as_str(), Some(file)),
        _ => bail!("usage: cargo xtask bench AREA [--json FILE] [-- ARGUMENTS OF THE BENCHMARK]"),
    };
    if area == "python" {
        return print(&mut parsed(area, &python_overhead()?)?, read("/proc/loadavg"), json);
    }
    let Some((_, package)) = AREAS.iter().find(|(name, _)| *name == area) else {
        let names: Vec<_> = AREAS.iter().map(|(name, _)| *name).collect();
        bail!("no area named {area:?}; there are {}, python", names.join(", "));
    };
    let folder = workspace_root().join(folder_of(package)).join("benches");
    let script = folder.join("peers.py");
    let python = if script.exists() {
        Some(virtual_environment(&format!("bench-{area}"), &folder.join("peers-requirements.txt"))?)
    } else {
        None
    };
    // Crates above tract are built with the workspace's features, or tract is compiled a second time.
    let scope: &[&str] = if area == "pose" { &["--workspace"] } else { &["--package", package] };
    let mut benchmark = cargo(&[&["bench", "--quiet"], scope, &["--bench", area]].concat());
    if let (Some(python), "pose") = (&python, area) {
        benchmark.envs(networks(python, &folder)?);
    }
    benchmark.arg("--").args(passed.iter().map(from_here));
    // What comes now is measured; what takes long once is done.
    let load_before = read("/proc/loadavg");
    let ours = output(&mut benchmark)?;
    let mut report = parsed(area, &ours)?;
    if let Some(python) = python {
        let printed = output(Command::new(python).arg(&script))?;
        let peers: Report = serde_json::from_str(&printed).context("peers.py printed something else than rows")?;
        join(&mut report.rows, peers.rows);
    }
    print(&mut report, load_before, json)
}

fn parsed(area: &str, printed: &str) -> Result<Report> {
    serde_json::from_str(printed).with_context(|| format!("the {area} benchmark printed something else than rows"))
}

fn print(report: &mut Report, load_before: String, json: Option<&String>) -> Result<()> {
    report.machine = Some(machine(load_before));
    print_table(report);
    if let Some(file) = json {
        std::fs::write(file, serde_json::to_string_pretty(report)?).with_context(|| file.clone())?;
    }
    Ok(())
}

/// What a call of the wheel costs over the work it asks for.
fn python_overhead() -> Result<String> {
    output(Command::new(python::installed()?).arg(workspace_root().join("py/benches/overhead.py")))
}

/// What `benches/pose.rs` runs networks with: the environment's ONNX Runtime, unless another one is named, and a network with
/// random weights.
fn networks(python: &Path, folder: &Path) -> Result<Vec<(&'static str, PathBuf)>> {
    let models = target_dir().join("bench-pose");
    output(Command::new(python).arg(folder.join("models.py")).arg(&models))?;
    let mut named = vec![("OGG_POSE_BENCH_MODELS", models)];
    if std::env::var_os("ORT_DYLIB_PATH").is_none() {
        let find = "import glob, os, onnxruntime\n\
                    print(glob.glob(os.path.dirname(onnxruntime.__file__) + '/capi/libonnxruntime.so*')[0])";
        named.push(("ORT_DYLIB_PATH", output(Command::new(python).args(["-c", find]))?.trim().into()));
    }
    Ok(named)
}

/// Cargo starts a benchmark in its crate's folder, so a file named from here needs its whole path.
fn from_here(argument: &String) -> String {
    match std::path::absolute(argument) {
        Ok(path) if path.exists() => path.display().to_string(),
        _ => argument.clone(),
    }
}

fn folder_of(package: &str) -> &Path {
    match package {
        "gmr-core" => Path::new("crates/gmr-core"),
        "kin" => Path::new("crates/kin"),
        "motion" => Path::new("crates/motion"),
        "can-driver" => Path::new("crates/can-driver"),
        "sim" => Path::new("crates/sim"),
        "pose" => Path::new("crates/pose"),
        "follow" => Path::new("crates/follow"),
        _ => Path::new("crates/ogg"),
    }
}

/// Peer rows carry their figure as `ours` or `peer`; several peers of one row become several rows.
fn join(rows: &mut Vec<Row>, peers: Vec<Row>) {
    for peer in peers {
        let figure = peer.peer.or(peer.ours);
        match rows.iter().find(|row| row.name == peer.name).cloned() {
            Some(row) => {
                let over = |(theirs, ours): (f64, f64)| theirs / ours;
                let joined = Row {
                    peer: figure,
                    peer_name: peer.peer_name,
                    ratio: figure.zip(row.ours).map(over),
                    peer_processor: peer.peer_processor,
                    ratio_processor: peer.peer_processor.zip(row.ours_processor).map(over),
                    peer_note: peer.note,
                    ..row
                };
                match rows.iter_mut().find(|row| row.name == joined.name && row.peer.is_none()) {
                    Some(place) => *place = joined,
                    None => rows.push(joined),
                }
            }
            None => rows.push(Row { ours: None, peer: figure, ..peer }),
        }
    }
}

fn machine(load_before: String) -> Machine {
    let field = |file: &str, name: &str| {
        read(file)
            .lines()
            .find(|line| line.starts_with(name))
            .and_then(|line| line.split_once(':'))
            .map_or_else(|| "unknown".to_owned(), |(_, value)| value.trim().to_owned())
    };
    let memory_kib: f64 =
        field("/proc/meminfo", "MemTotal").split(' ').next().and_then(|v| v.parse().ok()).unwrap_or(f64::NAN);
    Machine {
        cpu: field("/proc/cpuinfo", "model name"),
        cores: std::thread::available_parallelism().map_or(0, usize::from),
        memory_gib: (memory_kib / 1024.0 / 1024.0 * 10.0).round() / 10.0,
        kernel: read("/proc/sys/kernel/osrelease"),
        rustc: output(Command::new("rustc").arg("--version")).map_or_else(|_| "unknown".into(), |v| v.trim().into()),
        load_before,
        load_after: read("/proc/loadavg"),
    }
}

fn read(path: &str) -> String {
    std::fs::read_to_string(path).map_or_else(|_| "unknown".into(), |text| text.trim().to_owned())
}

#[expect(clippy::print_stdout, reason = "the table is this command's result")]
fn print_table(report: &Report) {
    let number = |value: Option<f64>| match value {
        None => String::new(),
        Some(0.0) => "0".into(),
        Some(v) if v.abs() >= 1e5 || v.abs() < 1e-3 => format!("{v:.3e}"),
        Some(v) if v.abs() >= 100.0 => format!("{v:.0}"),
        Some(v) => format!("{v:.3}"),
    };
    let header = [
        "name",
        "unit",
        "ours",
        "peer",
        "peer is",
        "ratio",
        "ours cpu",
        "peer cpu",
        "cpu ratio",
        "p50",
        "p99",
        "min",
        "max",
        "n",
        "note",
        "note of peer",
    ];
    let mut table = vec![header.map(str::to_owned).to_vec()];
    for row in &report.rows {
        table.push(vec![
            row.name.clone(),
            row.unit.clone(),
            number(row.ours),
            number(row.peer),
            row.peer_name.clone().unwrap_or_default(),
            number(row.ratio),
            number(row.ours_processor),
            number(row.peer_processor),
            number(row.ratio_processor),
            number(row.p50),
            number(row.p99),
            number(row.min),
            number(row.max),
            row.n.map(|n| n.to_string()).unwrap_or_default(),
            row.note.clone().unwrap_or_default(),
            row.peer_note.clone().unwrap_or_default(),
        ]);
    }
    let used: Vec<usize> = (0..header.len()).filter(|&c| table[1..].iter().any(|row| !row[c].is_empty())).collect();
    for (index, row) in table.iter().enumerate() {
        let cells: Vec<String> = used
            .iter()
            .map(|&c| {
                let width = table.iter().map(|r| r[c].chars().count()).max().unwrap_or(0);
                format!("{:width$}", row[c])
            })
            .collect();
        println!("| {} |", cells.join(" | "));
        if index == 0 {
            let rule: Vec<String> = cells.iter().map(|c| "-".repeat(c.chars().count())).collect();
            println!("| {} |", rule.join(" | "));
        }
    }
    if let Some(m) = &report.machine {
        println!(
            "\n{}, {} cores, {} GiB, Linux {}, {}; load before {}, after {}",
            m.cpu, m.cores, m.memory_gib, m.kernel, m.rustc, m.load_before, m.load_after
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, ours: Option<f64>, peer_name: Option<&str>) -> Row {
        Row {
            name: name.into(),
            unit: "ms".into(),
            ours,
            peer: None,
            peer_name: peer_name.map(Into::into),
            ratio: None,
            ours_processor: None,
            peer_processor: None,
            ratio_processor: None,
            p50: None,
            p99: None,
            min: None,
            max: None,
            n: None,
            note: None,
            peer_note: None,
        }
    }

    #[test]
    fn processor_time_is_compared_beside_wall_time() {
        let mut rows = vec![Row { ours_processor: Some(1.0), ..row("fit", Some(2.0), None) }];
        join(&mut rows, vec![Row { peer_processor: Some(8.0), ..row("fit", Some(10.0), Some("a")) }]);
        assert_eq!((rows[0].ratio, rows[0].ratio_processor), (Some(5.0), Some(8.0)));
    }

    #[test]
    fn two_peers_of_one_figure_become_two_rows() {
        let mut rows = vec![row("fit", Some(2.0), None)];
        join(&mut rows, vec![row("fit", Some(10.0), Some("a")), row("fit", Some(4.0), Some("b"))]);
        let ratios: Vec<_> = rows.iter().map(|r| r.ratio).collect();
        assert_eq!(ratios, [Some(5.0), Some(2.0)]);
    }

    #[test]
    fn a_peer_without_our_figure_is_kept() {
        let mut rows = vec![];
        join(&mut rows, vec![row("other", Some(3.0), Some("a"))]);
        assert_eq!((rows[0].ours, rows[0].peer), (None, Some(3.0)));
    }
}
