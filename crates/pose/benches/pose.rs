//! Preprocessing, decoding, targets, gates, and whole networks. Prints one JSON document.
//!
//! `OGG_POSE_MODELS` names a folder of networks, each known by its card; without it only the project's own are run.
//! `ORT_DYLIB_PATH` names ONNX Runtime, and networks of the project also run on OpenVINO where it has it; all also run on tract, in a
//! process of their own. `cargo xtask bench pose` names one that it installs, and makes an `ogg-vgg` with random
//! weights (`models.py`). `OGG_POSE_THREADS` sets the threads, 2 by default.
#![expect(clippy::print_stdout, reason = "the JSON document is the product of this program")]
#![expect(clippy::disallowed_methods, reason = "a benchmark reads its clock and its environment")]
#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run ends")]

#[path = "pose/data.rs"]
mod data;
#[path = "pose/measure.rs"]
mod measure;
#[path = "pose/networks.rs"]
mod networks;

use std::time::Duration;

use measure::row;
use pose::{
    ArmGate, CropMap, GateOptions, ImageView, JointState, Labels, Layout, MapView, Maps, Model, OpenPoseDecoder,
    Preprocessor, Side, Skeleton, TargetParams, WorkerOptions, WorkerTracker,
};
use rayon::prelude::*;
use serde_json::{Value, json};

fn main() {
    if std::env::args().any(|a| a == networks::TRACT_CHILD) {
        println!("{}", Value::Array(networks::rows(true)));
        return;
    }
    let mut rows = Vec::new();
    preprocess(&mut rows);
    decode(&mut rows);
    targets(&mut rows);
    tracking(&mut rows);
    rows.extend(networks::rows(false));
    rows.extend(networks::rows_of_tract());
    println!("{}", json!({ "area": "pose", "rows": rows }));
}

fn preprocess(rows: &mut Vec<Value>) {
    let picture = data::picture(1280, 720);
    let image = ImageView::new(1280, 720, &picture).unwrap();
    let card = Model::builtin_cards().into_iter().find(|c| c.name == "blazepose-full").unwrap();
    let mut p = Preprocessor::new(&card.input);
    let letterbox = CropMap::letterbox(1280, 720, 256, 256);
    rows.push(row("preprocess: 1280x720 letterboxed to 256x256 float", 400, || {
        p.fill(image, letterbox);
    }));
    let crop = CropMap::around(640.0, 360.0, 500.0, 256, 256);
    rows.push(row("preprocess: crop of 500 px to 256x256 float", 400, || {
        p.fill(image, crop);
    }));
    let mut large = Preprocessor::new(&pose::InputSpec { width: 368, height: 368, layout: Layout::Nchw, ..card.input });
    let letterbox = CropMap::letterbox(1280, 720, 368, 368);
    rows.push(row("preprocess: 1280x720 letterboxed to 368x368 float planar", 400, || {
        large.fill(image, letterbox);
    }));
}

fn decode(rows: &mut Vec<Value>) {
    let card = Model::builtin_cards().into_iter().find(|c| c.openpose.is_some()).unwrap();
    let spec = card.openpose.unwrap();
    for (people, layout) in [(1, Layout::Nchw), (10, Layout::Nchw), (1, Layout::Nhwc), (10, Layout::Nhwc)] {
        let (width, height) = (54, 46);
        let (pcm, paf) = data::maps(people, &spec, card.skeleton, width, height, layout);
        let mut decoder = OpenPoseDecoder::new(card.skeleton, &spec, 0.1);
        let view = |data, channels| MapView { data, layout, channels, first: 0, width, height };
        let found = decoder.decode(view(&pcm, 19), view(&paf, 38)).len();
        let name = format!("decode: {people} people, 46x54 maps, {layout:?}");
        let mut r = row(&name, 400, || {
            decoder.decode(view(&pcm, 19), view(&paf, 38));
        });
        r["note"] = json!(format!("{found} people found"));
        rows.push(r);
    }
}

fn targets(rows: &mut Vec<Value>) {
    let limbs = Model::builtin_cards().into_iter().find_map(|c| c.openpose).unwrap().limbs;
    let plan = TargetParams::openpose(Skeleton::OpenPose18, limbs, 368, 368).validate().unwrap();
    let (joints_px, boxes_px) = data::labels(16, 2);
    let states = vec![JointState::Labelled as u8; 16 * 2 * 18];
    let labels = Labels { batch: 16, people: 2, joints_px: &joints_px, states: &states, boxes_px: &boxes_px };
    let mut maps = Maps::default();
    rows.push(row("targets: encode 16 pictures of 368x368, 2 people", 100, || {
        plan.encode_into(&labels, &mut maps).unwrap();
    }));
    let teacher = (data::noise(maps.pcm.len()), data::noise(maps.paf.len()));
    rows.push(row("targets: fuse 16 pictures of 368x368", 100, || {
        plan.fuse(&mut maps, &teacher.0, &teacher.1, 0.1).unwrap();
    }));
    rows.push(row("targets: encode and fuse 16 pictures of 368x368, 2 people", 100, || {
        plan.encode_fused_into(&labels, &teacher.0, &teacher.1, 0.1, &mut maps).unwrap();
    }));
    let Maps { pcm, paf, pcm_mask, paf_mask } = &mut maps;
    rows.push(row("memory: only write what encoding writes", 100, || {
        for (map, mask) in [(&mut *pcm, &mut *pcm_mask), (paf, paf_mask)] {
            map.par_chunks_mut(1 << 14).for_each(|part| part.fill(1.0));
            mask.par_chunks_mut(1 << 16).for_each(|part| part.fill(true));
        }
    }));
    rows.push(row("memory: only read and write what fusing reads and writes", 100, || {
        for (own, mask, teacher) in [(&mut *pcm, &mut *pcm_mask, &teacher.0), (paf, paf_mask, &teacher.1)] {
            let own = own.par_chunks_mut(1 << 14).zip(mask.par_chunks_mut(1 << 14));
            own.zip(teacher.par_chunks(1 << 14)).for_each(|((own, mask), teacher)| {
                for ((own, mask), teacher) in own.iter_mut().zip(mask).zip(teacher) {
                    *own += *teacher;
                    *mask |= *teacher >= 0.1;
                }
            });
        }
    }));
}

fn tracking(rows: &mut Vec<Value>) {
    let mut gate = ArmGate::new(Side::Right, GateOptions::default()).unwrap();
    let mut worker = WorkerTracker::new(WorkerOptions::default()).unwrap();
    let people = data::people(3);
    let mut time = Duration::ZERO;
    rows.push(row("worker and gate: one picture, 3 people", 2000, || {
        time += Duration::from_millis(33);
        let update = worker.update(time, &people);
        gate.update(time, update.person(&people));
    }));
}
