"""Puppets: flat-shaded seated figures with exact joints, drawn in milliseconds.

They serve two ends: data for tests, and pretraining, where a network learns what limbs, sides and affinity fields are
before it sees slower and better pictures. A figure is a random three-dimensional skeleton before a random camera; its
limbs are drawn as shaded strokes from far to near, among random background shapes, mostly behind a bench with a
machine and pieces of fabric on the hands. Joints in OpenPose-18 order.

Frame of the figure: x forward, y to its left, z up, metres, origin between the hips.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter
from tqdm import tqdm

from .augment import Sample
from .coco import COCO_CENTRE_PX
from .skeleton import ARM_PARTS, COCO17, PARTS
from .targets import State

SIZE = (320, 240)
_PART = {name: i for i, name in enumerate(PARTS)}


def _unit(v: NDArray[np.float64]) -> NDArray[np.float64]:
    return v / max(float(np.linalg.norm(v)), 1e-9)


def _elbow(
    shoulder: NDArray[np.float64], wrist: NDArray[np.float64], upper: float, fore: float, pole: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Elbow and reachable wrist of a two-link arm whose elbow leans towards `pole`."""
    along = _unit(wrist - shoulder)
    reach = float(np.clip(np.linalg.norm(wrist - shoulder), abs(upper - fore) + 0.05, 0.99 * (upper + fore)))
    foot = (reach**2 + upper**2 - fore**2) / (2 * reach)
    side = _unit(pole - along * (pole @ along))
    return shoulder + along * foot + side * np.sqrt(max(upper**2 - foot**2, 0.0)), shoulder + along * reach


def skeleton(rng: np.random.Generator) -> NDArray[np.float64]:
    """Random seated figure: joints `(18, 3)` in its own frame, metres."""
    size = rng.uniform(0.88, 1.12)
    joints = np.zeros((len(PARTS), 3))
    lean, twist, tilt = rng.uniform(-0.1, 0.5), rng.uniform(-0.35, 0.35), rng.uniform(-0.15, 0.15)
    up = _unit(np.array([np.sin(lean), np.sin(tilt), np.cos(lean)]))
    left = _unit(np.array([-np.sin(twist), np.cos(twist), -np.sin(tilt)]))
    forward = np.cross(left, up)
    chest = up * 0.48 * size
    half = rng.uniform(0.16, 0.21) * size
    for sign, side in ((-1, "right"), (1, "left")):
        shoulder = chest + sign * half * left + up * rng.uniform(-0.02, 0.05)
        joints[_PART[f"{side}_shoulder"]] = shoulder
        reach = np.array([rng.uniform(0.05, 0.55), sign * rng.uniform(-0.25, 0.45), rng.uniform(-0.5, 0.1)]) * size
        if rng.random() < 0.12:
            reach[2] += rng.uniform(0.2, 0.7)
        pole = np.array([-0.3, sign * rng.uniform(0.1, 1.2), -1.0 + rng.uniform(0, 0.8)])
        elbow, wrist = _elbow(shoulder, shoulder + reach, 0.29 * size, 0.25 * size, pole)
        joints[_PART[f"{side}_elbow"]], joints[_PART[f"{side}_wrist"]] = elbow, wrist
        hip = np.array([0, sign * 0.1 * size, 0])
        knee = hip + _unit(np.array([1, sign * rng.uniform(0, 0.4), rng.uniform(-0.3, 0.05)])) * 0.41 * size
        joints[_PART[f"{side}_hip"]], joints[_PART[f"{side}_knee"]] = hip, knee
        joints[_PART[f"{side}_ankle"]] = knee + np.array([rng.uniform(-0.2, 0.1), 0, -1]) * 0.4 * size
    joints[_PART["neck"]] = (joints[_PART["right_shoulder"]] + joints[_PART["left_shoulder"]]) / 2
    nod, turn = rng.uniform(-0.1, 0.8), rng.uniform(-0.5, 0.5)
    gaze = _unit(forward * np.cos(turn) + left * np.sin(turn) - np.array([0, 0, np.sin(nod)]))
    across = _unit(np.cross(np.array([0, 0, 1.0]), gaze))
    crown = np.cross(gaze, across)
    head = chest + up * 0.17 * size + forward * 0.03
    for name, x, y, z in (
        ("nose", 0.115, 0, -0.02), ("right_eye", 0.09, -0.032, 0.02), ("left_eye", 0.09, 0.032, 0.02),
        ("right_ear", 0, -0.076, 0), ("left_ear", 0, 0.076, 0),
    ):  # fmt: skip
        joints[_PART[name]] = head + size * (x * gaze + y * across + z * crown)
    return joints


@dataclass(frozen=True)
class View:
    """A pinhole camera that looks at the figure; no lens errors."""

    rotation: NDArray[np.float64]
    eye: NDArray[np.float64]
    focal_px: float

    @staticmethod
    def random(rng: np.random.Generator) -> View:
        """From the front or the sides, level to steeply from above."""
        yaw, pitch, roll = rng.uniform(-1.5, 1.5), rng.uniform(0.0, 1.0), rng.uniform(-0.1, 0.1)
        distance = rng.uniform(1.1, 2.6)
        away = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        target = np.array([rng.uniform(0.0, 0.3), rng.uniform(-0.15, 0.15), rng.uniform(0.2, 0.45)])
        z = -away
        x = _unit(np.cross(z, np.array([0, 0, 1.0])))
        y = np.cross(z, x)
        x, y = np.cos(roll) * x + np.sin(roll) * y, np.cos(roll) * y - np.sin(roll) * x
        return View(np.stack((x, y, z)), target + away * distance, rng.uniform(0.75, 1.1) * SIZE[0])

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Continuous pixels `(n, 2)` and depths `(n,)` in metres."""
        local = (points - self.eye) @ self.rotation.T
        depth = np.maximum(local[:, 2], 0.1)
        return self.focal_px * local[:, :2] / depth[:, None] + np.array(SIZE) / 2, depth


def _colour(rng: np.random.Generator) -> NDArray[np.float64]:
    return rng.uniform(20, 235, 3)


def _skin(rng: np.random.Generator) -> NDArray[np.float64]:
    return np.array([224, 172, 140]) * rng.uniform(0.35, 1.1) * rng.uniform(0.92, 1.08, 3)


class _Canvas:
    """Strokes with a darker rim, which reads as roundness."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        low = rng.uniform(0, 255, (int(rng.integers(2, 7)), int(rng.integers(2, 9)), 3)).astype(np.uint8)
        self.image = Image.fromarray(low).resize(SIZE, Image.Resampling.BICUBIC if rng.random() < 0.7 else Image.Resampling.NEAREST)
        self.draw = ImageDraw.Draw(self.image)

    @staticmethod
    def fill(colour: NDArray[np.float64], light: float = 1.0) -> tuple[int, int, int]:
        r, g, b = np.clip(colour * light, 0, 255).astype(int)
        return int(r), int(g), int(b)

    def stroke(self, a: NDArray, b: NDArray, wa: float, wb: float, colour: NDArray[np.float64]) -> None:
        """Tapered limb from a (width wa) to b (width wb)."""
        along = _unit(b - a)
        across = np.array([-along[1], along[0]])
        for share, light in ((1.0, 0.72), (0.72, 0.9), (0.4, 1.06)):
            ra, rb = wa * share / 2, wb * share / 2
            shift = across * (0.12 * wa * (1 - share))
            corners = [a + across * ra, b + across * rb, b - across * rb, a - across * ra]
            fill = self.fill(colour, light)
            self.draw.polygon([tuple(c + shift) for c in corners], fill=fill)
            for centre, radius in ((a + shift, ra), (b + shift, rb)):
                self.disc(centre, radius, radius, fill)

    def disc(self, centre: NDArray, rx: float, ry: float, fill: tuple[int, int, int]) -> None:
        self.draw.ellipse((centre[0] - rx, centre[1] - ry, centre[0] + rx, centre[1] + ry), fill=fill)

    def clutter(self, count: int) -> None:
        """Random shapes of the background."""
        for _ in range(count):
            x, y = self.rng.uniform(-20, SIZE[0]), self.rng.uniform(-20, SIZE[1])
            w, h = self.rng.uniform(5, 120, 2)
            kind = self.rng.integers(0, 3)
            fill = self.fill(_colour(self.rng))
            if kind == 0:
                self.draw.rectangle((x, y, x + w, y + h), fill=fill)
            elif kind == 1:
                self.draw.ellipse((x, y, x + w, y + h), fill=fill)
            else:
                self.draw.line((x, y, *self.rng.uniform(0, SIZE[0], 2)), fill=fill, width=int(self.rng.integers(1, 16)))


def puppet(rng: np.random.Generator) -> tuple[Image.Image, NDArray[np.float32], NDArray[np.bool_]]:
    """A picture, the joints `(18, 2)` in continuous pixels, and which of them the bench covers."""
    while True:
        view = View.random(rng)
        joints = skeleton(rng)
        pixels, depth = view.project(joints)
        arms = pixels[list(ARM_PARTS)]
        if ((arms > -15) & (arms < np.array(SIZE) + 15)).all():
            break
    # In the picture the neck is the middle of the shoulders, as COCO's readers define it.
    pixels[_PART["neck"]] = (pixels[_PART["right_shoulder"]] + pixels[_PART["left_shoulder"]]) / 2
    canvas = _Canvas(rng)
    canvas.clutter(int(rng.integers(2, 14)))
    skin, shirt, trousers, hair = _skin(rng), _colour(rng), _colour(rng), rng.uniform(10, 120, 3)
    sleeve = rng.random()
    girth = rng.uniform(0.8, 1.3)

    def px(metres: float, part: int) -> float:
        return girth * metres * view.focal_px / depth[part]

    def limb(a: str, b: str, wa: float, wb: float, colour: NDArray[np.float64]) -> tuple[float, object]:
        i, j = _PART[a], _PART[b]
        return (depth[i] + depth[j]) / 2, lambda: canvas.stroke(pixels[i], pixels[j], px(wa, i), px(wb, j), colour)

    def hand(side: str) -> tuple[float, object]:
        i, j = _PART[f"{side}_elbow"], _PART[f"{side}_wrist"]
        tip = pixels[j] + (pixels[j] - pixels[i]) * rng.uniform(0.25, 0.5)
        return depth[j] - 0.01, lambda: canvas.stroke(pixels[j], tip, px(0.06, j), px(0.07, j), skin)

    def torso() -> None:
        rs, ls, rh, lh = (_PART[f"{s}_{p}"] for p in ("shoulder", "hip") for s in ("right", "left"))
        for share, light in ((1.0, 0.8), (0.75, 1.0)):
            middle = pixels[[rs, ls, rh, lh]].mean(0)
            corners = [tuple(middle + (pixels[k] - middle) * share) for k in (rs, ls, lh, rh)]
            canvas.draw.polygon(corners, fill=canvas.fill(shirt, light))
        canvas.stroke(pixels[rs], pixels[ls], px(0.11, rs), px(0.11, ls), shirt)
        canvas.stroke(pixels[rh], pixels[lh], px(0.2, rh), px(0.2, lh), shirt)
        spine = (pixels[rh] + pixels[lh]) / 2
        canvas.stroke(pixels[_PART["neck"]], spine, px(0.26, rs), px(0.26, rh), shirt)

    def head() -> None:
        ears = [_PART["right_ear"], _PART["left_ear"]]
        centre = pixels[ears].mean(0)
        radius = px(0.1, ears[0]) / girth
        canvas.stroke(pixels[_PART["neck"]], centre, radius, radius, skin * 0.85)
        nose = _PART["nose"]
        facing = depth[nose] < depth[ears].mean()
        canvas.disc(centre, radius, 1.2 * radius, canvas.fill(skin if facing else hair))
        for ear in ears:
            if depth[ear] <= depth[ears].mean() + 0.03:
                canvas.disc(pixels[ear], 0.2 * radius, 0.3 * radius, canvas.fill(skin, 0.8))
        canvas.disc(centre + (centre - pixels[nose]) * 0.35 - np.array([0, 0.3 * radius]), radius, 0.95 * radius, canvas.fill(hair))
        if facing:
            for eye in (_PART["right_eye"], _PART["left_eye"]):
                canvas.disc(pixels[eye], 0.12 * radius, 0.1 * radius, (30, 25, 25))
            canvas.disc(pixels[nose], 0.14 * radius, 0.18 * radius, canvas.fill(skin, 0.75))

    jobs: list[tuple[float, object]] = [(depth[[2, 5, 8, 11]].mean() + 0.04, torso), (depth[[16, 17]].mean(), head)]
    for side in ("right", "left"):
        jobs.append(limb(f"{side}_hip", f"{side}_knee", 0.17, 0.13, trousers))
        jobs.append(limb(f"{side}_knee", f"{side}_ankle", 0.12, 0.09, trousers))
        jobs.append(limb(f"{side}_shoulder", f"{side}_elbow", 0.11, 0.085, shirt if sleeve > 0.15 else skin))
        jobs.append(limb(f"{side}_elbow", f"{side}_wrist", 0.08, 0.06, shirt if sleeve > 0.55 else skin))
        jobs.append(hand(side))
    for _, job in sorted(jobs, key=lambda entry: -entry[0]):
        job()

    covered = np.zeros(len(PARTS), bool)
    if rng.random() < 0.85:
        covered = _bench(canvas, view, joints, pixels, rng)
    if rng.random() < 0.6:
        _fabric(canvas, pixels, rng)
    image = canvas.image
    if rng.random() < 0.3:
        image = image.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 1.2)))
    return image, pixels.astype(np.float32), covered


def _bench(
    canvas: _Canvas, view: View, joints: NDArray, pixels: NDArray, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Front of the bench, drawn below the lower wrist, and maybe a machine on it; which joints they hide."""
    wrists = [_PART["right_wrist"], _PART["left_wrist"]]
    top = pixels[wrists][:, 1].max() + rng.uniform(2, 25)
    slope = rng.uniform(-0.08, 0.08)
    left, right = top - slope * SIZE[0] / 2, top + slope * SIZE[0] / 2
    canvas.draw.polygon([(0, left), (SIZE[0], right), (SIZE[0], SIZE[1] + 400), (0, SIZE[1] + 400)], fill=canvas.fill(_colour(rng)))
    edge = left + (right - left) * pixels[:, 0] / SIZE[0]
    covered = pixels[:, 1] > edge
    if rng.random() < 0.5:
        x, colour = rng.uniform(0, SIZE[0]), _colour(rng)
        w, h = rng.uniform(20, 60), rng.uniform(20, 50)
        free = np.abs(pixels[list(ARM_PARTS), 0] - x).min() > w
        if free:
            canvas.draw.rectangle((x - w / 2, top - h, x + w / 2, top + 5), fill=canvas.fill(colour))
            canvas.draw.rectangle((x - w / 2, top - h, x - w / 4, top + 5), fill=canvas.fill(colour, 0.8))
    return covered


def _fabric(canvas: _Canvas, pixels: NDArray, rng: np.random.Generator) -> None:
    """A piece of cloth near or over one hand."""
    centre = pixels[_PART["right_wrist" if rng.random() < 0.5 else "left_wrist"]] + rng.normal(0, 18, 2)
    angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(4, 8))))
    radius = rng.uniform(10, 38, len(angles))
    corners = centre + np.stack((np.cos(angles) * radius, np.sin(angles) * radius * 0.6), 1)
    colour = _colour(rng)
    canvas.draw.polygon([tuple(c) for c in corners], fill=canvas.fill(colour))
    canvas.draw.line([tuple(c) for c in corners[: len(corners) // 2 + 1]], fill=canvas.fill(colour, 0.8), width=2)


class Puppets:
    """`count` puppets drawn when asked for; number `i` depends on `(seed, i)` alone."""

    def __init__(self, count: int, seed: int) -> None:
        self.count, self.seed = count, seed

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, i: int) -> Sample:
        image, joints, covered = puppet(np.random.default_rng((self.seed, i)))
        states = np.where(covered, State.HIDDEN, State.LABELLED).astype(np.int64)
        states[((joints < 0) | (joints >= np.array(SIZE))).any(1)] = State.OUTSIDE
        box = np.concatenate((joints.min(0) - 15, joints.max(0) + 15))[None].astype(np.float32)
        return Sample(image, joints[None], states[None], box)


def write(root: Path, count: int, seed: int) -> None:
    """Puppets as a COCO keypoint data set with `extras.json`; goes on where an interrupted call stopped."""
    (root / "images").mkdir(parents=True, exist_ok=True)
    images, annotations, extras = [], [], []
    for i in tqdm(range(count), desc="puppets", unit="img"):
        name = f"images/{i:06}.png"
        image, joints, covered = puppet(np.random.default_rng((seed, i)))
        if not (root / name).is_file():
            part = root / f"{name}.part"
            image.save(part, "PNG", compress_level=1)
            part.rename(root / name)
        shifted = joints - COCO_CENTRE_PX
        inside = ((joints >= 0) & (joints < np.array(SIZE))).all(1)
        rows = []
        for part_name in COCO17:
            k = _PART[part_name]
            rows += [float(shifted[k, 0]), float(shifted[k, 1]), 2] if inside[k] and not covered[k] else [0.0, 0.0, 0]
        low, high = shifted[inside].min(0) - 10, shifted[inside].max(0) + 10
        images.append({"id": i, "file_name": name, "width": SIZE[0], "height": SIZE[1]})
        annotations.append({
            "id": i, "image_id": i, "category_id": 1, "iscrowd": 0, "keypoints": rows,
            "num_keypoints": sum(1 for v in rows[2::3] if v), "area": float(np.prod(high - low)),
            "bbox": [float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])],
        })  # fmt: skip
        # An arm joint under the bench is nobody's to know: without a place it stays out of the loss.
        unplaced = covered & np.isin(np.arange(len(PARTS)), ARM_PARTS)
        places = [None if hidden else [float(u), float(v)] for hidden, (u, v) in zip(unplaced, shifted, strict=True)]
        extras.append({"annotation_id": i, "keypoints18": places})
    categories = [{"id": 1, "name": "person", "keypoints": list(COCO17), "skeleton": []}]
    (root / "annotations.json").write_text(
        json.dumps({"images": images, "annotations": annotations, "categories": categories})
    )
    (root / "extras.json").write_text(json.dumps({"annotations": extras}))
