"""The simulated arm, and the synthetic worker at the bench with pictures of it.

>>> from ogg_rs import sim
>>> arm = sim.Arm(start=[0.0, 0.6, -1.2, 0.3, 0.0, 0.0])
>>> state = arm.step([0.0, 0.6, -1.2, 0.3, 0.0, 0.0], dt=0.5)
>>> bool(abs(state.position_rad[1] - 0.6) < 1e-3)  # the weight is compensated
True
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arrays import FloatArray, count, floats, real, rows, vector
from .errors import InvalidParameter

__all__ = ["KEYPOINTS", "Arm", "ArmState", "Frame", "Poses", "Scene", "Worker", "random_frames"]

KEYPOINTS: tuple[str, ...] = tuple(_native.worker_keypoints())
"""Names of the worker's 18 keypoints, in the order of OpenPose's COCO model."""


class ArmState(NamedTuple):
    """Measured joint values (rad or m) and speeds, each `(n,)`, or `(m, n)` after `m` steps."""

    position_rad: FloatArray
    velocity_rad_s: FloatArray


class Arm:
    """A robot arm of rigid bodies with servo drives, gravity, friction and limits.

    Args:
        urdf: Robot description; None for the project's own six-joint arm.
        start: Joint values at the start, `(n,)`; by default zero, brought within the limits.
        gravity_m_s2: Gravity in the base, `(3,)`.
        servo_hz: Lowest natural frequency of the servos, 0.5 to 50 Hz.
        damping_ratio: Damping of the servos, 0.1 to 5; 1 is the fastest without overshoot.
        gravity_compensation: Share of the weight that the drives carry by feed-forward, 0 to 1.5.
        substep_s: Fixed step of the simulation, 1e-4 to 5e-3 s.

    Raises:
        DeviceError: The file cannot be read.
        InvalidParameter: A setting is out of its interval, or the robot cannot be simulated.
    """

    __slots__ = ("_native", "_size")

    def __init__(
        self,
        urdf: str | os.PathLike[str] | None = None,
        *,
        start: ArrayLike | None = None,
        gravity_m_s2: ArrayLike = (0.0, 0.0, -9.81),
        servo_hz: float = 9.5,
        damping_ratio: float = 1.0,
        gravity_compensation: float = 1.0,
        substep_s: float = 0.001,
    ) -> None:
        self._native = _native.Arm(
            None if urdf is None else os.fspath(urdf),
            start=None if start is None else vector("start", start).tolist(),
            gravity_m_s2=vector("gravity_m_s2", gravity_m_s2, 3).tolist(),
            servo_hz=float(servo_hz),
            damping_ratio=float(damping_ratio),
            gravity_compensation=float(gravity_compensation),
            substep_s=float(substep_s),
        )
        self._size = len(self._native.joint_names)

    def __repr__(self) -> str:
        return f"Arm({len(self.joint_names)} joints)"

    @property
    def joint_names(self) -> list[str]:
        """Names of the `n` joints, in the order of a joint vector."""
        return self._native.joint_names

    @property
    def state(self) -> ArmState:
        """What is measured now."""
        position, velocity = self._native.measured()
        return ArmState(position[0], velocity[0])

    def step(
        self,
        position_rad: ArrayLike | None = None,
        velocity_rad_s: ArrayLike | None = None,
        *,
        dt: float = 0.001,
        brake: bool = False,
    ) -> ArmState:
        """Moves on by `dt` s towards a setpoint, which moves on at its velocity meanwhile.

        Args:
            position_rad: Setpoint, `(n,)`; may be left out when braking.
            velocity_rad_s: Speed of the setpoint, `(n,)`; zero by default.
            dt: Time, s. What is left over of the fixed step is kept for the next call.
            brake: The brakes hold every joint where they closed; the setpoint is not read.

        Raises:
            InvalidParameter: A shape does not fit, or a number is not finite.
        """
        n = self._size
        if position_rad is None and not brake:
            raise InvalidParameter("position_rad: expected a setpoint unless braking, got None", "Missing")
        position = np.zeros(n) if position_rad is None else vector("position_rad", position_rad, n)
        velocity = np.zeros(n) if velocity_rad_s is None else vector("velocity_rad_s", velocity_rad_s, n)
        q, qd = self._native.run(position[np.newaxis], velocity[np.newaxis], real("dt", dt), bool(brake))
        return ArmState(q[0], qd[0])

    def run(self, position_rad: ArrayLike, velocity_rad_s: ArrayLike | None = None, *, dt: float = 0.001) -> ArmState:
        """One step of `dt` s per setpoint of `(m, n)`, with the interpreter released; what is measured after each."""
        n = self._size
        positions = rows("position_rad", position_rad, n)
        given = np.zeros_like(positions) if velocity_rad_s is None else rows("velocity_rad_s", velocity_rad_s, n)
        return ArmState(*self._native.run(positions, given, real("dt", dt), False))

    def gravity_load(self, q: ArrayLike) -> FloatArray:
        """Torque (N m) or force (N) that holds the arm still at `q: (n,)`."""
        return self._native.gravity_load(vector("q", q, self._size).tolist())


class Poses(NamedTuple):
    """Where the worker is at `m` times.

    Attributes:
        joints_m: Joint centres in `world`, `(m, 18, 3)`, in the order of `KEYPOINTS`.
        action: What is done, `(m,)`: `move`, `align` or `flip`.
        phase: Share of the cycle that has passed, `(m,)`.
    """

    joints_m: FloatArray
    action: list[str]
    phase: FloatArray

    def arm(self, side: str = "right") -> FloatArray:
        """Shoulder, elbow and wrist, `(m, 3, 3)`, as `MotionModel.teach` takes them."""
        if side not in ("left", "right"):
            raise InvalidParameter(f"side: expected 'left' or 'right', got {side!r}", "Domain")
        places = [KEYPOINTS.index(f"{side}_{joint}") for joint in ("shoulder", "elbow", "wrist")]
        return np.ascontiguousarray(self.joints_m[:, places])


class Worker:
    """A seated person performing sewing actions; the same seed gives the same worker.

    Args:
        seed: Seed of everything that varies.
        action: `"move"`, `"align"`, `"flip"` over and over, or `"round"` for all three in turn.
        repetitions: Cycles of one action before the next begins, in a round.
        period_s: Mean length of a cycle, 0.5 to 60 s.
        variation: Size of the differences between repetitions, 0 to 4; 1 is a practised worker.
        amplitude: Size of the movements, 0 to 2.

    Raises:
        InvalidParameter: A setting is out of its interval.

    >>> worker = Worker(seed=1, action="flip")
    >>> worker.poses([0.0, 1.5]).joints_m.shape
    (2, 18, 3)
    """

    __slots__ = ("_native",)

    def __init__(
        self,
        seed: int = 0,
        *,
        action: str = "round",
        repetitions: int = 3,
        period_s: float = 3.0,
        variation: float = 1.0,
        amplitude: float = 1.0,
    ) -> None:
        self._native = _native.Worker(
            count("seed", seed, 0),
            action,
            count("repetitions", repetitions, 1),
            float(period_s),
            float(variation),
            float(amplitude),
        )

    def poses(self, t: ArrayLike) -> Poses:
        """Where the worker is at times `t: (m,)` in s, not negative; the interpreter is released meanwhile."""
        return Poses(*self._native.poses(vector("t", np.atleast_1d(floats("t", t)))))


class Frame(NamedTuple):
    """A picture and what is true in it.

    Attributes:
        image: RGB, `(height, width, 3)` uint8.
        joints_m: Joint centres in `world`, `(18, 3)`.
        joints_px: u and v of the joints (pixel centres at whole numbers), `(18, 2)`; NaN behind the camera.
        visibility: COCO's flag, `(18,)` uint8: 0 not in the picture, 1 covered, 2 visible.
        box_px: Left, top, width, height of the worker, `(4,)`; NaN where it is not seen.
        area_px: Pixels on which the worker is seen.
    """

    image: NDArray[np.uint8]
    joints_m: FloatArray
    joints_px: FloatArray
    visibility: NDArray[np.uint8]
    box_px: FloatArray
    area_px: float


def _frame(
    image: NDArray[np.uint8],
    joints_m: FloatArray,
    joints_px: FloatArray,
    visibility: NDArray[np.uint8],
    place: FloatArray,
) -> Frame:
    return Frame(image, joints_m, joints_px, visibility, place[:4], float(place[4]))


def _size(size: tuple[int, int]) -> tuple[int, int]:
    if len(size) != 2:
        raise InvalidParameter(f"size: expected (width, height), got {size!r}", "Shape")
    return count("size", size[0], 16), count("size", size[1], 16)


class Scene:
    """The usual camera's view of a worker at the bench.

    Args:
        worker: The worker.
        size: Width and height of the picture, 16 to 8192 px each.

    Raises:
        InvalidParameter: A side is out of its interval.

    >>> Scene(Worker(), size=(160, 120)).render(0.5).image.shape
    (120, 160, 3)
    """

    __slots__ = ("_native",)

    def __init__(self, worker: Worker, *, size: tuple[int, int] = (640, 480)) -> None:
        self._native = _native.Scene(worker._native, *_size(size))

    def render(self, t: float) -> Frame:
        """The picture at `t` s, with the interpreter released."""
        return _frame(*self._native.render(real("t", t)))

    def frames(self, t: Iterable[float]) -> Iterator[Frame]:
        """Pictures at times in s, one after the other."""
        return map(self.render, t)


def random_frames(seeds: Iterable[int], *, size: tuple[int, int] = (320, 240)) -> Iterator[Frame]:
    """One picture per seed, with a worker, an instant, a camera and a look drawn from it: pictures to train with.

    >>> [frame.visibility.shape for frame in random_frames(range(2), size=(64, 48))]
    [(18,), (18,)]
    """
    width, height = _size(size)
    for seed in seeds:
        yield _frame(*_native.random_frame(count("seeds", seed, 0), width, height))
