"""Gaussian mixtures with scikit-learn's manners."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arrays import FloatArray, count, rows, vector
from ._estimator import legacy_random
from ._fit import MixtureEstimator, sample_weights
from ._start import covariance_shape, full_covariances
from .errors import InvalidParameter

Self = TypeVar("Self", bound="GaussianMixture")


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
        init_params: `"kmeans"`, `"k-means++"`, `"random_from_data"`, or `"random"` (responsibilities drawn at random, the
            same as scikit-learn's from the same seed).
        random_state: Seed or generator of the start and of `sample`.
        warm_start: Begin at the last fit.
        weights_init: `(k,)` weights to begin at.
        means_init: `(k, d)` means to begin at; without them, those after one step from `init_params`. Weights and
            precisions that are not given are taken from the samples nearest to each.
        precisions_init: Inverse covariances to begin at, in the shape of `covariances_`.
        weight_fusion: Fuse the weights with ARIMA models of the rows of `X`, which are then in order of time:
            `"components"`, `"literal"` or a `WeightFusion`.

    Attributes:
        weights_: `(k,)`.
        means_: `(k, d)`.
        covariances_: full `(k, d, d)`, tied `(d, d)`, diag `(k, d)`, spherical `(k,)`.
        precisions_cholesky_: Factors of the inverse covariances, upper triangular, in the same shape.
        converged_: Whether the change fell below `tol`.
        n_iter_: Steps of the kept start.
        lower_bound_: Mean log-likelihood per sample before the last step.
        lower_bounds_: The same before every step, `(n_iter_,)`.
        fusion_reliability_, fusion_omega_: With `weight_fusion`, R and omega of (11)-(13) after the first step and every
            later one, `(steps, k)`.

    >>> import numpy as np
    >>> x = np.array([[0.0], [2.0]])
    >>> mixture = GaussianMixture(reg_covar=0.0).fit(x)
    >>> float(mixture.means_[0, 0]), float(mixture.covariances_[0, 0, 0])
    (1.0, 1.0)
    """

    _estimator_type = "density_estimator"

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
        """The likeliest component of each row, `(n,)`; NaN is integrated out, as in all methods below."""
        mixture = self._mixture or self._fitted
        found = mixture.labels_if_ready(X)
        if found is not None:
            return found
        x = rows("X", X, self.n_features_in_, type(self).__name__)
        try:
            return mixture.labels(x)
        except InvalidParameter:
            if not np.isnan(x).any():
                raise
        labels: NDArray[np.int64] = np.argmax(self._responsibilities(x), axis=1)
        return labels

    def predict_proba(self, X: ArrayLike) -> FloatArray:
        """Probability of each component for each row, `(n, k)`."""
        mixture = self._mixture or self._fitted
        shares = mixture.responsibilities_if_ready(X)
        if shares is not None:
            return shares
        x = rows("X", X, self.n_features_in_, type(self).__name__)
        try:
            return mixture.responsibilities(x)
        except InvalidParameter:
            if not np.isnan(x).any():
                raise
        return self._responsibilities(x)

    def score_samples(self, X: ArrayLike) -> FloatArray:
        """Log density of each row, `(n,)`; of the values that were seen, where some are NaN."""
        mixture = self._mixture or self._fitted
        densities = mixture.log_densities_if_ready(X)
        if densities is not None:
            return densities
        x = rows("X", X, self.n_features_in_, type(self).__name__)
        try:
            return mixture.log_densities(x)
        except InvalidParameter:
            if not np.isnan(x).any():
                raise
        out = np.zeros(len(x))
        for at, seen, marginal in self._marginals(x):
            out[at] = marginal.log_densities(np.ascontiguousarray(x[np.ix_(at, seen)]))
        return out

    def _responsibilities(self, x: FloatArray) -> FloatArray:
        # Of a row without any value nothing is known but the weights.
        out = np.tile(self.weights_, (len(x), 1))
        for at, seen, marginal in self._marginals(x):
            out[at] = marginal.responsibilities(np.ascontiguousarray(x[np.ix_(at, seen)]))
        return out

    def _marginals(self, x: FloatArray) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], _native.Mixture]]:
        """Rows that have values in the same columns, these columns, and the mixture of them."""
        full = full_covariances(self._fitted.kind, self.covariances_, *self.means_.shape)
        patterns, which = np.unique(~np.isnan(x), axis=0, return_inverse=True)
        for number, pattern in enumerate(patterns):
            seen = np.flatnonzero(pattern)
            if len(seen) > 0:
                means = np.ascontiguousarray(self.means_[:, seen])
                covariances = np.ascontiguousarray(full[:, seen[:, np.newaxis], seen])
                marginal = _native.Mixture("full", self.weights_.tolist(), means, covariances)
                yield np.flatnonzero(which.reshape(-1) == number), seen, marginal

    def score(self, X: ArrayLike, y: Any = None) -> float:
        """Mean log density of the rows."""
        return float(self.score_samples(X).mean())

    def _free_parameters(self) -> int:
        k, d = self.means_.shape
        triangle = d * (d + 1) // 2
        covariances = {"full": k * triangle, "tied": triangle, "diag": k * d, "spherical": k}
        return int(k - 1 + k * d + covariances[self._fitted.kind])

    def bic(self, X: ArrayLike) -> float:
        """Bayesian information criterion on `X`; lower is better."""
        densities = self.score_samples(X)
        return float(self._free_parameters() * np.log(len(densities)) - 2.0 * densities.sum())

    def aic(self, X: ArrayLike) -> float:
        """Akaike information criterion on `X`; lower is better."""
        return float(2.0 * self._free_parameters() - 2.0 * self.score_samples(X).sum())

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

    def select_order(
        self: Self,
        X: ArrayLike,
        y: Any = None,
        *,
        k_max: int = 10,
        k_min: int = 1,
        criterion: str = "bic",
        sample_weight: ArrayLike | None = None,
    ) -> Self:
        """Fits every number of components from `k_min` to `k_max`, in parallel, and keeps the lowest criterion.

        Sets `n_components` to the best number and leaves this estimator fitted with it. `order_criteria_` holds the
        criterion of each number, `(k_max - k_min + 1,)`; NaN where no mixture could be fitted.

        Args:
            X: Samples `(n, d)`. NaN is a value that was not seen.
            y: Ignored.
            k_max: Largest number of components.
            k_min: Smallest number of components.
            criterion: `"bic"` or `"aic"`.
            sample_weight: `(n,)`.

        Raises:
            InvalidParameter: A start is given, which fits one number of components only, or weights are to be fused.
            NumericalError: No number of components could be fitted.

        >>> import numpy as np
        >>> x = np.array([[i % 3 * 10 + 0.1 * np.sin(1.7 * i)] for i in range(90)])
        >>> GaussianMixture(random_state=0).select_order(x, k_max=5).n_components
        3
        """
        x = rows("X", X)
        least = count("k_min", k_min, 1)
        most = count("k_max", k_max, least)
        given = (self.weights_init, self.means_init, self.precisions_init, self.weight_fusion)
        if any(value is not None for value in given) or self.init_params == "random":
            raise InvalidParameter(
                "select_order: expected no weights_init, means_init, precisions_init or weight_fusion, and a start "
                "other than 'random'",
                "Conflict",
            )
        covariance_shape(self.covariance_type, 1, x.shape[1])
        mixture, criteria, report = _native.select_mixture(
            x,
            least=least,
            most=most,
            criterion=criterion,
            restarts=count("n_init", self.n_init, 1),
            seed=int(legacy_random(self.random_state).randint(2**31)),
            weights=sample_weights(sample_weight, x.shape[0]),
            **self._settings(),
        )
        self._take_fit(mixture, report)
        self.n_components = len(self.weights_)
        self.n_features_in_ = x.shape[1]
        self.order_criteria_ = criteria
        return self
