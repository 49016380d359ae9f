"""Jerk-limited tracking of a moving target.

>>> from ogg_rs.motion import JointLimits, Tracker
>>> limit = JointLimits(lower_rad=-2.0, upper_rad=2.0, velocity_rad_s=2.0, acceleration_rad_s2=15.0, jerk_rad_s3=300.0)
>>> tracker = Tracker([limit], 0.01)
>>> motion = tracker.track([[0.5]] * 300)
>>> motion.position_rad.shape, round(float(motion.position_rad[-1, 0]), 6)
((300, 1), 0.5)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, rows, vector

__all__ = ["Command", "JointLimits", "Tracker"]


@dataclass(frozen=True, kw_only=True)
class JointLimits:
    """Limits of one joint; none has a default.

    Attributes:
        lower_rad: Lower end of the position range.
        upper_rad: Upper end of the position range.
        velocity_rad_s: Largest speed.
        acceleration_rad_s2: Largest acceleration.
        jerk_rad_s3: Largest jerk.
    """

    lower_rad: float
    upper_rad: float
    velocity_rad_s: float
    acceleration_rad_s2: float
    jerk_rad_s3: float


class Command(NamedTuple):
    """Position, velocity and acceleration of `n` joints, each `(n,)`, or `(m, n)` for `m` steps."""

    position_rad: FloatArray
    velocity_rad_s: FloatArray
    acceleration_rad_s2: FloatArray


class Tracker:
    """Follows targets without ever leaving the limits, at a fixed time step.

    Args:
        limits: One entry per joint, 1 to 64 joints.
        dt: Time step, s.
        start: Position at rest to begin at, `(n,)`; zeros by default.
        bandwidth_rad_s: A small error decays as `exp(-bandwidth t)`.
        coast_s: Age up to which a target is continued with its velocity.
        fade_s: Time over which the motion then slows down to rest.

    Raises:
        InvalidParameter: A limit or setting is outside its interval.
    """

    def __init__(
        self,
        limits: Sequence[JointLimits],
        dt: float,
        *,
        start: ArrayLike | None = None,
        bandwidth_rad_s: float = 40.0,
        coast_s: float = 0.15,
        fade_s: float = 0.2,
    ) -> None:
        self.limits = tuple(limits)
        self.dt = float(dt)
        table = np.array([astuple(limit) for limit in self.limits], dtype=np.float64).reshape(-1, 5)
        origin = np.zeros(len(table)) if start is None else vector("start", start, len(table))
        self._native = _native.Tracker(table, self.dt, origin.tolist(), bandwidth_rad_s, coast_s, fade_s)

    def __repr__(self) -> str:
        return f"Tracker({len(self.limits)} joints, dt={self.dt})"

    @property
    def is_at_rest(self) -> bool:
        """Whether every joint of the last command rests."""
        return self._native.is_at_rest

    @property
    def command(self) -> Command:
        """The last command."""
        return Command(*np.ascontiguousarray(self._native.command().T))

    def offer(self, position_rad: ArrayLike, velocity_rad_s: ArrayLike | None = None) -> None:
        """Takes over a target of this instant, each `(n,)`; the velocity is zero by default.

        Raises:
            InvalidParameter: A number is not finite, or two targets come in one time step.
        """
        position = vector("position_rad", position_rad, len(self.limits))
        given = np.zeros_like(position) if velocity_rad_s is None else velocity_rad_s
        self._native.offer(position.tolist(), vector("velocity_rad_s", given, len(self.limits)).tolist())

    def step(self) -> Command:
        """Moves on by `dt` and returns the new command."""
        return Command(*np.ascontiguousarray(self._native.step().T))

    def track(self, position_rad: ArrayLike, velocity_rad_s: ArrayLike | None = None) -> Command:
        """Takes one target and one step per row of `(m, n)`; returns the commands, each `(m, n)`."""
        positions = rows("position_rad", position_rad, len(self.limits))
        velocities = np.zeros_like(positions) if velocity_rad_s is None else rows("velocity_rad_s", velocity_rad_s)
        table = self._native.track(positions, velocities).reshape((len(positions), len(self.limits), 3))
        return Command(*(np.ascontiguousarray(table[:, :, i]) for i in range(3)))

    def stop(self) -> None:
        """Brakes to rest within the limits and stays there."""
        self._native.stop()
