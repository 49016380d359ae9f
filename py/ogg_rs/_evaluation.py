"""Average precision of keypoints."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from . import _native
from ._arrays import FloatArray, batch, count, floats
from .errors import DeviceError, InvalidParameter, OggError

COCO_17_SIGMAS: tuple[float, ...] = tuple(_native.coco_sigmas())
"""Deviations of human labels of COCO's keypoints, as fractions of the square root of the area."""


class KeypointScores(NamedTuple):
    """COCO's ten numbers; NaN where no label is of the size.

    Attributes:
        ap: Average precision over similarities 0.50 to 0.95.
        ap_50: At similarity 0.50.
        ap_75: At similarity 0.75.
        ap_medium: Of people of 32^2 to 96^2 px^2.
        ap_large: Of larger people.
        ar: Average recall over the same similarities.
        ar_50: At similarity 0.50.
        ar_75: At similarity 0.75.
        ar_medium: Of people of 32^2 to 96^2 px^2.
        ar_large: Of larger people.
    """

    ap: float
    ap_50: float
    ap_75: float
    ap_medium: float
    ap_large: float
    ar: float
    ar_50: float
    ar_75: float
    ar_medium: float
    ar_large: float


def evaluate_keypoints(
    gt: str | os.PathLike[str] | Mapping[str, Any] | Sequence[Mapping[str, Any]],
    dt: str | os.PathLike[str] | Sequence[Mapping[str, Any]],
    *,
    sigmas: Sequence[float] = COCO_17_SIGMAS,
    keypoints: Sequence[int] | None = None,
    visibility: int | None = None,
    max_detections: int = 20,
) -> KeypointScores:
    """Average precision and recall of detected keypoints, as pycocotools computes them.

    Args:
        gt: Labels in COCO's format: a file, its content, or its list of annotations (`image_id`, `keypoints`, `bbox`,
            `area`, `iscrowd`).
        dt: Detections in COCO's result format: a file or its list (`image_id`, `keypoints`, `score`).
        sigmas: Deviation of each keypoint, as a fraction of the square root of the area.
        keypoints: Keypoints that count; None for all.
        visibility: 1 counts covered keypoints only, 2 visible ones only; None counts both.
        max_detections: Detections per picture that count, best first.

    Raises:
        DeviceError: A file cannot be read.
        InvalidParameter: A key is missing, or a number of keypoints is another than that of `sigmas`.

    >>> label = {"image_id": 1, "keypoints": [10.0, 20.0, 2] * 17, "bbox": [0, 0, 50, 90], "area": 4000.0, "iscrowd": 0}
    >>> found = {"image_id": 1, "keypoints": [10.0, 20.0, 1] * 17, "score": 0.9}
    >>> evaluate_keypoints([label], [found]).ap.__round__(9)
    1.0
    """
    content = _json("gt", gt)
    annotations = content.get("annotations") if isinstance(content, Mapping) else content
    results = _json("dt", dt)
    for what, rows in (("gt", annotations), ("dt", results)):
        if not isinstance(rows, Sequence) or isinstance(rows, str):
            raise InvalidParameter(f"{what}: expected a list of objects, got {type(rows).__name__}", "Type")
    labels, found = list(annotations or ()), list(results or ())
    n = len(sigmas)
    try:
        boxes = [[*_field("gt", a, "bbox"), _field("gt", a, "area")] for a in labels]
        places = np.array(boxes, float).reshape((len(labels), -1 if labels else 5))
        numbers = _native.evaluate_keypoints(
            [count("image_id", _field("gt", a, "image_id"), 0) for a in labels],
            _points("gt", labels, n, 3),
            batch("bbox and area", places, (5,))[0],
            [bool(a.get("iscrowd", 0)) for a in labels],
            [count("image_id", _field("dt", a, "image_id"), 0) for a in found],
            np.ascontiguousarray(_points("dt", found, n, 3)[:, :, :2]),
            [float(_field("dt", a, "score")) for a in found],
            sigmas=[float(sigma) for sigma in sigmas],
            keypoints=None if keypoints is None else [count("keypoints", i, 0) for i in keypoints],
            visibility=None if visibility is None else count("visibility", visibility, 1),
            max_detections=count("max_detections", max_detections, 1),
        )
    except OggError:
        raise
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidParameter(f"gt, dt: {error}", "Type") from error
    return KeypointScores(*(np.nan if value is None else value for value in numbers))


def _json(what: str, given: Any) -> Any:
    if not isinstance(given, str | os.PathLike):
        return given
    try:
        with open(given, encoding="utf-8") as stream:
            return json.load(stream)
    except OSError as error:
        raise DeviceError(f"{os.fspath(given)}: {error.strerror}", "File", str(error)) from error
    except ValueError as error:
        raise InvalidParameter(f"{what}: {os.fspath(given)}: {error}", "Syntax") from error


def _field(what: str, row: Any, key: str) -> Any:
    if not isinstance(row, Mapping) or key not in row:
        raise InvalidParameter(f"{what}: expected objects with {key!r}, got {row!r:.80}", "Missing")
    return row[key]


def _points(what: str, rows: list[Any], joints: int, each: int) -> FloatArray:
    out = np.empty((len(rows), joints, each))
    for place, row in enumerate(rows):
        numbers = floats(f"{what} keypoints", _field(what, row, "keypoints"))
        if numbers.size != joints * each:
            raise InvalidParameter(f"{what} keypoints: expected {joints * each} numbers, got {numbers.size}", "Shape")
        out[place] = numbers.reshape((joints, each))
    return out
