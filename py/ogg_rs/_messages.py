"""Messages of the joint protocol."""

from __future__ import annotations

from dataclasses import dataclass

from . import _native

STATES: tuple[str, ...] = tuple(_native.controller_states())
"""States of the controller; the place is the code on the wire."""


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


def message_of(name: str, f: dict[str, float]) -> Message:
    """The message of its name and fields, as the native codec tells them."""
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
