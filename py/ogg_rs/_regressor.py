"""Gaussian mixture regression."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, floats, rows
from ._fit import MixtureEstimator
from ._start import full_covariances
from .errors import InvalidParameter, not_fitted


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

    _estimator_type = "regressor"
    _regressor: _native.Regressor | None = None

    def fit(
        self, X: ArrayLike, y: ArrayLike, *, sample_weight: ArrayLike | None = None
    ) -> GaussianMixtureRegressor:
        """Fits to `X: (n, d)` and `y: (n,)` or `(n, m)`. The interpreter is released meanwhile.

        Raises:
            InvalidParameter: A parameter or array is out of its domain.
            NumericalError: Every start ended in an empty or collapsed component.
        """
        x = rows("X", X)
        if y is None:
            raise InvalidParameter(f"{type(self).__name__} requires y to be passed, but the target y is None", "Missing")
        target = floats("y", y)
        if target.ndim not in (1, 2) or target.shape[0] != x.shape[0] or target.size == 0:
            raise InvalidParameter(f"y: expected ({x.shape[0]},) or ({x.shape[0]}, m), got {target.shape}", "Shape")
        if not np.isfinite(target).all():
            raise InvalidParameter("y: expected finite numbers, got NaN or infinity (inf)", "NotFinite")
        self._flat = target.ndim == 1
        joint = np.column_stack((x, target))
        self._fit_joint(joint, sample_weight)
        self.n_features_in_ = x.shape[1]
        self.n_outputs_ = joint.shape[1] - x.shape[1]
        self._regressor = self._given(range(x.shape[1]))
        return self

    def _given(self, inputs: Iterable[int]) -> _native.Regressor:
        """The regression on some of the columns of `X`."""
        d = self.n_features_in_
        return _native.Regressor(self._fitted, list(inputs), list(range(d, d + self.n_outputs_)))

    @property
    def _prepared(self) -> _native.Regressor:
        if self._regressor is None:
            raise not_fitted(f"this {type(self).__name__} is not fitted yet; call fit first")
        return self._regressor

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_regressor"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        if "_mixture" in state:
            self._regressor = self._given(range(self.n_features_in_))

    @overload
    def predict(self, X: ArrayLike, return_cov: Literal[False] = False) -> FloatArray: ...
    @overload
    def predict(self, X: ArrayLike, return_cov: Literal[True]) -> tuple[FloatArray, FloatArray]: ...
    def predict(self, X: ArrayLike, return_cov: bool = False) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Conditional mean at `X: (q, d)`, in the shape of `y`: `(q,)` or `(q, m)`.

        Args:
            X: Queries. NaN is a value that is not known; the answer is given by the others.
            return_cov: Also return the conditional covariance, `(q,)` or `(q, m, m)`.

        Raises:
            NumericalError: A query lies so far out that no component reaches it.
        """
        regressor = self._regressor or self._prepared
        if not return_cov:
            found = regressor.means_if_ready(X, self._flat)
            if found is not None:
                return found
        x = rows("X", X, self.n_features_in_, type(self).__name__)
        try:
            if not return_cov:
                means = regressor.means(x)
                return means[:, 0] if self._flat else means
            means, covariances = regressor.means_and_covariances(x)
        except InvalidParameter:
            if not np.isnan(x).any():
                raise
            means, covariances = self._predict_seen(x)
        if self._flat:
            means, covariances = means[:, 0], covariances[:, 0, 0]
        return (means, covariances) if return_cov else means

    def _predict_seen(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        d, m = self.n_features_in_, self.n_outputs_
        means, covariances = np.empty((len(x), m)), np.empty((len(x), m, m))
        patterns, which = np.unique(~np.isnan(x), axis=0, return_inverse=True)
        for number, pattern in enumerate(patterns):
            at, seen = np.flatnonzero(which.reshape(-1) == number), np.flatnonzero(pattern)
            if len(seen) > 0:
                queries = np.ascontiguousarray(x[np.ix_(at, seen)])
                means[at], covariances[at] = self._given(seen.tolist()).means_and_covariances(queries)
            else:
                # Nothing is known: mean and covariance of the outputs over all components.
                full = full_covariances(self._fitted.kind, self.covariances_, *self.means_.shape)[:, d:, d:]
                centre = self.weights_ @ self.means_[:, d:]
                away = self.means_[:, d:] - centre
                spread = np.einsum("k,kij->ij", self.weights_, full)
                means[at], covariances[at] = centre, spread + np.einsum("k,ki,kj->ij", self.weights_, away, away)
        return means, covariances

    def predict_derivative(self, X: ArrayLike) -> FloatArray:
        """Derivative of the prediction by `X`, `(q, d)` or `(q, m, d)`."""
        slopes = self._prepared.derivatives(rows("X", X, self.n_features_in_, type(self).__name__))
        return slopes[:, 0] if self._flat else slopes

    def score(self, X: ArrayLike, y: ArrayLike) -> float:
        """Coefficient of determination R^2, averaged over the outputs."""
        predicted = self.predict(X)
        target = floats("y", y)
        if target.shape != predicted.shape:
            raise InvalidParameter(f"y: expected shape {predicted.shape}, got {target.shape}", "Shape")
        left = ((target - predicted) ** 2).sum(axis=0)
        spread = ((target - target.mean(axis=0)) ** 2).sum(axis=0)
        if not np.all(spread > 0.0):
            raise InvalidParameter("y: expected values that differ", "Constant")
        return float(np.mean(1.0 - left / spread))
