"""Labels from a network that is there already: pictures or videos in, a COCO keypoint folder out.

A teacher is right where it is sure, and a network is surest of what it sees twice the same way. Each picture is shown to the
teacher as it is and mirrored; a joint is labelled where both answers score at least `FLOOR` and lie within `TOLERANCE` torso
lengths of each other, at their middle. Every other joint stays unlabelled, which `fit` leaves out of the loss inside the person's box:
a doubtful joint teaches neither a place nor an absence.

The best person of each picture is labelled, searched for and looked at closely as the teacher's card says. Show it pictures of one
person: a second one would be taught as background.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from .coco import COCO_CENTRE_PX
from .files import keypoint_index, replace
from .real import TORSO_PER_UPPER_ARM, frames, square
from .skeleton import COCO17

FLOOR = 0.3
"""Smallest score of a labelled joint, in both views."""

TOLERANCE = 0.12
"""Largest distance of the two views, in torso lengths: PCK@0.1 counts what lies closer."""

LEAST_JOINTS = 6
"""A picture with fewer labelled joints is left out."""

PICTURES = (".jpg", ".jpeg", ".png", ".webp", ".bmp")
VIDEOS = (".mp4", ".mkv", ".avi", ".mov", ".webm")

_MIRROR = [COCO17.index(n.replace("left", "*").replace("right", "left").replace("*", "right")) for n in COCO17]
_SIDES = [tuple(COCO17.index(f"{side}_{joint}") for joint in ("shoulder", "elbow", "hip")) for side in ("left", "right")]
_LEGS = [i for i, name in enumerate(COCO17) if name.endswith(("knee", "ankle"))]

Joints = NDArray[np.float64]
"""`(17, 3)` in COCO's order: x, y in pixels from the centre of the first one, and the score."""


class Teacher(Protocol):
    """What answers for one picture: the best person's `Joints`, or `None` where there is nobody."""

    def __call__(self, image: Image.Image) -> Joints | None: ...


def torso_px(joints: Joints) -> float:
    """The longest of both shoulder to hip distances and both upper arms as torsos, of sure joints; NaN where none is."""
    lengths = [np.nan]
    for shoulder, elbow, hip in _SIDES:
        for end, ratio in ((hip, 1.0), (elbow, TORSO_PER_UPPER_ARM)):
            if joints[shoulder, 2] >= FLOOR and joints[end, 2] >= FLOOR:
                lengths.append(ratio * float(np.hypot(*(joints[shoulder, :2] - joints[end, :2]))))
    return float(np.nanmax(lengths)) if len(lengths) > 1 else float("nan")


def agreed(image: Image.Image, teacher: Teacher) -> Joints | None:
    """Joints on which the teacher agrees with itself about the mirrored picture; score 0 for the others."""
    seen = teacher(image)
    if seen is None:
        return None
    mirrored = teacher(image.transpose(Image.Transpose.FLIP_LEFT_RIGHT))
    if mirrored is None:
        return None
    back = mirrored[_MIRROR]
    back[:, 0] = image.size[0] - 1 - back[:, 0]
    score = np.minimum(seen[:, 2], back[:, 2])
    near = np.hypot(*(seen[:, :2] - back[:, :2]).T) <= TOLERANCE * torso_px(seen)
    joints = (seen + back) / 2
    joints[:, 2] = np.where(near & (score >= FLOOR), score, 0)
    return joints if (joints[:, 2] > 0).sum() >= LEAST_JOINTS else None


def framings(joints: Joints) -> Iterator[tuple[str, tuple[float, float, float]]]:
    """Squares `x, y, side` to keep of a picture: the whole person, and the person down to the hips."""
    for name, left_out, margin in (("whole", [], 1.3), ("upper", _LEGS, 1.5)):
        use = joints[:, 2] > 0
        use[left_out] = False
        if use.sum() < LEAST_JOINTS:
            continue
        low, high = joints[use, :2].min(0), joints[use, :2].max(0)
        side = max(32.0, float((high - low).max()) * margin)
        x, y = (low + high) / 2 - side / 2 + COCO_CENTRE_PX
        yield name, (float(x), float(y), side)


def annotation(joints: Joints, window: tuple[float, float, float], side: int) -> dict:
    """The COCO entry of a person in a square that was scaled to `side` pixels."""
    x, y, length = window
    scale = side / length
    places = (joints[:, :2] + COCO_CENTRE_PX - (x, y)) * scale - COCO_CENTRE_PX
    known = (joints[:, 2] > 0) & (places >= 0).all(1) & (places <= side - 1).all(1)
    rows = [[round(float(u), 2), round(float(v), 2), 2] if k else [0.0, 0.0, 0] for (u, v), k in zip(places, known, strict=True)]
    sure = places[joints[:, 2] > 0]
    reach = 0.15 * np.ptp(sure, axis=0).max()
    low, high = np.clip(sure.min(0) - reach, 0, side - 1), np.clip(sure.max(0) + reach, 0, side - 1)
    return {
        "category_id": 1, "iscrowd": 0, "keypoints": sum(rows, []), "num_keypoints": int(known.sum()),
        "bbox": [round(float(v), 2) for v in (*low, *(high - low))], "area": round(float(np.prod(high - low)), 1),
    }  # fmt: skip


@dataclass(frozen=True)
class Shown:
    """One picture of the input and a name for it that does not depend on where the folder lies."""

    name: str
    image: Image.Image


def shown(sources: Sequence[Path], every: int) -> Iterator[Shown]:
    """Pictures of files and folders, and every `every`-th frame of videos, by name."""
    for source in sources:
        if not source.exists():
            raise FileNotFoundError(f"{source}: expected a picture, a video or a folder of them")
        files = sorted(p for p in source.rglob("*") if p.is_file()) if source.is_dir() else [source]
        for path in files:
            name = str(path.relative_to(source.parent))
            if path.suffix.lower() in VIDEOS:
                for number, image in enumerate(frames(path)):
                    if number % every == 0:
                        yield Shown(f"{name}#{number}", image)
            elif path.suffix.lower() in PICTURES:
                with Image.open(path) as image:
                    yield Shown(name, image.convert("RGB"))


def write(root: Path, sources: Sequence[Path], teacher: Teacher, *, every: int = 1, side: int = 288) -> tuple[int, int]:
    """Labels what has none yet, then writes `annotations.json`; pictures shown and labelled.

    A picture's files are named by the first digits of its name's SHA-256; `labels/` also keeps an empty list for what the teacher is
    not sure of, so that the same command goes on where an interrupted one stopped.
    """
    for folder in ("images", "labels"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    names: dict[str, str] = {}
    for item in tqdm(shown(sources, every), desc="labelling", unit="img"):
        key = hashlib.sha256(item.name.encode()).hexdigest()[:12]
        if names.setdefault(key, item.name) != item.name:
            raise ValueError(f"{item.name}: expected one picture of that name, got two")
        label = root / f"labels/{key}.json"
        if label.is_file():
            continue
        joints = agreed(item.image, teacher)
        people = []
        for framing, window in framings(joints) if joints is not None else ():
            piece, _ = square(item.image, window)
            file = f"images/{key}-{framing}.jpg"
            piece = piece.resize((side, side), Image.Resampling.LANCZOS)
            replace(root / file, lambda part, piece=piece: piece.save(part, "JPEG", quality=92))
            people.append({"file_name": file, "source": item.name, **annotation(joints, window, side)})
        replace(label, lambda part, people=people: part.write_text(json.dumps(people)))
    entries = [entry for key in sorted(names) for entry in json.loads((root / f"labels/{key}.json").read_text())]
    images, annotations = [], []
    for number, entry in enumerate(entries):
        images.append({"id": number, "file_name": entry.pop("file_name"), "source": entry.pop("source"), "width": side, "height": side})
        annotations.append({"id": number, "image_id": number, **entry})
    (root / "annotations.json").write_text(json.dumps(keypoint_index(images, annotations)))
    return len(names), len({image["source"] for image in images})
