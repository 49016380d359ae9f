"""From which side a labelled person is seen: what a data set holds too little of is shown more often."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .skeleton import PARTS
from .targets import State

UPPER_ARM_PER_TORSO = 0.65
"""Upper arm over torso (shoulder joint to hip joint): 0.186 over 0.288 of the body height (Winter, 2009)."""

_RIGHT, _LEFT = PARTS.index("right_shoulder"), PARTS.index("left_shoulder")


def _lengths(joints_px: NDArray[np.float32], known: NDArray[np.bool_], joint: str) -> Iterator[float]:
    """Distances of both shoulders to their side's joint, where both ends are known."""
    for side, shoulder in (("right", _RIGHT), ("left", _LEFT)):
        end = PARTS.index(f"{side}_{joint}")
        if known[shoulder] and known[end]:
            yield float(np.hypot(*(joints_px[shoulder] - joints_px[end])))


def from_behind(joints_px: NDArray[np.float32], states: NDArray[np.int64]) -> bool:
    """Whether the first person `(people, 18, 2)` shows the back: the right shoulder lies to the right of the left one, by
    more than a fifth of the shoulders' distance or of the longer upper arm."""
    known, joints = _known(states[0]), joints_px[0]
    if not (known[_RIGHT] and known[_LEFT]):
        return False
    width = float(np.hypot(*(joints[_RIGHT] - joints[_LEFT])))
    return bool(joints[_RIGHT, 0] - joints[_LEFT, 0] > 0.2 * max(width, *_lengths(joints, known, "elbow"), 0.0))


def from_the_side(joints_px: NDArray[np.float32], states: NDArray[np.int64]) -> bool:
    """Whether the first person `(people, 18, 2)` is seen from the side: the shoulders lie less than 0.3 of an upper arm apart
    across the picture, 70 to 80 degrees off the frontal view. The upper arm is the longest that is seen, or that which the
    torso makes likely; without either the view is not known."""
    known, joints = _known(states[0]), joints_px[0]
    arms = [*_lengths(joints, known, "elbow"), *(UPPER_ARM_PER_TORSO * t for t in _lengths(joints, known, "hip"))]
    return bool(known[_RIGHT] and known[_LEFT] and arms and abs(joints[_RIGHT, 0] - joints[_LEFT, 0]) < 0.3 * max(arms))


def _known(states: NDArray[np.int64]) -> NDArray[np.bool_]:
    return (states == State.LABELLED) | (states == State.HIDDEN)
