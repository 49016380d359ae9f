"""Learn a worker's arm motion from video and replay it on a robot arm: the analysis side.

Everything takes and returns NumPy arrays in SI units and radians. Estimators follow scikit-learn's manners. The native
half is loaded with the first name that needs it, so `ogg_rs.train` runs from the sources where nothing is built.

>>> import numpy as np
>>> import ogg_rs
>>> x = np.array([[-1.1], [-1.0], [-0.9], [0.9], [1.0], [1.1]])
>>> mixture = ogg_rs.GaussianMixture(2, random_state=0).fit(x)
>>> np.sort(mixture.means_.ravel()).round(6).tolist()
[-1.0, 1.0]
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from . import errors
from .errors import (
    ConvergenceWarning,
    DeviceError,
    InvalidParameter,
    MissingDependency,
    NotFitted,
    NumericalError,
    OggError,
)

if TYPE_CHECKING:
    from . import can, kin, motion, plot, pose, recording, sim
    from ._arima import Arima, auto_arima
    from ._fusion import WeightFusion
    from ._mixture import GaussianMixture
    from ._model import MotionModel
    from ._regressor import GaussianMixtureRegressor

__all__ = [
    "Arima",
    "ConvergenceWarning",
    "DeviceError",
    "GaussianMixture",
    "GaussianMixtureRegressor",
    "InvalidParameter",
    "MissingDependency",
    "MotionModel",
    "NotFitted",
    "NumericalError",
    "OggError",
    "WeightFusion",
    "auto_arima",
    "can",
    "errors",
    "kin",
    "motion",
    "plot",
    "pose",
    "recording",
    "sim",
]

_HOMES = {
    "Arima": "_arima",
    "GaussianMixture": "_mixture",
    "GaussianMixtureRegressor": "_regressor",
    "MotionModel": "_model",
    "WeightFusion": "_fusion",
    "auto_arima": "_arima",
}
_MODULES = ("can", "kin", "motion", "plot", "pose", "recording", "sim")


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    elif name in _MODULES:
        value = import_module(f".{name}", __name__)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
