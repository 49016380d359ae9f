"""What scikit-learn expects of an estimator, without needing scikit-learn."""

from __future__ import annotations

import inspect
from typing import Any, TypeVar

import numpy as np

from .errors import InvalidParameter

Self = TypeVar("Self", bound="Estimator")
RandomState = int | np.random.RandomState | np.random.Generator | None


class Estimator:
    """Parameters by name; everything a fit learns ends in an underscore."""

    _estimator_type = ""

    def __sklearn_tags__(self) -> Any:
        """What scikit-learn, which alone asks, has to know: NaN is taken, and who needs a `y`."""
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags

        predicts = self._estimator_type == "regressor"
        return Tags(
            estimator_type=self._estimator_type,
            target_tags=TargetTags(required=predicts, multi_output=predicts, single_output=True),
            regressor_tags=RegressorTags() if predicts else None,
            input_tags=InputTags(allow_nan=True),
        )

    @classmethod
    def _names(cls) -> list[str]:
        return [name for name in inspect.signature(cls.__init__).parameters if name != "self"]

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The constructor's arguments by name."""
        return {name: getattr(self, name) for name in self._names()}

    def set_params(self: Self, **params: Any) -> Self:
        """Sets constructor arguments by name.

        Raises:
            InvalidParameter: There is no such argument.
        """
        names = self._names()
        for name, value in params.items():
            if name not in names:
                raise InvalidParameter(f"{type(self).__name__}: no parameter {name!r}; it has {names}", "Name")
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self).__init__).parameters
        given = [(n, getattr(self, n)) for n in self._names()]
        shown = [f"{n}={_short(v)}" for n, v in given if v is not defaults[n].default]
        return f"{type(self).__name__}({', '.join(shown)})"


def _short(value: Any) -> str:
    return f"<array {value.shape}>" if isinstance(value, np.ndarray) else repr(value)


def legacy_random(random_state: RandomState) -> np.random.RandomState:
    """The generator that scikit-learn would draw from; a `Generator` seeds a new one.

    Raises:
        InvalidParameter: `random_state` is neither a seed nor a generator.
    """
    if isinstance(random_state, np.random.RandomState):
        return random_state
    if isinstance(random_state, np.random.Generator):
        return np.random.RandomState(int(random_state.integers(2**32)))
    if random_state is None:
        return np.random.RandomState()
    if isinstance(random_state, int | np.integer) and not isinstance(random_state, bool) and 0 <= random_state < 2**32:
        return np.random.RandomState(int(random_state))
    raise InvalidParameter(
        f"random_state: expected None, a seed in [0, 2**32), a RandomState or a Generator, got {random_state!r}", "Domain"
    )
