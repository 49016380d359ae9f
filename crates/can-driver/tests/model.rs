//! The bus in virtual time: bit times, arbitration, error counters, faults, and the load of the
//! protocol against the table of `docs/can.md`.

#![expect(clippy::unwrap_used, reason = "tests")]

mod common;

use std::fmt::Write as _;
use std::time::Duration;

use can_driver::{
    Bus, BusFault, Event, Faults, Frame, Id, SendOutcome, SimBus, SimBusParams, SimNode, Stuffing, frame_bits,
};
use proptest::prelude::*;

const US: Duration = Duration::from_micros(1);
const NOW: Duration = Duration::ZERO;

fn id(raw: u16) -> Id {
    Id::new(raw).unwrap()
}

fn send(node: &mut SimNode, now: Duration, frame: Frame) {
    assert_eq!(node.send(now, &frame).unwrap(), SendOutcome::Sent);
}

fn frames(node: &mut SimNode, now: Duration) -> Vec<(Duration, Frame)> {
    std::iter::from_fn(|| node.receive(now).unwrap())
        .filter_map(|event| match event {
            Event::Frame(s) => Some((s.at, s.frame)),
            Event::Fault(_) => None,
        })
        .collect()
}

fn faults(node: &mut SimNode, now: Duration) -> Vec<BusFault> {
    std::iter::from_fn(|| node.receive(now).unwrap())
        .filter_map(|event| match event {
            Event::Frame(_) => None,
            Event::Fault(f) => Some(f),
        })
        .collect()
}

/// The frame as text of bits, checksum by long division, stuffed by looking at the text.
fn bits_as_text(frame: &Frame) -> usize {
    let mut text = format!("0{:011b}000{:04b}", frame.id().raw(), frame.data().len());
    for byte in frame.data() {
        write!(text, "{byte:08b}").unwrap();
    }
    let mut rest: Vec<u8> = text.bytes().map(|b| b - b'0').chain([0; 15]).collect();
    let divisor: Vec<u8> = format!("{:016b}", 0xC599).bytes().map(|b| b - b'0').collect();
    for at in 0..text.len() {
        if rest[at] == 1 {
            rest[at..].iter_mut().zip(&divisor).for_each(|(r, d)| *r ^= d);
        }
    }
    text.extend(rest[text.len()..].iter().map(|b| (b + b'0') as char));
    let mut wire = String::new();
    for bit in text.chars() {
        wire.push(bit);
        if wire.ends_with("00000") {
            wire.push('1');
        } else if wire.ends_with("11111") {
            wire.push('0');
        }
    }
    wire.len() + 13
}

proptest! {
    #[test]
    fn frame_length_equals_the_stuffed_text(raw in 0_u16..0x800, data in prop::collection::vec(any::<u8>(), 0..=8)) {
        let frame = Frame::new(id(raw), &data).unwrap();
        let exact = frame_bits(&frame, Stuffing::Exact);
        prop_assert_eq!(exact as usize, bits_as_text(&frame));
        prop_assert!((frame_bits(&frame, Stuffing::None)..=frame_bits(&frame, Stuffing::Worst)).contains(&exact));
    }
}

#[test]
fn frame_lengths_are_those_of_the_standard() {
    for (len, plain, worst) in [(0, 47, 55), (1, 55, 65), (6, 95, 115), (8, 111, 135)] {
        let frame = Frame::new(id(0x555), &[0x55; 8][..len]).unwrap();
        assert_eq!((frame_bits(&frame, Stuffing::None), frame_bits(&frame, Stuffing::Worst)), (plain, worst));
    }
}

#[test]
fn the_lowest_identifier_wins_when_the_bus_falls_idle() {
    let bus = SimBus::new(SimBusParams::default()).unwrap();
    let (mut a, mut b, mut c) = (bus.node(4), bus.node(4), bus.node(4));
    let frame = |raw| Frame::full(id(raw), [0x55; 8]);
    send(&mut a, NOW, frame(0x300)); // takes the idle bus
    send(&mut a, 10 * US, frame(0x200));
    send(&mut b, 20 * US, frame(0x100));
    send(&mut b, 20 * US, frame(0x050)); // behind 0x100 in its node's queue
    let order: Vec<u16> = frames(&mut c, 1000 * US).iter().map(|(_, f)| f.id().raw()).collect();
    assert_eq!(order, [0x300, 0x100, 0x050, 0x200]);
}

#[test]
fn a_frame_arrives_after_its_bits() {
    let bus = SimBus::new(SimBusParams { bit_rate: 500_000, ..Default::default() }).unwrap();
    let (mut a, mut b) = (bus.node(4), bus.node(4));
    let frame = Frame::full(id(0x123), [0x55; 8]);
    send(&mut a, 100 * US, frame);
    let bits = frame_bits(&frame, Stuffing::Exact);
    assert_eq!(frames(&mut b, 1000 * US), [(100 * US + 2 * US * bits, frame)]);
}

#[test]
fn a_full_queue_refuses_and_forgets_nothing() {
    let bus = SimBus::new(SimBusParams::default()).unwrap();
    let (mut a, mut b) = (bus.node(4), bus.node(4));
    let frame = Frame::full(id(0x123), [0x55; 8]);
    bus.stall(NOW, 10_000 * US);
    let taken = (0..10).filter(|_| a.send(NOW, &frame).unwrap() == SendOutcome::Sent).count();
    assert_eq!(taken, 4);
    assert_eq!(frames(&mut b, 9_999 * US).len(), 0);
    assert_eq!(frames(&mut b, 20_000 * US).len(), 4);
}

#[test]
fn nobody_acknowledging_ends_in_error_passive_and_never_in_bus_off() {
    let bus = SimBus::new(SimBusParams::default()).unwrap();
    let (mut a, mut b) = (bus.node(4), bus.node(4));
    b.set_power(NOW, false);
    let frame = Frame::full(id(0x123), [0x55; 8]);
    send(&mut a, NOW, frame);
    let seen = faults(&mut a, Duration::from_secs(1));
    assert!(seen.contains(&BusFault::NoAcknowledge) && seen.contains(&BusFault::Passive), "{seen:?}");
    assert!(!seen.contains(&BusFault::Off));
    // The old frame leaves when the other side comes back: why the receiver has to check ages.
    b.set_power(Duration::from_secs(1), true);
    assert_eq!(frames(&mut b, Duration::from_secs(2)).len(), 1);
}

#[test]
fn a_disturbed_bus_ends_in_bus_off_until_restarted() {
    let faulty = Faults { wire_error: 1.0, ..Faults::default() };
    let bus = SimBus::new(SimBusParams { faults: faulty, ..Default::default() }).unwrap();
    let (mut a, mut b) = (bus.node(4), bus.node(4));
    let frame = Frame::full(id(0x123), [0x55; 8]);
    send(&mut a, NOW, frame);
    assert_eq!(faults(&mut a, 100_000 * US), [BusFault::Warning, BusFault::Passive, BusFault::Off]);
    assert_eq!(bus.load().errors, 32); // 256 / 8
    assert_eq!(a.send(100_000 * US, &frame).unwrap(), SendOutcome::Full);
    bus.set_faults(Faults::default());
    a.restart(200_000 * US);
    send(&mut a, 200_000 * US, frame);
    assert_eq!(frames(&mut b, 300_000 * US).len(), 1);
}

#[test]
fn faults_come_as_often_as_asked_and_from_the_seed() {
    let run = |seed| {
        let rates = Faults {
            loss: 0.1,
            duplicate: 0.2,
            corrupt: 0.3,
            delay: 0.4,
            delay_max: Duration::from_millis(3),
            wire_error: 0.05,
        };
        let bus = SimBus::new(SimBusParams { faults: rates, seed, ..Default::default() }).unwrap();
        let (mut a, mut b) = (bus.node(4), bus.node(4));
        let frame = Frame::full(id(0x123), [0x55; 8]);
        let mut got = Vec::new();
        for k in 0..20_000_u32 {
            let now = k * 1000 * US;
            send(&mut a, now, frame);
            got.extend(frames(&mut b, now));
        }
        (got, bus.load())
    };
    let (got, load) = run(7);
    assert_eq!((got.clone(), load), run(7));
    assert_ne!(got, run(8).0);
    // Deliveries: (1 - loss) (1 + duplicate) = 1.08; three standard deviations of 20,000 are 0.012.
    let share = got.len() as f64 / 20_000.0;
    assert!((share - 1.08).abs() < 0.012, "{share}");
    let corrupt = got.iter().filter(|(_, f)| f.data() != [0x55; 8]).count() as f64 / got.len() as f64;
    assert!((corrupt - 0.3).abs() < 0.012, "{corrupt}");
    let errors = load.errors as f64 / 20_000.0;
    assert!((errors - 0.05 / 0.95).abs() < 0.006, "{errors}");
}

/// Rows of the table: frames a cycle as (count, bytes), us a cycle in the worst case.
type Row = (&'static str, &'static [(u32, usize)], u32);

const ROWS: [Row; 5] = [
    ("one joint a frame", &[(12, 8), (1, 1)], 1685),
    ("two joints a frame", &[(8, 8)], 1080),
    ("two joints, host frames twice", &[(12, 8)], 1620),
    ("CiA 402 CSP", &[(12, 6), (1, 0)], 1435),
    ("CiA 402 CSP with counter and CRC", &[(12, 8), (1, 1)], 1685),
];

#[test]
fn measured_load_equals_the_table() {
    for (name, cycle, table_us) in ROWS {
        for rate_hz in [100_u32, 200, 500] {
            let bus = SimBus::new(SimBusParams { stuffing: Stuffing::Worst, ..Default::default() }).unwrap();
            let (mut a, mut b) = (bus.node(16), bus.node(16));
            let period = Duration::from_secs(1) / rate_hz;
            for k in 0..rate_hz {
                let now = period * k;
                for (count, bytes) in cycle {
                    for i in 0..*count {
                        send(&mut a, now, Frame::new(id(0x100 + i as u16), &[0x55; 8][..*bytes]).unwrap());
                    }
                }
                frames(&mut b, now);
            }
            bus.advance_to(Duration::from_secs(1));
            let measured = bus.load().busy.as_secs_f64();
            let table = f64::from(table_us) * f64::from(rate_hz) * 1e-6;
            assert!((measured / table - 1.0).abs() < 0.02, "{name} at {rate_hz} Hz: {measured} {table}");
        }
    }
}

/// Host and controller on the modelled bus: load, and cycles missed.
fn exchange(rate_hz: u32, stuffing: Stuffing) -> f64 {
    use can_driver::{Command, Controller, ControllerParams, Event, HostParams, HostSession, HostState, JointState};
    let cycle = Duration::from_secs(1) / rate_hz;
    let bus = SimBus::new(SimBusParams { stuffing, ..Default::default() }).unwrap();
    let (mut host_node, mut controller_node) = (bus.node(8), bus.node(12));
    let mut host = HostSession::new(HostParams::standard(0, vec![common::LIMITS; 6], cycle)).unwrap();
    let mut controller = Controller::new(ControllerParams::standard(0, vec![common::LIMITS; 6])).unwrap();
    let mut joints = vec![JointState { position_rad: 0.25, velocity_rad_s: 0.0 }; 6];
    let tick = Duration::from_micros(500);
    let mut rx: Vec<Event> = Vec::with_capacity(64);
    let mut now = Duration::ZERO;
    let mut measured_from = None;
    let mut wanted = [0.25; 6];
    let mut full = 0;
    let end = Duration::from_secs(6);
    while now < end {
        now += tick;
        if now.as_nanos().is_multiple_of(cycle.as_nanos()) {
            host_node.drain(now, &mut rx).unwrap();
            let out = host.tick(now, &rx, Command::Follow { position_rad: &wanted, speed_scale: 1.0 });
            let outcome = host_node.transmit(now, &out.tx).unwrap();
            host.sent(outcome);
            full += u32::from(outcome == SendOutcome::Full);
            if out.state == HostState::Active {
                if measured_from.is_none() {
                    measured_from = Some((now, bus.load().busy));
                    for (w, q) in wanted.iter_mut().zip(&out.commanded_rad) {
                        *w = *q;
                    }
                }
                let t = now.as_secs_f64();
                for w in &mut wanted {
                    *w += 0.4 * (3.0 * t).sin() * cycle.as_secs_f64();
                }
            }
        }
        controller_node.drain(now, &mut rx).unwrap();
        let out = controller.tick(now, &rx, &joints);
        assert_eq!(controller_node.transmit(now, &out.tx).unwrap(), SendOutcome::Sent);
        for (joint, s) in joints.iter_mut().zip(&out.setpoints) {
            *joint = JointState { position_rad: s.position_rad, velocity_rad_s: s.velocity_rad_s };
        }
    }
    let (from, busy) = measured_from.expect("becomes active");
    assert_eq!((full, host.link().status_lost), (0, 0));
    let load = bus.load().busy.saturating_sub(busy).as_secs_f64() / now.saturating_sub(from).as_secs_f64();
    let counts = controller.counts();
    assert_eq!((counts.lost, counts.incomplete, counts.stale), (0, 0, 0));
    load
}

#[test]
fn the_sessions_themselves_load_the_bus_as_the_table_says() {
    for (rate_hz, table) in [(100, 0.108), (200, 0.216), (500, 0.540)] {
        // Ten heartbeats of 65 bits a second come on top.
        let expected = table + 650e-6;
        let load = exchange(rate_hz, Stuffing::Worst);
        assert!((load / expected - 1.0).abs() < 0.02, "{rate_hz} Hz: {load} {expected}");
        // With the stuff bits that the frames really need: between no stuffing and the worst case.
        let exact = exchange(rate_hz, Stuffing::Exact);
        assert!(exact < load && exact > load * 111.0 / 135.0, "{rate_hz} Hz: {exact}");
    }
}
