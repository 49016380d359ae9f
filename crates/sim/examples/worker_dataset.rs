//! Renders labelled pictures of sewing workers for training.
//!
//! `cargo run --release -p sim --example worker_dataset -- --out DIR --count N --seed S [--size WxH] [--look varied|default]`
//!
//! Writes `images/NNNNNN.png`, `annotations.json` (COCO keypoints) and `extras.json` (every joint in OpenPose-18
//! order, hidden ones included). Picture `i` depends on `S + i` alone. An interrupted call goes on where it
//! stopped: a picture whose label lies in `labels/` is not rendered again.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use image::RgbImage;
use serde_json::{Value, json};
use sim::{
    Action, GroundTruth, Keypoint, Scene, SceneVariation, Script, Visibility, Worker, WorkerParams, default_camera,
};

const THREADS: usize = 2;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

struct Job {
    out: PathBuf,
    count: u64,
    seed: u64,
    size: [u32; 2],
    varied: bool,
}

impl Job {
    fn parse() -> Outcome<Self> {
        let mut job = Self { out: PathBuf::new(), count: 0, seed: 0, size: [320, 240], varied: true };
        let mut args = std::env::args().skip(1);
        while let Some(name) = args.next() {
            let value = args.next().ok_or_else(|| format!("{name} wants a value"))?;
            match name.as_str() {
                "--out" => job.out = value.into(),
                "--count" => job.count = value.parse()?,
                "--seed" => job.seed = value.parse()?,
                "--size" => {
                    let (w, h) = value.split_once('x').ok_or("--size wants WxH")?;
                    job.size = [w.parse()?, h.parse()?];
                }
                "--look" => {
                    job.varied = match value.as_str() {
                        "varied" => true,
                        "default" => false,
                        _ => return Err(format!("--look {value}: expected varied or default").into()),
                    }
                }
                _ => return Err(format!("unknown option {name}").into()),
            }
        }
        if job.out.as_os_str().is_empty() || job.count == 0 {
            return Err("--out DIR and --count N are needed".into());
        }
        Ok(job)
    }

    fn render(&self, i: u64) -> Outcome<(RgbImage, GroundTruth)> {
        let seed = self.seed.wrapping_mul(1_000_003).wrapping_add(i);
        if self.varied {
            let variation = SceneVariation::random(seed, self.size)?;
            let worker = Worker::new(variation.worker.clone())?;
            return Ok(Scene::varied(&variation).render(&worker.pose_at(variation.at)));
        }
        let script = Script::Repeat(Action::ALL[(i % 3) as usize]);
        let params = WorkerParams { seed, script, ..WorkerParams::default() };
        let worker = Worker::new(params)?;
        let at = Duration::from_millis(seed.wrapping_mul(7919) % 60_000);
        Ok(Scene::new(default_camera(self.size)?, worker.params()).render(&worker.pose_at(at)))
    }

    fn label_path(&self, i: u64) -> PathBuf {
        self.out.join("labels").join(format!("{i:06}.json"))
    }

    /// Renders picture `i` unless it exists. The label is written last, so its presence means "done".
    fn make(&self, i: u64) -> Outcome<()> {
        let label = self.label_path(i);
        if label.is_file() {
            return Ok(());
        }
        let (picture, truth) = self.render(i)?;
        picture.save(self.out.join(file_name(i)))?;
        write_whole(&label, &label_of(i, &truth, self.size).to_string())
    }
}

fn file_name(i: u64) -> String {
    format!("images/{i:06}.png")
}

/// Writes beside the target and renames, so that an interruption leaves no half file.
fn write_whole(path: &Path, text: &str) -> Outcome<()> {
    let part = path.with_extension("part");
    fs::write(&part, text)?;
    Ok(fs::rename(part, path)?)
}

/// `{"annotation": COCO annotation, "extra": every joint}` of one picture.
fn label_of(i: u64, truth: &GroundTruth, [width, height]: [u32; 2]) -> Value {
    let round = |x: f64| (x * 1000.0).round() / 1000.0;
    let mut keypoints = Vec::with_capacity(51);
    let mut labelled = 0;
    for keypoint in Keypoint::COCO {
        let flag = truth.visibility[keypoint.index()].coco_flag();
        match truth.pixel(keypoint) {
            Some(p) => {
                labelled += 1;
                keypoints.extend([round(p.x), round(p.y), f64::from(flag)]);
            }
            None => keypoints.extend([0.0; 3]),
        }
    }
    let places: Vec<Value> = Keypoint::ALL
        .iter()
        .map(|k| {
            let seen = truth.visibility[k.index()] == Visibility::Visible;
            truth.points_px[k.index()].map_or(Value::Null, |p| json!([round(p.x), round(p.y), u8::from(seen)]))
        })
        .collect();
    let place_m: Vec<[f64; 3]> = truth.points_m.iter().map(|p| [round(p.x), round(p.y), round(p.z)]).collect();
    json!({
        "annotation": {
            "id": i, "image_id": i, "category_id": 1, "iscrowd": 0,
            "keypoints": keypoints, "num_keypoints": labelled,
            "area": truth.area_px,
            "bbox": truth.box_px.unwrap_or([0.0, 0.0, f64::from(width), f64::from(height)]),
        },
        "extra": { "annotation_id": i, "keypoints18": places, "world_m": place_m },
    })
}

/// Joins all labels into the two files.
fn assemble(job: &Job) -> Outcome<()> {
    let (mut images, mut annotations, mut extras) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..job.count {
        let path = job.label_path(i);
        let text = fs::read_to_string(&path)?;
        let mut label: Value = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
        images.push(json!({"id": i, "file_name": file_name(i), "width": job.size[0], "height": job.size[1]}));
        annotations.push(label["annotation"].take());
        extras.push(label["extra"].take());
    }
    let names: Vec<&str> = Keypoint::COCO.iter().map(|k| k.name()).collect();
    let categories = json!([{"id": 1, "name": "person", "keypoints": names, "skeleton": []}]);
    let index = json!({"images": images, "annotations": annotations, "categories": categories});
    write_whole(&job.out.join("annotations.json"), &index.to_string())?;
    write_whole(&job.out.join("extras.json"), &json!({"annotations": extras}).to_string())
}

fn main() -> Outcome<()> {
    let job = Job::parse()?;
    fs::create_dir_all(job.out.join("images"))?;
    fs::create_dir_all(job.out.join("labels"))?;
    let next = AtomicU64::new(0);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..THREADS)
            .map(|_| {
                scope.spawn(|| -> Outcome<()> {
                    loop {
                        let i = next.fetch_add(1, Ordering::Relaxed);
                        if i >= job.count {
                            return Ok(());
                        }
                        job.make(i)?;
                        if (i + 1).is_multiple_of(200) {
                            eprintln!("{} of {}", i + 1, job.count);
                        }
                    }
                })
            })
            .collect();
        workers.into_iter().try_for_each(|w| w.join().map_err(|_| "a rendering thread panicked")?)
    })?;
    assemble(&job)?;
    eprintln!("{} pictures in {}", job.count, job.out.display());
    Ok(())
}
