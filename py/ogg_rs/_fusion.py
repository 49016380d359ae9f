"""Weight fusion of a mixture with ARIMA models (paper, equations 11-14)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, count, vector
from .errors import InvalidParameter


@dataclass(frozen=True, kw_only=True)
class WeightFusion:
    """How the weights of every M step are fused with the errors of ARIMA models.

    Attributes:
        reading: `"components"`: the index of (11)-(14) runs over the components, whose reliability is the mean error of
            the samples they explain. `"literal"`: it runs over the two models, as printed; that changes nothing, and the
            report shows it.
        order: `(p, d, q)` of the ARIMA model that is fitted to each column of each demonstration.
        lengths: Rows of each demonstration in `X`, which are at equal steps of time; None for one demonstration.
        errors: `(n,)` standardised absolute errors, one per row, instead of fitting ARIMA models.
    """

    reading: str = "components"
    order: tuple[int, int, int] = (1, 0, 0)
    lengths: Sequence[int] | None = None
    errors: ArrayLike | None = None


def fusion_errors(x: FloatArray, fusion: Any) -> tuple[FloatArray, str] | None:
    """Errors of the rows of `x` and the reading, as `weight_fusion` says; None for None.

    Raises:
        InvalidParameter: `weight_fusion` is of another kind, or does not fit `x`.
        NumericalError: A column cannot be described by an ARIMA model.
    """
    if fusion is None:
        return None
    if isinstance(fusion, str):
        fusion = WeightFusion(reading=fusion)
    if not isinstance(fusion, WeightFusion):
        raise InvalidParameter(
            f"weight_fusion: expected None, 'components', 'literal' or a WeightFusion, got {fusion!r}", "Domain"
        )
    if fusion.reading not in ("components", "literal"):
        raise InvalidParameter(
            f"weight_fusion: expected the reading 'components' or 'literal', got {fusion.reading!r}", "Domain"
        )
    if fusion.errors is not None:
        return vector("weight_fusion errors", fusion.errors, x.shape[0]), fusion.reading
    if len(fusion.order) != 3:
        raise InvalidParameter(f"weight_fusion order: expected (p, d, q), got {fusion.order!r}", "Shape")
    p, d, q = (count("weight_fusion order", number, 0) for number in fusion.order)
    given = [x.shape[0]] if fusion.lengths is None else list(fusion.lengths)
    lengths = [count("weight_fusion lengths", length, 1) for length in given]
    if sum(lengths) != x.shape[0]:
        raise InvalidParameter(
            f"weight_fusion lengths: expected a sum of {x.shape[0]} rows, got {sum(lengths)}", "Shape"
        )
    return _native.arima_errors(x, lengths, (p, d, q)), fusion.reading
