"""How far the decoded joints lie from the true ones: PCK and pixel errors, per joint.

One person per picture is assumed: a joint is decoded as the highest cell of its map, refined below the cell. For a
Gaussian the logarithm of the map is a parabola, so three cells along each axis give its centre exactly.

PCK@a is the share of joints within `a` times the torso length (mean distance of each shoulder to its hip) of the truth
(Yang & Ramanan, 2013). A joint whose peak is below `floor` counts as missed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from . import augment
from .batches import Normalisation
from .nets import STRIDE
from .skeleton import OPENPOSE18, Skeleton

FLOOR = 0.1
"""Smallest peak that counts as seen; the floor of OpenPose's decoder."""


class Runner(Protocol):
    """From normalised pictures `(b, 3, h, w)` to `(pcm, paf)` as arrays."""

    def __call__(self, image: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...


def onnx_runner(path: Path, *, threads: int = 1) -> Runner:
    """Runs an exported network, one picture at a time."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def run(image: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        answers = [session.run(["pcm", "paf"], {"image": one[None]}) for one in image]
        return np.concatenate([a[0] for a in answers]), np.concatenate([a[1] for a in answers])

    return run


def torch_runner(network: torch.nn.Module) -> Runner:
    """Runs a PyTorch network."""

    def run(image: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        with torch.no_grad():
            pcm, paf = network.eval()(torch.from_numpy(image))[-1]
        return pcm.numpy(), paf.numpy()

    return run


def decode_single(pcm: NDArray[np.float32], *, stride: int = STRIDE) -> NDArray[np.float32]:
    """Joints `(b, parts, 3)` as x, y (continuous input pixels) and peak, from maps `(b, parts + 1, h, w)`."""
    batch, maps, height, width = pcm.shape
    joints = np.zeros((batch, maps - 1, 3), np.float32)
    for b in range(batch):
        for j in range(maps - 1):
            plane = pcm[b, j]
            y, x = divmod(int(plane.argmax()), width)
            dx = _vertex(plane[y, x - 1 : x + 2]) if 0 < x < width - 1 else 0.0
            dy = _vertex(plane[y - 1 : y + 2, x]) if 0 < y < height - 1 else 0.0
            joints[b, j] = (x + 0.5 + dx) * stride, (y + 0.5 + dy) * stride, plane[y, x]
    return joints


def _vertex(three: NDArray[np.float32]) -> float:
    """Vertex of the parabola through the logarithms of three neighbouring cells, within one cell of the middle."""
    low, mid, high = np.log(np.maximum(three.astype(np.float64), 1e-3))
    bend = low - 2 * mid + high
    return float(np.clip(0.5 * (low - high) / bend, -1, 1)) if bend < -1e-9 else 0.0


@dataclass
class Scores:
    """Errors of one joint over a picture set."""

    errors: list[float] = field(default_factory=list)
    """Relative to the torso; infinite for a missed joint."""
    errors_px: list[float] = field(default_factory=list)
    """In pixels of the original picture, missed joints left out."""

    def pck(self, share: float) -> float:
        """Share of joints within `share` torso lengths."""
        return float(np.mean(np.array(self.errors) <= share)) if self.errors else float("nan")

    def median_px(self) -> float:
        """Median error of the joints seen."""
        return float(np.median(self.errors_px)) if self.errors_px else float("nan")


@dataclass(frozen=True)
class Case:
    """One picture to score: true joints `(18, 2)` in its continuous pixels, which of them count, and the torso length."""

    image: Image.Image
    joints_px: NDArray[np.float32]
    counts: NDArray[np.bool_]
    torso_px: float


def score(
    run: Runner, cases: list[Case], size: tuple[int, int], normalise: Normalisation, *, skeleton: Skeleton = OPENPOSE18
) -> dict[str, Scores]:
    """Scores by joint name over `cases`, each letterboxed to `size` as at run time."""
    found = []
    for case in tqdm(cases, desc="scoring", unit="img", leave=False):
        pixels, (scale, dx, dy) = augment.letterboxed(case.image, size)
        joints = decode_single(run(normalise(torch.from_numpy(pixels[None])).contiguous().numpy())[0])[0]
        joints[:, :2] = (joints[:, :2] - (dx, dy)) / scale
        found.append(joints)
    return score_found(found, cases, skeleton=skeleton)


def score_found(
    found: list[NDArray[np.floating]], cases: list[Case], *, skeleton: Skeleton = OPENPOSE18
) -> dict[str, Scores]:
    """Scores by joint name of joints `(parts, 3)` found in the pictures of `cases`, in their pixels."""
    scores = {name: Scores() for name in skeleton.parts}
    for joints, case in zip(found, cases, strict=True):
        for j, name in enumerate(skeleton.parts):
            if not case.counts[j]:
                continue
            error = float(np.linalg.norm(joints[j, :2] - case.joints_px[j]))
            seen = joints[j, 2] >= FLOOR
            scores[name].errors.append(error / case.torso_px if seen else float("inf"))
            if seen:
                scores[name].errors_px.append(error)
    return scores


def table(scores: dict[str, Scores], names: list[str]) -> str:
    """Readable lines: joint, count, PCK@0.1, PCK@0.2, median error."""
    lines = [f"{'joint':16} {'n':>5} {'PCK@0.1':>8} {'PCK@0.2':>8} {'median px':>10}"]
    for name in names:
        s = scores[name]
        lines.append(
            f"{name:16} {len(s.errors):5} {100 * s.pck(0.1):7.1f}% {100 * s.pck(0.2):7.1f}% {s.median_px():10.2f}"
        )
    every = Scores([e for n in names for e in scores[n].errors], [e for n in names for e in scores[n].errors_px])
    lines.append(
        f"{'all of these':16} {len(every.errors):5} {100 * every.pck(0.1):7.1f}% {100 * every.pck(0.2):7.1f}%"
        f" {every.median_px():10.2f}"
    )
    return "\n".join(lines)
