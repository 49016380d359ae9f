"""People of a picture as the daemon sees them: the native estimator, picture by picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

Seen = NDArray[np.float64]
"""Joints `(n, 3)` in the order that was asked for: x, y in pixels from the centre of the first one, and the score."""


def everybody(
    card: str | Path, skeleton: str, *, weights: Sequence[str | Path] = (), threads: int = 1, mirror: bool = False
) -> Callable[[Image.Image], Seen]:
    """The network of a model card; its answer is all people `(people, n, 3)`, the surest first. Needs the installed wheel."""
    try:
        from .. import pose
    except ImportError as error:
        raise ImportError(f"{error}: the network runs in the native module: pip install ogg_rs") from error
    estimator = pose.Estimator(card, weights_dirs=weights, threads=threads, mirror=mirror)

    def answer(image: Image.Image) -> Seen:
        estimator.reset()
        people = estimator.estimate(np.asarray(image))
        return pose.convert(people.keypoints, estimator.skeleton.name, skeleton).astype(np.float64)

    return answer


def best_person(
    card: str | Path, skeleton: str, *, weights: Sequence[str | Path] = (), threads: int = 1, mirror: bool = False
) -> Callable[[Image.Image], Seen | None]:
    """The surest person of `everybody`, `None` where there is nobody."""
    people = everybody(card, skeleton, weights=weights, threads=threads, mirror=mirror)

    def answer(image: Image.Image) -> Seen | None:
        found = people(image)
        return found[0] if len(found) else None

    return answer
