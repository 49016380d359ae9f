//! Messages to frames and back.
//!
//! Every frame but the heartbeat carries a counter and a CRC-16 over its data id and its first 48
//! bits. The data id (version, robot, direction, slot) is not sent: a frame of another robot,
//! another slot, the other direction or another version fails its checksum, even under the right
//! identifier. Encoding and decoding cost some tens of nanoseconds and never allocate.

use std::time::Duration;

use super::message::{Commit, Config, ControllerState, Counted, Direction, Message, Mode, Status};
use super::tables::{self as t, Signal};
use super::{Angle, StopCause, VERSION, crc16};
use crate::{Error, Frame, Id};

/// Encodes and decodes for one robot.
///
/// ```
/// use can_driver::{Angle, Counted, Message, Protocol};
/// let protocol = Protocol::new(0)?;
/// let message = Message::Set { slot: 1, angles: [Angle::from_rad(0.5)?, Angle::NO_VALUE] };
/// let frame = protocol.encode(&Counted { message, counter: 7 });
/// assert_eq!(frame.id().raw(), 0x101);
/// assert_eq!(protocol.decode(&frame), Ok(Some(Counted { message, counter: 7 })));
/// assert!(protocol.decode(&frame.with_flipped_bit(3)).is_err());
/// # Ok::<(), can_driver::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Protocol {
    robot: u8,
}

/// A frame under one of the protocol's identifiers that is not one of its messages: wrong length,
/// wrong checksum, or a field without meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corrupt;

/// One message's identifier, data id slot, counter and checksum.
struct Shape {
    id: u16,
    slot: u8,
    direction: Direction,
    counter: Signal,
    crc: Signal,
}

macro_rules! shape {
    ($name:ident, $counter:ident, $crc:ident, $slot:literal, $direction:ident) => {
        Shape { id: t::$name.id, slot: $slot, direction: Direction::$direction, counter: t::$counter, crc: t::$crc }
    };
}

const SHAPES: [Shape; 14] = [
    shape!(HOST_STOP, HOST_STOP_COUNTER, HOST_STOP_CRC, 0, ToController),
    shape!(HOST_STOP_INVERTED, HOST_STOP_INVERTED_COUNTER, HOST_STOP_INVERTED_CRC, 1, ToController),
    shape!(CTRL_STOP, CTRL_STOP_COUNTER, CTRL_STOP_CRC, 0, ToHost),
    shape!(CTRL_STOP_INVERTED, CTRL_STOP_INVERTED_COUNTER, CTRL_STOP_INVERTED_CRC, 1, ToHost),
    shape!(SET_12, SET_12_COUNTER, SET_12_CRC, 2, ToController),
    shape!(SET_34, SET_34_COUNTER, SET_34_CRC, 3, ToController),
    shape!(SET_56, SET_56_COUNTER, SET_56_CRC, 4, ToController),
    shape!(COMMIT, COMMIT_COUNTER, COMMIT_CRC, 5, ToController),
    shape!(FB_12, FB_12_COUNTER, FB_12_CRC, 2, ToHost),
    shape!(FB_34, FB_34_COUNTER, FB_34_CRC, 3, ToHost),
    shape!(FB_56, FB_56_COUNTER, FB_56_CRC, 4, ToHost),
    shape!(STATUS, STATUS_COUNTER, STATUS_CRC, 5, ToHost),
    shape!(CONFIG, CONFIG_COUNTER, CONFIG_CRC, 6, ToController),
    shape!(CONFIG_REPLY, CONFIG_REPLY_COUNTER, CONFIG_REPLY_CRC, 6, ToHost),
];

const SET_ANGLES: [[Signal; 2]; 3] =
    [[t::SET_12_JOINT1, t::SET_12_JOINT2], [t::SET_34_JOINT3, t::SET_34_JOINT4], [t::SET_56_JOINT5, t::SET_56_JOINT6]];
const FB_ANGLES: [[Signal; 2]; 3] =
    [[t::FB_12_JOINT1, t::FB_12_JOINT2], [t::FB_34_JOINT3, t::FB_34_JOINT4], [t::FB_56_JOINT5, t::FB_56_JOINT6]];

impl Protocol {
    /// The protocol of robot 0 to 15; the number is a part of every checksum.
    ///
    /// # Errors
    /// [`Error::InvalidParameter`] above 15.
    pub fn new(robot: u8) -> Result<Self, Error> {
        if robot < 16 {
            Ok(Self { robot })
        } else {
            Err(Error::InvalidParameter { field: "robot".to_owned(), allowed: "0 to 15", value: robot.into() })
        }
    }

    /// The identifiers that the protocol uses, for a filter.
    pub const IDS: [Id; 15] = {
        let mut ids = [Id::known(t::HEARTBEAT.id); 15];
        let mut i = 0;
        while i < SHAPES.len() {
            ids[i] = Id::known(SHAPES[i].id);
            i += 1;
        }
        ids
    };

    fn data_id(self, shape: &Shape) -> u16 {
        let direction = match shape.direction {
            Direction::ToController => 0,
            Direction::ToHost => 1,
        };
        u16::from(VERSION) << 12 | u16::from(self.robot) << 8 | direction << 7 | u16::from(shape.slot)
    }

    fn shape(id: u16) -> Option<&'static Shape> {
        SHAPES.iter().find(|shape| shape.id == id)
    }

    /// The frame of a message.
    ///
    /// # Panics
    /// If a slot is above 2: slots are counted by this crate alone.
    pub fn encode(self, counted: &Counted) -> Frame {
        let mut bytes = [0; 8];
        let mut inverted = false;
        let id = match counted.message {
            Message::Stop { direction, inverted: copy, cause, joint } => {
                inverted = copy;
                t::HOST_STOP_CAUSE.put(&mut bytes, cause.map_or(0, StopCause::code).into());
                t::HOST_STOP_JOINT.put(&mut bytes, joint.into());
                match (direction, copy) {
                    (Direction::ToController, false) => t::HOST_STOP.id,
                    (Direction::ToController, true) => t::HOST_STOP_INVERTED.id,
                    (Direction::ToHost, false) => t::CTRL_STOP.id,
                    (Direction::ToHost, true) => t::CTRL_STOP_INVERTED.id,
                }
            }
            Message::Set { slot, angles } => {
                put_angles(&mut bytes, &SET_ANGLES[usize::from(slot)], angles);
                [t::SET_12.id, t::SET_34.id, t::SET_56.id][usize::from(slot)]
            }
            Message::Feedback { slot, angles } => {
                put_angles(&mut bytes, &FB_ANGLES[usize::from(slot)], angles);
                [t::FB_12.id, t::FB_34.id, t::FB_56.id][usize::from(slot)]
            }
            Message::Commit(commit) => {
                put_commit(&mut bytes, &commit);
                t::COMMIT.id
            }
            Message::Status(status) => {
                put_status(&mut bytes, &status);
                t::STATUS.id
            }
            Message::Config(config) => {
                t::CONFIG_KEY.put(&mut bytes, config.key.into());
                t::CONFIG_VALUE.put(&mut bytes, config.value.into());
                t::CONFIG.id
            }
            Message::ConfigReply(config) => {
                t::CONFIG_REPLY_KEY.put(&mut bytes, config.key.into());
                t::CONFIG_REPLY_VALUE.put(&mut bytes, config.value.into());
                t::CONFIG_REPLY.id
            }
            Message::Heartbeat { node_state } => {
                let id = Id::known(t::HEARTBEAT.id);
                return Frame::new(id, &[node_state]).expect("one byte fits a frame");
            }
        };
        let shape = Self::shape(id).expect("every message with a checksum has a shape");
        shape.counter.put(&mut bytes, counted.counter.into());
        let crc = crc16(self.data_id(shape), &bytes[..6]);
        shape.crc.put(&mut bytes, crc.into());
        if inverted {
            bytes = bytes.map(|b| !b);
        }
        Frame::full(Id::known(id), bytes)
    }

    /// The message of a frame; `Ok(None)` for identifiers that the protocol does not use.
    ///
    /// # Errors
    /// [`Corrupt`].
    pub fn decode(self, frame: &Frame) -> Result<Option<Counted>, Corrupt> {
        let id = frame.id().raw();
        if id == t::HEARTBEAT.id {
            let [node_state] = *frame.data() else { return Err(Corrupt) };
            return Ok(Some(Counted { message: Message::Heartbeat { node_state }, counter: 0 }));
        }
        let Some(shape) = Self::shape(id) else { return Ok(None) };
        let mut bytes = frame.all_bytes().ok_or(Corrupt)?;
        let inverted = id == t::HOST_STOP_INVERTED.id || id == t::CTRL_STOP_INVERTED.id;
        if inverted {
            bytes = bytes.map(|b| !b);
        }
        if i64::from(crc16(self.data_id(shape), &bytes[..6])) != shape.crc.get(bytes) {
            return Err(Corrupt);
        }
        let counter = shape.counter.get(bytes) as u8;
        let slot = (id % 4) as u8;
        let message = if id == t::SET_12.id || id == t::SET_34.id || id == t::SET_56.id {
            Message::Set { slot, angles: get_angles(bytes, &SET_ANGLES[usize::from(slot)])? }
        } else if id == t::FB_12.id || id == t::FB_34.id || id == t::FB_56.id {
            Message::Feedback { slot, angles: get_angles(bytes, &FB_ANGLES[usize::from(slot)])? }
        } else if id == t::COMMIT.id {
            Message::Commit(get_commit(bytes)?)
        } else if id == t::STATUS.id {
            Message::Status(get_status(bytes)?)
        } else if id == t::CONFIG.id {
            Message::Config(Config { key: t::CONFIG_KEY.get(bytes) as u8, value: t::CONFIG_VALUE.get(bytes) as i32 })
        } else if id == t::CONFIG_REPLY.id {
            Message::ConfigReply(Config {
                key: t::CONFIG_REPLY_KEY.get(bytes) as u8,
                value: t::CONFIG_REPLY_VALUE.get(bytes) as i32,
            })
        } else {
            if t::HOST_STOP_ZERO.get(bytes) != 0 {
                return Err(Corrupt);
            }
            Message::Stop {
                direction: shape.direction,
                inverted,
                cause: get_cause(t::HOST_STOP_CAUSE.get(bytes))?,
                joint: t::HOST_STOP_JOINT.get(bytes) as u8,
            }
        };
        Ok(Some(Counted { message, counter }))
    }
}

fn put_angles(bytes: &mut [u8; 8], signals: &[Signal; 2], angles: [Angle; 2]) {
    for (signal, angle) in signals.iter().zip(angles) {
        signal.put(bytes, angle.code().into());
    }
}

fn get_angles(bytes: [u8; 8], signals: &[Signal; 2]) -> Result<[Angle; 2], Corrupt> {
    let angle = |signal: &Signal| Angle::from_code(signal.get(bytes) as i32).ok_or(Corrupt);
    Ok([angle(&signals[0])?, angle(&signals[1])?])
}

fn get_cause(code: i64) -> Result<Option<StopCause>, Corrupt> {
    if code == 0 {
        return Ok(None);
    }
    StopCause::from_code(code as u8).map(Some).ok_or(Corrupt)
}

fn put_commit(bytes: &mut [u8; 8], commit: &Commit) {
    let mode = match commit.mode {
        Mode::Idle => 0,
        Mode::Position => 1,
    };
    t::COMMIT_MODE.put(bytes, mode);
    t::COMMIT_ENABLE.put(bytes, commit.enable.into());
    t::COMMIT_QUICKSTOP.put(bytes, commit.quick_stop.into());
    t::COMMIT_RESET.put(bytes, commit.reset.into());
    t::COMMIT_TEST.put(bytes, commit.test.into());
    t::COMMIT_SPEEDSCALE.put_physical(bytes, commit.speed_scale.min(1.0));
    t::COMMIT_HORIZON.put_physical(bytes, commit.horizon.as_secs_f64());
    t::COMMIT_HOSTTIME.put(bytes, commit.host_time.into());
}

fn get_commit(bytes: [u8; 8]) -> Result<Commit, Corrupt> {
    let mode = match t::COMMIT_MODE.get(bytes) {
        0 => Mode::Idle,
        1 => Mode::Position,
        _ => return Err(Corrupt),
    };
    if t::COMMIT_SPEEDSCALE.get(bytes) > 200 {
        return Err(Corrupt); // above 1
    }
    Ok(Commit {
        mode,
        enable: t::COMMIT_ENABLE.get(bytes) == 1,
        quick_stop: t::COMMIT_QUICKSTOP.get(bytes) == 1,
        reset: t::COMMIT_RESET.get(bytes) == 1,
        test: t::COMMIT_TEST.get(bytes) == 1,
        speed_scale: t::COMMIT_SPEEDSCALE.physical(bytes),
        horizon: milliseconds(t::COMMIT_HORIZON.get(bytes)),
        host_time: t::COMMIT_HOSTTIME.get(bytes) as u16,
    })
}

fn put_status(bytes: &mut [u8; 8], status: &Status) {
    t::STATUS_STATE.put(bytes, status.state.code().into());
    t::STATUS_POWERED.put(bytes, status.powered.into());
    t::STATUS_ATREST.put(bytes, status.at_rest.into());
    t::STATUS_LIMITING.put(bytes, status.limiting.into());
    t::STATUS_SETDROPPED.put(bytes, status.set_dropped.into());
    t::STATUS_CAUSE.put(bytes, status.cause.map_or(0, StopCause::code).into());
    t::STATUS_ECHO.put(bytes, status.echo.into());
    t::STATUS_ECHOAGE.put(bytes, status.echo_age.as_millis().min(255) as i64);
    t::STATUS_TRACKINGERROR.put_physical(bytes, status.tracking_error_rad);
}

fn get_status(bytes: [u8; 8]) -> Result<Status, Corrupt> {
    let state = t::STATUS_STATE.get(bytes) as usize;
    Ok(Status {
        state: ControllerState::ALL.get(state).copied().ok_or(Corrupt)?,
        powered: t::STATUS_POWERED.get(bytes) == 1,
        at_rest: t::STATUS_ATREST.get(bytes) == 1,
        limiting: t::STATUS_LIMITING.get(bytes) == 1,
        set_dropped: t::STATUS_SETDROPPED.get(bytes) == 1,
        cause: get_cause(t::STATUS_CAUSE.get(bytes))?,
        echo: t::STATUS_ECHO.get(bytes) as u8,
        echo_age: milliseconds(t::STATUS_ECHOAGE.get(bytes)),
        tracking_error_rad: t::STATUS_TRACKINGERROR.physical(bytes),
    })
}

fn milliseconds(raw: i64) -> Duration {
    Duration::from_millis(raw.cast_unsigned())
}
