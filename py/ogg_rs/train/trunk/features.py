"""What the frozen trunk answers to every changed picture, computed once and kept in files of half floats."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from .. import augment
from ..augment import AugmentParams
from ..batches import Joined, stack_people
from ..drape import drape
from ..skeleton import COCO17, OPENPOSE18, PARTS
from ..targets import State
from . import FEATURES, OFFSETS, SIZE, tfjs

SNAP_PX = 14.0
"""Largest distance in pixels of 256 between an exact label and the trunk's answer that replaces it."""

SNAP_SCORE = 0.35
"""Smallest probability of the trunk for that."""

_COCO_OF_PART = [COCO17.index(name) if name in COCO17 else -1 for name in PARTS]


def trunk_session(model: Path, *, offsets: bool, threads: int) -> object:
    """The public trunk under ONNX Runtime, with its features as outputs."""
    import onnxruntime

    wanted = {name: node for name, (node, _, _) in FEATURES.items()}
    if offsets:
        wanted["offset"] = OFFSETS[0]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    data = tfjs.to_onnx(model, wanted, SIZE).SerializeToString()
    return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])


def snapped(
    joints: NDArray[np.float32], states: NDArray[np.int64], heat: NDArray[np.float32], offset: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Joints `(people, 18, 2)` moved to the trunk's answer where it is near; `heat (17, h, w)` logits."""
    result = joints.copy()
    cell = SIZE[0] // heat.shape[-1]
    reach = int(np.ceil(SNAP_PX / cell))
    height, width = heat.shape[1:]
    for person in range(len(joints)):
        for part, coco in enumerate(_COCO_OF_PART):
            if coco < 0 or states[person, part] != State.LABELLED:
                continue
            x, y = (int(v // cell) for v in joints[person, part])
            x0, y0 = max(x - reach, 0), max(y - reach, 0)
            window = heat[coco, y0 : min(y + reach + 1, height), x0 : min(x + reach + 1, width)]
            if window.size == 0 or 1 / (1 + np.exp(-float(window.max()))) < SNAP_SCORE:
                continue
            dy, dx = np.unravel_index(int(window.argmax()), window.shape)
            cy, cx = y0 + int(dy), x0 + int(dx)
            place = cell * np.array([cx + offset[2 * coco + 1, cy, cx], cy + offset[2 * coco, cy, cx]])
            if np.linalg.norm(place - joints[person, part]) <= SNAP_PX:
                result[person, part] = place
        neck, right, left = PARTS.index("neck"), PARTS.index("right_shoulder"), PARTS.index("left_shoulder")
        if states[person, neck] == State.LABELLED:
            result[person, neck] = (result[person, right] + result[person, left]) / 2
    return result


class Features:
    """The trunk's maps and the labels of `changes` changed copies of every picture.

    `exact`, `states`, `boxes` and `seen` are those of the rendering; `joints` are `exact` moved to where the trunk itself sees them.
    `draped` tells which joints lie under fabric that was laid over a share `drapes` of the arms afterwards. `name` distinguishes
    pictures of one count that are not the same. Of the copies only every `every`-th is made.
    """

    def __init__(
        self, root: Path, name: str, pictures: Joined, model: Path, change: AugmentParams, *, changes: int, seed: int,
        threads: int, drapes: float = 0.0, every: int = 1,
    ) -> None:  # fmt: skip
        self.count = -(-len(pictures) * changes // every)
        key = json.dumps([name, len(pictures), changes, seed, drapes, every, asdict(change)])
        folder = root / f"features-{name}-{hashlib.sha256(key.encode()).hexdigest()[:12]}"
        folder.mkdir(parents=True, exist_ok=True)
        done, partial = folder / "done", folder / "labels.part"
        mode = "r" if done.is_file() else "r+" if partial.is_file() else "w+"
        shapes = {part: (self.count, channels, side, side) for part, (_, channels, side) in FEATURES.items()}
        self.maps = {
            part: np.memmap(folder / f"{part}.f16", np.float16, mode, shape=shape) for part, shape in shapes.items()
        }
        labels = folder / "labels.pt"
        if not done.is_file():
            self._fill(pictures, model, change, drapes, every, seed, threads, partial, labels)
            done.touch()
        self.joints, self.exact, self.states, self.boxes, self.seen, self.draped = torch.load(labels, weights_only=True)

    def _fill(
        self, pictures: Joined, model: Path, change: AugmentParams, drapes: float, every: int, seed: int, threads: int,
        partial: Path, labels: Path,
    ) -> None:  # fmt: skip
        """Goes on where an interrupted call stopped; what is done is written down every few pictures."""
        session = trunk_session(model, offsets=True, threads=threads)
        people = torch.load(partial, weights_only=False) if partial.is_file() else []
        first = len(people)
        for i in tqdm(range(first, self.count), desc="trunk", unit="img", initial=first, total=self.count):
            if i % 64 == 0 and i > first:
                for maps in self.maps.values():
                    maps.flush()
                unfinished = partial.with_suffix(".new")
                torch.save(people, unfinished)
                unfinished.rename(partial)
            number = i * every % len(pictures)
            sample, key = pictures[number], (seed, 3, i * every)
            _, mirrored = augment.placement(sample.image.size, SIZE, change, np.random.default_rng(key))
            seen = pictures.visible(number)
            if mirrored:
                seen = seen[:, list(OPENPOSE18.mirror)]
            pixels, joints, states, boxes = augment.apply(sample, SIZE, OPENPOSE18, change, np.random.default_rng(key))
            pixels, under = drape(pixels, joints, states, drapes, np.random.default_rng((seed, 6, i * every)))
            image = np.clip(pixels, 0, 255).transpose(2, 0, 1)[None].astype(np.float32)
            *features, offset = session.run([*FEATURES, "offset"], {"image": np.ascontiguousarray(image)})
            for name, value in zip(FEATURES, features, strict=True):
                self.maps[name][i] = value[0]
            heat = features[list(FEATURES).index("heat")][0]
            people.append((snapped(joints, states, heat, offset[0]), joints, states, boxes, seen, under))
        exact, states, boxes = stack_people([p[1:4] for p in people], len(PARTS))
        moved, _, _ = stack_people([(p[0], p[2], p[3]) for p in people], len(PARTS))
        seen, draped = torch.zeros(states.shape, dtype=torch.bool), torch.zeros(states.shape, dtype=torch.bool)
        for row, person in enumerate(people):
            seen[row, : len(person[4])] = torch.from_numpy(person[4])
            draped[row, : len(person[5])] = torch.from_numpy(person[5])
        torch.save((moved, exact, states, boxes, seen, draped), labels)

    def read(self, rows: NDArray[np.int64]) -> list[torch.Tensor]:
        """Features of some pictures."""
        return [torch.from_numpy(self.maps[name][rows].astype(np.float32)) for name in FEATURES]
