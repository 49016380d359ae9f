//! The codec against independent judges: bytes laid out by hand, the DBC file read bit by bit,
//! and every small pattern of flipped bits.

#![expect(clippy::unwrap_used, reason = "tests")]

use std::time::Duration;

use can_driver::{
    ANGLE_LSB_RAD, Angle, Commit, Config, ControllerState, Counted, DBC, Dbc, Direction, Frame, Id, Message, Mode,
    Protocol, Status, StopCause,
};

/// CRC-16, bit by bit, for the bytes laid out by hand.
fn crc(data_id: u16, bytes: &[u8]) -> u16 {
    data_id.to_be_bytes().iter().chain(bytes).fold(0xFFFF, |crc: u16, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |c, _| if c & 0x8000 == 0 { c << 1 } else { c << 1 ^ 0x3D65 })
    })
}

/// The low 48 bits given, with counter and checksum, as the document of the protocol has them.
fn by_hand(id: u16, data_id: u16, low40: u64, counter: u8) -> Frame {
    let mut bytes = (low40 | u64::from(counter) << 40).to_le_bytes();
    let sum = crc(data_id, &bytes[..6]);
    bytes[6..].copy_from_slice(&sum.to_be_bytes());
    Frame::full(Id::new(id).unwrap(), bytes)
}

fn one_of_each() -> Vec<Message> {
    let angles = [Angle::from_rad(1.25).unwrap(), Angle::from_rad(-3.5).unwrap()];
    let stop =
        |direction, inverted| Message::Stop { direction, inverted, cause: Some(StopCause::TrackingError), joint: 3 };
    let mut all = vec![
        stop(Direction::ToController, false),
        stop(Direction::ToController, true),
        stop(Direction::ToHost, false),
        stop(Direction::ToHost, true),
        Message::Commit(Commit {
            mode: Mode::Position,
            enable: true,
            quick_stop: false,
            reset: true,
            test: false,
            speed_scale: 0.75,
            horizon: Duration::from_millis(10),
            host_time: 54_321,
        }),
        Message::Status(Status {
            state: ControllerState::Coasting,
            powered: true,
            at_rest: false,
            limiting: true,
            set_dropped: false,
            cause: Some(StopCause::HostSilent),
            echo: 17,
            echo_age: Duration::from_millis(4),
            tracking_error_rad: 0.031,
        }),
        Message::Config(Config { key: 19, value: -1_234_567 }),
        Message::ConfigReply(Config { key: 19, value: 1_234_567 }),
    ];
    for slot in 0..3 {
        all.push(Message::Set { slot, angles });
        all.push(Message::Feedback { slot, angles });
    }
    all
}

#[test]
fn frames_equal_bytes_laid_out_by_hand() {
    let protocol = Protocol::new(5).unwrap();
    let code = |angle: Angle| u64::from(angle.code().cast_unsigned()) & 0xF_FFFF;
    let angles = [Angle::from_rad(1.25).unwrap(), Angle::from_rad(-3.5).unwrap()];
    for slot in 0..3_u8 {
        let low40 = code(angles[0]) | code(angles[1]) << 20;
        let set = protocol.encode(&Counted { message: Message::Set { slot, angles }, counter: 200 });
        assert_eq!(set, by_hand(0x100 + u16::from(slot), 0x1502 + u16::from(slot), low40, 200));
        let feedback = protocol.encode(&Counted { message: Message::Feedback { slot, angles }, counter: 201 });
        assert_eq!(feedback, by_hand(0x180 + u16::from(slot), 0x1582 + u16::from(slot), low40, 201));
    }
    let commit = one_of_each()[4];
    let low40 = 1 | 0b0101 << 4 | 150 << 8 | 10 << 16 | 54_321 << 24;
    assert_eq!(protocol.encode(&Counted { message: commit, counter: 9 }), by_hand(0x103, 0x1505, low40, 9));
    let status = one_of_each()[5];
    let low40 = 4 | 0b0101 << 4 | 2 << 8 | 17 << 16 | 4 << 24 | 31 << 32;
    assert_eq!(protocol.encode(&Counted { message: status, counter: 9 }), by_hand(0x183, 0x1585, low40, 9));
    let config = one_of_each()[6];
    let low40 = 0x13 | u64::from((-1_234_567_i32).cast_unsigned()) << 8;
    assert_eq!(protocol.encode(&Counted { message: config, counter: 9 }), by_hand(0x601, 0x1506, low40, 9));
}

#[test]
fn every_message_comes_back() {
    let protocol = Protocol::new(3).unwrap();
    for message in one_of_each() {
        for counter in [0, 1, 127, 255] {
            let counted = Counted { message, counter };
            assert_eq!(protocol.decode(&protocol.encode(&counted)), Ok(Some(counted)));
        }
    }
}

#[test]
fn all_codes_of_all_joints_come_back() {
    let protocol = Protocol::new(0).unwrap();
    for code in -524_288..=524_287 {
        let (angle, other) = (Angle::from_code(code).unwrap(), Angle::from_code(-1 - code).unwrap());
        if let Some(rad) = angle.rad() {
            assert_eq!(Angle::from_rad(rad).unwrap(), angle);
        } else {
            assert_eq!(code, -524_288);
        }
        for slot in 0..3 {
            for angles in [[angle, other], [other, angle]] {
                let set = Counted { message: Message::Set { slot, angles }, counter: code as u8 };
                assert_eq!(protocol.decode(&protocol.encode(&set)), Ok(Some(set)));
            }
        }
    }
}

/// Calls `visit` with every way of flipping 1 to `left` of the bits from `from` on.
fn flips(frame: Frame, from: u8, left: u8, visit: &mut impl FnMut(&Frame)) {
    for bit in from..64 {
        let flipped = frame.with_flipped_bit(bit);
        visit(&flipped);
        if left > 1 {
            flips(flipped, bit + 1, left - 1, visit);
        }
    }
}

#[test]
fn no_pattern_of_one_to_five_flipped_bits_is_accepted() {
    let protocol = Protocol::new(0).unwrap();
    for message in one_of_each() {
        let frame = protocol.encode(&Counted { message, counter: 0x5A });
        let (mut tried, mut accepted) = (0_u64, 0_u64);
        flips(frame, 0, 5, &mut |flipped| {
            tried += 1;
            accepted += u64::from(protocol.decode(flipped).is_ok());
        });
        assert_eq!((tried, accepted), (8_303_632, 0), "{message:?}");
    }
}

#[test]
fn a_frame_is_valid_for_one_robot_and_one_identifier_only() {
    for message in one_of_each() {
        let frame = Protocol::new(0).unwrap().encode(&Counted { message, counter: 1 });
        for robot in 0..16 {
            let protocol = Protocol::new(robot).unwrap();
            assert_eq!(protocol.decode(&frame).is_ok(), robot == 0);
            for id in Protocol::IDS {
                let moved = Frame::new(id, frame.data()).unwrap();
                let accepted = protocol.decode(&moved).is_ok();
                assert_eq!(accepted, robot == 0 && id == frame.id(), "{message:?} as {id} of robot {robot}");
            }
        }
    }
}

#[test]
fn the_dbc_file_reads_what_the_codec_writes() {
    let dbc = Dbc::parse(DBC).unwrap();
    let protocol = Protocol::new(0).unwrap();
    assert_eq!(dbc.messages.len(), Protocol::IDS.len());
    for message in one_of_each() {
        let frame = protocol.encode(&Counted { message, counter: 77 });
        let entry = dbc.message(frame.id().raw()).unwrap();
        let read = |name: &str| {
            entry.signals.iter().find(|s| s.name == name).unwrap_or_else(|| panic!("{name}")).physical(frame.data())
        };
        assert!((read("Counter") - 77.0).abs() < 1e-12);
        let expected: Vec<(String, f64)> = match message {
            Message::Stop { joint, cause, .. } => {
                vec![
                    ("Cause".into(), cause.unwrap().code().into()),
                    ("Joint".into(), joint.into()),
                    ("Zero".into(), 0.0),
                ]
            }
            Message::Set { slot, angles } | Message::Feedback { slot, angles } => {
                (0..2).map(|i| (format!("Joint{}", usize::from(slot) * 2 + i + 1), angles[i].rad().unwrap())).collect()
            }
            Message::Commit(c) => vec![
                ("Mode".into(), 1.0),
                ("Enable".into(), 1.0),
                ("QuickStop".into(), 0.0),
                ("Reset".into(), 1.0),
                ("Test".into(), 0.0),
                ("SpeedScale".into(), c.speed_scale),
                ("Horizon".into(), 0.010),
                ("HostTime".into(), 5.4321),
            ],
            Message::Status(s) => vec![
                ("State".into(), s.state.code().into()),
                ("Powered".into(), 1.0),
                ("AtRest".into(), 0.0),
                ("Limiting".into(), 1.0),
                ("SetDropped".into(), 0.0),
                ("Cause".into(), 2.0),
                ("Echo".into(), 17.0),
                ("EchoAge".into(), 0.004),
                ("TrackingError".into(), 0.031),
            ],
            Message::Config(c) | Message::ConfigReply(c) => {
                vec![("Key".into(), c.key.into()), ("Value".into(), c.value.into())]
            }
            Message::Heartbeat { .. } => vec![],
        };
        for (name, value) in &expected {
            assert!((read(name) - value).abs() < 1e-12, "{} {name}: {} {value}", entry.name, read(name));
        }
        // Nothing in the file goes unchecked: counter and checksum stand beside the rest.
        assert_eq!(entry.signals.len(), expected.len() + 2, "{}", entry.name);
    }
}

#[test]
fn the_dbc_files_scale_is_exact_and_its_names_are_the_codes() {
    let dbc = Dbc::parse(DBC).unwrap();
    for message in &dbc.messages {
        for signal in &message.signals {
            if signal.name.starts_with("Joint") && signal.unit == "rad" {
                assert_eq!(signal.factor.to_bits(), ANGLE_LSB_RAD.to_bits(), "{} {}", message.name, signal.name);
            }
            if signal.name == "Cause" && !message.name.ends_with("INVERTED") {
                let named: Vec<(i64, String)> = std::iter::once((0, "None".to_owned()))
                    .chain(StopCause::NAMED.iter().map(|(cause, code, _)| (i64::from(*code), format!("{cause:?}"))))
                    .collect();
                assert_eq!(signal.names, named, "{}", message.name);
            }
            if signal.name == "State" {
                let named: Vec<(i64, String)> =
                    ControllerState::ALL.iter().map(|s| (i64::from(s.code()), format!("{s:?}"))).collect();
                assert_eq!(signal.names, named);
            }
        }
    }
}

#[test]
fn every_cause_has_one_code() {
    for (cause, code, _) in StopCause::NAMED {
        assert_eq!(StopCause::from_code(*code), Some(*cause));
        assert_eq!(cause.code(), *code);
    }
    let mut codes: Vec<u8> = StopCause::NAMED.iter().map(|(_, code, _)| *code).collect();
    codes.sort_unstable();
    codes.dedup();
    assert_eq!(codes.len(), StopCause::NAMED.len());
    assert!(codes.iter().all(|c| (1..128).contains(c)));
}

#[test]
fn multiplexed_and_extended_messages_are_refused_by_name() {
    let dbc = |text: &str| Dbc::parse(text).unwrap_err().to_string();
    assert_eq!(dbc("BO_ 2147484000 X: 8 N"), "dbc line 1: extended identifier");
    assert_eq!(dbc("BO_ 1 X: 64 N"), "dbc line 1: message longer than 8 bytes");
    assert_eq!(dbc("BO_ 1 X: 8 N\n SG_ A M : 0|8@1+ (1,0) [0|1] \"\" N"), "dbc line 2: malformed signal");
    assert_eq!(
        dbc("BO_ 1 X: 1 N\n SG_ A : 4|8@1+ (1,0) [0|1] \"\" N"),
        "dbc line 2: signal reaches outside its message"
    );
}
