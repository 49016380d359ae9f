//! The joint protocol: messages to frames and back.

use std::time::Duration;

use can_driver::{
    Angle, CandumpLine, Commit, Config, ControllerState, Counted, Direction, Frame, Id, Message, Mode, Protocol,
    Status, StopCause,
};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::array::{moved, moved2};
use crate::failure::Failure;

/// Identifier and payload.
type Wire = (u16, Vec<u8>);
/// Name of the message, its counter, and its fields by name; an angle that is not there is NaN.
type Decoded = (&'static str, u8, Vec<(&'static str, f64)>);

const STATES: [&str; 7] = ["unconfigured", "ready", "arming", "active", "coasting", "ramping", "latched"];

fn angle(radians: f64) -> Result<Angle, Failure> {
    // NaN stands for "no value", which the wire has a code for.
    if radians.is_nan() { Ok(Angle::NO_VALUE) } else { Ok(Angle::from_rad(radians)?) }
}

fn milliseconds(what: &'static str, value_s: f64) -> Result<Duration, Failure> {
    let millis = (value_s * 1e3).round();
    if (0.0..=255.0).contains(&millis) {
        Ok(Duration::from_millis(millis as u64))
    } else {
        Err(Failure::Argument { what, expected: "0 to 0.255 s".to_owned(), got: value_s.to_string() })
    }
}

fn slot(value: u8) -> Result<u8, Failure> {
    if value < 3 {
        Ok(value)
    } else {
        Err(Failure::Argument { what: "slot", expected: "0, 1 or 2".to_owned(), got: value.to_string() })
    }
}

fn cause(code: u8) -> Result<Option<StopCause>, Failure> {
    if code == 0 {
        return Ok(None);
    }
    StopCause::from_code(code).map(Some).ok_or_else(|| Failure::Argument {
        what: "cause",
        expected: "0 or the code of a cause".to_owned(),
        got: code.to_string(),
    })
}

fn direction(to_controller: bool) -> Direction {
    if to_controller { Direction::ToController } else { Direction::ToHost }
}

/// The codec of one robot.
#[pyclass(frozen, module = "ogg_rs._native")]
pub(crate) struct Codec {
    protocol: Protocol,
}

impl Codec {
    fn wire(&self, message: Message, counter: u8) -> Wire {
        let frame = self.protocol.encode(&Counted { message, counter });
        (frame.id().raw(), frame.data().to_vec())
    }
}

#[pymethods]
impl Codec {
    #[new]
    fn new(robot: u8) -> PyResult<Self> {
        Ok(Self { protocol: Protocol::new(robot).map_err(Failure::from)? })
    }

    fn set(&self, counter: u8, pair: u8, angles_rad: [f64; 2]) -> PyResult<Wire> {
        let [a, b] = angles_rad;
        Ok(self.wire(Message::Set { slot: slot(pair)?, angles: [angle(a)?, angle(b)?] }, counter))
    }

    fn feedback(&self, counter: u8, pair: u8, angles_rad: [f64; 2]) -> PyResult<Wire> {
        let [a, b] = angles_rad;
        Ok(self.wire(Message::Feedback { slot: slot(pair)?, angles: [angle(a)?, angle(b)?] }, counter))
    }

    #[expect(clippy::too_many_arguments, clippy::fn_params_excessive_bools, reason = "the fields of the message")]
    fn commit(
        &self,
        counter: u8,
        position: bool,
        enable: bool,
        quick_stop: bool,
        reset: bool,
        test: bool,
        speed_scale: f64,
        horizon_s: f64,
        host_time: u16,
    ) -> PyResult<Wire> {
        if !(0.0..=1.0).contains(&speed_scale) {
            let (what, expected) = ("speed_scale", "0 to 1".to_owned());
            return Err(Failure::Argument { what, expected, got: speed_scale.to_string() }.into());
        }
        let mode = if position { Mode::Position } else { Mode::Idle };
        let horizon = milliseconds("horizon_s", horizon_s)?;
        let commit = Commit { mode, enable, quick_stop, reset, test, speed_scale, horizon, host_time };
        Ok(self.wire(Message::Commit(commit), counter))
    }

    #[expect(clippy::too_many_arguments, clippy::fn_params_excessive_bools, reason = "the fields of the message")]
    fn status(
        &self,
        counter: u8,
        state: &str,
        powered: bool,
        at_rest: bool,
        limiting: bool,
        set_dropped: bool,
        cause_code: u8,
        echo: u8,
        echo_age_s: f64,
        tracking_error_rad: f64,
    ) -> PyResult<Wire> {
        let place = STATES.iter().position(|name| *name == state).ok_or_else(|| Failure::Argument {
            what: "state",
            expected: format!("one of {STATES:?}"),
            got: format!("{state:?}"),
        })?;
        if !(0.0..=0.255).contains(&tracking_error_rad) {
            let (what, expected) = ("tracking_error_rad", "0 to 0.255".to_owned());
            return Err(Failure::Argument { what, expected, got: tracking_error_rad.to_string() }.into());
        }
        let status = Status {
            state: ControllerState::ALL[place],
            powered,
            at_rest,
            limiting,
            set_dropped,
            cause: cause(cause_code)?,
            echo,
            echo_age: milliseconds("echo_age_s", echo_age_s)?,
            tracking_error_rad,
        };
        Ok(self.wire(Message::Status(status), counter))
    }

    fn stop(&self, counter: u8, to_controller: bool, inverted: bool, cause_code: u8, joint: u8) -> PyResult<Wire> {
        let message = Message::Stop { direction: direction(to_controller), inverted, cause: cause(cause_code)?, joint };
        Ok(self.wire(message, counter))
    }

    fn config(&self, counter: u8, reply: bool, key: u8, value: i32) -> Wire {
        let config = Config { key, value };
        self.wire(if reply { Message::ConfigReply(config) } else { Message::Config(config) }, counter)
    }

    fn heartbeat(&self, node_state: u8) -> Wire {
        self.wire(Message::Heartbeat { node_state }, 0)
    }

    /// The message of a frame; None for an identifier the protocol does not use.
    fn decode(&self, id: u16, data: Vec<u8>) -> PyResult<Option<Decoded>> {
        let known = Id::new(id).ok_or_else(|| Failure::Argument {
            what: "id",
            expected: "at most 0x7FF".to_owned(),
            got: format!("{id:#x}"),
        })?;
        let frame = Frame::new(known, &data).map_err(Failure::from)?;
        let decoded = self.protocol.decode(&frame).map_err(|_| Failure::CorruptFrame { id })?;
        Ok(decoded.map(|counted| {
            let (name, fields) = fields_of(&counted.message);
            (name, counted.counter, fields)
        }))
    }
}

fn fields_of(message: &Message) -> (&'static str, Vec<(&'static str, f64)>) {
    let flag = |value: bool| f64::from(u8::from(value));
    let code = |cause: &Option<StopCause>| cause.map_or(0.0, |cause| f64::from(cause.code()));
    let pair = |slot: &u8, angles: &[Angle; 2]| {
        let [a, b] = angles.map(|angle| angle.rad().unwrap_or(f64::NAN));
        vec![("slot", f64::from(*slot)), ("first_rad", a), ("second_rad", b)]
    };
    let config = |c: &Config| vec![("key", f64::from(c.key)), ("value", f64::from(c.value))];
    match message {
        Message::Stop { direction, inverted, cause, joint } => (
            "stop",
            vec![
                ("to_controller", flag(*direction == Direction::ToController)),
                ("inverted", flag(*inverted)),
                ("cause", code(cause)),
                ("joint", f64::from(*joint)),
            ],
        ),
        Message::Set { slot, angles } => ("set", pair(slot, angles)),
        Message::Feedback { slot, angles } => ("feedback", pair(slot, angles)),
        Message::Commit(c) => (
            "commit",
            vec![
                ("position", flag(c.mode == Mode::Position)),
                ("enable", flag(c.enable)),
                ("quick_stop", flag(c.quick_stop)),
                ("reset", flag(c.reset)),
                ("test", flag(c.test)),
                ("speed_scale", c.speed_scale),
                ("horizon_s", c.horizon.as_secs_f64()),
                ("host_time", f64::from(c.host_time)),
            ],
        ),
        Message::Status(s) => (
            "status",
            vec![
                ("state", f64::from(s.state.code())),
                ("powered", flag(s.powered)),
                ("at_rest", flag(s.at_rest)),
                ("limiting", flag(s.limiting)),
                ("set_dropped", flag(s.set_dropped)),
                ("cause", code(&s.cause)),
                ("echo", f64::from(s.echo)),
                ("echo_age_s", s.echo_age.as_secs_f64()),
                ("tracking_error_rad", s.tracking_error_rad),
            ],
        ),
        Message::Config(c) => ("config", config(c)),
        Message::ConfigReply(c) => ("config_reply", config(c)),
        Message::Heartbeat { node_state } => ("heartbeat", vec![("node_state", f64::from(*node_state))]),
    }
}

/// The DBC file of the protocol.
#[pyfunction]
pub(crate) fn dbc_text() -> &'static str {
    can_driver::DBC
}

/// The protocol's checksum.
#[pyfunction]
pub(crate) fn crc16(data_id: u16, data: Vec<u8>) -> u16 {
    can_driver::crc16(data_id, &data)
}

/// Code and text of every named cause of a stop.
#[pyfunction]
pub(crate) fn stop_causes() -> Vec<(u8, &'static str)> {
    StopCause::NAMED.iter().map(|(_, code, text)| (*code, *text)).collect()
}

/// Names of the controller's states, in the order of their codes.
#[pyfunction]
pub(crate) fn controller_states() -> [&'static str; 7] {
    STATES
}

/// Times in s `(n)`, interfaces, identifiers `(n)`, payloads padded with zeros `(n, 8)`, lengths `(n)`.
type Log<'py> = (
    Bound<'py, PyArray1<f64>>,
    Vec<String>,
    Bound<'py, PyArray1<u16>>,
    Bound<'py, PyArray2<u8>>,
    Bound<'py, PyArray1<u8>>,
);

/// Reads a candump log.
#[pyfunction]
pub(crate) fn read_candump<'py>(py: Python<'py>, text: &str) -> PyResult<Log<'py>> {
    let parsed = py.detach(|| {
        let lines = text.lines().enumerate().map(|(i, line)| CandumpLine::parse(line, i + 1));
        lines.filter_map(Result::transpose).collect::<Result<Vec<_>, _>>()
    });
    let lines = parsed.map_err(Failure::from)?;
    let mut payloads = Vec::with_capacity(8 * lines.len());
    for line in &lines {
        payloads.extend_from_slice(line.frame.data());
        payloads.resize(payloads.len().next_multiple_of(8), 0);
        if line.frame.data().is_empty() {
            payloads.extend_from_slice(&[0; 8]);
        }
    }
    Ok((
        moved(py, lines.iter().map(|l| l.time.as_secs_f64()).collect()),
        lines.iter().map(|l| l.interface.clone()).collect(),
        moved(py, lines.iter().map(|l| l.frame.id().raw()).collect()),
        moved2(py, payloads, [lines.len(), 8])?,
        moved(py, lines.iter().map(|l| l.frame.data().len() as u8).collect()),
    ))
}
