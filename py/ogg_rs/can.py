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
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._arrays import FloatArray, count
from ._messages import (
    STATES,
    Commit,
    Config,
    ConfigReply,
    Feedback,
    Heartbeat,
    Message,
    Set,
    Status,
    Stop,
    message_of,
)
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

ANGLE_LSB_RAD: float = 4.0 * float(np.pi) / 2**20
"""One step of an angle on the wire."""


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
        return Counted(message_of(name, dict(pairs)), counter)


def _frame(wire: tuple[int, list[int] | bytes]) -> Frame:
    return Frame(wire[0], bytes(wire[1]))


def _byte(what: str, value: int) -> int:
    number = count(what, value, 0)
    if number > 0xFF:
        raise InvalidParameter(f"{what}: expected at most 255, got {number}", "Domain")
    return number


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
