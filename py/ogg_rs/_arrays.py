"""Arrays on their way in: float64, C-contiguous, aligned, copied only if they are not so already."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidParameter

FloatArray = NDArray[np.float64]
# NumPy has one object for the type of this machine's byte order: to compare with it costs next to nothing.
_FLOAT64 = np.dtype(np.float64)


def floats(what: str, values: ArrayLike) -> FloatArray:
    """`values` as a C-contiguous, aligned float64 array; the same object if it already is one.

    Raises:
        InvalidParameter: `values` are not real numbers, or have ragged rows.
    """
    if type(values) is np.ndarray and values.dtype is _FLOAT64:
        flags = values.flags
        if flags.c_contiguous and flags.aligned:
            return values
    if hasattr(values, "tocsr"):
        raise InvalidParameter(f"{what}: expected a dense array, got a sparse one; use its toarray()", "Type")
    array: NDArray[Any]
    try:
        array = np.asarray(values)
        if array.dtype.kind == "O":
            array = array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidParameter(f"{what}: expected an array of real numbers: {error}", "Type") from error
    if array.dtype.kind == "c":
        raise InvalidParameter(f"{what}: expected real numbers. Complex data not supported", "Type")
    if array.dtype.kind not in "fiub":
        raise InvalidParameter(f"{what}: expected real numbers, got dtype {array.dtype}", "Type")
    return np.require(array, np.float64, ("C", "A"))


def rows(what: str, values: ArrayLike, columns: int | None = None, owner: str = "this") -> FloatArray:
    """`values` as `(n, d)`, `n >= 1`, `d >= 1`.

    Raises:
        InvalidParameter: Another number of axes, no row or column, or another number of columns than `columns`, which
            `owner` asks for.
    """
    array = floats(what, values)
    shape = array.shape
    if len(shape) != 2:
        raise InvalidParameter(
            f"{what}: expected a 2D array (n, d), got shape {shape}. Reshape your data: (-1, 1) makes one column, "
            "(1, -1) one row",
            "Shape",
        )
    if shape[1] == 0:
        raise InvalidParameter(
            f"{what}: 0 feature(s) (shape={shape}) while a minimum of 1 is required.", "Shape"
        )
    if columns is not None and shape[1] != columns:
        raise InvalidParameter(
            f"{what} has {shape[1]} features, but {owner} is expecting {columns} features as input", "Shape"
        )
    if shape[0] == 0:
        raise InvalidParameter(f"{what}: expected at least 1 sample, got 0 sample(s)", "Shape")
    return array


def vector(what: str, values: ArrayLike, length: int | None = None) -> FloatArray:
    """`values` as `(n)`.

    Raises:
        InvalidParameter: Another number of axes, or another length than `length`.
    """
    array = floats(what, values)
    if array.ndim != 1 or (length is not None and array.shape[0] != length):
        wanted = "(n,)" if length is None else f"({length},)"
        raise InvalidParameter(f"{what}: expected shape {wanted}, got {array.shape}", "Shape")
    return array


def batch(what: str, values: ArrayLike, tail: tuple[int, ...]) -> tuple[FloatArray, tuple[int, ...]]:
    """`values: (..., *tail)` as `(m, *tail)`, and the leading shape.

    Raises:
        InvalidParameter: The last axes are not `tail`.
    """
    array = floats(what, values)
    lead = array.ndim - len(tail)
    if lead < 0 or array.shape[lead:] != tail:
        wanted = f"(..., {', '.join(map(str, tail))})"
        raise InvalidParameter(f"{what}: expected shape {wanted}, got {array.shape}", "Shape")
    shape = array.shape[:lead]
    return (array if lead == 1 else array.reshape((math.prod(shape), *tail))), shape


def count(what: str, value: Any, least: int) -> int:
    """`value` as a whole number, `least` at least.

    Raises:
        InvalidParameter: It is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InvalidParameter(f"{what}: expected a whole number of at least {least}, got {value!r}", "Domain")
    return int(value)


def real(what: str, value: Any) -> float:
    """`value` as a finite number, not negative.

    Raises:
        InvalidParameter: It is none.
    """
    if not isinstance(value, int | float | np.integer | np.floating) or not 0.0 <= value < np.inf:
        raise InvalidParameter(f"{what}: expected a number in [0, inf), got {value!r}", "Domain")
    return float(value)
