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
    name: str, file: str, sha256: str, size: tuple[int, int], skeleton: Skeleton, about: str, peak_threshold: float,
    *, stride: int = STRIDE, normalise: Normalisation | None = None, pad: int | None = None, licence: str = LICENCE,
    source: str = "trained by this project: python -m ogg_rs.train",
) -> str:  # fmt: skip
    """The whole card. `about` is the text from `[about]` on."""
    normalise = normalise or Normalisation()
    pad = int(normalise.mean) if pad is None else pad
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
            f"licence = {quoted(licence)}",
            f"source = {quoted(source)}",
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
            f"pad = {pad}",
            "",
            "[openpose]",
            f"stride = {stride}",
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


def reading(path: Path) -> tuple[int, Normalisation]:
    """Stride and normalisation that the card of a network asks for; those of `ogg-lite` where there is no card."""
    if not path.is_file():
        return STRIDE, Normalisation()
    values: dict[str, str] = {}
    for line in path.read_text().partition("[about]")[0].splitlines():
        key, equals, value = line.partition(" = ")
        if equals:
            values[key] = value
    mean, scale = (json.loads(values[key])[0] for key in ("mean", "scale"))
    return int(values["stride"]), Normalisation(mean, 1 / scale, values["colour"] == '"bgr"')


def about_of(path: Path) -> str:
    """What people wrote into a card: its text from `[about]` on."""
    _, mark, rest = path.read_text().partition("[about]")
    return mark + rest if mark else ABOUT


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
    about = about_of(path) if path.is_file() else ABOUT
    path.write_text(text(file.stem, file.name, sha256, size, skeleton, about, peak_threshold))
