"""Batches for training: shuffled, changed at random, encoded, and prepared one ahead on a thread.

What batch `step` of a run holds depends on `(seed, step)` alone, never on what ran before, so a resumed run sees the
pictures it would have seen uninterrupted.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from . import augment, targets
from .augment import AugmentParams, Sample
from .coco import People
from .empty import nobody
from .skeleton import Skeleton
from .targets import Maps, State
from .views import from_behind, from_the_side


class Pictures(Protocol):
    """Anything that has numbered samples."""

    def __len__(self) -> int: ...
    def __getitem__(self, i: int) -> Sample: ...


class LabelledPictures(Pictures, Protocol):
    """Samples whose labels are known before their pixels are read."""

    @property
    def people(self) -> Sequence[People]:
        """The people of each picture."""
        ...

    def visible(self, i: int) -> np.ndarray:
        """Which joints `(n, parts)` of a picture are marked visible."""
        ...


@dataclass(frozen=True)
class Normalisation:
    """`(value - mean) / scale` on 0..255, channels in the order the network expects."""

    mean: float = 128.0
    scale: float = 256.0
    bgr: bool = True

    def __call__(self, pixels: Tensor) -> Tensor:
        """From `(b, h, w, 3)` RGB of 0..255 to the network's `(b, 3, h, w)`."""
        if self.bgr:
            pixels = pixels.flip(-1)
        return ((pixels - self.mean) / self.scale).permute(0, 3, 1, 2)


@dataclass
class Batch:
    """One training batch."""

    image: Tensor
    maps: Maps


class Joined:
    """Several picture sets one after the other, each repeated `weight` times, pictures of people seen `from_behind` as
    often again and again as `behind` says and those seen `from_the_side` as `sideways` says: photographs show fronts, and
    a network that has hardly seen a back gives it the arms of a front, right and left exchanged."""

    def __init__(self, sets: Sequence[tuple[LabelledPictures, int]], *, behind: int = 1, sideways: int = 1) -> None:
        def times(joints_px: NDArray[np.float32], states: NDArray[np.int64]) -> int:
            if behind > 1 and from_behind(joints_px, states):
                return behind
            return sideways if sideways > 1 and from_the_side(joints_px, states) else 1

        self._index = [
            (pictures, i)
            for pictures, weight in sets
            for i in range(len(pictures))
            for _ in range(weight * (times(*pictures.people[i][:2]) if max(behind, sideways) > 1 else 1))
        ]

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, i: int) -> Sample:
        pictures, k = self._index[i]
        return pictures[k]

    def visible(self, i: int) -> np.ndarray:
        """Which joints `(people, parts)` of a picture are marked visible."""
        pictures, k = self._index[i]
        return pictures.visible(k)


def beside(left: Sample, right: Sample) -> Sample:
    """Two pictures as one, the second brought to the height of the first and set to its right, with the people of both."""
    height = left.image.size[1]
    ratio = height / right.image.size[1]
    other = right.image.resize((round(ratio * right.image.size[0]), height), Image.Resampling.BILINEAR)
    both = Image.new("RGB", (left.image.size[0] + other.size[0], height))
    both.paste(left.image, (0, 0))
    both.paste(other, (left.image.size[0], 0))
    scale = np.array([other.size[0] / right.image.size[0], ratio], np.float32)
    shift = np.array([left.image.size[0], 0], np.float32)
    return Sample(
        both,
        np.concatenate((left.joints_px, right.joints_px * scale + shift)),
        np.concatenate((left.states, right.states)),
        np.concatenate((left.boxes_px, right.boxes_px * np.tile(scale, 2) + np.tile(shift, 2))),
    )


def stack_people(
    people: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], parts: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Joints, states and boxes of a batch, empty person slots filled up."""
    most = max(1, *(len(p[0]) for p in people))
    joints = np.zeros((len(people), most, parts, 2), np.float32)
    states = np.full((len(people), most, parts), State.OUTSIDE, np.int64)
    boxes = np.full((len(people), most, 4), -1, np.float32)
    for k, (j, s, b) in enumerate(people):
        joints[k, : len(j)], states[k, : len(s)], boxes[k, : len(b)] = j, s, b
    return torch.from_numpy(joints), torch.from_numpy(states), torch.from_numpy(boxes)


@dataclass(frozen=True)
class BatchMaker:
    """Makes batch number `step`."""

    pictures: Pictures
    skeleton: Skeleton
    size: tuple[int, int]
    batch: int
    seed: int
    augment: AugmentParams
    normalise: Normalisation
    nobody: float = 0.0
    """Share of the pictures whose people are taken away."""

    def __call__(self, step: int) -> Batch:
        per_epoch = max(1, len(self.pictures) // self.batch)
        epoch, k = divmod(step, per_epoch)
        order = np.random.default_rng((self.seed, 1, epoch)).permutation(len(self.pictures))
        rng = np.random.default_rng((self.seed, 2, step))
        images, people = [], []
        for i in order[k * self.batch : (k + 1) * self.batch]:
            sample = self.pictures[int(i)]
            if self.nobody > 0 and rng.random() < self.nobody:
                sample = nobody(sample, rng)
            pixels, *person = augment.apply(sample, self.size, self.skeleton, self.augment, rng)
            images.append(pixels)
            people.append(tuple(person))
        joints, states, boxes = stack_people(people, len(self.skeleton.parts))
        maps = targets.encode(joints, states, boxes, self.skeleton, self.size)
        image = self.normalise(torch.from_numpy(np.stack(images)))
        return Batch(image.contiguous(memory_format=torch.channels_last), maps)


def prefetch(make: Callable[[int], Batch], first: int, last: int, *, ahead: int = 2) -> Iterator[Batch]:
    """Batches `first .. last`, prepared on a thread at most `ahead` in advance."""
    ready: queue.Queue[Batch | BaseException] = queue.Queue(maxsize=ahead)
    stop = threading.Event()

    def work() -> None:
        for step in range(first, last):
            try:
                item: Batch | BaseException = make(step)
            except BaseException as error:  # noqa: BLE001 - handed to the consumer, raised there
                item = error
            while not stop.is_set():
                try:
                    ready.put(item, timeout=0.2)
                    break
                except queue.Full:
                    continue
            if stop.is_set() or isinstance(item, BaseException):
                return

    thread = threading.Thread(target=work, daemon=True, name="batches")
    thread.start()
    try:
        for _ in range(first, last):
            item = ready.get()
            if isinstance(item, BaseException):
                raise item
            yield item
    finally:
        stop.set()
        thread.join()
