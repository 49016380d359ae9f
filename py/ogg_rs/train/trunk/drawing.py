"""Arms drawn on pictures, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ..evaluate import FLOOR

Tile = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]
"""Pixels `(h, w, 3)`, arm joints `(6, 3)` in the order of `ARM_PARTS`, and which of them lie under fabric."""

_COLOURS = ((255, 140, 0), (40, 150, 255))
"""Of the right and the left arm."""


def arms(tile: Tile) -> Image.Image:
    """One picture with its arms; a ring where the joint lies under fabric."""
    pixels, joints, under = tile
    picture = Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    for side, colour in enumerate(_COLOURS):
        numbers = range(3 * side, 3 * side + 3)
        places = [tuple(joints[n, :2].tolist()) if joints[n, 2] >= FLOOR else None for n in numbers]
        for a, b in zip(places, places[1:], strict=False):
            if a and b:
                draw.line([a, b], fill=colour, width=3)
        for n, place in zip(numbers, places, strict=True):
            if place:
                x, y = place
                draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=colour, outline=(0, 0, 0))
                if under[n]:
                    draw.ellipse((x - 7, y - 7, x + 7, y + 7), outline=(255, 255, 0), width=2)
    return picture


def montage(rows: Sequence[Sequence[Tile]], titles: Sequence[str], path: Path) -> None:
    """A sheet with a title over each column, as JPEG."""
    height, width = rows[0][0][0].shape[:2]
    sheet = Image.new("RGB", (width * len(titles), height * len(rows) + 16), (255, 255, 255))
    draw = ImageDraw.Draw(sheet)
    for k, title in enumerate(titles):
        draw.text((k * width + 4, 2), title, fill=(0, 0, 0))
    for i, row in enumerate(rows):
        for k, tile in enumerate(row):
            sheet.paste(arms(tile), (k * width, i * height + 16))
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path, "JPEG", quality=68)
