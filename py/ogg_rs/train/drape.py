"""Fabric laid over labelled arms: a picture whose wrists are seen becomes one whose wrists are covered, with the same labels.

No annotator and no teacher is needed: the label was set before the fabric came.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from .people.look import Backgrounds, fabric, smooth_noise
from .skeleton import PARTS
from .targets import State

_ARMS = tuple((PARTS.index(f"{side}_elbow"), PARTS.index(f"{side}_wrist")) for side in ("right", "left"))
CORNERS = 28


def outline(rng: np.random.Generator, middle: NDArray[np.float64], along: NDArray[np.float64]) -> list[tuple[float, float]]:
    """A wavy closed curve about `middle`, longer along the forearm `along` or across it."""
    length = float(np.linalg.norm(along))
    axis = along / max(length, 1e-6)
    turn = rng.uniform(-0.6, 0.6)
    axis = np.array([axis[0] * np.cos(turn) - axis[1] * np.sin(turn), axis[0] * np.sin(turn) + axis[1] * np.cos(turn)])
    radii = length * np.array([rng.uniform(0.4, 0.95), rng.uniform(0.35, 0.9)])
    angle = np.linspace(0, 2 * np.pi, CORNERS, endpoint=False)
    wave = 1 + sum(rng.normal(0, 0.11) * np.cos(k * angle + rng.uniform(0, 6.3)) for k in (2, 3, 4, 5, 7))
    sideways = np.array([-axis[1], axis[0]])
    points = middle + (radii[0] * np.cos(angle) * wave)[:, None] * axis + (radii[1] * np.sin(angle) * wave)[:, None] * sideways
    return [(float(x), float(y)) for x, y in points]


def drape(
    pixels: NDArray[np.float32], joints: NDArray[np.float32], states: NDArray[np.int64], share: float, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A picture `(height, width, 3)` with fabric over each labelled forearm with probability `share`, and which joints lie under it.

    The fabric's middle is at the wrist or up to half a forearm before it. Patterned, folded, with a shadow beside it.
    """
    under = np.zeros(states.shape, bool)
    height, width = pixels.shape[:2]
    for person in range(len(joints)):
        for elbow, wrist in _ARMS:
            if rng.random() >= share or (states[person, [elbow, wrist]] != State.LABELLED).any():
                continue
            along = (joints[person, wrist] - joints[person, elbow]).astype(np.float64)
            if np.linalg.norm(along) < 6:
                continue
            middle = joints[person, wrist] - rng.uniform(-0.15, 0.5) * along
            mask = Image.new("L", (width, height))
            ImageDraw.Draw(mask).polygon(outline(rng, middle, along), fill=255)
            shadow = np.asarray(mask.filter(ImageFilter.GaussianBlur(4)), np.float32)[..., None] / 255
            solid = np.asarray(mask.filter(ImageFilter.GaussianBlur(0.7)), np.float32)[..., None] / 255
            side = max(width, height)
            cloth = fabric(rng, Backgrounds(None), side)[:height, :width] * rng.uniform(0.5, 1.1)
            folds = smooth_noise(rng, (width, height), int(rng.integers(8, 28)))
            cloth = cloth * (1 + rng.uniform(0.05, 0.22) * folds)
            pixels = (pixels * (1 - 0.35 * shadow)) * (1 - solid) + cloth * solid
            hit = np.asarray(mask)
            columns, rows = (np.clip(joints[..., k], 0, limit - 1).astype(int) for k, limit in ((0, width), (1, height)))
            under |= (hit[rows, columns] > 127) & (states == State.LABELLED)
    return pixels, under
