"""What the mixture and its regression have in common: parameters, starts and the fit."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, count, real, vector
from ._estimator import Estimator, RandomState, legacy_random
from ._fusion import WeightFusion, fusion_errors
from ._start import covariance_shape, from_responsibilities, precision_factors, start_mixture
from .errors import ConvergenceWarning, InvalidParameter, NumericalError, not_fitted


def sample_weights(sample_weight: ArrayLike | None, n: int) -> FloatArray | None:
    """Checked weights of `n` rows.

    Raises:
        InvalidParameter: A wrong length, or nothing but zeros.
    """
    if sample_weight is None:
        return None
    weights = vector("sample_weight", sample_weight, n)
    if not weights.any():
        raise InvalidParameter("sample_weight: every weight is zero, expected one above", "Domain")
    return weights


class MixtureEstimator(Estimator):
    """Parameters and fit that the mixture and the regressor share."""

    weights_: FloatArray
    means_: FloatArray
    covariances_: FloatArray
    precisions_cholesky_: FloatArray
    converged_: bool
    n_iter_: int
    lower_bound_: float
    lower_bounds_: FloatArray
    n_features_in_: int
    order_criteria_: FloatArray
    fusion_reliability_: FloatArray
    fusion_omega_: FloatArray

    # Methods that cost little hand their argument to the native half at once, which takes an array that needs no conversion
    # and answers None to everything else; then it is converted, or its fault is named.
    _mixture: _native.Mixture | None = None

    def __init__(
        self,
        n_components: int = 1,
        *,
        covariance_type: str = "full",
        tol: float = 1e-3,
        reg_covar: float = 1e-6,
        max_iter: int = 100,
        n_init: int = 1,
        init_params: str = "kmeans",
        random_state: RandomState = None,
        warm_start: bool = False,
        weights_init: ArrayLike | None = None,
        means_init: ArrayLike | None = None,
        precisions_init: ArrayLike | None = None,
        weight_fusion: str | WeightFusion | None = None,
    ) -> None:
        self.n_components = n_components
        self.covariance_type = covariance_type
        self.tol = tol
        self.reg_covar = reg_covar
        self.max_iter = max_iter
        self.n_init = n_init
        self.init_params = init_params
        self.random_state = random_state
        self.warm_start = warm_start
        self.weights_init = weights_init
        self.means_init = means_init
        self.precisions_init = precisions_init
        self.weight_fusion = weight_fusion

    @property
    def _fitted(self) -> _native.Mixture:
        mixture = self._mixture
        if mixture is None:
            raise not_fitted(f"this {type(self).__name__} is not fitted yet; call fit first")
        return mixture

    def __sklearn_is_fitted__(self) -> bool:
        return self._mixture is not None

    def _settings(self) -> dict[str, Any]:
        """What the native fit is told, but for components, restarts and start."""
        if self.init_params not in ("kmeans", "k-means++", "random", "random_from_data"):
            raise InvalidParameter(
                "init_params: expected 'kmeans', 'k-means++', 'random' or 'random_from_data', "
                f"got {self.init_params!r}",
                "Domain",
            )
        return {
            "covariance": self.covariance_type,
            "init": self.init_params,
            "max_iterations": count("max_iter", self.max_iter, 1),
            "tolerance": real("tol", self.tol),
            "ridge": real("reg_covar", self.reg_covar),
        }

    def _fit_joint(self, x: FloatArray, sample_weight: ArrayLike | None) -> None:
        k = count("n_components", self.n_components, 1)
        covariance_shape(self.covariance_type, k, x.shape[1])
        settings = self._settings()
        restarts = count("n_init", self.n_init, 1)
        settings["components"] = k
        settings["weights"] = sample_weights(sample_weight, x.shape[0])
        settings["fusion"] = fusion_errors(x, self.weight_fusion)
        random = legacy_random(self.random_state)
        previous = self._mixture if self.warm_start else None
        if previous is not None:
            fit = _native.fit_mixture(x, restarts=1, seed=0, start=previous, **settings)
        elif self.init_params == "random":
            fit = self._fit_random(x, k, restarts, random, settings)
        else:
            settings["seed"] = int(random.randint(2**31))
            start = self._given_start(x, k, settings)
            fit = _native.fit_mixture(x, restarts=restarts if start is None else 1, start=start, **settings)
        self._take_fit(*fit)
        if not self.converged_:
            warnings.warn(
                f"the fit did not converge to tol={self.tol} in max_iter={self.max_iter} iterations",
                ConvergenceWarning,
                stacklevel=3,
            )

    def _given_start(self, x: FloatArray, k: int, settings: dict[str, Any]) -> _native.Mixture | None:
        given = (self.weights_init, self.means_init, self.precisions_init)
        if all(value is None for value in given):
            return None
        first: _native.Mixture | None = None
        if self.means_init is None:
            # Means that nobody gave are those after one step from `init_params`.
            one_step = {**settings, "max_iterations": 1, "fusion": None}
            first = _native.fit_mixture(x, restarts=1, **one_step)[0]
        return start_mixture(x, k, self.covariance_type, settings["ridge"], given, first)

    def _fit_random(
        self, x: FloatArray, k: int, restarts: int, random: np.random.RandomState, settings: dict[str, Any]
    ) -> tuple[_native.Mixture, tuple[FloatArray, bool, tuple[FloatArray, FloatArray] | None]]:
        """Starts at responsibilities drawn as scikit-learn draws them; the likeliest end is kept."""
        best, last = None, None
        for _ in range(restarts):
            shares = random.uniform(size=(x.shape[0], k))
            shares /= shares.sum(axis=1)[:, np.newaxis]
            first = from_responsibilities(self.covariance_type, x, shares, settings["ridge"], settings["weights"])
            given = (self.weights_init, self.means_init, self.precisions_init)
            start = start_mixture(x, k, self.covariance_type, settings["ridge"], given, first)
            try:
                fit = _native.fit_mixture(x, restarts=1, seed=0, start=start, **{**settings, "init": "kmeans"})
            except NumericalError as error:
                last = error
                continue
            if best is None or fit[1][0][-1] > best[1][0][-1]:
                best = fit
        if best is None:
            raise NumericalError(f"all {restarts} restarts failed, the last with: {last}", "AllRestartsFailed") from last
        return best

    def _take_fit(
        self,
        mixture: _native.Mixture,
        report: tuple[FloatArray, bool, tuple[FloatArray, FloatArray] | None],
    ) -> None:
        history, converged, fused = report
        self._take(mixture)
        self.converged_ = converged
        self.n_iter_ = len(history)
        self.lower_bounds_ = history
        self.lower_bound_ = float(history[-1])
        for name in ("fusion_reliability_", "fusion_omega_"):
            self.__dict__.pop(name, None)
        if fused is not None:
            self.fusion_reliability_, self.fusion_omega_ = fused

    def _take(self, mixture: _native.Mixture) -> None:
        k, d = mixture.means.shape
        covariances = mixture.covariances.reshape(covariance_shape(mixture.kind, k, d))
        self.precisions_cholesky_ = precision_factors(mixture.kind, covariances)
        self._mixture = mixture
        self.weights_, self.means_, self.covariances_ = mixture.weights, mixture.means, covariances
