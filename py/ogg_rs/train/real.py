"""Real recordings as judges: reference keypoints, labelled crops, and labels set by hand.

Three sources, none of them ever trained on:

- *reference*: a folder with `camNN.mp4` and `reference2d.csv` (camera, frame, and `rsho_u_px`, `rsho_v_px`, `relb_...` to `lwri_v_px`):
  both arms triangulated from several views and projected back;
- *crops*: an `.npz` with `C (n, h, w, 3)` BGR pictures, `U (n, 8, 2)` joints, `T (n,)` torso lengths and `tag (n,)` subjects;
- *hand*: `data/hand_labels.csv`, places set one by one by looking at enlarged frames of public recordings.

In a recording the network looks twice at a frame, as a tracker does: at the whole frame or where the person was in the last one, then at
the square around what it found. No label takes part in this.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from . import augment
from .coco import COCO_CENTRE_PX
from .evaluate import FLOOR, decode_single
from .seen import best_person
from .skeleton import ARM_PARTS, PARTS

HAND_LABELS = Path(__file__).parent / "data" / "hand_labels.csv"
CROP_PARTS = ("nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist")
_COLUMNS = {
    f"{short}{joint}": f"{side}_{name}"
    for short, side in (("r", "right"), ("l", "left"))
    for joint, name in (("sho", "shoulder"), ("elb", "elbow"), ("wri", "wrist"))
}
Found = NDArray[np.float64]
"""Joints `(18, 3)`: x, y in continuous pixels of the picture, and the peak."""
Answer = Callable[[Image.Image], Found]
"""From an upright picture to the joints of its main person."""


@dataclass(frozen=True)
class Judged:
    """One labelled picture: true joints by name, the torso length, and who it is."""

    image: Image.Image
    truth: dict[str, NDArray[np.float64]]
    torso_px: float
    subject: str
    window: tuple[float, float, float] | None = None
    """Square `x, y, side` to look at; `None` to find the person."""


def map_answer(run: object, size: tuple[int, int], normalise: object, stride: int) -> Answer:
    """The highest peak of each part map of a network with maps."""
    import torch

    def answer(image: Image.Image) -> Found:
        pixels, (scale, dx, dy) = augment.letterboxed(image, size, pad=int(normalise.mean))
        maps = run(normalise(torch.from_numpy(pixels[None])).contiguous().numpy())[0]
        found = decode_single(maps, stride=stride)[0].astype(np.float64)
        found[:, :2] = (found[:, :2] - (dx, dy)) / scale
        return found

    return answer


def people_answer(model: Path, *, mirror: bool = False) -> Answer:
    """The best person as the daemon finds them: peaks joined by limbs; needs the installed wheel."""
    card = model.with_suffix(".toml")
    if not card.is_file():
        raise FileNotFoundError(f"{card}: expected the card of the network")
    seen = best_person(card, "openpose-18", mirror=mirror)

    def answer(image: Image.Image) -> Found:
        found = seen(image)
        if found is None:
            return np.zeros((len(PARTS), 3))
        return found + (COCO_CENTRE_PX, COCO_CENTRE_PX, 0)

    return answer


def square(image: Image.Image, window: tuple[float, float, float]) -> tuple[Image.Image, NDArray[np.float64]]:
    """The square of a picture, at most 512 pixels, with what lies outside repeated from its edge; and `x, y, scale` of it."""
    x, y, side = window
    out = int(min(512, max(64, side)))
    box = (int(np.floor(x)), int(np.floor(y)), int(np.ceil(x + side)), int(np.ceil(y + side)))
    source = np.asarray(image)
    rows = np.clip(np.arange(box[1], box[3]), 0, source.shape[0] - 1)
    columns = np.clip(np.arange(box[0], box[2]), 0, source.shape[1] - 1)
    piece = Image.fromarray(source[rows[:, None], columns])
    inner = (x - box[0], y - box[1], x - box[0] + side, y - box[1] + side)
    return piece.resize((out, out), Image.Resampling.BOX if out < side else Image.Resampling.BILINEAR, box=inner), np.array(
        [x, y, side / out]
    )


def look(answer: Answer, image: Image.Image, window: tuple[float, float, float] | None) -> Found:
    """What a network finds in the window of a picture, in the picture's pixels."""
    if window is None:
        return answer(image)
    piece, (x, y, scale) = square(image, window)
    found = answer(piece)
    found[:, :2] = found[:, :2] * scale + (x, y)
    return found


def around(found: Found, image: Image.Image, margin: float = 1.5) -> tuple[float, float, float] | None:
    """The square around the arms, head and hips that were found, or `None` where too few were."""
    upper = [i for i, name in enumerate(PARTS) if not name.endswith(("knee", "ankle"))]
    sure = found[upper][found[upper, 2] >= 2 * FLOOR, :2]
    if len(sure) < 4:
        return None
    low, high = sure.min(0), sure.max(0)
    side = float(np.clip((high - low).max() * margin, 48, 1.2 * max(image.size)))
    x, y = (low + high) / 2 - side / 2
    return float(x), float(y), side


def twice(answer: Answer, image: Image.Image, window: tuple[float, float, float] | None) -> Found:
    """Looks at the window (or everything), then at the square around what was found there."""
    first = look(answer, image, window)
    closer = around(first, image)
    return look(answer, image, closer) if closer else first


def frames(path: Path) -> Iterator[Image.Image]:
    """All frames of a video."""
    try:
        import cv2
    except ImportError as error:
        raise ImportError(f"{error}: reading videos needs `pip install opencv-python-headless`") from error
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected a video")
    video = cv2.VideoCapture(str(path))
    while True:
        good, pixels = video.read()
        if not good:
            return
        yield Image.fromarray(np.ascontiguousarray(pixels[:, :, ::-1]))


TORSO_PER_UPPER_ARM = 1.55
"""Torso (shoulder joint to hip joint) over upper arm: 0.288 over 0.186 of the body height (Winter, 2009, after Drillis and Contini)."""


def reference_cases(folder: Path, every: int) -> Iterator[Judged]:
    """Every `every`-th frame of each camera, in order.

    The reference has no hips. The torso length is that of the longest upper arm seen in the camera (90th percentile), which is the
    one least foreshortened, times `TORSO_PER_UPPER_ARM`.
    """
    rows: dict[str, dict[int, dict[str, NDArray[np.float64]]]] = {}
    with (folder / "reference2d.csv").open() as file:
        for row in csv.DictReader(file):
            places = {
                name: np.array([float(row[f"{short}_u_px"]), float(row[f"{short}_v_px"])]) + COCO_CENTRE_PX
                for short, name in _COLUMNS.items()
            }
            rows.setdefault(row["camera"], {})[int(row["frame"])] = places
    for camera, wanted in sorted(rows.items()):
        arms = [np.linalg.norm(p[f"{s}_shoulder"] - p[f"{s}_elbow"]) for p in wanted.values() for s in ("right", "left")]
        torso = TORSO_PER_UPPER_ARM * float(np.percentile(arms, 90))
        for number, image in enumerate(frames(folder / f"{camera}.mp4")):
            if number % every == 0 and number in wanted:
                yield Judged(image, wanted[number], torso, camera)


def crop_cases(path: Path) -> list[Judged]:
    """The labelled crops; the whole crop is the window."""
    if not path.is_file():
        raise FileNotFoundError(f"{path}: expected an .npz with C, U, T and tag")
    data = np.load(path)
    cases = []
    for pixels, joints, torso, tag in zip(data["C"], data["U"], data["T"], data["tag"], strict=True):
        truth = {name: joints[k] + COCO_CENTRE_PX for k, name in enumerate(CROP_PARTS) if PARTS.index(name) in ARM_PARTS}
        image = Image.fromarray(np.ascontiguousarray(pixels[:, :, ::-1]))
        cases.append(Judged(image, truth, float(torso), str(tag).rstrip("0123456789"), (0.0, 0.0, float(image.size[0]))))
    return cases


def hand_rows(path: Path = HAND_LABELS) -> dict[tuple[str, int, str], tuple[dict[str, NDArray[np.float64]], float]]:
    """Labels set by hand: by recording, frame and person, the visible joints and the torso length."""
    people: dict[tuple[str, int, str], tuple[dict[str, NDArray[np.float64]], float]] = {}
    with path.open() as file:
        for row in csv.DictReader(file):
            key = (row["recording"], int(row["frame"]), row["person"])
            joints, _ = people.setdefault(key, ({}, float(row["torso_px"])))
            joints[row["joint"]] = np.array([float(row["x_px"]), float(row["y_px"])]) + COCO_CENTRE_PX
    return people


def hand_cases(recordings: Path) -> list[Judged]:
    """The frames labelled by hand that are in `recordings`. Several people share some of them, so the square to look at is given: it
    comes from the labels, twice as wide as they are."""
    people = hand_rows()
    pictures: dict[tuple[str, int], Image.Image] = {}
    for name in sorted({key[0] for key in people}):
        wanted = {frame for recording, frame, _ in people if recording == name}
        path = recordings / name
        if not path.is_file():
            continue
        source = [Image.open(path).convert("RGB")] if path.suffix == ".jpg" else frames(path)
        pictures.update({(name, i): image for i, image in enumerate(source) if i in wanted})
    cases = []
    for (name, frame, person), (truth, torso) in people.items():
        if (name, frame) not in pictures:
            continue
        places = np.stack(list(truth.values()))
        side = max(2.0 * float(np.ptp(places, axis=0).max()), 2.4 * torso)
        x, y = (places.min(0) + places.max(0)) / 2 - side / 2
        subject = f"{Path(name).parts[0]} {person}"
        cases.append(Judged(pictures[name, frame], truth, torso, subject, (float(x), float(y), side)))
    return cases


@dataclass
class Tally:
    """Errors over the torso length of one joint name of both sides."""

    errors: list[float]

    def pck(self, share: float) -> float:
        """Share within `share` torso lengths."""
        return float(np.mean(np.array(self.errors) <= share)) if self.errors else float("nan")


def judge(pairs: list[tuple[Judged, Found]]) -> dict[str, dict[str, Tally]]:
    """Errors by subject and by shoulder, elbow, wrist; a joint below the floor is missed."""
    scores: dict[str, dict[str, Tally]] = {}
    for case, found in pairs:
        for name, place in case.truth.items():
            row = found[PARTS.index(name)]
            error = float(np.linalg.norm(row[:2] - place)) / case.torso_px if row[2] >= FLOOR else float("inf")
            for subject in (case.subject, "all"):
                scores.setdefault(subject, {}).setdefault(name.split("_")[1], Tally([])).errors.append(error)
    return scores


def lines(scores: dict[str, dict[str, Tally]]) -> str:
    """A table: subject, joint, count, PCK@0.1, PCK@0.2, median error over the torso."""
    out = [f"{'subject':24} {'joint':9} {'n':>5} {'PCK@0.1':>8} {'PCK@0.2':>8} {'median':>7}"]
    for subject in sorted(scores, key=lambda s: (s == "all", s)):
        for joint, tally in scores[subject].items():
            out.append(
                f"{subject:24} {joint:9} {len(tally.errors):5} {100 * tally.pck(0.1):7.1f}% {100 * tally.pck(0.2):7.1f}%"
                f" {np.median(tally.errors):7.3f}"
            )
    return "\n".join(out)
