"""ARIMA models by exact maximum likelihood."""

from __future__ import annotations

from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, count, vector
from .errors import InvalidParameter, not_fitted


class Arima:
    """An ARIMA(p, d, q) model of one series; NaN marks missing values.

    Args:
        order: `(p, d, q)`.
        trend: `"c"` estimates the mean of the `d` times differenced series (for `d = 1` the drift), `"n"` takes it as
            zero; None is `"c"` for `d = 0` and `"n"` otherwise.

    Attributes:
        params_: The mean if it is estimated, `phi_1 .. phi_p`, `theta_1 .. theta_q`, innovation variance.
        loglike_: Exact log-likelihood of the series (diffuse for `d > 0`).
        fittedvalues_: One-step predictions, `(n,)`; NaN until the level is known.
        resid_: Values minus predictions, `(n,)`.

    >>> import numpy as np
    >>> walk = Arima((0, 1, 0), trend="n").fit(np.array([0.0, 1.0, 0.0, 1.0]))
    >>> float(walk.params_[0])
    1.0
    >>> walk.forecast(2).tolist()
    [1.0, 1.0]
    """

    params_: FloatArray
    loglike_: float
    fittedvalues_: FloatArray
    resid_: FloatArray

    def __init__(self, order: tuple[int, int, int] = (1, 0, 0), *, trend: str | None = None) -> None:
        if len(order) != 3:
            raise InvalidParameter(f"order: expected (p, d, q), got {order!r}", "Shape")
        if trend not in (None, "n", "c"):
            raise InvalidParameter(f"trend: expected None, 'n' or 'c', got {trend!r}", "Domain")
        p, d, q = (count("order", number, 0) for number in order)
        self.order = (p, d, q)
        self.trend = trend
        self._model: _native.Arima | None = None
        self._series: FloatArray = np.empty(0)

    def __repr__(self) -> str:
        return f"Arima({self.order}, trend={self.trend!r})"

    @property
    def _constant(self) -> bool:
        return self.order[1] == 0 if self.trend is None else self.trend == "c"

    def _fitted(self) -> _native.Arima:
        if self._model is None:
            raise not_fitted("this Arima is not fitted yet; call fit first")
        return self._model

    def _run(self, series: FloatArray) -> None:
        self.loglike_, self.fittedvalues_, self.resid_ = self._fitted().filter(series)
        self._series = series

    def fit(self, y: ArrayLike) -> Arima:
        """Estimates the parameters from `y: (n,)`. The interpreter is released meanwhile.

        Raises:
            InvalidParameter: Infinite values, or too few for the order.
            NumericalError: The series is constant after differencing.
        """
        series = vector("y", y).copy()
        self._model = _native.fit_arima(series, self.order, self._constant)
        ar, _, ma, mean, variance = self._model.parts()
        self.params_ = np.array([*([mean] if self._constant else []), *ar, *ma, variance])
        self._run(series)
        return self

    @overload
    def forecast(self, steps: int, return_var: Literal[False] = False) -> FloatArray: ...
    @overload
    def forecast(self, steps: int, return_var: Literal[True]) -> tuple[FloatArray, FloatArray]: ...
    def forecast(self, steps: int, return_var: bool = False) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Means of the next `steps` values, `(steps,)`; with `return_var` also their variances."""
        means, variances = self._fitted().forecast(self._series, count("steps", steps, 1))
        return (means, variances) if return_var else means

    def append(self, y: ArrayLike) -> Arima:
        """Takes further values without estimating the parameters again."""
        self._fitted()
        self._run(np.concatenate((self._series, vector("y", y))))
        return self

    def loglike_at(self, params: ArrayLike, y: ArrayLike) -> float:
        """Exact log-likelihood of `y` under `params`, laid out as `params_`."""
        p, d, q = self.order
        head = int(self._constant)
        numbers = vector("params", params, head + p + q + 1)
        mean = float(numbers[0]) if head else 0.0
        ar, ma = numbers[head : head + p].tolist(), numbers[head + p : -1].tolist()
        return _native.Arima(ar, d, ma, mean, float(numbers[-1])).log_likelihood(vector("y", y))


def auto_arima(y: ArrayLike, *, max_p: int = 5, max_d: int = 2, max_q: int = 5) -> Arima:
    """The model with the lowest corrected Akaike criterion, differenced until the KPSS test accepts; fitted to `y`."""
    series = vector("y", y)
    limits = (count(what, value, 0) for what, value in (("max_p", max_p), ("max_d", max_d), ("max_q", max_q)))
    order, constant = _native.auto_arima(series, *limits)
    return Arima(order, trend="c" if constant else "n").fit(series)
