"""Training of the head: the frozen trunk answers once to every changed picture, then the head learns from its answers. Its linear
first stage is solved for, its second stage is trained by gradients.

The labels of joints that the trunk itself sees where they are follow the trunk: a body model's joints are computed from its
surface, people mark shoulders and hips a little elsewhere, and the trunk has learnt from people. All others, covered
joints above all, keep the exact place of the rendering.
"""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional
from tqdm import tqdm

from .. import augment
from ..augment import AugmentParams
from ..batches import Joined, stack_people
from ..engine import average_into, has_amx_bf16, save_atomically
from ..losses import total_loss
from ..skeleton import COCO17, OPENPOSE18, PARTS
from ..targets import State, encode
from . import FEATURES, OFFSETS, SIZE, STRIDE, tfjs
from .head import AROUND, AT, Head

SNAP_PX = 14.0
"""Largest distance in pixels of 256 between an exact label and the trunk's answer that replaces it."""

SNAP_SCORE = 0.35
"""Smallest probability of the trunk for that."""

_COCO_OF_PART = [COCO17.index(name) if name in COCO17 else -1 for name in PARTS]


@dataclass(frozen=True)
class HeadParams:
    """How long and how hard to train the head."""

    epochs: int = 14
    batch: int = 24
    changes: int = 2
    """Changed copies of each picture."""
    learning_rate: float = 3e-3
    emphasis: float = 4.0
    ridge: float = 30.0
    """Penalty on the weights of the first stage, in rows of the system."""
    strength: float = 0.8
    threads: int = 1
    seed: int = 0


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
    """Features and labels of every changed picture, kept in files beside each other as they are made."""

    def __init__(self, root: Path, pictures: Joined, model: Path, params: HeadParams) -> None:
        self.count = len(pictures) * params.changes
        key = json.dumps([len(pictures), params.changes, params.strength, params.seed])
        folder = root / f"features-{hashlib.sha256(key.encode()).hexdigest()[:12]}"
        folder.mkdir(parents=True, exist_ok=True)
        done = folder / "done"
        partial = folder / "labels.part"
        mode = "r" if done.is_file() else "r+" if partial.is_file() else "w+"
        shapes = {name: (self.count, channels, side, side) for name, (_, channels, side) in FEATURES.items()}
        self.maps = {
            name: np.memmap(folder / f"{name}.f16", np.float16, mode, shape=shape) for name, shape in shapes.items()
        }
        self.labels_path = folder / "labels.pt"
        if not done.is_file():
            self._fill(pictures, model, params, partial)
            done.touch()
        self.joints, self.states, self.boxes = torch.load(self.labels_path, weights_only=True)

    def _fill(self, pictures: Joined, model: Path, params: HeadParams, partial: Path) -> None:
        """Goes on where an interrupted call stopped; what is done is written down every few pictures."""
        session = trunk_session(model, offsets=True, threads=params.threads)
        full = AugmentParams()
        change = augment.AugmentParams(
            scale=(0.75, 1.35), rotation_rad=full.rotation_rad * params.strength, shift=full.shift * params.strength,
            flip=0.5, gain=full.gain * params.strength, gamma=full.gamma * params.strength, grey=0.08, blur=0.2,
            noise=full.noise * params.strength, covers=0.2,
        )  # fmt: skip
        people = torch.load(partial, weights_only=False) if partial.is_file() else []
        first = len(people)
        for i in tqdm(range(first, self.count), desc="trunk", unit="img", initial=first, total=self.count):
            if i % 32 == 0 and i > first:
                for maps in self.maps.values():
                    maps.flush()
                unfinished = partial.with_suffix(".new")
                torch.save(people, unfinished)
                unfinished.rename(partial)
            rng = np.random.default_rng((params.seed, 3, i))
            pixels, joints, states, boxes = augment.apply(pictures[i % len(pictures)], SIZE, OPENPOSE18, change, rng)
            image = np.clip(pixels, 0, 255).transpose(2, 0, 1)[None].astype(np.float32)
            *features, offset = session.run([*FEATURES, "offset"], {"image": np.ascontiguousarray(image)})
            for name, value in zip(FEATURES, features, strict=True):
                self.maps[name][i] = value[0]
            heat = features[list(FEATURES).index("heat")][0]
            people.append((snapped(joints, states, heat, offset[0]), states, boxes))
        torch.save(stack_people(people, len(PARTS)), self.labels_path)

    def batch(self, rows: NDArray[np.int64]) -> tuple[list[torch.Tensor], object]:
        """Features and maps of some pictures."""
        order = torch.from_numpy(rows)
        features = [torch.from_numpy(self.maps[name][rows].astype(np.float32)) for name in FEATURES]
        maps = encode(self.joints[order], self.states[order], self.boxes[order], OPENPOSE18, SIZE, stride=STRIDE)
        return features, maps


def solve_first(head: Head, data: Features, params: HeadParams) -> None:
    """Sets normalisation and first stage: weighted least squares over the cells of all pictures, with a ridge.

    A cell weighs `1 + emphasis` times how much of a person it shows; cells that the mask leaves out do not count, and of the
    empty ones every sixth does, six times.
    """
    with torch.no_grad():
        head.inputs.train()
        for rows in np.array_split(np.arange(data.count), max(1, data.count // 32)):
            head.inputs(*data.batch(rows)[0])
        head.inputs.eval()
        size = 9 * AROUND + AT + 1
        left = torch.zeros(size, size)
        right = torch.zeros(size, head.around.out_channels)
        draw = np.random.default_rng((params.seed, 5))
        for rows in tqdm(np.array_split(np.arange(data.count), max(1, data.count // 16)), desc="first stage", unit="batch"):
            features, maps = data.batch(rows)
            around, at = head.inputs(*features)
            cells = torch.cat((functional.unfold(around, 3, padding=1), at.flatten(2)), 1).transpose(1, 2).reshape(-1, size - 1)
            targets = torch.cat((maps.pcm, maps.paf), 1).flatten(2).transpose(1, 2).reshape(-1, right.shape[1])
            known = torch.cat((maps.pcm_mask, maps.paf_mask), 1).flatten(2).amin(1).reshape(-1)
            presence = (1 - maps.pcm[:, -1]).flatten()
            chosen = torch.from_numpy(draw.random(len(presence)) < 1 / 6)
            weight = known * torch.where(presence > 0.01, 1 + params.emphasis * presence, 6.0 * chosen)
            keep = weight > 0
            x = torch.cat((cells[keep], torch.ones(int(keep.sum()), 1)), 1) * weight[keep].sqrt()[:, None]
            left += x.T @ x
            right += x.T @ (targets[keep] * weight[keep].sqrt()[:, None])
        penalty = torch.full((size,), params.ridge)
        penalty[-1] = 0
        solution = torch.linalg.solve((left + torch.diag(penalty)).double(), right.double()).float().T
        wide = 9 * AROUND
        head.around.weight.copy_(solution[:, :wide].reshape(head.around.weight.shape))
        head.at.weight.copy_(solution[:, wide:-1, None, None])
        head.around.bias.copy_(solution[:, -1])


def fit_head(pictures: Joined, model: Path, params: HeadParams, out: Path) -> nn.Module:
    """Trains the head, resuming from `out/checkpoint.pt`, and returns its averaged weights."""
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(params.threads)
    data = Features(out, pictures, model, params)
    torch.manual_seed(params.seed)
    head = Head(OPENPOSE18.part_maps, OPENPOSE18.field_maps)
    checkpoint, first = out / "checkpoint.pt", 0
    if not checkpoint.is_file():
        solve_first(head, data, params)
    averaged = Head(OPENPOSE18.part_maps, OPENPOSE18.field_maps)
    averaged.load_state_dict(head.state_dict())
    for part in (head.inputs, head.around, head.at):
        part.requires_grad_(False)
    head = head.to(memory_format=torch.channels_last).train()
    head.inputs.eval()
    per_epoch = data.count // params.batch
    steps = per_epoch * params.epochs
    if steps == 0:
        save_atomically(checkpoint, {"step": 0, "average": averaged.state_dict()})
        return averaged.eval()
    optimiser = torch.optim.AdamW([*head.refine.parameters(), *head.correct.parameters()], params.learning_rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, params.learning_rate, total_steps=steps + 1, pct_start=0.1)
    if checkpoint.is_file():
        state = torch.load(checkpoint, weights_only=True)
        for part, name in ((head, "network"), (averaged, "average"), (optimiser, "optimiser"), (schedule, "schedule")):
            part.load_state_dict(state[name])
        first = state["step"]
    if not checkpoint.is_file():
        _save(checkpoint, 0, head, averaged, optimiser, schedule)
    bf16, began, recent = has_amx_bf16(), time.monotonic(), 0.0
    bar = tqdm(range(first, steps), initial=first, total=steps, unit="step", desc=out.name)
    for step in bar:
        epoch, k = divmod(step, per_epoch)
        order = np.random.default_rng((params.seed, 4, epoch)).permutation(data.count)
        features, maps = data.batch(np.sort(order[k * params.batch : (k + 1) * params.batch]))
        with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
            stages = head(*(f.contiguous(memory_format=torch.channels_last) for f in features))
        loss = total_loss(stages[1:], maps, emphasis=params.emphasis)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(head.parameters(), 20000.0)
        optimiser.step()
        schedule.step()
        average_into(averaged, head, min(0.997, (step + 1) / (step + 10)))
        recent = float(loss.detach()) if recent == 0 else 0.95 * recent + 0.05 * float(loss.detach())
        bar.set_postfix(loss=f"{recent:.1f}")
        done = step + 1
        if done % 25 == 0 or done == steps:
            row = {"step": done, "loss": recent, "seconds": round(time.monotonic() - began, 1)}
            with (out / "log.jsonl").open("a") as log:
                log.write(json.dumps(row) + "\n")
            _save(checkpoint, done, head, averaged, optimiser, schedule)
    return averaged.eval()


def _save(path: Path, step: int, head: nn.Module, averaged: nn.Module, optimiser: object, schedule: object) -> None:
    save_atomically(
        path,
        {
            "step": step, "network": head.state_dict(), "average": averaged.state_dict(),
            "optimiser": optimiser.state_dict(), "schedule": schedule.state_dict(),
        },
    )  # fmt: skip
