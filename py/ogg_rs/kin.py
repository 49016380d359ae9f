"""Kinematics of a robot arm read from a URDF, over whole arrays of joint vectors.

>>> import numpy as np
>>> from ogg_rs import kin
>>> robot = kin.Robot.builtin()
>>> robot.joint_names[0], robot.fk(np.zeros((5, 2, 6))).shape, robot.jacobian(np.zeros(6)).shape
('joint1', (5, 2, 4, 4), (6, 6))
"""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arrays import FloatArray, batch, vector
from .errors import InvalidParameter

__all__ = ["IkResult", "Robot"]


class IkResult(NamedTuple):
    """What inverse kinematics found.

    Attributes:
        q: Joint values within the limits, `(..., n)`: the answer, or as near to the target as the limits allow.
        reached: Whether the target is reached within 1e-6 m and 1e-6 rad, `(...)`.
        position_error_m: Distance of the tip from the target, `(...)`.
        rotation_error_rad: Angle between the tip and the target, `(...)`.
    """

    q: FloatArray
    reached: NDArray[np.bool_]
    position_error_m: FloatArray
    rotation_error_rad: FloatArray


class Robot:
    """A robot and the chain of joints between two of its links; made by `from_urdf` or `builtin`."""

    __slots__ = ("_native", "_size")

    def __init__(self, native: _native.Robot) -> None:
        self._native = native
        self._size = len(native.joint_names)

    @classmethod
    def from_urdf(cls, path: str | os.PathLike[str], base: str | None = None, tip: str | None = None) -> Robot:
        """Reads a URDF file.

        Args:
            path: The file. Meshes it names need not exist.
            base: Link that poses are given in; by default the root link.
            tip: Link whose pose is asked for; by default the one link that carries no other.

        Raises:
            DeviceError: The file cannot be read.
            InvalidParameter: It is not a URDF of one tree with limits for every moving joint, or lacks a link.
        """
        return cls(_native.Robot.from_urdf(os.fspath(path), base, tip))

    @classmethod
    def builtin(cls) -> Robot:
        """The project's own six-joint arm with 850 mm reach, from `base_link` to `tool0`."""
        return cls(_native.Robot.builtin())

    @property
    def name(self) -> str:
        """Name in the URDF."""
        return self._native.name

    @property
    def base(self) -> str:
        """Base link."""
        return self._native.base

    @property
    def tip(self) -> str:
        """Tip link."""
        return self._native.tip

    @property
    def joint_names(self) -> list[str]:
        """Names of the `n` joints, in the order of a joint vector."""
        return self._native.joint_names

    @property
    def position_limits(self) -> FloatArray:
        """Smallest and largest joint values (rad or m), `(n, 2)`; infinite for a continuous joint."""
        return self._native.position_limits

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, {self.base!r} -> {self.tip!r}, {len(self.joint_names)} joints)"

    def fk(self, q: ArrayLike) -> FloatArray:
        """Poses of the tip in the base as homogeneous matrices, `(..., n)` to `(..., 4, 4)`; metres."""
        poses = self._native.fk_if_ready(q)
        if poses is not None:
            return poses
        joints, shape = batch("q", q, (self._size,))
        return self._native.fk(joints).reshape((*shape, 4, 4))

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """Velocity of the tip (linear, then angular, axes of the base) by joint speed, `(..., n)` to `(..., 6, n)`."""
        rows = self._native.jacobian_if_ready(q)
        if rows is not None:
            return rows
        n = self._size
        joints, shape = batch("q", q, (n,))
        return self._native.jacobian(joints).reshape((*shape, 6, n))

    def ik(self, target: ArrayLike, seed: ArrayLike | None = None) -> IkResult:
        """Joint values that bring the tip to `target: (..., 4, 4)`. The interpreter is released meanwhile.

        Args:
            target: Poses of the tip in the base.
            seed: Joint values to begin at, `(n,)` or `(..., n)`; by default zero, brought within the limits.

        Raises:
            InvalidParameter: A target is no pose, or a shape does not fit.
        """
        poses, shape = batch("target", target, (4, 4))
        limits = self.position_limits
        if seed is None:
            seed = np.clip(np.zeros(len(limits)), limits[:, 0], limits[:, 1])
        seeds, lead = batch("seed", seed, (len(limits),))
        if lead != shape:
            seeds = np.ascontiguousarray(_broadcast("seed", seeds.reshape((*lead, -1)), (*shape, len(limits))))
        q, reached, position, rotation = self._native.ik(poses, seeds.reshape((len(poses), len(limits))))
        return IkResult(
            q.reshape((*shape, len(limits))), reached.reshape(shape), position.reshape(shape), rotation.reshape(shape)
        )

    def mass_matrix(self, q: ArrayLike) -> FloatArray:
        """Mass matrix, `(..., n)` to `(..., n, n)`: kg m^2 between joints that turn, kg between joints that slide.

        Joints of the robot that are not in the chain stand at zero, or at the limit next to it.
        """
        n = self._size
        joints, shape = batch("q", q, (n,))
        return self._native.mass_matrix(joints).reshape((*shape, n, n))

    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        qdd: ArrayLike | None = None,
        *,
        gravity_m_s2: ArrayLike = (0.0, 0.0, -9.81),
    ) -> FloatArray:
        """Torque (N m) or force (N) of each joint for a motion, `(..., n)`. Friction and damping are not part of it.

        Joints of the robot that are not in the chain rest at zero, or at the limit next to it.

        Args:
            q: Joint values, `(..., n)`.
            qd: Their speeds, of the same shape or `(n,)`; zero by default.
            qdd: Their accelerations, of the same shape or `(n,)`; zero by default.
            gravity_m_s2: Gravity in the root link, `(3,)`.

        Raises:
            InvalidParameter: A shape does not fit, or a number is not finite.
        """
        n = self._size
        joints, shape = batch("q", q, (n,))
        rates = []
        for what, given in (("qd", qd), ("qdd", qdd)):
            rows, lead = batch(what, np.zeros(n) if given is None else given, (n,))
            if lead != shape:
                rows = _broadcast(what, rows.reshape((*lead, n)), (*shape, n)).reshape((-1, n))
            rates.append(np.ascontiguousarray(rows))
        gravity = vector("gravity_m_s2", gravity_m_s2, 3).tolist()
        return self._native.inverse_dynamics(joints, rates[0], rates[1], gravity).reshape((*shape, n))


def _broadcast(what: str, values: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    try:
        return np.broadcast_to(values, shape)
    except ValueError as error:
        raise InvalidParameter(f"{what}: expected {shape[-1:]} or {shape}, got {values.shape}", "Shape") from error
