"""Reader for pictures with keypoints in COCO's format, and for what a rendering knows beyond it.

`annotations.json` is an ordinary COCO keypoint file (17 keypoints `x, y, v`; v = 0 unlabelled, 1 labelled but
covered, 2 visible). COCO counts pixels from the centre of the top left one; the training code counts from its corner,
so 0.5 is added here and nowhere else.

`extras.json`, where present beside it, gives the true place of every joint of a rendered person in OpenPose-18 order.
It turns "unlabelled" into "hidden, at a known place", and is what the label rules need:

- v = 2: labelled; v = 1: labelled too, unless a rendering says so of a joint that is no arm joint: then it is hidden;
- v = 0 with a known place inside the picture: an arm joint is labelled (fabric may cover it, its place is exact),
  any other joint is hidden;
- v = 0 without a known place: unknown; crowds are unknown whole.

The neck is the middle of the shoulders and labelled when both are.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from .augment import Sample
from .skeleton import ARM_PARTS, COCO17, NECK, OPENPOSE18, PARTS, Skeleton
from .targets import State

People = tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.float32]]
"""Of a picture: joints `(n, parts, 2)` in pixels, states `(n, parts)` and boxes `(n, 4)`."""

COCO_CENTRE_PX = 0.5
"""From COCO's pixel coordinates (centre of the first pixel) to continuous ones (its corner)."""

_FROM_COCO = {coco: PARTS.index(name) for coco, name in enumerate(COCO17)}
_SHOULDERS = (PARTS.index("right_shoulder"), PARTS.index("left_shoulder"))


def _states_from_coco(flags: NDArray[np.int64]) -> NDArray[np.int64]:
    """States of the 18 parts from 17 COCO visibility flags, without further knowledge."""
    states = np.full(len(PARTS), State.UNKNOWN, np.int64)
    for coco, part in _FROM_COCO.items():
        states[part] = State.LABELLED if flags[coco] > 0 else State.UNKNOWN
    return states


def person(annotation: dict, places: NDArray[np.float32] | None, size: tuple[int, int]) -> tuple[
    NDArray[np.float32], NDArray[np.int64], NDArray[np.float32]
]:
    """Joints `(18, 2)` in continuous pixels, states `(18,)` and the box `(4,)` of one COCO annotation.

    `places (18, 2)` are true places in COCO's pixels, NaN where there is none.
    """
    x, y, w, h = annotation["bbox"]
    box = np.array([x, y, x + w, y + h], np.float32) + np.float32(COCO_CENTRE_PX)
    joints = np.zeros((len(PARTS), 2), np.float32)
    flat = annotation.get("keypoints") or [0] * 51
    if len(flat) != 51:
        raise ValueError(f"annotation {annotation.get('id')}: expected 51 keypoint numbers, got {len(flat)}")
    rows = np.array(flat, np.float32).reshape(17, 3)
    states = _states_from_coco(rows[:, 2].astype(np.int64))
    for coco, part in _FROM_COCO.items():
        joints[part] = rows[coco, :2]
    if places is not None:
        covered = np.ones(len(PARTS), bool)
        covered[list(_FROM_COCO.values())] = rows[list(_FROM_COCO), 2] < 2
        known = np.isfinite(places).all(1) & covered
        joints[known] = places[known]
        arms = np.isin(np.arange(len(PARTS)), ARM_PARTS)
        states[known & arms] = State.LABELLED
        states[known & ~arms] = State.HIDDEN
    joints[NECK] = joints[list(_SHOULDERS)].mean(0)
    states[NECK] = min(int(states[i]) for i in _SHOULDERS)
    joints += np.float32(COCO_CENTRE_PX)
    outside = (joints < 0).any(1) | (joints >= np.array(size)).any(1)
    states[outside & (states != State.UNKNOWN)] = State.OUTSIDE
    if annotation.get("iscrowd"):
        states[:] = State.UNKNOWN
    return joints, states, box


class CocoKeypoints:
    """Pictures of one folder with their people.

    `root` holds the annotation file; picture paths in it are relative to `images` (default: `root`). Decoded pictures
    are kept in one file beside the annotations when all have one size (`cache`), so that an epoch reads and decodes
    nothing.
    """

    def __init__(
        self,
        root: Path,
        *,
        annotations: str = "annotations.json",
        images: Path | None = None,
        skeleton: Skeleton = OPENPOSE18,
        cache: bool = True,
    ) -> None:
        self.root = Path(root)
        self.images = Path(images) if images else self.root
        path = self.root / annotations
        try:
            index = json.loads(path.read_text())
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{path}: expected a COCO keypoint file") from error
        extras_path = self.root / "extras.json"
        extras = json.loads(extras_path.read_text())["annotations"] if extras_path.is_file() else []
        places = _places_of(extras)
        self._fabric = {entry["annotation_id"]: entry.get("under_fabric", []) for entry in extras}
        self._places = places
        self._parts = [PARTS.index(name) for name in skeleton.parts]
        by_image: dict[int, list[dict]] = {}
        for annotation in index["annotations"]:
            by_image.setdefault(annotation["image_id"], []).append(annotation)
        self.records = [image for image in index["images"] if image["id"] in by_image]
        self.people: list[People] = []
        for image in self.records:
            size = (image["width"], image["height"])
            people = [person(a, places.get(a["id"]), size) for a in by_image[image["id"]]]
            joints, states, boxes = (np.stack(column) for column in zip(*people, strict=True))
            self.people.append((joints, states, boxes))
        self._by_image = by_image
        self._pixels = self._cached() if cache else None

    def visible(self, i: int) -> NDArray[np.bool_]:
        """Which joints `(people, 18)` are marked visible (v = 2); the neck where both shoulders are."""
        rows = np.zeros((len(self._by_image[self.records[i]["id"]]), len(PARTS)), bool)
        for row, annotation in zip(rows, self._by_image[self.records[i]["id"]], strict=True):
            flags = np.array(annotation["keypoints"]).reshape(17, 3)[:, 2] == 2
            for coco, part in _FROM_COCO.items():
                row[part] = flags[coco]
            row[NECK] = row[list(_SHOULDERS)].all()
        return rows

    def under_fabric(self) -> list[NDArray[np.bool_]]:
        """By picture: which joints `(18,)` of its first person lie under fabric, as far as the rendering says."""
        names = [self._fabric.get(self._by_image[record["id"]][0]["id"], []) for record in self.records]
        return [np.isin(PARTS, covered) for covered in names]

    def torso_px(self, i: int, person: int = 0) -> float:
        """Mean distance of a person's shoulders to the hips, from true places where they are known; of one side
        where only that one has both ends, NaN where neither has."""
        joints, states, _ = (column[person] for column in self.people[i])
        places = self._places.get(self._by_image[self.records[i]["id"]][person]["id"])
        if places is None:
            places = np.where((states == State.UNKNOWN)[:, None], np.float32(np.nan), joints)
        sides = ((PARTS.index(f"{s}_shoulder"), PARTS.index(f"{s}_hip")) for s in ("right", "left"))
        lengths = [np.linalg.norm(places[a] - places[b]) for a, b in sides]
        known = [length for length in lengths if np.isfinite(length)]
        return float(np.mean(known)) if known else float("nan")

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, i: int) -> Sample:
        joints, states, boxes = self.people[i]
        return Sample(self.image(i), joints[:, self._parts], states[:, self._parts], boxes)

    def image(self, i: int) -> Image.Image:
        """Picture `i`, RGB."""
        if self._pixels is not None:
            return Image.fromarray(self._pixels[i])
        return Image.open(self.images / self.records[i]["file_name"]).convert("RGB")

    def _cached(self) -> NDArray[np.uint8] | None:
        sizes = {(image["width"], image["height"]) for image in self.records}
        if len(sizes) != 1:
            return None
        width, height = sizes.pop()
        path = self.root / f".pixels-{len(self.records)}x{height}x{width}.npy"
        if not path.is_file():
            unfinished = path.with_suffix(".part")
            store = np.lib.format.open_memmap(unfinished, "w+", np.uint8, (len(self.records), height, width, 3))
            for i, record in enumerate(tqdm(self.records, desc="decoding pictures", unit="img")):
                with Image.open(self.images / record["file_name"]) as image:
                    store[i] = np.asarray(image.convert("RGB"))
            store.flush()
            del store
            unfinished.rename(path)
        return np.load(path, mmap_mode="r")


def _places_of(extras: list[dict]) -> dict[int, NDArray[np.float32]]:
    """True joint places by annotation id, from entries `{"annotation_id", "keypoints18": [[u, v], ...]}`."""
    return {
        entry["annotation_id"]: np.array([[np.nan, np.nan] if p is None else p[:2] for p in entry["keypoints18"]], np.float32)
        for entry in extras
    }
