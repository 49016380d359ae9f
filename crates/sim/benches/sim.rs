//! Time of a rendered picture and of a substep of the plant; prints one JSON document.

use std::time::{Duration, Instant};

use can_driver::{Controller, ControllerParams, Drive, JointLimits, Setpoint};
use serde_json::{Value, json};
use sim::{Arm, ArmParams, ControllerNode, Scene, SceneVariation, Worker, WorkerParams, default_camera};

fn row(name: &str, unit: &str, scale: f64, note: &str, mut times: Vec<Duration>) -> Value {
    times.sort();
    eprintln!("{name}: {} measured", times.len());
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize].as_secs_f64() * scale;
    json!({
        "name": name, "unit": unit, "ours": at(0.5), "peer": null, "peer_name": null, "ratio": null,
        "p50": at(0.5), "p99": at(0.99), "min": at(0.0), "max": at(1.0), "n": times.len(), "note": note,
    })
}

#[expect(clippy::disallowed_methods, reason = "a benchmark measures the clock")]
fn time(n: usize, mut work: impl FnMut(usize)) -> Vec<Duration> {
    (0..n)
        .map(|i| {
            let start = Instant::now();
            work(i);
            start.elapsed()
        })
        .collect()
}

#[expect(clippy::print_stdout, reason = "the document is the benchmark's output")]
fn main() -> Result<(), sim::Error> {
    let mut rows = Vec::new();
    for size in [[320, 240], [640, 480]] {
        let worker = Worker::new(WorkerParams::default())?;
        let mut scene = Scene::new(default_camera(size)?, worker.params());
        let (mut picture, _) = scene.render(&worker.pose_at(Duration::ZERO));
        let times = time(200, |i| {
            scene.render_into(&worker.pose_at(Duration::from_millis(33 * i as u64)), &mut picture);
        });
        let name = format!("render {}x{}", size[0], size[1]);
        rows.push(row(&name, "ms", 1e3, "one core, default look, with ground truth", times));
    }
    let times = time(40, |i| {
        let Ok(variation) = SceneVariation::random(i as u64, [320, 240]) else { return };
        let Ok(worker) = Worker::new(variation.worker.clone()) else { return };
        Scene::varied(&variation).render(&worker.pose_at(variation.at));
    });
    rows.push(row("training picture 320x240", "ms", 1e3, "new room, body, look and camera each time", times));
    let worker = Worker::new(WorkerParams::default())?;
    let times = time(5_000, |i| {
        std::hint::black_box(worker.pose_at(Duration::from_millis(i as u64)));
    });
    rows.push(row("worker pose", "us", 1e6, "all 18 joints", times));

    let home = [0.0, 0.6, -1.2, 0.3, 0.0, 0.0];
    let arm = || Arm::new(&kin::Robot::builtin(), ArmParams::new(home.to_vec()));
    let hold = home.map(|position_rad| Setpoint { position_rad, velocity_rad_s: 0.0 });
    let mut plant = arm()?;
    let times = time(4_000, |_| {
        let _ = std::hint::black_box(plant.step(Duration::from_millis(1), &hold, Drive::Servo));
    });
    rows.push(row("plant substep", "us", 1e6, "built-in arm, 1 ms", times));
    let limits = JointLimits { min_rad: -3.0, max_rad: 3.0, velocity_rad_s: 2.0, acceleration_rad_s2: 8.0 };
    if let Ok(controller) = Controller::new(ControllerParams::standard(0, vec![limits; 6])) {
        let mut node = ControllerNode::new(controller, arm()?)?;
        let mut tx = Vec::new();
        let times = time(4_000, |i| {
            tx.clear();
            let _ = std::hint::black_box(node.advance_to(Duration::from_millis(i as u64), &[], &mut tx));
        });
        rows.push(row("controller and plant tick", "us", 1e6, "no host on the bus", times));
    }
    println!("{}", json!({"area": "sim", "rows": rows}));
    Ok(())
}
