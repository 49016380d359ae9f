"""Where a fit begins when some of its parameters are given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, floats, vector
from .errors import InvalidParameter, NumericalError

SHAPES = {"full": "(k, d, d)", "tied": "(d, d)", "diag": "(k, d)", "spherical": "(k,)"}


def covariance_shape(kind: str, k: int, d: int) -> tuple[int, ...]:
    """Shape in which covariances, precisions and their factors are stored.

    Raises:
        InvalidParameter: There is no such kind.
    """
    shapes: dict[str, tuple[int, ...]] = {"full": (k, d, d), "tied": (d, d), "diag": (k, d), "spherical": (k,)}
    if kind not in shapes:
        raise InvalidParameter(f"covariance_type: expected one of {sorted(shapes)}, got {kind!r}", "Domain")
    return shapes[kind]


def inverted(kind: str, matrices: FloatArray) -> FloatArray:
    """Covariances of precisions, exactly symmetric.

    Raises:
        NumericalError: A matrix is singular.
    """
    if kind in ("diag", "spherical"):
        with np.errstate(divide="ignore"):
            return np.asarray(1.0 / matrices, np.float64)
    try:
        inverse = np.asarray(np.linalg.inv(matrices), np.float64)
    except np.linalg.LinAlgError as error:
        raise NumericalError("precisions_init: expected invertible matrices", "NotPositiveDefinite") from error
    return np.ascontiguousarray(0.5 * (inverse + inverse.swapaxes(-1, -2)))


def full_covariances(kind: str, covariances: FloatArray, k: int, d: int) -> FloatArray:
    """Covariances of any kind as `(k, d, d)`."""
    if kind == "full":
        return covariances
    if kind == "tied":
        return np.broadcast_to(covariances, (k, d, d))
    variances = covariances if kind == "diag" else covariances[:, np.newaxis]
    return variances[:, :, np.newaxis] * np.eye(d)


def precision_factors(kind: str, covariances: FloatArray) -> FloatArray:
    """Upper triangular `U` with `U U' = inv(covariance)`, or reciprocal deviations.

    Raises:
        NumericalError: A covariance is singular to rounding: the fit's own factor just passed where this one does not.
    """
    if kind in ("diag", "spherical"):
        return 1.0 / np.sqrt(covariances)
    try:
        return np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(covariances)).swapaxes(-1, -2))
    except np.linalg.LinAlgError as error:
        raise NumericalError(
            "covariances_: expected positive definite ones, got one that is singular to rounding; a larger reg_covar prevents that",
            "NotPositiveDefinite",
        ) from error


def start_mixture(
    x: FloatArray,
    k: int,
    kind: str,
    reg_covar: float,
    given: tuple[ArrayLike | None, ArrayLike | None, ArrayLike | None],
    first: _native.Mixture | None,
) -> _native.Mixture:
    """The mixture described by weights, means and precisions.

    What is not given is taken from `first`; without it, from the samples nearest to each mean.

    Raises:
        InvalidParameter: A wrong shape, or a mean without samples.
    """
    weights, means, precisions = given
    shape = covariance_shape(kind, k, x.shape[1])
    centres: FloatArray | None = None
    if means is not None:
        centres = floats("means_init", means)
        if centres.shape != (k, x.shape[1]):
            raise InvalidParameter(f"means_init: expected shape {(k, x.shape[1])}, got {centres.shape}", "Shape")
    covariances: FloatArray | None = None
    if precisions is not None:
        inverse = floats("precisions_init", precisions)
        if inverse.shape != shape:
            raise InvalidParameter(f"precisions_init: expected shape {shape}, got {inverse.shape}", "Shape")
        covariances = inverted(kind, inverse)
    shares = None if weights is None else vector("weights_init", weights, k)
    if first is not None:
        centres = first.means if centres is None else centres
        shares = first.weights if shares is None else shares
        covariances = first.covariances.reshape(shape) if covariances is None else covariances
    assert centres is not None, "either means or a first mixture are given"
    if covariances is None or shares is None:
        complete = x[~np.isnan(x).any(axis=1)]
        distances = [((complete - centre) ** 2).sum(axis=1) for centre in centres]
        labels = np.argmin(distances, axis=0)
        counts = np.bincount(labels, minlength=k)
        if not counts.all():
            empty = int(np.argmin(counts))
            raise InvalidParameter(f"means_init: no sample is nearest to mean {empty}", "EmptyComponent")
        shares = counts / counts.sum() if shares is None else shares
        if covariances is None:
            covariances = _moments(kind, complete, np.eye(k)[labels], reg_covar)[2]
    return _native.Mixture(kind, shares.tolist(), centres, covariances)


def from_responsibilities(
    kind: str, x: FloatArray, shares: FloatArray, reg_covar: float, sample_weight: FloatArray | None
) -> _native.Mixture:
    """The mixture of an M step with these responsibilities `(n, k)`; rows with NaN are left out.

    Raises:
        InvalidParameter: Every row has a NaN.
    """
    if sample_weight is not None:
        shares = shares * sample_weight[:, np.newaxis]
    seen = ~np.isnan(x).any(axis=1)
    if not seen.any():
        raise InvalidParameter("init_params: 'random' needs a row without NaN", "TooFewSamples")
    weights, means, covariances = _moments(kind, x[seen], shares[seen], reg_covar)
    return _native.Mixture(kind, weights.tolist(), means, covariances)


def _moments(
    kind: str, x: FloatArray, shares: FloatArray, reg_covar: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights, means and covariances of responsibilities."""
    with np.errstate(over="ignore", invalid="ignore"):
        mass = shares.sum(axis=0) + 10.0 * np.finfo(np.float64).eps
        means = shares.T @ x / mass[:, np.newaxis]
        full = np.empty((len(mass), x.shape[1], x.shape[1]))
        for i, mean in enumerate(means):
            centred = x - mean
            full[i] = (shares[:, i] * centred.T) @ centred / mass[i]
        full = 0.5 * (full + full.swapaxes(-1, -2)) + reg_covar * np.eye(x.shape[1])
        weights = mass / mass.sum()
        if kind == "full":
            covariances = full
        elif kind == "tied":
            covariances = np.einsum("k,kij->ij", weights, full)
        else:
            covariances = np.diagonal(full, axis1=1, axis2=2)
            covariances = covariances.mean(axis=1) if kind == "spherical" else covariances
    return weights, np.ascontiguousarray(means), np.ascontiguousarray(covariances)
