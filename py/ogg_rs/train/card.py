"""Model cards: the TOML file beside an exported network that says how to feed and read it.

The machine's half (names, sizes, channel order, SHA-256) is written from the network; the section `[about]`, written by
people, is kept from a card that is already there.
"""

from __future__ import annotations

import json
from pathlib import Path

from .batches import Normalisation
from .nets import STRIDE
from .skeleton import PARTS, Skeleton

ASSEMBLY: tuple[tuple[int, int], ...] = (
    (1, 2), (1, 5), (2, 3), (3, 4), (5, 6), (6, 7), (1, 8), (8, 9), (9, 10), (1, 11),
    (11, 12), (12, 13), (1, 0), (0, 14), (14, 16), (0, 15), (15, 17), (2, 16), (5, 17),
)  # fmt: skip
"""Limbs in the order in which people are assembled: from the neck outwards, certain ones first."""

LICENCE = "MIT OR Apache-2.0"
ABOUT = """[about]
description = ""
data = ""
training = ""
scores = ""
limits = ""
"""


PEAK_THRESHOLD = 0.1
"""Floor of OpenPose's decoder. A small network answers weakly beside its joints: its floor belongs between the highest
false peak and the lowest true one."""


def text(
    name: str, file: str, sha256: str, size: tuple[int, int], skeleton: Skeleton, about: str, peak_threshold: float
) -> str:
    """The whole card. `about` is the text from `[about]` on."""
    normalise = Normalisation()
    three = ", ".join
    quoted = json.dumps
    limbs = [limb for limb in ASSEMBLY if limb in skeleton.limbs]
    rows = []
    for a, b in limbs:
        channel = 2 * skeleton.limbs.index((a, b))
        rows.append(
            f'  {{ from = {quoted(PARTS[a])}, to = {quoted(PARTS[b])}, paf = [{channel}, {channel + 1}] }},'
        )
    return "\n".join(
        [
            f"name = {quoted(name)}",
            f"file = {quoted(file)}",
            f"sha256 = {quoted(sha256)}",
            f"licence = {quoted(LICENCE)}",
            'source = "trained by this project: python -m ogg_rs.train"',
            'output = "openpose"',
            f"skeleton = {quoted(skeleton.name)}",
            "",
            "[input]",
            'name = "image"',
            f"width = {size[0]}",
            f"height = {size[1]}",
            'layout = "nchw"',
            'dtype = "float32"',
            f'colour = "{"bgr" if normalise.bgr else "rgb"}"',
            f"mean = [{three([repr(normalise.mean)] * 3)}]",
            f"scale = [{three([repr(1 / normalise.scale)] * 3)}]",
            f"pad = {int(normalise.mean)}",
            "",
            "[openpose]",
            f"stride = {STRIDE}",
            f"peak_threshold = {peak_threshold}",
            'layout = "nchw"',
            f'pcm = {{ output = "pcm", first = 0, channels = {skeleton.part_maps} }}',
            f'paf = {{ output = "paf", first = 0, channels = {skeleton.field_maps} }}',
            "limbs = [",
            *rows,
            "]",
            "",
            about.rstrip(),
            "",
        ]
    )


def write(
    path: Path,
    file: Path,
    sha256: str,
    size: tuple[int, int],
    skeleton: Skeleton,
    *,
    peak_threshold: float = PEAK_THRESHOLD,
) -> None:
    """Writes or renews the card of an exported network."""
    about = ABOUT
    if path.is_file():
        _, mark, rest = path.read_text().partition("[about]")
        about = mark + rest if mark else ABOUT
    path.write_text(text(file.stem, file.name, sha256, size, skeleton, about, peak_threshold))
