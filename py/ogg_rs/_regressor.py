"""Gaussian mixture regression."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, floats, rows
from ._mixture import MixtureEstimator
from .errors import InvalidParameter


class GaussianMixtureRegressor(MixtureEstimator):
    """Regression of `y` on `X` by a Gaussian mixture over both.

    The prediction is the conditional mean of the joint mixture, with its full conditional covariance and its exact
    derivative. The arguments are those of `GaussianMixture`; `means_init` and its kin are over the columns of `X`, then
    those of `y`.

    Attributes:
        weights_, means_, covariances_: The joint mixture, columns of `X` first.
        n_features_in_: Columns of `X`.
        n_outputs_: Columns of `y`.

    >>> import numpy as np
    >>> x = np.linspace(0.0, 1.0, 11)[:, None]
    >>> model = GaussianMixtureRegressor(reg_covar=1e-9).fit(x, 2.0 * x[:, 0] + 1.0)
    >>> float(model.predict([[0.25]]).round(6)[0]), float(model.predict_derivative([[0.25]]).round(6)[0, 0])
    (1.5, 2.0)
    """

    def fit(
        self, X: ArrayLike, y: ArrayLike, *, sample_weight: ArrayLike | None = None
    ) -> GaussianMixtureRegressor:
        """Fits to `X: (n, d)` and `y: (n,)` or `(n, m)`. The interpreter is released meanwhile.

        Raises:
            InvalidParameter: A parameter or array is out of its domain.
            NumericalError: Every start ended in an empty or collapsed component.
        """
        x, target = rows("X", X), floats("y", y)
        if target.ndim not in (1, 2) or target.shape[0] != x.shape[0] or target.size == 0:
            raise InvalidParameter(f"y: expected ({x.shape[0]},) or ({x.shape[0]}, m), got {target.shape}", "Shape")
        self._flat = target.ndim == 1
        joint = np.column_stack((x, target))
        self._fit_joint(joint, sample_weight)
        self.n_features_in_ = x.shape[1]
        self.n_outputs_ = joint.shape[1] - x.shape[1]
        self.__dict__.pop("_prepared", None)
        return self

    @property
    def _regressor(self) -> _native.Regressor:
        mixture = self._fitted
        if "_prepared" not in self.__dict__:
            d = self.n_features_in_
            self._prepared = _native.Regressor(mixture, list(range(d)), list(range(d, d + self.n_outputs_)))
        return self._prepared

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_prepared"}

    def predict(self, X: ArrayLike, return_cov: bool = False) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Conditional mean at `X: (q, d)`, in the shape of `y`: `(q,)` or `(q, m)`.

        Args:
            X: Queries.
            return_cov: Also return the conditional covariance, `(q,)` or `(q, m, m)`.

        Raises:
            NumericalError: A query lies so far out that no component reaches it.
        """
        regressor = self._regressor
        x = rows("X", X, self.n_features_in_)
        if not return_cov:
            means = regressor.means(x)
            return means[:, 0] if self._flat else means
        means, covariances = regressor.means_and_covariances(x)
        return (means[:, 0], covariances[:, 0, 0]) if self._flat else (means, covariances)

    def predict_derivative(self, X: ArrayLike) -> FloatArray:
        """Derivative of the prediction by `X`, `(q, d)` or `(q, m, d)`."""
        regressor = self._regressor
        slopes = regressor.derivatives(rows("X", X, self.n_features_in_))
        return slopes[:, 0] if self._flat else slopes

    def score(self, X: ArrayLike, y: ArrayLike) -> float:
        """Coefficient of determination R^2, averaged over the outputs."""
        predicted = np.asarray(self.predict(X))
        target = floats("y", y)
        if target.shape != predicted.shape:
            raise InvalidParameter(f"y: expected shape {predicted.shape}, got {target.shape}", "Shape")
        left = ((target - predicted) ** 2).sum(axis=0)
        spread = ((target - target.mean(axis=0)) ** 2).sum(axis=0)
        if not np.all(spread > 0.0):
            raise InvalidParameter("y: expected values that differ", "Constant")
        return float(np.mean(1.0 - left / spread))
