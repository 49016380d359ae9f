"""Where a fit begins when some of its parameters are given."""

from __future__ import annotations

from typing import Any

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
            return 1.0 / matrices
    try:
        inverse: FloatArray = np.linalg.inv(matrices)
    except np.linalg.LinAlgError as error:
        raise NumericalError("precisions_init: expected invertible matrices", "NotPositiveDefinite") from error
    return np.ascontiguousarray(0.5 * (inverse + inverse.swapaxes(-1, -2)))


def precision_factors(kind: str, covariances: FloatArray) -> FloatArray:
    """Upper triangular `U` with `U U' = inv(covariance)`, or reciprocal deviations."""
    if kind in ("diag", "spherical"):
        return 1.0 / np.sqrt(covariances)
    return np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(covariances)).swapaxes(-1, -2))


def start_mixture(
    x: FloatArray,
    k: int,
    kind: str,
    reg_covar: float,
    means: ArrayLike | None,
    weights: ArrayLike | None,
    precisions: ArrayLike | None,
) -> Any:
    """The mixture described by `means_init`, `weights_init` and `precisions_init`; None without any of them.

    What is not given is taken from the samples nearest to each mean.

    Raises:
        InvalidParameter: Weights or precisions without means, a wrong shape, or a mean without samples.
    """
    if means is None:
        if weights is not None or precisions is not None:
            raise InvalidParameter("weights_init, precisions_init: expected means_init with them", "Missing")
        return None
    d = x.shape[1]
    shape = covariance_shape(kind, k, d)
    centres = floats("means_init", means)
    if centres.shape != (k, d):
        raise InvalidParameter(f"means_init: expected shape {(k, d)}, got {centres.shape}", "Shape")
    covariances: FloatArray | None = None
    if precisions is not None:
        given = floats("precisions_init", precisions)
        if given.shape != shape:
            raise InvalidParameter(f"precisions_init: expected shape {shape}, got {given.shape}", "Shape")
        covariances = inverted(kind, given)
    shares = None if weights is None else vector("weights_init", weights, k)
    if covariances is None or shares is None:
        complete = x[~np.isnan(x).any(axis=1)]
        labels = np.argmin([((complete - centre) ** 2).sum(axis=1) for centre in centres], axis=0)
        counts = np.bincount(labels, minlength=k)
        if not counts.all():
            empty = int(np.argmin(counts))
            raise InvalidParameter(f"means_init: no sample is nearest to mean {empty}", "EmptyComponent")
        shares = counts / counts.sum() if shares is None else shares
        if covariances is None:
            covariances = _scatter(kind, complete, labels, k, reg_covar)
    return _native.Mixture(kind, shares.tolist(), centres, covariances)


def _scatter(kind: str, x: FloatArray, labels: Any, k: int, reg_covar: float) -> FloatArray:
    groups = [x[labels == c] for c in range(k)]
    full = np.stack([np.atleast_2d(np.cov(g, rowvar=False, bias=True)) for g in groups])
    full += reg_covar * np.eye(x.shape[1])
    if kind == "full":
        return full
    if kind == "tied":
        return np.ascontiguousarray(np.einsum("k,kij->ij", [len(g) / len(x) for g in groups], full))
    variances = np.ascontiguousarray(np.diagonal(full, axis1=1, axis2=2))
    return variances if kind == "diag" else variances.mean(axis=1)
