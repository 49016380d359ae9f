"""The joint protocol on CAN: messages to frames and back, its DBC file, and candump logs.

>>> from ogg_rs import can
>>> protocol = can.Protocol(robot=0)
>>> frame = protocol.encode(can.Set(slot=1, angles_rad=(0.5, float("nan"))), counter=7)
>>> f"{frame.id:03X}", len(frame.data)
('101', 8)
>>> protocol.decode(frame.id, frame.data).counter
7
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arrays import FloatArray, count
from .errors import DeviceError, InvalidParameter

__all__ = [
    "ANGLE_LSB_RAD",
    "CAUSES",
    "DBC_PATH",
    "STATES",
    "CandumpLog",
    "Commit",
    "Config",
    "ConfigReply",
    "Counted",
    "Feedback",
    "Frame",
    "Heartbeat",
    "Message",
    "Protocol",
    "Set",
    "Status",
    "Stop",
    "crc16",
    "read_candump",
]

DBC_PATH: Path = Path(__file__).parent / "ogg-joint.dbc"
"""The protocol's DBC file, for cantools, SavvyCAN and others."""

CAUSES: dict[int, str] = dict(_native.stop_causes())
"""Text of the named causes of a stop by code; 128 to 255 are the application's own."""

STATES: tuple[str, ...] = tuple(_native.controller_states())
"""States of the controller; the place is the code on the wire."""

ANGLE_LSB_RAD: float = 4.0 * float(np.pi) / 2**20
"""One step of an angle on the wire."""


@dataclass(frozen=True, kw_only=True)
class Set:
    """Two setpoints of a set. `slot` 0 to 2 is the pair of joints; NaN is "no value"."""

    slot: int
    angles_rad: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """Two measured angles. `slot` 0 to 2 is the pair of joints; NaN is "no value"."""

    slot: int
    angles_rad: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Commit:
    """End of a set of setpoints.

    Attributes:
        position: The set's angles are position setpoints; else nothing acts.
        enable: The host wants motion.
        quick_stop: Stop and latch.
        reset: A rising edge ends a latched stop.
        test: The set measures the link and never acts.
        speed_scale: Share of the velocity limits that may be used, 0 to 1 in steps of 0.005.
        horizon_s: How long the controller may go on, 0 to 0.255 s in steps of 1 ms.
        host_time: Clock of the host in 100 us, modulo 2^16.
    """

    position: bool = False
    enable: bool = False
    quick_stop: bool = False
    reset: bool = False
    test: bool = False
    speed_scale: float = 0.0
    horizon_s: float = 0.0
    host_time: int = 0


@dataclass(frozen=True, kw_only=True)
class Status:
    """End of a set of measured angles.

    Attributes:
        state: One of `STATES`.
        powered: The drives are powered and the brakes open.
        at_rest: Nothing moves.
        limiting: The controller's own limits shape the motion.
        set_dropped: A set was refused since the last status.
        cause: Why it is stopped, see `CAUSES`; 0 for no cause.
        echo: Counter of the last accepted set.
        echo_age_s: Time since it arrived, 0 to 0.255 s in steps of 1 ms.
        tracking_error_rad: Largest distance of setpoint and angle, 0 to 0.255 rad in steps of 1 mrad.
    """

    state: str = "unconfigured"
    powered: bool = False
    at_rest: bool = False
    limiting: bool = False
    set_dropped: bool = False
    cause: int = 0
    echo: int = 0
    echo_age_s: float = 0.0
    tracking_error_rad: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Stop:
    """Stop and latch. Sent twice, the second time with all bits inverted.

    Attributes:
        to_controller: Whether the host sends it.
        inverted: Whether this is the inverted copy.
        cause: See `CAUSES`; 0 for no cause.
        joint: The joint concerned, from 1; 0 if it is not about one.
    """

    to_controller: bool = True
    inverted: bool = False
    cause: int = 0
    joint: int = 0


@dataclass(frozen=True, kw_only=True)
class Config:
    """The host writes a parameter."""

    key: int
    value: int


@dataclass(frozen=True, kw_only=True)
class ConfigReply:
    """The controller says what it stores."""

    key: int
    value: int


@dataclass(frozen=True, kw_only=True)
class Heartbeat:
    """Sign of life: 0 boot-up, 4 stopped, 5 operational, 127 pre-operational."""

    node_state: int


Message = Set | Feedback | Commit | Status | Stop | Config | ConfigReply | Heartbeat


class Frame(NamedTuple):
    """A classic CAN data frame: an 11-bit identifier and 0 to 8 bytes."""

    id: int
    data: bytes


class Counted(NamedTuple):
    """A message and the sequence counter it travels under; that of a heartbeat is 0."""

    message: Message
    counter: int


class Protocol:
    """Encodes and decodes for one robot, 0 to 15; the number is a part of every checksum.

    Raises:
        InvalidParameter: Above 15.
    """

    __slots__ = ("_native", "robot")

    def __init__(self, robot: int = 0) -> None:
        self.robot = _byte("robot", robot)
        self._native = _native.Codec(self.robot)

    def __repr__(self) -> str:
        return f"Protocol(robot={self.robot})"

    def encode(self, message: Message, counter: int = 0) -> Frame:
        """The frame of a message.

        Raises:
            InvalidParameter: A field is outside what the wire carries.
        """
        wire, n = self._native, _byte("counter", counter)
        match message:
            case Set() | Feedback():
                if len(message.angles_rad) != 2:
                    raise InvalidParameter(f"angles_rad: expected two, got {message.angles_rad!r}", "Shape")
                a, b = (float(angle) for angle in message.angles_rad)
                put = wire.set if isinstance(message, Set) else wire.feedback
                return _frame(put(n, _byte("slot", message.slot), [a, b]))
            case Commit():
                time = count("host_time", message.host_time, 0)
                if time > 0xFFFF:
                    raise InvalidParameter(f"host_time: expected at most 65535, got {time}", "Domain")
                return _frame(
                    wire.commit(
                        n,
                        bool(message.position),
                        bool(message.enable),
                        bool(message.quick_stop),
                        bool(message.reset),
                        bool(message.test),
                        float(message.speed_scale),
                        float(message.horizon_s),
                        time,
                    )
                )
            case Status():
                return _frame(
                    wire.status(
                        n,
                        message.state,
                        bool(message.powered),
                        bool(message.at_rest),
                        bool(message.limiting),
                        bool(message.set_dropped),
                        _byte("cause", message.cause),
                        _byte("echo", message.echo),
                        float(message.echo_age_s),
                        float(message.tracking_error_rad),
                    )
                )
            case Stop():
                cause, joint = _byte("cause", message.cause), _byte("joint", message.joint)
                return _frame(wire.stop(n, bool(message.to_controller), bool(message.inverted), cause, joint))
            case Config() | ConfigReply():
                key, value = _byte("key", message.key), message.value
                if isinstance(value, bool) or not isinstance(value, int | np.integer) or not -(2**31) <= value < 2**31:
                    raise InvalidParameter(f"value: expected a whole number of 32 bits, got {value!r}", "Domain")
                return _frame(wire.config(n, isinstance(message, ConfigReply), key, int(value)))
            case Heartbeat():
                return _frame(wire.heartbeat(_byte("node_state", message.node_state)))
        raise InvalidParameter(f"message: expected a message of the protocol, got {message!r}", "Type")

    def decode(self, id: int, data: bytes) -> Counted | None:
        """The message of a frame; None for an identifier that the protocol does not use.

        Raises:
            InvalidParameter: The identifier or the payload is no classic frame, or, with the kind `CorruptFrame`, the
                length, the checksum or a field is wrong.
        """
        number = count("id", id, 0)
        if number > 0x7FF:
            raise InvalidParameter(f"id: expected at most 0x7FF, got {number:#x}", "Domain")
        found = self._native.decode(number, list(bytes(data)))
        if found is None:
            return None
        name, counter, pairs = found
        return Counted(_message(name, dict(pairs)), counter)


def _frame(wire: tuple[int, list[int] | bytes]) -> Frame:
    return Frame(wire[0], bytes(wire[1]))


def _byte(what: str, value: int) -> int:
    number = count(what, value, 0)
    if number > 0xFF:
        raise InvalidParameter(f"{what}: expected at most 255, got {number}", "Domain")
    return number


def _message(name: str, f: dict[str, float]) -> Message:
    if name in ("set", "feedback"):
        kind = Set if name == "set" else Feedback
        return kind(slot=int(f["slot"]), angles_rad=(f["first_rad"], f["second_rad"]))
    if name == "commit":
        return Commit(
            position=bool(f["position"]),
            enable=bool(f["enable"]),
            quick_stop=bool(f["quick_stop"]),
            reset=bool(f["reset"]),
            test=bool(f["test"]),
            speed_scale=f["speed_scale"],
            horizon_s=f["horizon_s"],
            host_time=int(f["host_time"]),
        )
    if name == "status":
        return Status(
            state=STATES[int(f["state"])],
            powered=bool(f["powered"]),
            at_rest=bool(f["at_rest"]),
            limiting=bool(f["limiting"]),
            set_dropped=bool(f["set_dropped"]),
            cause=int(f["cause"]),
            echo=int(f["echo"]),
            echo_age_s=f["echo_age_s"],
            tracking_error_rad=f["tracking_error_rad"],
        )
    if name == "stop":
        return Stop(
            to_controller=bool(f["to_controller"]),
            inverted=bool(f["inverted"]),
            cause=int(f["cause"]),
            joint=int(f["joint"]),
        )
    if name == "heartbeat":
        return Heartbeat(node_state=int(f["node_state"]))
    answer = Config if name == "config" else ConfigReply
    return answer(key=int(f["key"]), value=int(f["value"]))


def crc16(data_id: int, data: bytes) -> int:
    """The protocol's checksum over a data id and bytes.

    >>> hex(crc16(0x3132, b"3456789"))  # the usual check input, its first two characters being the data id
    '0xbbb6'
    """
    number = count("data_id", data_id, 0)
    if number > 0xFFFF:
        raise InvalidParameter(f"data_id: expected at most 65535, got {number}", "Domain")
    return _native.crc16(number, list(bytes(data)))


class CandumpLog(NamedTuple):
    """Frames of a log.

    Attributes:
        time_s: Time stamps, `(n,)`.
        interface: Interface of each frame.
        id: Identifiers, `(n,)` uint16.
        data: Payloads padded with zeros, `(n, 8)` uint8.
        length: Bytes of each payload, `(n,)` uint8.
    """

    time_s: FloatArray
    interface: list[str]
    id: NDArray[np.uint16]
    data: NDArray[np.uint8]
    length: NDArray[np.uint8]


def read_candump(path: str | os.PathLike[str]) -> CandumpLog:
    """Reads a log of `candump -l` or `ogg can log`. 29-bit, remote, error and FD frames are left out.

    Raises:
        DeviceError: The file cannot be read.
        InvalidParameter: A line is no line of such a log.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise DeviceError(f"{os.fspath(path)}: {error.strerror}", "File", str(error)) from error
    except UnicodeDecodeError as error:
        raise InvalidParameter(f"{os.fspath(path)}: expected text: {error}", "Candump") from error
    return CandumpLog(*_native.read_candump(text))
