"""Writing a folder of pictures with COCO keypoints, in a way that an interruption leaves whole files only."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .skeleton import COCO17


def replace(path: Path, fill: Callable[[Path], object]) -> None:
    """Lets `fill` write a file beside `path`, then renames it to `path`."""
    part = path.with_name(path.name + ".part")
    fill(part)
    part.rename(path)


def keypoint_index(images: list[dict], annotations: list[dict]) -> dict:
    """The whole of a COCO keypoint file."""
    categories = [{"id": 1, "name": "person", "keypoints": list(COCO17), "skeleton": []}]
    return {"images": images, "annotations": annotations, "categories": categories}
