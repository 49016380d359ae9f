"""Colours, fabrics, backgrounds and the faults of a camera."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from .body import TEXELS, Region

Pixels = NDArray[np.float32]
"""`(height, width, 3)` RGB of 0..255."""

SKINS = np.array(
    [[235, 196, 172], [224, 172, 141], [205, 150, 120], [185, 130, 95], [150, 100, 70], [110, 72, 50], [80, 50, 35]], float
)
HAIR = np.array([[25, 22, 20], [60, 40, 28], [120, 85, 60], [200, 160, 110], [175, 170, 170]], float)


def smooth_noise(rng: np.random.Generator, size: tuple[int, int], cells: int) -> Pixels:
    """Noise `(height, width, 1)` of mean 0 and deviation about 1 whose grain is the picture's side over `cells`."""
    coarse = rng.standard_normal((cells, cells)).astype(np.float32)
    return np.asarray(Image.fromarray(coarse).resize(size, Image.Resampling.BICUBIC), np.float32)[..., None]


class Backgrounds:
    """Photographs of a folder, or procedural rooms where there are none."""

    def __init__(self, folder: Path | None) -> None:
        self._files: list[Path] = []
        if folder is not None:
            kinds = {".jpg", ".jpeg", ".png", ".webp"}
            self._files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in kinds and p.is_file())
            if not self._files:
                raise FileNotFoundError(f"{folder}: expected pictures (.jpg, .png, .webp)")
        self._opened: dict[Path, Image.Image] = {}

    def crop(self, rng: np.random.Generator, size: tuple[int, int]) -> Pixels:
        """A random piece."""
        if not self._files or rng.random() < 0.25:
            return room(rng, size)
        path = self._files[int(rng.integers(len(self._files)))]
        if path not in self._opened:
            picture = Image.open(path).convert("RGB")
            picture.thumbnail((900, 900))
            if len(self._opened) > 200:
                self._opened.clear()
            self._opened[path] = picture
        picture = self._opened[path]
        side = max(8.0, min(picture.size) * rng.uniform(0.3, 1.0))
        x, y = (rng.uniform(0, max(edge - side, 0.0)) for edge in picture.size)
        piece = picture.resize(size, Image.Resampling.BILINEAR, box=(x, y, x + side, y + side))
        if rng.random() < 0.5:
            piece = piece.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
        return np.asarray(piece, np.float32)


def room(rng: np.random.Generator, size: tuple[int, int]) -> Pixels:
    """A wall and a floor with shelves, boxes, strips and blotches of light."""
    width, height = size
    picture = np.empty((height, width, 3), np.float32)
    edge = int(rng.uniform(0.45, 0.95) * height)
    picture[:edge], picture[edge:] = rng.uniform(40, 240, 3), rng.uniform(20, 200, 3)
    for _ in range(int(rng.integers(3, 28))):
        w, h = (int(v) for v in rng.uniform(3, 90, 2) * (rng.choice([0.3, 1.0]), rng.choice([0.3, 1.0])) + 1)
        x, y = int(rng.integers(-w + 1, width)), int(rng.integers(-h + 1, height))
        patch = picture[max(y, 0) : y + h, max(x, 0) : x + w]
        patch[:] = rng.uniform(5, 250, 3) * (1 + 0.15 * np.linspace(-1, 1, patch.shape[1])[None, :, None])
    picture *= 1 + 0.15 * smooth_noise(rng, size, int(rng.integers(3, 9)))
    return np.clip(picture, 0, 255)


def fabric(rng: np.random.Generator, backgrounds: Backgrounds, side: int = TEXELS) -> Pixels:
    """A cloth: plain, striped, checked or printed, never quite even."""
    colour = rng.uniform(10, 245, 3)
    if rng.random() < 0.35:
        colour = rng.choice([25.0, 60.0, 120.0, 200.0, 235.0]) * rng.uniform(0.9, 1.1, 3)
    cloth = np.broadcast_to(colour, (side, side, 3)).astype(np.float32)
    y, x = np.mgrid[:side, :side]
    kind = rng.integers(0, 7)
    if kind == 1:
        angle = rng.choice([0.0, np.pi / 2, rng.uniform(0, np.pi)])
        wave = np.sin((x * np.cos(angle) + y * np.sin(angle)) * 2 * np.pi / rng.uniform(4, 24))
        cloth = np.where((wave > rng.uniform(-0.6, 0.6))[..., None], rng.uniform(0, 255, 3), cloth)
    elif kind == 2:
        step = rng.uniform(6, 24)
        cloth = cloth * np.where((x // step + y // step) % 2 == 0, 1.0, rng.uniform(0.3, 0.9))[..., None]
    elif kind == 3:
        cloth = backgrounds.crop(rng, (side, side)) * rng.uniform(0.6, 1.2)
    cloth = cloth * (1 + 0.08 * rng.uniform(0.3, 2) * smooth_noise(rng, (side, side), int(rng.integers(6, 40))))
    return np.clip(cloth, 0, 255).astype(np.float32)


def outfit(
    rng: np.random.Generator, regions: NDArray[np.uint8], backgrounds: Backgrounds
) -> tuple[Image.Image, frozenset[int]]:
    """The texture of a dressed body and which regions are clothed."""
    size = (TEXELS, TEXELS)
    tone = rng.uniform(0, len(SKINS) - 1.001)
    low = int(tone)
    skin = (SKINS[low] * (1 - tone + low) + SKINS[low + 1] * (tone - low)) * rng.uniform(0.9, 1.1, 3)
    texture = skin * (1 + 0.05 * smooth_noise(rng, size, 32))
    sleeves = rng.choice(4, p=[0.42, 0.38, 0.12, 0.08])
    clothed = {
        0: (Region.TORSO, Region.UPPER_SLEEVE, Region.LOWER_SLEEVE), 1: (Region.TORSO, Region.UPPER_SLEEVE),
        2: (Region.TORSO,), 3: (),
    }[int(sleeves)]  # fmt: skip
    top, trousers = fabric(rng, backgrounds), fabric(rng, backgrounds)
    texture = np.where(np.isin(regions, clothed)[..., None], top, texture)
    if rng.random() < 0.85:
        texture = np.where((regions == Region.LEGS)[..., None], trousers, texture)
        clothed = (*clothed, Region.LEGS)
    texture = np.where((regions == Region.FEET)[..., None], rng.uniform(10, 90, 3), texture)
    hair = HAIR[rng.choice(len(HAIR), p=[0.42, 0.3, 0.12, 0.08, 0.08])]
    if rng.random() < 0.2:
        hair = rng.uniform(0, 255, 3)
    texture = np.where((regions == Region.HAIR)[..., None], hair * (1 + 0.25 * smooth_noise(rng, size, 64)), texture)
    texture = np.where((regions == Region.EYES)[..., None], 235.0, texture)
    return Image.fromarray(np.clip(texture, 0, 255).astype(np.uint8)), frozenset(int(r) for r in clothed)


def photographed(rng: np.random.Generator, front: NDArray[np.uint8], back: Pixels) -> Image.Image:
    """The rendering (RGBA) before its background, with the exposure, blur, noise and compression of a camera."""
    alpha = np.asarray(Image.fromarray(front[..., 3]).filter(ImageFilter.GaussianBlur(0.6)), np.float32)[..., None] / 255
    back_picture = Image.fromarray(np.clip(back * rng.uniform(0.5, 1.15), 0, 255).astype(np.uint8))
    if rng.random() < 0.6:
        back_picture = back_picture.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 2.5)))
    pixels = front[..., :3] * alpha + np.asarray(back_picture, np.float32) * (1 - alpha)
    pixels = np.clip(pixels * rng.uniform(0.6, 1.25) * np.clip(rng.normal(1, 0.06, 3), 0.8, 1.2), 0, 255)
    pixels = 255 * (pixels / 255) ** rng.uniform(0.75, 1.35)
    picture = Image.fromarray(pixels.astype(np.uint8))
    if rng.random() < 0.4:
        picture = picture.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 1.2)))
    noisy = np.asarray(picture, np.float32) + rng.uniform(0, 8) * rng.standard_normal(pixels.shape).astype(np.float32)
    picture = Image.fromarray(np.clip(noisy, 0, 255).astype(np.uint8))
    if rng.random() < 0.6:
        store = io.BytesIO()
        picture.save(store, "JPEG", quality=int(rng.uniform(35, 95)))
        picture = Image.open(store).convert("RGB")
    return picture
