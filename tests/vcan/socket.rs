//! The socket itself.

use std::process::Command;
use std::time::{Duration, Instant};

use can_driver::{Bus as _, BusFault, Error, Event, FdFrame, Filter, Frame, Id, SendOutcome, SocketCan, SocketEvent};

use crate::{frame, interface, pause, prepared};

fn open(name: &str, filter: Filter<'_>) -> SocketCan {
    SocketCan::open(name, filter, 65_536).unwrap()
}

#[test]
fn frames_cross_intact_in_order_and_stamped() {
    let Some(name) = interface(0) else { return };
    let (mut a, mut b) = (open(&name, Filter::All), open(&name, Filter::All));
    let start = Instant::now();
    for k in 0..500_u16 {
        let bytes = k.to_le_bytes();
        assert_eq!(a.send(start.elapsed(), &frame(k, &bytes)).unwrap(), SendOutcome::Sent);
        if k % 50 == 49 {
            let sent = start.elapsed();
            pause(Duration::from_millis(20));
            for i in k - 49..=k {
                let now = start.elapsed();
                let Some(Event::Frame(got)) = b.receive(now).unwrap() else { panic!("frame {i} is missing") };
                assert_eq!(got.frame, frame(i, &i.to_le_bytes()));
                // Stamped when it arrived, and not when it was read 20 ms later.
                assert!(got.at <= sent + Duration::from_millis(10), "{:?} {sent:?} {now:?}", got.at);
            }
        }
    }
    assert_eq!(a.receive(start.elapsed()).unwrap(), None, "nobody hears himself");
    assert_eq!(b.counts().implausible_stamps, 0);
}

#[test]
fn many_frames_go_through_one_call_and_none_is_lost_where_the_room_ends() {
    let Some(name) = interface(0) else { return };
    let (mut a, mut b) = (open(&name, Filter::All), open(&name, Filter::All));
    let frames: Vec<Frame> = (0..70).map(|k: u16| frame(k, &k.to_be_bytes()[..usize::from(k % 3)])).collect();
    assert_eq!(a.transmit(Duration::ZERO, &frames).unwrap(), SendOutcome::Sent);
    assert_eq!(a.transmit(Duration::ZERO, &[]).unwrap(), SendOutcome::Sent);
    pause(Duration::from_millis(20));
    let mut got = Vec::new();
    let mut events = Vec::with_capacity(25);
    for expected in [25, 25, 20, 0] {
        b.drain(Duration::from_secs(1), &mut events).unwrap();
        assert_eq!((events.len(), events.capacity()), (expected, 25));
        got.extend(events.iter().map(|event| match event {
            Event::Frame(stamped) => stamped.frame,
            Event::Fault(fault) => panic!("{fault:?}"),
        }));
    }
    assert_eq!(got, frames);
    assert_eq!(b.counts().implausible_stamps, 0);
}

#[test]
fn conditions_of_one_error_frame_that_find_no_room_come_next_time() {
    let Some(name) = interface(0) else { return };
    let mut b = open(&name, Filter::All);
    let mut a = open(&name, Filter::All);
    // Bus-off, restarted and error-passive in one frame; a data frame after it.
    let cansend = prepared("VCAN_TOOLS").join("cansend");
    assert!(Command::new(cansend).args([name.as_str(), "20000144#0030000000000000"]).status().unwrap().success());
    let _ = a.send(Duration::ZERO, &frame(0x77, &[7])).unwrap();
    pause(Duration::from_millis(5));
    let mut events = Vec::with_capacity(2);
    let mut got = Vec::new();
    for _ in 0..4 {
        b.drain(Duration::from_secs(1), &mut events).unwrap();
        assert!(events.len() <= 2);
        got.extend(events.iter().copied());
    }
    assert!(matches!(got.pop(), Some(Event::Frame(stamped)) if stamped.frame == frame(0x77, &[7])));
    assert_eq!(got.len(), 3);
    for fault in [BusFault::Off, BusFault::Restarted, BusFault::Passive] {
        assert!(got.contains(&Event::Fault(fault)), "{fault:?} is not in {got:?}");
    }
}

#[test]
fn the_kernel_filters() {
    let Some(name) = interface(0) else { return };
    let mut a = open(&name, Filter::All);
    let mut b = open(&name, Filter::Only(&[Id::new(0x100).unwrap(), Id::new(0x7FF).unwrap()]));
    for id in 0..=0x7FF {
        assert_eq!(a.send(Duration::ZERO, &frame(id, &[])).unwrap(), SendOutcome::Sent);
    }
    pause(Duration::from_millis(20));
    let got: Vec<Event> = std::iter::from_fn(|| b.receive(Duration::from_secs(1)).unwrap()).collect();
    let ids: Vec<u16> = got
        .iter()
        .map(|e| match e {
            Event::Frame(s) => s.frame.id().raw(),
            Event::Fault(f) => panic!("{f:?}"),
        })
        .collect();
    assert_eq!(ids, [0x100, 0x7FF]);
}

#[test]
fn fd_frames_cross_beside_classic_ones() {
    let Some(name) = interface(0) else { return };
    let (mut a, mut b) = (open(&name, Filter::All), open(&name, Filter::All));
    let data: Vec<u8> = (0..64).collect();
    let id = Id::new(0x234).unwrap();
    for len in [0, 1, 8, 12, 16, 20, 24, 32, 48, 64] {
        let fd = FdFrame::new(id, &data[..len], len % 16 == 0).unwrap();
        assert_eq!(a.send_fd(&fd).unwrap(), SendOutcome::Sent);
        pause(Duration::from_millis(2));
        match b.receive_any(Duration::from_secs(1)).unwrap() {
            Some(SocketEvent::Fd { frame, .. }) => assert_eq!(frame, fd),
            other => panic!("{other:?}"),
        }
    }
    assert!(FdFrame::new(id, &data[..9], false).is_err());
    // Someone who wants classic frames only does not stumble over them.
    let _ = a.send_fd(&FdFrame::new(id, &data, true).unwrap()).unwrap();
    let _ = a.send(Duration::ZERO, &frame(0x10, &[1])).unwrap();
    pause(Duration::from_millis(2));
    assert!(
        matches!(b.receive(Duration::from_secs(1)).unwrap(), Some(Event::Frame(s)) if s.frame == frame(0x10, &[1]))
    );
    assert_eq!(b.counts().fd_ignored, 1);
}

#[test]
fn error_frames_are_decoded() {
    let Some(name) = interface(0) else { return };
    let mut b = open(&name, Filter::Only(&[]));
    // cansend writes error frames as identifiers with the error flag 0x20000000 and the class bits of linux/can/error.h.
    for (text, fault) in [
        ("20000040#0000000000000000", BusFault::Off),
        ("20000004#0030000000000000", BusFault::Passive),
        ("20000004#000C000000000000", BusFault::Warning),
        ("20000004#0001000000000000", BusFault::Overflow),
        ("20000100#0000000000000000", BusFault::Restarted),
        ("20000020#0000000000000000", BusFault::NoAcknowledge),
        ("20000001#0000000000000000", BusFault::TransmitTimeout),
    ] {
        let status = Command::new(prepared("VCAN_TOOLS").join("cansend")).args([name.as_str(), text]).status().unwrap();
        assert!(status.success(), "{text}");
        pause(Duration::from_millis(2));
        assert_eq!(b.receive(Duration::from_secs(1)).unwrap(), Some(Event::Fault(fault)), "{text}");
    }
}

#[test]
fn twenty_nine_bit_identifiers_and_remote_frames_are_passed_over() {
    let Some(name) = interface(0) else { return };
    let mut b = open(&name, Filter::All);
    for text in ["12345678#0102", "123#R4", "123#AB"] {
        let status = Command::new(prepared("VCAN_TOOLS").join("cansend")).args([name.as_str(), text]).status().unwrap();
        assert!(status.success(), "{text}");
    }
    pause(Duration::from_millis(5));
    assert!(
        matches!(b.receive(Duration::from_secs(1)).unwrap(), Some(Event::Frame(s)) if s.frame == frame(0x123, &[0xAB]))
    );
    assert_eq!(b.counts().unsupported, 2);
}

#[test]
fn an_interface_that_is_missing_or_down_is_an_error() {
    let Some(name) = interface(9) else { return };
    assert!(matches!(SocketCan::open("vcan77", Filter::All, 4096), Err(Error::Io { .. })));
    let Some(busybox) = std::env::var_os("VCAN_BUSYBOX") else { return };
    let mut a = open(&name, Filter::All);
    let link = |state| Command::new(&busybox).args(["ip", "link", "set", &name, state]).status().unwrap();
    assert!(link("down").success());
    assert!(matches!(a.send(Duration::ZERO, &frame(1, &[])), Err(Error::Down { .. })));
    assert!(link("up").success());
}

#[test]
fn a_burst_overflows_the_receiver_and_not_the_sender() {
    let Some(name) = interface(0) else { return };
    let mut a = open(&name, Filter::All);
    let mut b = open(&name, Filter::All);
    for k in 0..300_u16 {
        assert_eq!(a.send(Duration::ZERO, &frame(k, &[])).unwrap(), SendOutcome::Sent);
    }
    let got = std::iter::from_fn(|| b.receive(Duration::from_secs(1)).unwrap()).count();
    assert!((100..=300).contains(&got), "{got}");
}
