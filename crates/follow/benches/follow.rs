//! How far ahead the learned action looks, beside a Kalman filter and holding the last posture, and what a sample costs.
//! Prints one JSON document.
//!
//! The synthetic worker does each of the paper's three actions with the differences of a practised worker between
//! repetitions. Its joints are seen at 30 Hz with independent noise of 4 mm per coordinate. The first 9 s are the
//! lesson; on the 30 s that follow, the wrist is predicted from each sample and compared with where it then was.
#![expect(clippy::print_stdout, reason = "the JSON document is the product of this program")]
#![expect(clippy::disallowed_methods, reason = "a benchmark reads its clock")]

use std::error::Error;
use std::time::{Duration, Instant};

use follow::{
    ArmSample, Evidence, JointSample, LearnParams, MotionModel, PhaseParams, Prediction, Predictor, TeachParams, teach,
};
use nalgebra::{Matrix3, Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use sim::{Action, Keypoint, Script, Worker, WorkerParams};

const RATE_HZ: f64 = 30.0;
const NOISE_M: f64 = 0.004;
const LESSON_S: f64 = 9.0;
const LENGTH_S: f64 = 39.0;
const STEP: Duration = Duration::from_millis(20);
const HORIZON: Duration = Duration::from_millis(400);
const AHEAD_MS: [u32; 4] = [60, 100, 200, 400];
const SEEDS: u64 = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let mut rows = Vec::new();
    let mut times = Times::default();
    for action in Action::ALL {
        let mut errors = Errors::default();
        for seed in 1..=SEEDS {
            run(action, seed, &mut errors, &mut times)?;
        }
        errors.rows(action.name(), &mut rows);
    }
    rows.push(spread("teach and learn 9 s of samples", "ms", 1e3, &mut times.learn));
    rows.push(spread("sample to prediction of 400 ms", "us", 1e6, &mut times.observe));
    println!("{}", json!({ "area": "follow", "rows": rows }));
    Ok(())
}

/// Wrist errors in millimetres per look-ahead.
#[derive(Default)]
struct Errors {
    model: [Vec<f64>; AHEAD_MS.len()],
    kalman: [Vec<f64>; AHEAD_MS.len()],
    hold: [Vec<f64>; AHEAD_MS.len()],
}

#[derive(Default)]
struct Times {
    learn: Vec<f64>,
    observe: Vec<f64>,
}

fn run(action: Action, seed: u64, errors: &mut Errors, times: &mut Times) -> Result<(), Box<dyn Error>> {
    let worker = Worker::new(WorkerParams { seed, script: Script::Repeat(action), ..WorkerParams::default() })?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let samples: Vec<ArmSample> =
        (0..(LENGTH_S * RATE_HZ) as u32).map(|i| seen(&worker, f64::from(i) / RATE_HZ, &mut rng)).collect();
    let (lesson, rest) = samples.split_at((LESSON_S * RATE_HZ) as usize);
    let started = Instant::now();
    let (model, _) = MotionModel::learn(&teach(lesson, &TeachParams::default())?, &LearnParams::default())?;
    times.learn.push(started.elapsed().as_secs_f64());
    let mut with = Predictor::new(Some(model), PhaseParams::default(), HORIZON, STEP)?;
    let mut without = Predictor::new(None, PhaseParams::default(), HORIZON, STEP)?;
    for sample in rest {
        let started = Instant::now();
        let ours = with.observe(sample)?.ok_or("a complete sample")?;
        times.observe.push(started.elapsed().as_secs_f64());
        let theirs = without.observe(sample)?.ok_or("a complete sample")?;
        for (k, ahead) in AHEAD_MS.into_iter().enumerate() {
            let ahead = Duration::from_millis(u64::from(ahead));
            let truth = worker.pose_at(sample.captured + ahead).joint(Keypoint::RightWrist);
            errors.model[k].push(1e3 * (wrist(&ours, ahead) - truth).norm());
            errors.kalman[k].push(1e3 * (wrist(&theirs, ahead) - truth).norm());
            errors.hold[k].push(1e3 * (wrist(&ours, Duration::ZERO) - truth).norm());
        }
    }
    Ok(())
}

fn wrist(prediction: &Prediction, ahead: Duration) -> Point3<f64> {
    let posture = &prediction.ahead[(ahead.as_nanos() / STEP.as_nanos()) as usize].posture;
    Point3::new(posture[0], posture[1], posture[2])
}

/// The arm at `t` seconds, as a camera with noise sees it.
fn seen(worker: &Worker, t: f64, rng: &mut ChaCha8Rng) -> ArmSample {
    let captured = Duration::from_secs_f64(t);
    let pose = worker.pose_at(captured);
    let mut joint = |keypoint| {
        let noise = Vector3::from_fn(|_, _| NOISE_M * normal(rng));
        Some(JointSample {
            position_m: pose.joint(keypoint) + noise,
            covariance_m2: Matrix3::identity() * (NOISE_M * NOISE_M),
            evidence: Evidence::Measured,
        })
    };
    ArmSample {
        captured,
        shoulder: joint(Keypoint::RightShoulder),
        elbow: joint(Keypoint::RightElbow),
        wrist: joint(Keypoint::RightWrist),
    }
}

/// Standard normal number (Box and Muller 1958).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

impl Errors {
    fn rows(&mut self, action: &str, rows: &mut Vec<Value>) {
        for (k, ahead) in AHEAD_MS.into_iter().enumerate() {
            for (peer_name, theirs) in
                [("constant-velocity Kalman filter", &self.kalman[k]), ("last filtered posture held", &self.hold[k])]
            {
                let (ours, peer) = (rms(&self.model[k]), rms(theirs));
                let mut sorted = self.model[k].clone();
                sorted.sort_by(f64::total_cmp);
                rows.push(json!({
                    "name": format!("{action}: wrist {ahead} ms ahead, rms error"), "unit": "mm",
                    "ours": ours, "peer": peer, "peer_name": peer_name, "ratio": peer / ours,
                    "p50": quantile(&sorted, 0.5), "p99": quantile(&sorted, 0.99),
                    "min": quantile(&sorted, 0.0), "max": quantile(&sorted, 1.0), "n": sorted.len(),
                    "note": format!("{SEEDS} workers, {RATE_HZ} Hz, {:.0} mm noise per coordinate", 1e3 * NOISE_M),
                }));
            }
        }
    }
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

fn spread(name: &str, unit: &str, scale: f64, seconds: &mut [f64]) -> Value {
    seconds.sort_by(f64::total_cmp);
    let at = |share| scale * quantile(seconds, share);
    json!({
        "name": name, "unit": unit, "ours": at(0.5), "p50": at(0.5), "p99": at(0.99), "min": at(0.0), "max": at(1.0),
        "n": seconds.len(), "note": "one thread",
    })
}
