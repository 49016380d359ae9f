"""Keypoints of people in pictures: training targets, decoding, networks, evaluation, and the orders of keypoints.

Points are in picture coordinates in pixels: u to the right, v down, (0, 0) is the centre of the top left pixel. Maps are
float32, `(batch, channels, rows, columns)`; batches are spread over threads with the interpreter released.

>>> import numpy as np
>>> from ogg_rs import pose
>>> joints = np.zeros((1, 1, 18, 2), np.float32)
>>> joints[0, 0, 3:5] = [[11.5, 11.5], [43.5, 11.5]]  # right elbow and wrist
>>> states = np.full((1, 1, 18), pose.State.OUTSIDE, np.uint8)
>>> states[0, 0, 3:5] = pose.State.LABELLED
>>> maps = pose.encode_targets(joints, states, [[[0, 0, 63, 63]]], size=(64, 64))
>>> maps.pcm.shape, maps.paf.shape, float(maps.pcm[0, 4, 1, 5])
((1, 19, 8, 8), (1, 38, 8, 8), 1.0)
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arrays import count, floats, real
from ._evaluation import COCO_17_SIGMAS, KeypointScores, evaluate_keypoints
from ._network import BUILTIN_CARDS, Estimator, People
from ._skeletons import SKELETONS, Limb, Skeleton, convert, known_skeleton
from .errors import InvalidParameter

__all__ = [
    "BUILTIN_CARDS",
    "COCO_17_SIGMAS",
    "LIMBS",
    "SKELETONS",
    "Estimator",
    "KeypointScores",
    "People",
    "Skeleton",
    "State",
    "TargetMaps",
    "convert",
    "decode",
    "encode_targets",
    "evaluate_keypoints",
    "fuse_labels",
]

MapArray = NDArray[np.float32]
MaskArray = NDArray[np.bool_]

def _published() -> tuple[tuple[int, int, int, int], ...]:
    return tuple(_native.published_limbs())


LIMBS: tuple[Limb, ...] = tuple(
    (limb[0], limb[1]) for limb in sorted(_published(), key=lambda limb: limb[2])
)
"""Limbs of `openpose-18` in the order of the affinity channels: limb `l` has the channels `2 l` (u) and `2 l + 1` (v)."""


class State(IntEnum):
    """What is known of a joint of a person."""

    UNKNOWN = 0
    """Nobody knows where it is, or whether it is in the picture."""
    HIDDEN = 1
    """Its place is known, but the network is not asked for it."""
    OUTSIDE = 2
    """Not in the picture, or there is no such person."""
    LABELLED = 3
    """Its place is known and is to be learnt, covered or not."""


class TargetMaps(NamedTuple):
    """Targets of a batch of `b` pictures: maps of float32 and masks of bool.

    Attributes:
        pcm: Part confidence maps and the background, `(b, joints + 1, h, w)`.
        paf: Part affinity fields, `(b, 2 limbs, h, w)`.
        pcm_mask: Where `pcm` counts, of the same shape.
        paf_mask: Where `paf` counts, of the same shape.
    """

    pcm: MapArray
    paf: MapArray
    pcm_mask: MaskArray
    paf_mask: MaskArray


def _singles(what: str, values: ArrayLike) -> MapArray:
    """`values` as C-contiguous, aligned float32; the same object if it already is one."""
    if type(values) is np.ndarray and values.dtype == np.float32:
        flags = values.flags
        if flags.c_contiguous and flags.aligned:
            return values
    with np.errstate(over="ignore"):
        return np.require(floats(what, values), np.float32, ("C", "A"))


def _mask(what: str, values: ArrayLike) -> MaskArray:
    """`values` as C-contiguous bool; nothing else is taken for a yes or a no."""
    given = np.asarray(values)
    if given.dtype != np.bool_:
        raise InvalidParameter(f"{what}: expected bool, got {given.dtype}", "Domain")
    return np.require(given, requirements="C")


def _channel_limbs(skeleton: Skeleton, limbs: Sequence[Limb] | None) -> list[tuple[int, int, int, int]]:
    if limbs is None:
        limbs = [(a, b) for a, b in LIMBS if max(a, b) < len(skeleton.parts)]
        if skeleton.name not in ("openpose-18", "upper-limb-8"):
            raise InvalidParameter(f"limbs: expected pairs of keypoints for {skeleton.name}, got None", "Missing")
    pairs = []
    for slot, limb in enumerate(limbs):
        if len(limb) != 2:
            raise InvalidParameter(f"limbs: expected pairs of keypoints, got {limb!r}", "Shape")
        pairs.append((count("limbs", limb[0], 0), count("limbs", limb[1], 0), 2 * slot, 2 * slot + 1))
    return pairs


def encode_targets(
    joints_px: ArrayLike,
    states: ArrayLike,
    boxes_px: ArrayLike,
    *,
    size: tuple[int, int],
    skeleton: str = "openpose-18",
    limbs: Sequence[Limb] | None = None,
    stride: int = 8,
    sigma_px: float = 7.0,
    half_width_px: float = 8.0,
) -> TargetMaps:
    """Targets and masks of a batch, spread over threads with the interpreter released.

    A map is `(size[1] / stride, size[0] / stride)`; the centre of its cell `k` is at `stride (k + 1/2) - 1/2` px. Arrays
    that are float32 (`states`: uint8) and C-contiguous are not copied.

    Args:
        joints_px: u and v of every joint, `(b, people, joints, 2)`; not read where the state is unknown or outside.
        states: `(b, people, joints)` of `State`.
        boxes_px: Left, top, right and bottom of every person, `(b, people, 4)`.
        size: Width and height of the pictures, multiples of `stride`.
        skeleton: Order of the joints.
        limbs: Pairs of joints in the order of the affinity channels; by default `LIMBS`, as far as the order has them.
        stride: Pixels per cell.
        sigma_px: Deviation of a confidence map.
        half_width_px: Half the width of a limb.

    Raises:
        InvalidParameter: A shape does not fit, a labelled place is not finite, or a setting is out of its interval.
    """
    order = known_skeleton(skeleton)
    joints = _singles("joints_px", joints_px)
    boxes = _singles("boxes_px", boxes_px)
    given = np.asarray(states)
    if given.dtype.kind not in "iu" or (given.size and (given.min() < 0 or given.max() > 3)):
        raise InvalidParameter("states: expected whole numbers 0 to 3 (State)", "Domain")
    flags = np.require(given, np.uint8, "C")
    if flags.ndim != 3 or joints.shape != (*flags.shape, 2) or boxes.shape != (*flags.shape[:2], 4):
        raise InvalidParameter(
            "joints_px, states, boxes_px: expected (b, people, joints, 2), (b, people, joints) and (b, people, 4), "
            f"got {joints.shape}, {flags.shape} and {boxes.shape}",
            "Shape",
        )
    if len(size) != 2:
        raise InvalidParameter(f"size: expected (width, height), got {size!r}", "Shape")
    return TargetMaps(
        *_native.encode_targets(
            joints,
            flags,
            boxes,
            skeleton=skeleton,
            limbs=_channel_limbs(order, limbs),
            width=count("size", size[0], 1),
            height=count("size", size[1], 1),
            stride=count("stride", stride, 1),
            sigma_px=real("sigma_px", sigma_px),
            half_width_px=real("half_width_px", half_width_px),
        )
    )


def fuse_labels(
    labels: TargetMaps, teacher_pcm: ArrayLike, teacher_paf: ArrayLike, *, floor: float = 0.1
) -> TargetMaps:
    """Labels corrected by a teacher's maps (paper, equation 3), in new arrays.

    `S_LC = max(S*, S_T)` per cell, `S_T` cut to 0..1; `L_LC` is whichever of `L*` and `L_T` has the larger 2-norm, per
    cell and limb. The background follows from the fused joints. A cell that the mask leaves out counts again where the
    teacher answers with at least `floor`.

    Args:
        labels: What `encode_targets` returned, `(b, ...)` each.
        teacher_pcm: `(b, joints + 1, h, w)`.
        teacher_paf: `(b, 2 limbs, h, w)`.
        floor: Smallest answer that counts.

    Raises:
        InvalidParameter: The teacher's maps have another shape, or a mask is not of bool.
    """
    own_pcm, own_paf = _singles("labels.pcm", labels[0]), _singles("labels.paf", labels[1])
    pcm_mask, paf_mask = _mask("labels.pcm_mask", labels[2]), _mask("labels.paf_mask", labels[3])
    other_pcm, other_paf = _singles("teacher_pcm", teacher_pcm), _singles("teacher_paf", teacher_paf)
    shapes = [array.shape for array in (own_pcm, own_paf, pcm_mask, paf_mask, other_pcm, other_paf)]
    same = shapes[0] == shapes[2] == shapes[4] and shapes[1] == shapes[3] == shapes[5]
    pcm, paf = shapes[0], shapes[1]
    if len(pcm) != 4 or len(paf) != 4 or not same or pcm[0] != paf[0] or pcm[2:] != paf[2:] or paf[1] % 2:
        raise InvalidParameter(
            f"labels and teacher: expected (b, joints + 1, h, w) and (b, 2 limbs, h, w) of one size, got {shapes}",
            "Shape",
        )
    least = real("floor", floor)
    return TargetMaps(*_native.fuse_labels(own_pcm, own_paf, pcm_mask, paf_mask, other_pcm, other_paf, least))


def decode(
    pcm: ArrayLike,
    paf: ArrayLike,
    *,
    skeleton: str = "openpose-18",
    limbs: Sequence[tuple[int, int, int, int]] | None = None,
    stride: int = 8,
    peak_threshold: float = 0.1,
    paf_threshold: float = 0.05,
    min_score: float = 0.1,
) -> People | list[People]:
    """People in a network's maps, in px of its input; the interpreter is released meanwhile.

    Args:
        pcm: Part confidence maps, `(joints or more, h, w)`, or a batch `(b, joints or more, h, w)`.
        paf: Part affinity fields, `(2 limbs or more, h, w)`, or a batch.
        skeleton: Order of the confidence maps.
        limbs: `(from, to, u channel, v channel)` in the order of assembly; by default the published limbs, arms first.
        stride: Pixels per cell.
        peak_threshold: A maximum below this is no keypoint, 0 to 1.
        paf_threshold: A field below this does not support a limb, 0 to 1.
        min_score: Keypoints below this are left out, 0 to 1.

    Returns:
        The people of the picture, or a list of them for a batch.

    Raises:
        InvalidParameter: A shape does not fit, or a number is not finite.
    """
    order = known_skeleton(skeleton)
    if limbs is None:
        if skeleton not in ("openpose-18", "upper-limb-8"):
            raise InvalidParameter(f"limbs: expected limbs for {skeleton}, got None", "Missing")
        channels = {limb: slot for slot, limb in enumerate(_channel_pairs(order))}
        limbs = [
            (a, b, 2 * channels[a, b], 2 * channels[a, b] + 1) for a, b, _, _ in _published() if (a, b) in channels
        ]
    chosen = []
    for limb in limbs:
        if len(limb) != 4:
            raise InvalidParameter(f"limbs: expected (from, to, u channel, v channel), got {limb!r}", "Shape")
        a, b, u, v = (count("limbs", number, 0) for number in limb)
        chosen.append((a, b, u, v))
    heat, field = _singles("pcm", pcm), _singles("paf", paf)
    if heat.ndim not in (3, 4) or field.ndim != heat.ndim or heat.shape[:-3] != field.shape[:-3]:
        raise InvalidParameter(
            f"pcm, paf: expected (joints + 1, h, w) and (2 limbs, h, w), or batches of them, "
            f"got {heat.shape} and {field.shape}",
            "Shape",
        )
    for what, array in (("pcm", heat), ("paf", field)):
        if not np.isfinite(array).all():
            raise InvalidParameter(f"{what}: expected finite numbers", "NotFinite")
    thresholds = {"peak_threshold": peak_threshold, "paf_threshold": paf_threshold, "min_score": min_score}
    for what, value in thresholds.items():
        if not real(what, value) <= 1.0:
            raise InvalidParameter(f"{what}: expected a number in [0, 1], got {value!r}", "Domain")
    settings: dict[str, Any] = {"skeleton": skeleton, "limbs": chosen, "stride": count("stride", stride, 1)}
    settings |= {what: float(value) for what, value in thresholds.items()}
    if heat.ndim == 3:
        return People(*_native.decode(heat, field, **settings))
    return [People(*_native.decode(h, f, **settings)) for h, f in zip(heat, field, strict=True)]


def _channel_pairs(skeleton: Skeleton) -> list[Limb]:
    return [(a, b) for a, b in LIMBS if max(a, b) < len(skeleton.parts)]
