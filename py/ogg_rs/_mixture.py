"""Gaussian mixtures with scikit-learn's manners."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arrays import FloatArray, count, real, rows, vector
from ._estimator import Estimator, RandomState, legacy_random
from ._start import covariance_shape, precision_factors, start_mixture
from .errors import ConvergenceWarning, NotFitted

Self = TypeVar("Self", bound="MixtureEstimator")


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

    @property
    def _fitted(self) -> _native.Mixture:
        mixture: _native.Mixture | None = self.__dict__.get("_mixture")
        if mixture is None:
            raise NotFitted(f"this {type(self).__name__} is not fitted yet; call fit first")
        return mixture

    def __sklearn_is_fitted__(self) -> bool:
        return "_mixture" in self.__dict__

    def _fit_joint(self, x: FloatArray, sample_weight: ArrayLike | None) -> None:
        k, kind = count("n_components", self.n_components, 1), self.covariance_type
        covariance_shape(kind, k, x.shape[1])
        ridge = real("reg_covar", self.reg_covar)
        weights = None if sample_weight is None else vector("sample_weight", sample_weight, x.shape[0])
        start = self.__dict__.get("_mixture") if self.warm_start else None
        if start is None:
            start = start_mixture(x, k, kind, ridge, self.means_init, self.weights_init, self.precisions_init)
        restarts = count("n_init", self.n_init, 1) if start is None else 1
        mixture, history, converged = _native.fit_mixture(
            x,
            components=k,
            covariance=kind,
            init=self.init_params,
            restarts=restarts,
            max_iterations=count("max_iter", self.max_iter, 1),
            tolerance=real("tol", self.tol),
            ridge=ridge,
            seed=int(legacy_random(self.random_state).randint(2**31)),
            weights=weights,
            start=start,
        )
        self._take(mixture)
        self.converged_ = converged
        self.n_iter_ = len(history)
        self.lower_bounds_ = history
        self.lower_bound_ = float(history[-1])
        if not converged:
            warnings.warn(
                f"the fit did not converge to tol={self.tol} in max_iter={self.max_iter} iterations",
                ConvergenceWarning,
                stacklevel=3,
            )

    def _take(self, mixture: _native.Mixture) -> None:
        self._mixture = mixture
        self.weights_, self.means_ = mixture.weights, mixture.means
        k, d = self.means_.shape
        self.covariances_ = mixture.covariances.reshape(covariance_shape(mixture.kind, k, d))
        self.precisions_cholesky_ = precision_factors(mixture.kind, self.covariances_)


class GaussianMixture(MixtureEstimator):
    """Gaussian mixture fitted by expectation maximisation.

    Arguments and attributes have scikit-learn's names, shapes and defaults, and from the same start the numbers are the
    same. In addition `fit` takes sample weights and integrates NaN (a value that was not seen) out exactly.

    Args:
        n_components: Number of components `k`.
        covariance_type: `"full"`, `"tied"`, `"diag"` or `"spherical"`.
        tol: The fit ends when the mean log-likelihood per sample (nats) changes by less.
        reg_covar: Added to every variance in every step.
        max_iter: Steps at most, per start.
        n_init: Independent starts, fitted in parallel; the likeliest is kept.
        init_params: `"kmeans"`, `"k-means++"` or `"random_from_data"`.
        random_state: Seed or generator of the start and of `sample`.
        warm_start: Begin at the last fit.
        weights_init: `(k,)` weights to begin at; needs `means_init`.
        means_init: `(k, d)` means to begin at. What is not given with them is taken from the samples nearest to each.
        precisions_init: Inverse covariances to begin at, in the shape of `covariances_`; needs `means_init`.

    Attributes:
        weights_: `(k,)`.
        means_: `(k, d)`.
        covariances_: full `(k, d, d)`, tied `(d, d)`, diag `(k, d)`, spherical `(k,)`.
        precisions_cholesky_: Factors of the inverse covariances, upper triangular, in the same shape.
        converged_: Whether the change fell below `tol`.
        n_iter_: Steps of the kept start.
        lower_bound_: Mean log-likelihood per sample before the last step.
        lower_bounds_: The same before every step, `(n_iter_,)`.

    >>> import numpy as np
    >>> x = np.array([[0.0], [2.0]])
    >>> mixture = GaussianMixture(reg_covar=0.0).fit(x)
    >>> float(mixture.means_[0, 0]), float(mixture.covariances_[0, 0, 0])
    (1.0, 1.0)
    """

    def fit(self: Self, X: ArrayLike, y: Any = None, *, sample_weight: ArrayLike | None = None) -> Self:
        """Fits to `X: (n, d)`; `y` is ignored. The interpreter is released meanwhile.

        Args:
            X: Samples. NaN is a value that was not seen.
            y: Ignored.
            sample_weight: `(n,)`; a weight of 2 counts as two equal rows.

        Raises:
            InvalidParameter: A parameter or array is out of its domain.
            NumericalError: Every start ended in an empty or collapsed component.
        """
        x = rows("X", X)
        self._fit_joint(x, sample_weight)
        self.n_features_in_ = x.shape[1]
        return self

    def fit_predict(self, X: ArrayLike, y: Any = None) -> NDArray[np.int64]:
        """`fit(X).predict(X)`."""
        return self.fit(X).predict(X)

    def predict(self, X: ArrayLike) -> NDArray[np.int64]:
        """The likeliest component of each row, `(n,)`."""
        mixture = self._fitted
        return mixture.labels(rows("X", X, self.n_features_in_))

    def predict_proba(self, X: ArrayLike) -> FloatArray:
        """Probability of each component for each row, `(n, k)`."""
        mixture = self._fitted
        return mixture.responsibilities(rows("X", X, self.n_features_in_))

    def score_samples(self, X: ArrayLike) -> FloatArray:
        """Log density of each row, `(n,)`."""
        mixture = self._fitted
        return mixture.log_densities(rows("X", X, self.n_features_in_))

    def score(self, X: ArrayLike, y: Any = None) -> float:
        """Mean log density of the rows."""
        return float(self.score_samples(X).mean())

    def bic(self, X: ArrayLike) -> float:
        """Bayesian information criterion on `X`; lower is better."""
        mixture = self._fitted
        return mixture.bic(rows("X", X, self.n_features_in_))

    def aic(self, X: ArrayLike) -> float:
        """Akaike information criterion on `X`; lower is better."""
        mixture = self._fitted
        return mixture.aic(rows("X", X, self.n_features_in_))

    def sample(self, n_samples: int = 1) -> tuple[FloatArray, NDArray[np.int64]]:
        """Draws rows `(n, d)` and the component of each `(n,)`; the same as scikit-learn from the same seed."""
        mixture = self._fitted
        n = count("n_samples", n_samples, 1)
        random = legacy_random(self.random_state)
        k, d = self.means_.shape
        counts = random.multinomial(n, self.weights_)
        if mixture.kind == "full":
            draws = [
                random.multivariate_normal(m, c, int(size))
                for m, c, size in zip(self.means_, self.covariances_, counts, strict=True)
            ]
        elif mixture.kind == "tied":
            draws = [
                random.multivariate_normal(m, self.covariances_, int(size))
                for m, size in zip(self.means_, counts, strict=True)
            ]
        else:
            draws = [
                m + random.standard_normal((int(size), d)) * np.sqrt(c)
                for m, c, size in zip(self.means_, self.covariances_, counts, strict=True)
            ]
        return np.vstack(draws), np.repeat(np.arange(k), counts)

    def condition(self, indices: Sequence[int], values: ArrayLike) -> GaussianMixture:
        """The mixture of the remaining columns, in ascending order, given `values` of the columns `indices`."""
        mixture = self._fitted
        chosen = [count("indices", i, 0) for i in indices]
        given = vector("values", values, len(chosen))
        out = GaussianMixture(self.n_components, random_state=self.random_state)
        out._take(mixture.condition(chosen, given.tolist()))
        out.n_features_in_ = self.n_features_in_ - len(chosen)
        return out
