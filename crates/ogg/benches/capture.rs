//! Capture: how fast files become frames, and what the stages around a frame cost.
//!
//! Prints one JSON document. `OGG_BENCH_VIDEO` names further video files (separated like a PATH) to decode.

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ogg::capture::{ColourMatrix, ColourSpace};
use ogg::capture::{OpenOptions, Source, image_hash, mailbox, open, rgb_from_yuyv};
use ogg::record::{JointStream, JointValue, Recorder, RecorderOptions, RunInfo, Sample};
use serde_json::{Value, json};

/// Seconds spent on each row.
const BUDGET: Duration = Duration::from_secs(3);

fn main() {
    let clip = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/data/testsrc2-720p.mp4");
    let mut rows = vec![decode_row("decode 720p H.264", &clip)];
    if let Some(more) = std::env::var_os("OGG_BENCH_VIDEO") {
        for path in std::env::split_paths(&more) {
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            rows.push(decode_row(&format!("decode {name}"), &path));
        }
    }
    rows.push(hash_row(&clip));
    rows.push(yuyv_row());
    rows.push(mailbox_row());
    rows.push(recorder_row());
    let report = json!({ "area": "capture", "rows": rows });
    #[expect(clippy::print_stdout, reason = "the report is the output of a benchmark")]
    {
        println!("{report}");
    }
}

/// Frames that are timed together: enough to even out pictures of different cost.
const WINDOW: u32 = 10;

/// Time per frame, decoding and conversion to RGB included, over windows of a file that is read again and again.
fn decode_row(name: &str, path: &Path) -> Value {
    let started = Instant::now();
    let mut per_frame_ms = Vec::new();
    let mut size = (0, 0);
    while started.elapsed() < BUDGET || per_frame_ms.is_empty() {
        let mut source = open(path, &OpenOptions::default()).expect("the clip opens");
        let (mut window, mut frames) = (Instant::now(), 0);
        while let Some(frame) = source.next_frame().expect("the clip decodes") {
            size = frame.image.dimensions();
            black_box(&frame.image);
            frames += 1;
            if frames == WINDOW {
                per_frame_ms.push(window.elapsed().as_secs_f64() * 1e3 / f64::from(WINDOW));
                (window, frames) = (Instant::now(), 0);
                if started.elapsed() >= BUDGET {
                    break;
                }
            }
        }
    }
    row(name, "ms/frame", per_frame_ms, &format!("{} x {}, one thread, windows of {WINDOW} frames", size.0, size.1))
}

fn hash_row(clip: &Path) -> Value {
    let mut source = open(clip, &OpenOptions::default()).expect("the clip opens");
    let frame = source.next_frame().expect("the clip decodes").expect("the clip has a frame");
    let times = measure(|| {
        black_box(image_hash(black_box(&frame.image)));
    });
    row("hash 720p picture", "ms", times, "stuck-frame check")
}

fn yuyv_row() -> Value {
    let bytes: Vec<u8> = (0..1280 * 720 * 2).map(|at: u32| (at.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let colour = ColourSpace { matrix: ColourMatrix::Bt601, full_range: false };
    let times = measure(|| {
        black_box(rgb_from_yuyv(black_box(&bytes), 1280, 720, 2560, colour).expect("the buffer is whole"));
    });
    row("YUYV to RGB 720p", "ms", times, "camera conversion, allocation included")
}

fn mailbox_row() -> Value {
    let (publisher, latest) = mailbox();
    let times = measure(|| {
        for item in 0..1000_u32 {
            publisher.publish(item);
            black_box(latest.try_take());
        }
    });
    row("mailbox put and take", "us", times, "uncontended, per item; 1000 items a call")
}

/// What the control loop pays to record its six joints.
fn recorder_row() -> Value {
    let folder = std::env::temp_dir().join(format!("ogg-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a temporary folder");
    let recorder = Recorder::create(&folder.join("bench.mcap"), RecorderOptions::default(), &RunInfo::default())
        .expect("a recording starts");
    let sink = recorder.sink();
    let joints: Arc<[String]> = (1..=6).map(|joint| format!("joint{joint}")).collect();
    let mut times = Vec::new();
    let started = Instant::now();
    while started.elapsed() < BUDGET {
        let tick = Instant::now();
        let values = joints
            .iter()
            .map(|name| JointValue {
                name: name.clone(),
                position: Some(0.5),
                velocity: Some(0.1),
                ..JointValue::default()
            })
            .collect();
        sink.put(started.elapsed(), Sample::Joints(JointStream::Measured, values));
        times.push(tick.elapsed().as_secs_f64() * 1e6);
        std::thread::sleep(Duration::from_millis(2));
    }
    let status = recorder.finish().expect("the recording ends");
    std::fs::remove_dir_all(&folder).expect("the temporary folder goes");
    row("record six joints", "us", times, &format!("cost to the loop at 500 Hz; {} dropped", status.dropped_samples))
}

/// Repeats for the budget and gives milliseconds per call.
fn measure(mut work: impl FnMut()) -> Vec<f64> {
    let started = Instant::now();
    let mut times = Vec::new();
    while started.elapsed() < BUDGET {
        let call = Instant::now();
        work();
        times.push(call.elapsed().as_secs_f64() * 1e3);
    }
    times
}

fn row(name: &str, unit: &str, mut times: Vec<f64>, note: &str) -> Value {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
    json!({
        "name": name, "unit": unit, "ours": at(0.5), "p50": at(0.5), "p99": at(0.99),
        "min": at(0.0), "max": at(1.0), "n": times.len(), "note": note,
    })
}
