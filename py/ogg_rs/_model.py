"""Learned motion models: the file that `ogg` writes and follows."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, floats


class MotionModel:
    """A learned action: the posture of a worker's arm over time, with its uncertainty.

    A posture has six coordinates, named in `COORDINATES`: the wrist in `world` (m), elevation of the upper arm, flexion
    of the elbow, inclination of the forearm (rad).

    Raises:
        InvalidParameter: The text given to the constructor is no motion model.
    """

    COORDINATES = ("x_m", "y_m", "z_m", "alpha_rad", "beta_rad", "theta_rad")

    __slots__ = ("_native",)

    def __init__(self, text: str) -> None:
        self._native = _native.MotionModel(text)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> MotionModel:
        """Reads a model file.

        Raises:
            DeviceError: The file cannot be read.
            InvalidParameter: It holds no motion model.
        """
        model = cls.__new__(cls)
        model._native = _native.MotionModel.load(os.fspath(path))
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
