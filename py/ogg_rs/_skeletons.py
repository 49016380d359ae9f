"""Orders of keypoints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import FloatArray, floats
from .errors import InvalidParameter

Limb = tuple[int, int]


class Skeleton(NamedTuple):
    """An order of keypoints.

    Attributes:
        name: As model cards write it.
        parts: Names of the parts in order.
        mirror: For every keypoint, the index of the same part of the other side.
        bones: Pairs of keypoints between which a line is drawn.
    """

    name: str
    parts: tuple[str, ...]
    mirror: tuple[int, ...]
    bones: tuple[Limb, ...]

    def index(self, part: str, /) -> int:  # type: ignore[override]
        """Place of a part.

        Raises:
            InvalidParameter: This order has no such part.
        """
        if part not in self.parts:
            raise InvalidParameter(f"part: expected one of {self.parts}, got {part!r}", "Domain")
        return self.parts.index(part)


SKELETONS: dict[str, Skeleton] = {
    name: Skeleton(name, tuple(parts), tuple(mirror), tuple(bones)) for name, parts, mirror, bones in _native.skeletons()
}
"""The orders: `coco-17`, `openpose-18`, `body-25`, `mediapipe-33` and `upper-limb-8`, by name."""


def known_skeleton(skeleton: str) -> Skeleton:
    """The order of a name.

    Raises:
        InvalidParameter: There is none.
    """
    if skeleton not in SKELETONS:
        raise InvalidParameter(f"skeleton: expected one of {sorted(SKELETONS)}, got {skeleton!r}", "Domain")
    return SKELETONS[skeleton]


def convert(keypoints: ArrayLike, source: str, target: str) -> FloatArray:
    """Keypoints `(..., joints, c)` of one order in another, `(..., joints', c)`.

    A neck is the middle of the shoulders and a mid-hip that of the hips where the source lacks them; with `c = 3` its
    score is the smaller of the two. A part that the source lacks is NaN, with a score of 0.

    Raises:
        InvalidParameter: An order is not known, or the number of joints is another.

    >>> import numpy as np
    >>> coco = np.arange(34.0).reshape(17, 2)
    >>> convert(coco, "coco-17", "openpose-18")[[1, 4]].tolist()  # neck, right wrist
    [[11.0, 12.0], [20.0, 21.0]]
    """
    have, want = known_skeleton(source), known_skeleton(target)
    points = floats("keypoints", keypoints)
    if points.ndim < 2 or points.shape[-2] != len(have.parts) or points.shape[-1] not in (2, 3):
        raise InvalidParameter(f"keypoints: expected (..., {len(have.parts)}, 2 or 3), got {points.shape}", "Shape")
    out = np.full((*points.shape[:-2], len(want.parts), points.shape[-1]), np.nan)
    out[..., 2:] = 0.0
    for place, parents in enumerate(_native.skeleton_sources(target, source)):
        if parents is not None:
            a, b = (points[..., parent, :] for parent in parents)
            out[..., place, :2] = 0.5 * (a[..., :2] + b[..., :2])
            out[..., place, 2:] = np.minimum(a[..., 2:], b[..., 2:])
    return out
