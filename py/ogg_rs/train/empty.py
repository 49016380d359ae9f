"""Pictures of nobody. A network that has only seen pictures with a person in them finds one in a blank wall.

Most are pictures of people who are painted over, so that the room around them teaches as well; the rest holds nothing at all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .augment import Sample

BLANK = 0.3
"""Share of the pictures of nobody that hold nothing."""

MARGIN = 0.15
"""What is painted goes beyond a person's box by this part of its longer side."""


def nobody(sample: Sample, rng: np.random.Generator) -> Sample:
    """`sample` without its people."""
    parts = sample.joints_px.shape[1]
    image = blank(sample.image.size, rng) if rng.random() < BLANK else painted_over(sample, rng)
    return Sample(image, np.zeros((0, parts, 2), np.float32), np.zeros((0, parts), np.int64), np.zeros((0, 4), np.float32))


def blank(size: tuple[int, int], rng: np.random.Generator) -> Image.Image:
    """One colour, a slope between two, or noise about such a slope."""
    width, height = size
    first, second = rng.uniform(0, 255, (2, 3))
    kind = rng.integers(3)
    if kind == 0:
        second = first
    share = np.linspace(0, 1, width)[None, :, None] if rng.random() < 0.5 else np.linspace(0, 1, height)[:, None, None]
    pixels = np.broadcast_to(first + share * (second - first), (height, width, 3))
    if kind == 2:
        pixels = pixels + rng.normal(0, rng.uniform(5, 60), (height, width, 3))
    return Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))


def painted_over(sample: Sample, rng: np.random.Generator) -> Image.Image:
    """The picture with every person's box painted: in one of its colours, or from its left edge's colours to its right edge's."""
    pixels = np.array(sample.image)
    height, width = pixels.shape[:2]
    for left, top, right, bottom in sample.boxes_px:
        margin = MARGIN * max(right - left, bottom - top)
        x, y = _cells(left - margin, right + margin, width), _cells(top - margin, bottom + margin, height)
        pixels[y, x] = _paint(pixels, x, y, rng)
    return Image.fromarray(pixels)


def _cells(low: float, high: float, limit: int) -> slice:
    return slice(int(np.clip(np.floor(low), 0, limit)), int(np.clip(np.ceil(high), 0, limit)))


def _paint(pixels: NDArray[np.uint8], x: slice, y: slice, rng: np.random.Generator) -> NDArray[np.uint8]:
    height, width = pixels.shape[:2]
    if rng.random() < 0.5:
        return pixels[rng.integers(height), rng.integers(width)]
    left, right = pixels[y, max(x.start - 1, 0), None], pixels[y, min(x.stop, width - 1), None]
    share = np.linspace(0, 1, x.stop - x.start)[None, :, None]
    return (left + share * (right.astype(np.float64) - left)).astype(np.uint8)
