"""Training of the head of `ogg-trunk`: the frozen trunk answers once to every changed picture, then the head learns from its answers. Its
linear first stage is solved for, its second stage is trained by gradients.

The labels of joints that the trunk itself sees where they are follow the trunk: a body model's joints are computed from its
surface, people mark shoulders and hips a little elsewhere, and the trunk has learnt from people. All others, covered
joints above all, keep the exact place of the rendering.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional
from tqdm import tqdm

from ..augment import AugmentParams, Sample
from ..batches import Joined, beside
from ..engine import save_atomically
from ..skeleton import OPENPOSE18
from ..targets import Maps, encode
from . import SIZE, STRIDE
from .features import Features
from .head import AROUND, AT, Head
from .stages import StageParams, measure_inputs, train_fields


@dataclass(frozen=True)
class HeadParams:
    """How long and how hard to train the head."""

    epochs: int = 20
    batch: int = 16
    changes: int = 2
    """Changed copies of each picture."""
    learning_rate: float = 3e-3
    emphasis: float = 4.0
    ridge: float = 30.0
    """Penalty on the weights of the first stage, in rows of the system."""
    solved: int = 700
    """Pictures that the first stage is solved from, at most."""
    strength: float = 0.8
    smallest: float = 0.4
    """Smallest size of a changed picture: how far away people may be."""
    pairs: float = 0.3
    """Share of pictures that get another one beside them."""
    drapes: float = 0.25
    """Share of arms that get fabric over the forearm."""
    threads: int = 1
    seed: int = 0


class Paired:
    """Pictures of which a share has another one beside it: two people, each half as large."""

    def __init__(self, pictures: Joined, share: float, seed: int) -> None:
        self._pictures, self._other = pictures, []
        for i in range(len(pictures)):
            rng = np.random.default_rng((seed, 8, i))
            self._other.append(int(rng.integers(len(pictures))) if rng.random() < share else None)

    def __len__(self) -> int:
        return len(self._pictures)

    def __getitem__(self, i: int) -> Sample:
        other = self._other[i]
        return self._pictures[i] if other is None else beside(self._pictures[i], self._pictures[other])

    def visible(self, i: int) -> NDArray[np.bool_]:
        """Which joints `(people, parts)` of a picture are marked visible."""
        other = self._other[i]
        mine = self._pictures.visible(i)
        return mine if other is None else np.concatenate((mine, self._pictures.visible(other)))


def changes_of(strength: float, smallest: float) -> AugmentParams:
    """Random changes of the pictures that the trunk looks at."""
    full = AugmentParams()
    return AugmentParams(
        scale=(smallest, 1.35), rotation_rad=full.rotation_rad * strength, shift=full.shift * strength,
        flip=0.5, gain=full.gain * strength, gamma=full.gamma * strength, grey=0.08, blur=0.2,
        noise=full.noise * strength, covers=0.2,
    )  # fmt: skip


def solve_first(head: Head, data: Features, params: HeadParams) -> None:
    """Sets the first stage: weighted least squares over the cells of the pictures, with a ridge.

    A cell weighs `1 + emphasis` times how much of a person it shows; cells that the mask leaves out do not count, and of the
    empty ones every sixth does, six times.
    """
    draw = np.random.default_rng((params.seed, 5))
    chosen_pictures = np.sort(draw.permutation(data.count)[: params.solved])
    measure_inputs(head.inputs, data.read, chosen_pictures)
    with torch.no_grad():
        size = 9 * AROUND + AT + 1
        left = torch.zeros(size, size)
        right = torch.zeros(size, head.around.out_channels)
        batches = np.array_split(chosen_pictures, max(1, len(chosen_pictures) // 16))
        for rows in tqdm(batches, desc="first stage", unit="batch"):
            maps = targets(data, rows)
            around, at = head.inputs(*data.read(rows))
            cells = torch.cat((functional.unfold(around, 3, padding=1), at.flatten(2)), 1).transpose(1, 2).reshape(-1, size - 1)
            wanted = torch.cat((maps.pcm, maps.paf), 1).flatten(2).transpose(1, 2).reshape(-1, right.shape[1])
            known = torch.cat((maps.pcm_mask, maps.paf_mask), 1).flatten(2).all(1).reshape(-1)
            presence = (1 - maps.pcm[:, -1]).flatten()
            chosen = torch.from_numpy(draw.random(len(presence)) < 1 / 6)
            weight = known * torch.where(presence > 0.01, 1 + params.emphasis * presence, 6.0 * chosen)
            keep = weight > 0
            x = torch.cat((cells[keep], torch.ones(int(keep.sum()), 1)), 1) * weight[keep].sqrt()[:, None]
            left += x.T @ x
            right += x.T @ (wanted[keep] * weight[keep].sqrt()[:, None])
        penalty = torch.full((size,), params.ridge)
        penalty[-1] = 0
        solution = torch.linalg.solve((left + torch.diag(penalty)).double(), right.double()).float().T
        wide = 9 * AROUND
        head.around.weight.copy_(solution[:, :wide].reshape(head.around.weight.shape))
        head.at.weight.copy_(solution[:, wide:-1, None, None])
        head.around.bias.copy_(solution[:, -1])


def targets(data: Features, rows: NDArray[np.int64]) -> Maps:
    """What the head shall answer to some pictures."""
    order = torch.from_numpy(rows)
    return encode(data.joints[order], data.states[order], data.boxes[order], OPENPOSE18, SIZE, stride=STRIDE)


def fit_head(pictures: Joined, model: Path, params: HeadParams, out: Path, *, first: Path | None = None) -> Head:
    """Trains the head, resuming from what `out` holds. `first`: the checkpoint of an earlier run whose first stage is taken over."""
    out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(params.threads)
    data = Features(
        out, "fit", Paired(pictures, params.pairs, params.seed), model, changes_of(params.strength, params.smallest),
        changes=params.changes, seed=params.seed, threads=params.threads, drapes=params.drapes,
    )  # fmt: skip
    torch.manual_seed(params.seed)
    head = Head(OPENPOSE18.part_maps, OPENPOSE18.field_maps)
    fresh = head.fields.state_dict()
    solved = first or out / "first.pt"
    if solved.is_file():
        state = torch.load(solved, weights_only=True)
        kept = {name: value for name, value in state["average"].items() if name.startswith(("inputs.", "around.", "at."))}
        head.load_state_dict(kept | {f"fields.{name}": value for name, value in fresh.items()})
    else:
        solve_first(head, data, params)
        save_atomically(solved, {"average": head.state_dict()})
    head.eval()
    steps = data.count // params.batch * params.epochs
    if steps > 0:
        seen = seen_by(head, data, out / "seen.npy")
        stage = StageParams(steps, params.batch, params.learning_rate, params.emphasis, params.seed)
        head.fields = train_fields(head.fields, seen, lambda rows: targets(data, rows), head.part_maps, stage, out)
    save_atomically(out / "checkpoint.pt", {"step": steps, "average": head.state_dict()})
    return head.eval()


def seen_by(head: Head, data: Features, path: Path) -> NDArray[np.float16]:
    """What the second stage reads of every picture `(n, channels, h, w)`, computed once."""
    if not path.is_file():
        pieces = []
        with torch.no_grad():
            for rows in tqdm(np.array_split(np.arange(data.count), max(1, data.count // 16)), desc="seen", unit="batch"):
                pieces.append(head.seen(*data.read(rows)).numpy().astype(np.float16))
        np.save(path, np.concatenate(pieces))
    return np.load(path, mmap_mode="r")
