"""Whose joints are whose: skeletons in pictures of several people.

A joint is on a person within `NEAR` torso lengths of where it is visible. A person is found where one skeleton has at least `SHARE` of
the visible arm joints; a skeleton mixes people where it has at least two joints on each of two and they are not within that distance
of each other. People with fewer than three visible arm joints say nothing about grouping, and their pictures are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from .coco import COCO_CENTRE_PX, CocoKeypoints
from .skeleton import ARM_PARTS, PARTS

NEAR = 0.2
SHARE = 0.6
LEAST_JOINTS = 3

Skeletons = NDArray[np.float64]
"""`(n, 18, 3)`: x, y in continuous pixels and the score, 0 where a joint was not found."""


@dataclass(frozen=True)
class Person:
    """A labelled person: joints `(18, 2)` in continuous pixels, which arm joints `(18,)` count, and the torso's length."""

    joints_px: NDArray[np.float32]
    counts: NDArray[np.bool_]
    torso_px: float


@dataclass
class Grouping:
    """Counts over pictures."""

    pictures: int = 0
    people: int = 0
    found: int = 0
    joints: int = 0
    joined: int = 0
    skeletons: int = 0
    mixed: int = 0

    def add(self, people: list[Person], skeletons: Skeletons) -> None:
        """Counts one picture."""
        near = np.stack([_near(person, skeletons) for person in people], 1)  # (skeletons, people, 18)
        shared = near.sum(1, keepdims=True) > 1
        of_each = near.sum(2).max(0, initial=0)
        labelled = np.array([person.counts.sum() for person in people])
        self.pictures += 1
        self.people += len(people)
        self.joints += int(labelled.sum())
        self.joined += int(of_each.sum())
        self.found += int((of_each >= SHARE * labelled).sum())
        self.skeletons += len(skeletons)
        self.mixed += int((((near & ~shared).sum(2) >= 2).sum(1) >= 2).sum())

    def __str__(self) -> str:
        return (
            f"several people, {self.pictures} pictures: {self.found} of {self.people} people found, {self.joined} of {self.joints} "
            f"visible arm joints in their best skeleton, {self.mixed} of {self.skeletons} skeletons mix two people"
        )


def _near(person: Person, skeletons: Skeletons) -> NDArray[np.bool_]:
    distance = np.linalg.norm(skeletons[:, :, :2] - person.joints_px, axis=2)
    return person.counts & (skeletons[:, :, 2] > 0) & (distance <= NEAR * person.torso_px)


def labelled(data: CocoKeypoints) -> Iterable[tuple[int, list[Person]]]:
    """Pictures of several people, each with enough visible arm joints and a torso to measure by."""
    arms = np.isin(np.arange(len(PARTS)), ARM_PARTS)
    for i in range(len(data)):
        joints, visible = data.people[i][0], data.visible(i)
        people = [Person(j, v & arms, data.torso_px(i, k)) for k, (j, v) in enumerate(zip(joints, visible, strict=True))]
        if len(people) > 1 and all(p.counts.sum() >= LEAST_JOINTS and p.torso_px > 0 for p in people):
            yield i, people


def judge(data: CocoKeypoints, seen: Callable[[Image.Image], Skeletons]) -> Grouping:
    """Skeletons of the pictures of several people, compared with their labels. `seen` gives COCO's pixels."""
    total = Grouping()
    for i, people in tqdm(list(labelled(data)), desc="grouping", unit="img", leave=False):
        total.add(people, seen(data.image(i)) + (COCO_CENTRE_PX, COCO_CENTRE_PX, 0))
    return total
