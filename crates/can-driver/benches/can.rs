//! Times of the codec, the sessions and the modelled bus, as one JSON document on standard output.
//!
//! Times on a real interface stand beside python-can in the vcan tests, because both have to run
//! on one kernel: `cargo xtask vcan-test round_trip`.

#![expect(clippy::print_stdout, clippy::disallowed_methods, reason = "a benchmark measures time and prints it")]

use std::hint::black_box;
use std::time::{Duration, Instant};

use can_driver::{
    Angle, Bus as _, Command, Controller, ControllerParams, Counted, Event, Frame, HostParams, HostSession, HostState,
    JointLimits, JointState, LocalBus, Message, Protocol,
};

const LIMITS: JointLimits = JointLimits { min_rad: -2.0, max_rad: 2.0, velocity_rad_s: 1.0, acceleration_rad_s2: 4.0 };

/// Sorted times in nanoseconds to a row.
fn row(name: &str, mut ns: Vec<f64>, note: &str) -> serde_json::Value {
    ns.sort_by(f64::total_cmp);
    let at = |share: f64| ns[((ns.len() - 1) as f64 * share) as usize];
    serde_json::json!({
        "name": name, "unit": "ns", "ours": at(0.5), "p50": at(0.5), "p99": at(0.99), "min": ns[0],
        "max": ns[ns.len() - 1], "n": ns.len(), "note": note,
    })
}

/// Times batches of `batch` calls, 2000 of them.
fn timed(batch: u32, mut work: impl FnMut()) -> Vec<f64> {
    (0..2000)
        .map(|_| {
            let begin = Instant::now();
            for _ in 0..batch {
                work();
            }
            begin.elapsed().as_secs_f64() * 1e9 / f64::from(batch)
        })
        .collect()
}

fn main() {
    let protocol = Protocol::new(0).expect("robot 0");
    let angles = [Angle::from_code(1000).expect("in range"), Angle::from_code(-1000).expect("in range")];
    let set = Counted { message: Message::Set { slot: 1, angles }, counter: 7 };
    let frame = protocol.encode(&set);
    let mut rows = vec![
        row("encode SET", timed(1000, || _ = black_box(protocol.encode(black_box(&set)))), "one frame"),
        row(
            "decode SET",
            timed(1000, || _ = black_box(protocol.decode(black_box(&frame)))),
            "one frame, checksum included",
        ),
    ];

    let bus = LocalBus::new(256);
    let (mut host_end, mut controller_end) = (bus.endpoint(), bus.endpoint());
    let cycle = Duration::from_millis(5);
    let mut host = HostSession::new(HostParams::standard(0, vec![LIMITS; 6], cycle)).expect("valid");
    let mut controller = Controller::new(ControllerParams::standard(0, vec![LIMITS; 6])).expect("valid");
    let mut joints = [JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; 6];
    let mut rx: Vec<Event> = Vec::with_capacity(64);
    let (mut host_ns, mut controller_ns) = (Vec::new(), Vec::new());
    let mut wanted = [0.25; 6];
    let mut active = 0_u32;
    for k in 1_u32.. {
        let now = Duration::from_millis(1) * k;
        if k % 5 == 0 {
            host_end.drain(now, &mut rx).expect("the bus inside the process does not fail");
            let begin = Instant::now();
            let out = host.tick(now, &rx, Command::Follow { position_rad: &wanted, speed_scale: 1.0 });
            let took = begin.elapsed();
            let _ = host_end.transmit(now, &out.tx).expect("the bus inside the process does not fail");
            if out.state == HostState::Active {
                host_ns.push(took.as_secs_f64() * 1e9);
                active += 1;
                for w in &mut wanted {
                    *w += 1e-3 * (f64::from(active) * 0.01).sin();
                }
            } else if let [q, ..] = out.commanded_rad[..] {
                wanted = [q; 6];
            }
        }
        controller_end.drain(now, &mut rx).expect("the bus inside the process does not fail");
        let begin = Instant::now();
        let out = controller.tick(now, &rx, &joints);
        let took = begin.elapsed();
        for frame in &out.tx {
            let _ = controller_end.send(now, frame).expect("the bus inside the process does not fail");
        }
        for (joint, s) in joints.iter_mut().zip(&out.setpoints) {
            *joint = JointState { position_rad: s.position_rad, velocity_rad_s: s.velocity_rad_s };
        }
        if active > 0 {
            controller_ns.push(took.as_secs_f64() * 1e9);
        }
        if active == 20_000 {
            break;
        }
    }
    rows.push(row("host tick", host_ns, "six joints, 5 ms cycle, reports taken and set made"));
    rows.push(row("controller tick", controller_ns, "six joints, 1 ms, every fifth with a set and reports"));

    let (mut a, mut b) = (bus.endpoint(), bus.endpoint());
    let frame: Frame = frame;
    let round = timed(100, || {
        let _ = a.send(Duration::ZERO, &frame).expect("the bus inside the process does not fail");
        while let Some(event) = b.receive(Duration::ZERO).expect("the bus inside the process does not fail") {
            let _ = black_box(event);
        }
    });
    rows.push(row("in-process bus", round, "send and receive of one frame among four endpoints"));
    println!("{}", serde_json::json!({"area": "can", "rows": rows}));
}
