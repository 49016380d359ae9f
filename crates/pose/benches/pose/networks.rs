//! Whole networks from picture to people, on ONNX Runtime and on tract.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use pose::{
    Estimator, ImageView, LibraryCandidate, LibraryChoice, LibraryOrigin, Model, Region, RegionOptions, Runtime,
    RuntimeOptions,
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
    let runtime = Runtime::load(options).unwrap();
    let mut models = vec![Model::default()];
    if let Some(dir) = std::env::var_os("OGG_POSE_MODELS").map(PathBuf::from) {
        for card in Model::builtin_cards().into_iter().skip(1) {
            models.extend(Model::find(Path::new(&card.name), std::slice::from_ref(&dir)));
        }
    }
    models.iter().map(|m| network(m, &runtime, tract)).collect()
}

/// One look at a crop, as in tracking: preprocess, network, decode.
fn network(model: &Model, runtime: &Runtime, tract: bool) -> Value {
    let backend = if tract { "tract" } else { "ONNX Runtime" };
    let name = format!("network: {} on {backend}", model.card.name);
    let picture = data::picture(1280, 720);
    let image = ImageView::new(1280, 720, &picture).unwrap();
    match Estimator::with_region(model, runtime, Region::Full, RegionOptions::default()) {
        Ok(mut estimator) => {
            let n = if tract { 20 } else { 100 };
            let mut row = measure::row(&name, n, || {
                estimator.estimate(image).unwrap();
            });
            let size = estimator.last_crop().map(|c| c.scale);
            row["note"] = json!(format!("picture to people, {}, scale {size:?}", estimator.runtime_info()));
            row
        }
        Err(e) => json!({ "name": name, "unit": "ms", "note": format!("does not run: {e}") }),
    }
}
