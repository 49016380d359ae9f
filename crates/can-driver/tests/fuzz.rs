//! Arbitrary bytes against the frame decoder and both sessions.
//!
//! A byte string is a script: time passes, frames of any content arrive, valid frames with any
//! fields arrive, the application wants this or that, the operator resets. Every script of
//! `tests/corpus` is run, then mutations of them from a fixed seed. The corpus holds the scripts
//! that reached a new pair of states or a new cause.
//!
//! One minute each: `cargo test --release -p can-driver --test fuzz -- --ignored`

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use can_driver::{
    Angle, Command, Commit, Config, Controller, ControllerParams, Counted, Direction, Event, Frame, HostParams,
    HostSession, Id, JointState, Message, Mode, Protocol, StopCause,
};
use common::LIMITS;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Reads a script; beyond its end there are zeros.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn one(&mut self) -> u8 {
        match self.0 {
            [first, rest @ ..] => {
                self.0 = rest;
                *first
            }
            [] => 0,
        }
    }

    fn eight(&mut self) -> [u8; 8] {
        std::array::from_fn(|_| self.one())
    }
}

/// What a script has reached: states of both sides and the controller's cause.
type Seen = BTreeSet<(u8, u8, u8, u8)>;

/// A message with fields from the script, valid on the wire.
fn message(bytes: &mut Bytes<'_>) -> Counted {
    let kind = bytes.one();
    let raw = bytes.eight();
    let angle = |i: usize| {
        let steps = i32::from(i16::from_le_bytes([raw[i], raw[i + 1]]));
        // Mostly near where the arm is, now and then anywhere.
        let code = if raw[7] > 200 { steps * 16 } else { 20_860 + steps / 64 };
        Angle::from_code(code).unwrap_or(Angle::NO_VALUE)
    };
    let message = match kind % 8 {
        0..=2 => Message::Set { slot: kind % 8, angles: [angle(0), angle(2)] },
        3 => Message::Commit(Commit {
            mode: if raw[0] & 1 == 0 { Mode::Idle } else { Mode::Position },
            enable: raw[0] & 2 != 0,
            quick_stop: raw[0] & 0x0C == 0x0C,
            reset: raw[0] & 0x10 != 0,
            test: raw[0] & 0x60 == 0x60,
            speed_scale: f64::from(raw[1]) / 255.0,
            horizon: Duration::from_millis(raw[2].into()),
            host_time: u16::from_le_bytes([raw[3], raw[4]]),
        }),
        4 => Message::Config(Config { key: raw[0], value: i32::from_le_bytes([raw[1], raw[2], raw[3], raw[4]]) }),
        5 => Message::ConfigReply(Config { key: raw[0], value: i32::from_le_bytes([raw[1], raw[2], raw[3], raw[4]]) }),
        6 => Message::Stop {
            direction: if raw[0] & 1 == 0 { Direction::ToController } else { Direction::ToHost },
            inverted: raw[0] & 2 != 0,
            cause: StopCause::from_code(raw[1]),
            joint: raw[2],
        },
        _ => Message::Feedback { slot: raw[0] % 3, angles: [angle(1), angle(3)] },
    };
    Counted { message, counter: raw[5] }
}

/// Runs a script against two sessions that are connected to one another unless the script cuts the
/// wire; its frames reach both.
fn run(script: &[u8], seen: &mut Seen) {
    let protocol = Protocol::new(0).unwrap();
    let mut bytes = Bytes(script);
    let mut host = HostSession::new(HostParams::standard(0, vec![LIMITS; 6], common::CYCLE)).unwrap();
    let mut controller = Controller::new(ControllerParams::standard(0, vec![LIMITS; 6])).unwrap();
    let mut joints = vec![JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; 6];
    let (mut to_host, mut to_controller) = (Vec::new(), Vec::new());
    let mut now = Duration::from_millis(10);
    let mut wanted = vec![0.25; 6];
    let mut follow = true;
    let (mut connected, mut ticks) = (true, 0_u32);
    let mut host_seen = (0, 0);
    while !bytes.0.is_empty() && ticks < 4000 {
        let mut pass = 1_u32;
        match bytes.one() % 16 {
            0 => {
                let id = Id::new(u16::from_le_bytes([bytes.one(), bytes.one()]) & 0x7FF).unwrap();
                let data = bytes.eight();
                let frame = Frame::new(id, &data[..usize::from(bytes.one() % 9)]).unwrap();
                let _ = protocol.decode(&frame);
                to_host.push(Event::frame(now, frame));
                to_controller.push(Event::frame(now, frame));
                pass = 0;
            }
            1 | 2 => {
                let frame = protocol.encode(&message(&mut bytes));
                to_host.push(Event::frame(now, frame));
                to_controller.push(Event::frame(now, frame));
                pass = 0;
            }
            3 => connected = !connected,
            4 => {
                let _ = host.reset();
            }
            5 => follow = !follow,
            6 => {
                for w in &mut wanted {
                    *w += f64::from(bytes.one().cast_signed()) * 1e-4;
                }
            }
            7 => {
                let value = f64::from_le_bytes(bytes.eight());
                wanted[0] = if value.is_finite() && value.abs() > 10.0 { 0.25 } else { value };
            }
            8 => now += Duration::from_micros(u64::from(bytes.one()) * u64::from(bytes.one())),
            9 => {
                let i = usize::from(bytes.one() % 6);
                joints[i].position_rad = f64::from(bytes.one().cast_signed()) * 0.05;
            }
            10 => joints[0].velocity_rad_s = f64::from_le_bytes(bytes.eight()),
            _ => pass = u32::from(bytes.one()),
        }
        for _ in 0..pass {
            ticks += 1;
            now += common::TICK;
            if ticks.is_multiple_of(5) {
                let command =
                    if follow { Command::Follow { position_rad: &wanted, speed_scale: 1.0 } } else { Command::Standby };
                let out = host.tick(now, &to_host, command);
                to_host.clear();
                if connected {
                    to_controller.extend(out.tx.iter().map(|f| Event::frame(now, *f)));
                }
                host_seen = (out.state as u8, out.cause.map_or(0, StopCause::code));
                for q in &out.commanded_rad {
                    assert!(q.is_finite());
                }
            }
            let mut twin = controller.clone();
            let before: Vec<f64> = joints.iter().map(|j| j.position_rad).collect();
            let out = controller.tick(now, &to_controller, &joints);
            if ticks.is_multiple_of(64) {
                // The same input gives the same output: nothing hides in a clock or an address.
                assert_eq!(format!("{:?}", twin.tick(now, &to_controller, &joints)), format!("{out:?}"));
            }
            to_controller.clear();
            if connected {
                to_host.extend(out.tx.iter().map(|f| Event::frame(now, *f)));
            }
            assert!(to_host.len() < 4096 && to_controller.len() < 4096);
            for (i, (joint, s)) in joints.iter_mut().zip(&out.setpoints).enumerate() {
                if out.drive == can_driver::Drive::Servo {
                    assert!(s.velocity_rad_s.abs() <= LIMITS.velocity_rad_s + 1e-9, "{s:?}");
                    let inside = before[i] >= LIMITS.min_rad && before[i] <= LIMITS.max_rad;
                    let kept = s.position_rad >= LIMITS.min_rad - 1e-9 && s.position_rad <= LIMITS.max_rad + 1e-9;
                    assert!(kept || !inside, "{s:?} from {}", before[i]);
                }
                joint.position_rad = if joint.position_rad.is_finite() { s.position_rad } else { 0.25 };
                joint.velocity_rad_s = if s.velocity_rad_s.is_finite() { s.velocity_rad_s } else { 0.0 };
            }
            let cause = out.cause.map_or(0, StopCause::code);
            seen.insert((out.state.code(), host_seen.0, cause, host_seen.1));
        }
    }
}

/// Size of the kept corpus.
const MOST_SCRIPTS: usize = 64;

fn corpus_folder() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus"))
}

fn corpus() -> Vec<Vec<u8>> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(corpus_folder()).unwrap().map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// A script from an old one: bytes changed, pieces cut, repeated, or taken from another.
fn mutated(rng: &mut ChaCha8Rng, corpus: &[Vec<u8>]) -> Vec<u8> {
    let mut script = corpus.get(rng.random_range(0..corpus.len().max(1))).cloned().unwrap_or_default();
    for _ in 0..rng.random_range(1..8) {
        let at = rng.random_range(0..=script.len());
        match rng.random_range(0..5) {
            0 => script.insert(at, rng.random()),
            1 if at < script.len() => script[at] = rng.random(),
            2 if at < script.len() => {
                let end = (at + rng.random_range(1..20)).min(script.len());
                script.drain(at..end);
            }
            3 => {
                let other = &corpus[rng.random_range(0..corpus.len())];
                let from = rng.random_range(0..=other.len());
                let to = (from + rng.random_range(0..60)).min(other.len());
                script.splice(at..at, other[from..to].iter().copied());
            }
            _ => script.extend((0..rng.random_range(1..20)).map(|_| rng.random::<u8>())),
        }
    }
    script.truncate(600);
    script
}

#[test]
fn the_corpus_and_its_mutations_break_nothing() {
    let corpus = corpus();
    assert!(corpus.len() >= 20, "{}", corpus.len());
    let mut seen = Seen::new();
    for script in &corpus {
        run(script, &mut seen);
    }
    let from_corpus = seen.len();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..500 {
        run(&mutated(&mut rng, &corpus), &mut seen);
    }
    // The corpus leads into most corners: both sides have been in many states for many reasons.
    let causes: BTreeSet<u8> = seen.iter().flat_map(|s| [s.2, s.3]).collect();
    assert!(from_corpus >= 60 && causes.len() >= 15, "{from_corpus} {causes:?}");
}

#[test]
fn arbitrary_frames_never_panic_the_decoder_and_pass_as_often_as_the_checksum_lets_them() {
    let protocol = Protocol::new(0).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut passed = 0_u32;
    for _ in 0..4_000_000 {
        let id = Protocol::IDS[rng.random_range(0..8)]; // those with eight bytes
        let bytes: [u8; 8] = rng.random();
        passed += u32::from(protocol.decode(&Frame::full(id, bytes)).is_ok());
        let short = Frame::new(id, &bytes[..rng.random_range(0..8)]).unwrap();
        assert!(protocol.decode(&short).is_err());
    }
    // 4e6 / 65536 = 61, less what has fields without meaning; five standard deviations are 39.
    assert!((1..=100).contains(&passed), "{passed}");
}

#[test]
fn arbitrary_text_never_panics_the_readers_of_dbc_and_candump() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let dbc = can_driver::DBC.as_bytes();
    let line = b"(1436509052.249713) can0 123#DEADBEEF";
    for _ in 0..3000 {
        let mut text = dbc[..rng.random_range(0..dbc.len())].to_vec();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..=text.len());
            text.insert(at, rng.random());
        }
        let _ = can_driver::Dbc::parse(&String::from_utf8_lossy(&text));
        let mut text = line.to_vec();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..text.len());
            text[at] = rng.random();
        }
        let _ = can_driver::CandumpLine::parse(&String::from_utf8_lossy(&text), 1);
    }
}

#[expect(clippy::disallowed_methods, reason = "the time to spend is given in seconds")]
fn for_a_minute(mut once: impl FnMut(&mut ChaCha8Rng)) -> u64 {
    let begin = std::time::Instant::now();
    let mut rng = ChaCha8Rng::seed_from_u64(begin.elapsed().as_nanos() as u64 ^ u64::from(std::process::id()));
    let mut runs = 0;
    while begin.elapsed() < Duration::from_mins(1) {
        once(&mut rng);
        runs += 1;
    }
    runs
}

#[test]
#[ignore = "one minute: cargo test --release -p can-driver --test fuzz -- --ignored"]
fn sessions_for_a_minute() {
    let mut corpus = corpus();
    let mut seen = Seen::new();
    corpus.iter().for_each(|script| run(script, &mut seen));
    let known = corpus.len();
    let runs = for_a_minute(|rng| {
        let script = mutated(rng, &corpus);
        let before = seen.len();
        run(&script, &mut seen);
        if seen.len() > before {
            corpus.push(script);
        }
    });
    eprintln!(
        "{runs} scripts, {} of them reached something new, {} pairs of states and causes",
        corpus.len() - known,
        seen.len()
    );
}

#[test]
#[ignore = "one minute: cargo test --release -p can-driver --test fuzz -- --ignored"]
fn decoder_for_a_minute() {
    let protocol = Protocol::new(0).unwrap();
    let frames = for_a_minute(|rng| {
        for _ in 0..1000 {
            let id = Id::new(rng.random_range(0..0x800)).unwrap();
            let bytes: [u8; 8] = rng.random();
            let frame = Frame::new(id, &bytes[..rng.random_range(0..=8)]).unwrap();
            if let Ok(Some(counted)) = protocol.decode(&frame) {
                assert_eq!(protocol.encode(&counted), frame);
            }
        }
    });
    eprintln!("{frames} thousand frames");
}

/// Keeps scripts that reach something new, as few as possible.
#[test]
#[ignore = "writes the corpus: cargo test --release -p can-driver --test fuzz -- --ignored grow_the_corpus"]
fn grow_the_corpus() {
    let mut corpus = corpus();
    let mut seen = Seen::new();
    corpus.iter().for_each(|script| run(script, &mut seen));
    if corpus.is_empty() {
        corpus.push(vec![15; 40]);
    }
    for_a_minute(|rng| {
        let script = mutated(rng, &corpus);
        let before = seen.len();
        run(&script, &mut seen);
        if seen.len() > before {
            corpus.push(script);
        }
    });
    // The scripts that reach most, one after the other, until the rest adds little.
    let mut reached: Vec<(Seen, Vec<u8>)> = Vec::new();
    for script in corpus {
        let mut seen = Seen::new();
        run(&script, &mut seen);
        reached.push((seen, script));
    }
    for old in std::fs::read_dir(corpus_folder()).unwrap() {
        std::fs::remove_file(old.unwrap().path()).unwrap();
    }
    let mut kept = Seen::new();
    for number in 0..MOST_SCRIPTS {
        let gain = |(seen, _): &(Seen, Vec<u8>)| seen.difference(&kept).count();
        let Some(best) = (0..reached.len()).max_by_key(|i| gain(&reached[*i])) else { break };
        let (seen, script) = reached.swap_remove(best);
        kept.extend(seen);
        std::fs::write(corpus_folder().join(format!("script-{number:02}")), script).unwrap();
    }
}
