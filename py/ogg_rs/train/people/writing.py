"""A folder of rendered people: COCO keypoints, and `extras.json` with what COCO has no place for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from tqdm import tqdm

from ..coco import COCO_CENTRE_PX
from ..files import keypoint_index, replace
from ..skeleton import COCO17, PARTS
from .look import Backgrounds
from .scene import Person, Shot, Studio

_COCO_OF_PART = [COCO17.index(name) if name in COCO17 else None for name in PARTS]
_SHOULDERS = [COCO17.index("left_shoulder"), COCO17.index("right_shoulder")]


def describe(person: Person, size: tuple[int, int]) -> dict:
    """One person's entries, in COCO's pixel coordinates."""
    shifted = person.joints_px - COCO_CENTRE_PX
    inside = ((person.joints_px >= 0) & (person.joints_px < size)).all(1) & (person.joints_m[:, 2] > 0.1)
    flags = np.where(person.visible, 2, np.where(inside, 1, 0))
    rows: list[float] = []
    for (x, y), flag in zip(shifted, flags, strict=True):
        rows += [round(float(x), 2), round(float(y), 2), int(flag)] if flag else [0.0, 0.0, 0]
    clipped = np.clip(shifted, 0, np.array(size) - 1)
    low, high = np.clip(clipped.min(0) - 12, 0, None), np.minimum(clipped.max(0) + 12, np.array(size) - 1)

    def in_parts(values: np.ndarray) -> list:
        neck = values[_SHOULDERS].mean(0)
        return [[round(float(v), 4) for v in (neck if k is None else values[k])] for k in _COCO_OF_PART]

    fabric = [PARTS[i] for i, k in enumerate(_COCO_OF_PART) if k is not None and person.under_fabric[k]]
    return {
        "annotation": {
            "category_id": 1, "iscrowd": 0, "keypoints": rows, "num_keypoints": int((flags > 0).sum()),
            "bbox": [round(float(v), 2) for v in (*low, *(high - low))], "area": round(float(np.prod(high - low)), 1),
        },
        "extra": {"keypoints18": in_parts(shifted), "keypoints18_m": in_parts(person.joints_m), "under_fabric": fabric},
    }  # fmt: skip


def write(
    root: Path, count: int, seed: int, *, size: tuple[int, int] = (288, 256), backgrounds: Path | None = None,
    second: float = 0.15, sewing: bool = False,
) -> None:  # fmt: skip
    """Renders what is missing of `count` pictures, then writes `annotations.json` and `extras.json`.

    Picture `i` depends on `(seed, i)` alone, apart from the packages and backgrounds used. With `sewing` everybody in front sits at
    a table with fabric over the hands.
    """
    for folder in ("images", "labels"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    missing = [i for i in range(count) if not (root / f"labels/{i:06}.json").is_file()]
    if missing:
        studio = Studio(size, Backgrounds(backgrounds), second=second, sewing=sewing)
        bar = tqdm(missing, desc="people", unit="img", initial=count - len(missing), total=count)
        for i in bar:
            _keep(studio.shot(np.random.default_rng((seed, 7, i))), root, i, size)
    images, annotations, extras = [], [], []
    for i in range(count):
        images.append({"id": i, "file_name": f"images/{i:06}.png", "width": size[0], "height": size[1]})
        for entry in json.loads((root / f"labels/{i:06}.json").read_text()):
            number = len(annotations)
            annotations.append({"id": number, "image_id": i, **entry["annotation"]})
            extras.append({"annotation_id": number, **entry["extra"]})
    (root / "annotations.json").write_text(json.dumps(keypoint_index(images, annotations)))
    (root / "extras.json").write_text(json.dumps({"annotations": extras}))


def _keep(shot: Shot, root: Path, i: int, size: tuple[int, int]) -> None:
    """Picture first, labels last: a label file means that both are whole."""
    people = [describe(person, size) for person in shot.people]
    inside = [p for p in people if p["annotation"]["num_keypoints"] > 0]
    replace(root / f"images/{i:06}.png", lambda part: shot.image.save(part, "PNG", compress_level=1))
    replace(root / f"labels/{i:06}.json", lambda part: part.write_text(json.dumps(inside)))


__all__ = ["describe", "write"]
