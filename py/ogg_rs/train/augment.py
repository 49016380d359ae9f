"""From a stored picture to a training input: one affine resampling, then colour, noise and covers.

All randomness comes from the generator passed in; the same generator state gives the same bytes. Joints and boxes
follow the picture exactly: `Image.transform` maps pixel centres `i + 0.5`, as the continuous coordinates here do.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from .skeleton import Skeleton
from .targets import State


@dataclass(frozen=True)
class AugmentParams:
    """Ranges of the random changes. The default suits a fixed camera before a bench; `none()` only letterboxes."""

    scale: tuple[float, float] = (0.7, 1.35)
    rotation_rad: float = math.radians(22)
    shift: float = 0.14
    """Largest shift as a share of each side."""
    flip: float = 0.5
    gain: float = 0.35
    """Largest relative change of brightness; each channel gets a third of it on top."""
    gamma: float = 0.35
    grey: float = 0.1
    """Share of pictures without colour."""
    blur: float = 0.25
    noise: float = 10.0
    """Largest standard deviation of the noise, of 255."""
    covers: float = 0.35
    """Share of pictures with up to three flat patches over them; what they cover stays labelled."""

    @staticmethod
    def none() -> AugmentParams:
        """No random change at all."""
        return AugmentParams((1, 1), 0, 0, 0, 0, 0, 0, 0, 0, 0)


@dataclass
class Sample:
    """A picture with its people. `joints_px (people, parts, 2)`, `states (people, parts)`, `boxes_px (people, 4)`."""

    image: Image.Image
    joints_px: NDArray[np.float32]
    states: NDArray[np.int64]
    boxes_px: NDArray[np.float32]


def letterbox(source: tuple[int, int], target: tuple[int, int]) -> tuple[float, float, float]:
    """`(scale, shift_x, shift_y)` that fits a picture of size `source` whole and centred into `target`."""
    scale = min(target[0] / source[0], target[1] / source[1])
    return scale, (target[0] - scale * source[0]) / 2, (target[1] - scale * source[1]) / 2


def letterboxed(
    image: Image.Image, target: tuple[int, int], *, pad: int = 128
) -> tuple[NDArray[np.float32], tuple[float, float, float]]:
    """The picture as the network sees it at run time, `(height, width, 3)` of 0..255, and its `letterbox`.

    Shrinking averages over the area that a pixel covers; what lies outside the picture has the value `pad`.
    """
    scale, dx, dy = letterbox(image.size, target)
    edges = (-dx / scale, -dy / scale, (target[0] - dx) / scale, (target[1] - dy) / scale)
    whole = tuple(math.floor(v) for v in edges[:2]) + tuple(math.ceil(v) for v in edges[2:])
    framed = Image.new("RGB", (int(whole[2] - whole[0]), int(whole[3] - whole[1])), (pad, pad, pad))
    framed.paste(image, (-int(whole[0]), -int(whole[1])))
    box = tuple(edge - whole[k % 2] for k, edge in enumerate(edges))
    method = Image.Resampling.BOX if scale < 1 else Image.Resampling.BILINEAR
    return np.asarray(framed.resize(target, method, box=box), np.float32), (scale, dx, dy)


def placement(
    source: tuple[int, int], target: tuple[int, int], params: AugmentParams, rng: np.random.Generator
) -> tuple[NDArray[np.float64], bool]:
    """Random 2x3 matrix from source to target pixels, and whether it mirrors."""
    base, _, _ = letterbox(source, target)
    scale = base * math.exp(rng.uniform(math.log(params.scale[0]), math.log(params.scale[1])))
    angle = rng.uniform(-1, 1) * params.rotation_rad
    shift = rng.uniform(-1, 1, 2) * params.shift * np.array(target)
    mirrored = bool(rng.random() < params.flip)
    linear = scale * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    if mirrored:
        linear = linear @ np.diag([-1.0, 1.0])
    centre = np.array(source) / 2
    offset = np.array(target) / 2 + shift - linear @ centre
    return np.hstack((linear, offset[:, None])), mirrored


def apply(
    sample: Sample, target: tuple[int, int], skeleton: Skeleton, params: AugmentParams, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64], NDArray[np.float32]]:
    """One training input: picture `(height, width, 3)` RGB of 0..255, joints, states and boxes in its pixels."""
    matrix, mirrored = placement(sample.image.size, target, params, rng)
    linear, offset = matrix[:, :2], matrix[:, 2]
    back = np.linalg.inv(linear)
    coefficients = np.hstack((back, (-back @ offset)[:, None])).ravel()
    fill = tuple(int(v) for v in rng.integers(0, 256, 3)) if params.gain > 0 else (128, 128, 128)
    shrink = math.sqrt(abs(np.linalg.det(linear)))
    source = sample.image
    if shrink < 0.5:
        # Bilinear sampling reads four pixels: larger reductions are averaged first, by a whole factor.
        factor = int(1 / shrink)
        source = source.reduce(factor)
        ratio = np.array([sample.image.size[0] / source.size[0], sample.image.size[1] / source.size[1]])
        coefficients = (coefficients.reshape(2, 3) / ratio[:, None]).ravel()
    resampled = source.transform(
        target, Image.Transform.AFFINE, tuple(coefficients), Image.Resampling.BILINEAR, fillcolor=fill
    )
    pixels = colour(resampled, params, rng)

    joints = (sample.joints_px @ linear.T + offset).astype(np.float32)
    states = sample.states.copy()
    if mirrored:
        order = list(skeleton.mirror)
        joints, states = joints[:, order], states[:, order]
    beyond = (joints < 0).any(-1) | (joints >= np.array(target)).any(-1)
    states[beyond & ((states == State.LABELLED) | (states == State.HIDDEN))] = State.OUTSIDE
    corners = sample.boxes_px[:, [0, 1, 2, 1, 0, 3, 2, 3]].reshape(-1, 4, 2) @ linear.T + offset
    boxes = np.concatenate((corners.min(1), corners.max(1)), 1).astype(np.float32)
    return pixels, joints, states, boxes


@functools.cache
def _noise_bank() -> NDArray[np.float32]:
    """Standard normal numbers, drawn once; pictures take a random run of them, which is far cheaper than drawing."""
    return np.random.default_rng(20).standard_normal(1 << 21, np.float32)


def colour(image: Image.Image, params: AugmentParams, rng: np.random.Generator) -> NDArray[np.float32]:
    """The picture with random light, colour, blur, covers and noise, `(height, width, 3)` of 0..255."""
    if rng.random() < params.grey:
        image = image.convert("L").convert("RGB")
    if params.gain > 0 or params.gamma > 0:
        common = rng.uniform(1 - params.gain, 1 + params.gain)
        channel = rng.uniform(1 - params.gain / 3, 1 + params.gain / 3, 3)
        offset = rng.uniform(-1, 1) * 40 * params.gain
        exponent = math.exp(rng.uniform(-params.gamma, params.gamma))
        levels = 255 * (np.arange(256) / 255) ** exponent
        table = np.clip(levels * (common * channel)[:, None] + offset, 0, 255).astype(np.uint8)
        image = image.point(table.ravel().tolist())
    if rng.random() < params.covers:
        image = cover(image, rng)
    if rng.random() < params.blur:
        # A box of three along one axis: the blur of a moving arm or of a soft lens; along both every second time.
        both = rng.random() < 0.5
        across = rng.random() < 0.5
        image = image.filter(ImageFilter.BoxBlur((1 if both or across else 0, 1 if both or not across else 0)))
    pixels = np.asarray(image, np.float32)
    if params.noise > 0:
        start = int(rng.integers(0, (1 << 21) - pixels.size))
        noise = _noise_bank()[start : start + pixels.size].reshape(pixels.shape)
        pixels = pixels + np.float32(rng.uniform(0, params.noise)) * noise
    return pixels


def cover(image: Image.Image, rng: np.random.Generator) -> Image.Image:
    """Up to three flat rectangles, each at most a quarter of the picture wide and high."""
    width, height = image.size
    draw = ImageDraw.Draw(image)
    for _ in range(int(rng.integers(1, 4))):
        w, h = int(rng.uniform(0.04, 0.25) * width), int(rng.uniform(0.04, 0.25) * height)
        x, y = int(rng.integers(0, width - w)), int(rng.integers(0, height - h))
        r, g, b = (int(v) for v in rng.integers(0, 256, 3))
        draw.rectangle((x, y, x + w, y + h), fill=(r, g, b))
    return image
