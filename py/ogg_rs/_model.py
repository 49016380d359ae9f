"""Learned motion models: the file that `ogg` writes and follows."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, count, floats, vector
from .errors import InvalidParameter


class MotionModel:
    """A learned action: the posture of a worker's arm over time, with its uncertainty.

    A posture has six coordinates, named in `COORDINATES`: the wrist in `world` (m), elevation of the upper arm, flexion
    of the elbow, inclination of the forearm (rad).

    Raises:
        InvalidParameter: The text given to the constructor is no motion model.
    """

    COORDINATES = ("x_m", "y_m", "z_m", "alpha_rad", "beta_rad", "theta_rad")

    __slots__ = ("_native", "teach_report")

    teach_report: dict[str, float] | None
    """What teaching did: samples given, complete and used, gaps bridged, demonstrations, duration; None for a model
    that was read."""

    def __init__(self, text: str) -> None:
        self._native = _native.MotionModel(text)
        self.teach_report = None

    @classmethod
    def teach(
        cls,
        demonstrations: Sequence[tuple[ArrayLike, ArrayLike]],
        *,
        element_s: float = 1.0,
        components: int = 5,
        restarts: int = 3,
        blend_s: float = 0.2,
        seed: int = 0,
        rate_hz: float = 100.0,
        longest_gap_s: float = 0.3,
        smoothing_s: float = 0.04,
        shortest_period_s: float = 1.0,
    ) -> MotionModel:
        """Learns an action from recordings of a worker's arm. The interpreter is released meanwhile.

        One recording is cut where its motion repeats itself; several are one repetition each, stretched to their median
        duration. `teach_report` then says what was used.

        Args:
            demonstrations: Pairs `(t, joints)`: times `(n,)` in s, increasing, and shoulder, elbow and wrist in `world`,
                `(n, 3, 3)` in m. A joint with a NaN is not seen; samples in which one is not seen are left out.
            element_s: Length of a motion element, s.
            components: Gaussian components per element.
            restarts: Starts per element; the likeliest is kept.
            blend_s: Time over which two elements are blended, s.
            seed: Seed of the starts.
            rate_hz: Rate at which recordings are sampled anew, Hz.
            longest_gap_s: Gaps up to this are bridged by straight lines, s; the longest piece between others is used.
            smoothing_s: Deviation of the smoothing Gaussian, s.
            shortest_period_s: Shortest repetition, s.

        Raises:
            InvalidParameter: A shape does not fit, a setting is out of its interval, or too little of the arm is seen.
            NumericalError: A mixture cannot be fitted.

        >>> import numpy as np
        >>> t = np.arange(0.0, 8.0, 0.02)
        >>> wrist = np.stack((0.4 + 0.1 * np.sin(np.pi * t), 0.1 * np.cos(np.pi * t), np.full_like(t, 0.1)), axis=1)
        >>> joints = np.stack((np.zeros_like(wrist), wrist * 0.5 + [0.0, 0.0, 0.1], wrist), axis=1)
        >>> model = MotionModel.teach([(t, joints)])
        >>> model.is_cyclic, round(model.duration_s, 2)
        (True, 2.0)
        """
        streams = []
        for entry in demonstrations:
            if len(entry) != 2:
                raise InvalidParameter(f"demonstrations: expected pairs (t, joints), got {len(entry)} parts", "Shape")
            times, joints = vector("t", entry[0]), floats("joints", entry[1])
            if joints.shape != (len(times), 3, 3):
                raise InvalidParameter(f"joints: expected {(len(times), 3, 3)}, got {joints.shape}", "Shape")
            streams.append((times, joints))
        if not streams:
            raise InvalidParameter("demonstrations: expected at least one", "Shape")
        model = cls.__new__(cls)
        model._native, report = _native.MotionModel.teach(
            streams,
            element_s=float(element_s),
            components=count("components", components, 1),
            restarts=count("restarts", restarts, 1),
            blend_s=float(blend_s),
            seed=count("seed", seed, 0),
            rate_hz=float(rate_hz),
            longest_gap_s=float(longest_gap_s),
            smoothing_s=float(smoothing_s),
            shortest_period_s=float(shortest_period_s),
        )
        model.teach_report = {name: value if name == "duration_s" else int(value) for name, value in report.items()}
        return model

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> MotionModel:
        """Reads a model file.

        Raises:
            DeviceError: The file cannot be read.
            InvalidParameter: It holds no motion model.
        """
        model = cls.__new__(cls)
        model._native = _native.MotionModel.load(os.fspath(path))
        model.teach_report = None
        return model

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the model; every number survives the round trip exactly.

        Raises:
            DeviceError: The file cannot be written.
        """
        self._native.save(os.fspath(path))

    def __reduce__(self) -> tuple[type[MotionModel], tuple[str]]:
        return (MotionModel, (self._native.to_json(),))

    def __repr__(self) -> str:
        return f"MotionModel({self.duration_s:.3f} s, {self.elements} elements, cyclic={self.is_cyclic})"

    @property
    def duration_s(self) -> float:
        """Duration of one repetition."""
        return self._native.duration_s

    @property
    def is_cyclic(self) -> bool:
        """Whether the end of the action joins its beginning."""
        return self._native.is_cyclic

    @property
    def elements(self) -> int:
        """Number of motion elements."""
        return self._native.elements

    @property
    def demonstrations(self) -> int:
        """Repetitions the model was learned from."""
        return self._native.demonstrations

    def _at(self, t: ArrayLike) -> tuple[tuple[int, ...], FloatArray, FloatArray, FloatArray]:
        times = floats("t", t)
        return (times.shape, *self._native.at(np.ascontiguousarray(times.reshape(-1))))

    @overload
    def predict(self, t: ArrayLike, return_cov: Literal[False] = False) -> FloatArray: ...
    @overload
    def predict(self, t: ArrayLike, return_cov: Literal[True]) -> tuple[FloatArray, FloatArray]: ...
    def predict(self, t: ArrayLike, return_cov: bool = False) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Expected posture at times `t: (...)` in s, `(..., 6)`; with `return_cov` also its covariance `(..., 6, 6)`.

        A cyclic action repeats; else its ends are held.
        """
        shape, means, _, covariances = self._at(t)
        mean = means.reshape((*shape, 6))
        return (mean, covariances.reshape((*shape, 6, 6))) if return_cov else mean

    def predict_derivative(self, t: ArrayLike) -> FloatArray:
        """Rate of change of the expected posture, `(..., 6)`, per second."""
        shape, _, rates, _ = self._at(t)
        return rates.reshape((*shape, 6))
