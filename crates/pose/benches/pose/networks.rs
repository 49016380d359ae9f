//! Whole networks from picture to people, on ONNX Runtime, on OpenVINO and on tract.

use std::{
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

use pose::{
    Backend, Estimator, ExecutionProvider, ImageView, LibraryCandidate, LibraryChoice, LibraryOrigin, Model, Region,
    RegionOptions, Runtime, RuntimeOptions, Stage,
};
use serde_json::{Value, json};

use crate::{data, measure};

/// Argument with which the benchmark starts itself for tract; a process has one runtime.
pub(crate) const TRACT_CHILD: &str = "--networks-on-tract";

pub(crate) fn rows_of_tract() -> Vec<Value> {
    let output = Command::new(std::env::current_exe().unwrap()).arg(TRACT_CHILD).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice::<Vec<Value>>(&output.stdout).unwrap()
}

pub(crate) fn rows(tract: bool) -> Vec<Value> {
    let library = if tract {
        LibraryChoice::PureRust
    } else {
        let Some(path) = std::env::var_os("ORT_DYLIB_PATH") else {
            return vec![
                json!({ "name": "networks on ONNX Runtime", "unit": "ms", "note": "left out: ORT_DYLIB_PATH is not set" }),
            ];
        };
        LibraryChoice::Search(vec![LibraryCandidate { path: path.into(), origin: LibraryOrigin::Environment }])
    };
    let threads = std::env::var("OGG_POSE_THREADS").ok().and_then(|t| t.parse().ok()).unwrap_or(2);
    let options = RuntimeOptions { library, threads: Some(threads), ..Default::default() };
    let runtime = Runtime::load(options.clone()).unwrap();
    let models = models();
    if tract {
        // Table 1's network takes half a minute a picture there.
        return models.iter().filter(|m| !m.card.name.starts_with("ogg-vgg")).map(|m| network(m, &runtime)).collect();
    }
    let mut rows: Vec<Value> = models.iter().map(|m| network(m, &runtime)).collect();
    match Runtime::load(RuntimeOptions { provider: ExecutionProvider::OpenVino, ..options }) {
        Ok(runtime) => {
            for model in models.iter().filter(|m| m.card.name.starts_with("ogg-")) {
                let mut row = network(model, &runtime);
                beside_plain(&mut row, model, &rows);
                rows.push(row);
            }
        }
        Err(e) => rows.push(json!({ "name": "networks on OpenVINO", "unit": "ms", "note": format!("left out: {e}") })),
    }
    rows
}

/// `ogg-lite`, the public networks in the folder of `OGG_POSE_MODELS`, and every network with a card there and in the folder of
/// `OGG_POSE_BENCH_MODELS`; of two with one name the first.
fn models() -> Vec<Model> {
    let mut models = vec![Model::default()];
    let folders = ["OGG_POSE_MODELS", "OGG_POSE_BENCH_MODELS"].map(|v| std::env::var_os(v).map(PathBuf::from));
    if let Some(dir) = &folders[0] {
        for card in Model::builtin_cards().into_iter().skip(1) {
            models.extend(Model::find(Path::new(&card.name), std::slice::from_ref(dir)));
        }
    }
    for folder in folders.iter().flatten() {
        let mut cards: Vec<PathBuf> = std::fs::read_dir(folder)
            .into_iter()
            .flatten()
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| path.extension().is_some_and(|e| e == "toml"))
            .collect();
        cards.sort();
        for model in cards.iter().filter_map(|card| Model::find(card, &[]).ok()) {
            if models.iter().all(|m| m.card.name != model.card.name) {
                models.push(model);
            }
        }
    }
    models
}

/// An `-int8` network on another provider is compared with its float original on the CPU provider.
fn beside_plain(row: &mut Value, model: &Model, rows: &[Value]) {
    let plain = model.card.name.trim_end_matches("-int8");
    let name = format!("network: {plain} on ONNX Runtime");
    let peer = rows.iter().find(|r| r["name"] == name.as_str()).and_then(|r| r["ours"].as_f64());
    if let (Some(peer), Some(ours)) = (peer, row["ours"].as_f64()) {
        row["peer"] = json!(peer);
        row["ratio"] = json!(peer / ours);
        row["peer_name"] = json!(format!("{plain} on ONNX Runtime's CPU provider"));
    }
}

/// One look at a picture of 1280x720, as in tracking: preprocess, network, decode.
fn network(model: &Model, runtime: &Runtime) -> Value {
    let info = runtime.info();
    let backend = match (&info.backend, info.active) {
        (Backend::Tract, _) => "tract",
        (_, ExecutionProvider::OpenVino) => "OpenVINO",
        _ => "ONNX Runtime",
    };
    let name = format!("network: {} on {backend}", model.card.name);
    let picture = data::picture(1280, 720);
    let image = ImageView::new(1280, 720, &picture).unwrap();
    match Estimator::with_region(model, runtime, Region::Full, RegionOptions::default()) {
        Ok(mut estimator) => {
            let mut stages = [const { Vec::new() }; 3];
            let mut row = measure::row_for(&name, Duration::from_secs(4), 100, || {
                let mut last = Instant::now();
                let observe = &mut |stage: Stage| {
                    stages[stage as usize].push(last.elapsed().as_secs_f64() * 1e3);
                    last = Instant::now();
                };
                estimator.estimate_observed(image, observe).unwrap();
            });
            let medians: Vec<String> = Stage::ALL
                .iter()
                .zip(&mut stages)
                .map(|(stage, times)| {
                    times.sort_by(f64::total_cmp);
                    format!("{} {:.3}", stage.name(), times[times.len() / 2])
                })
                .collect();
            let rate_hz = 1e3 / row["p50"].as_f64().unwrap();
            row["note"] = json!(format!("picture to people: {rate_hz:.1} Hz; {} ms", medians.join(", ")));
            row
        }
        Err(e) => json!({ "name": name, "unit": "ms", "note": format!("does not run: {e}") }),
    }
}
