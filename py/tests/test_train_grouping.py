"""Grouping: whose joints a skeleton holds, counted by hand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np
from ogg_rs.train import grouping
from ogg_rs.train.coco import COCO_CENTRE_PX, CocoKeypoints
from ogg_rs.train.grouping import Grouping, Person
from ogg_rs.train.skeleton import ARM_PARTS, COCO17, PARTS
from PIL import Image

ARMS = np.isin(np.arange(len(PARTS)), ARM_PARTS)


def person_at(x: float) -> Person:
    """Joints in a column of ten pixels' distance, torso of 20 pixels: a joint is near within 4."""
    joints = np.stack([np.full(len(PARTS), x), 10.0 * np.arange(len(PARTS))], 1)
    return Person(joints.astype(np.float32), ARMS, 20.0)


def skeleton_of(*parts: tuple[Person, list[int]], off: float = 0.0) -> np.ndarray:
    """A skeleton that takes these joints from these people, `off` pixels beside them."""
    joints = np.zeros((len(PARTS), 3))
    for person, rows in parts:
        joints[rows, :2] = person.joints_px[rows] + (off, 0)
        joints[rows, 2] = 1
    return joints


LEFT, RIGHT = person_at(0), person_at(100)
SIX = list(ARM_PARTS)


@pytest.mark.parametrize(
    ("skeletons", "found", "joined", "mixed"),
    [
        ([skeleton_of((LEFT, SIX)), skeleton_of((RIGHT, SIX))], 2, 12, 0),
        ([skeleton_of((LEFT, SIX), off=3.9)], 1, 6, 0),
        ([skeleton_of((LEFT, SIX), off=4.1)], 0, 0, 0),
        ([skeleton_of((LEFT, SIX[:4]))], 1, 4, 0),  # 4 of 6 is enough, 3 is not
        ([skeleton_of((LEFT, SIX[:3]))], 0, 3, 0),
        ([skeleton_of((LEFT, SIX[:3])), skeleton_of((LEFT, SIX[3:]))], 0, 3, 0),  # one person in two pieces
        ([skeleton_of((LEFT, SIX[:4]), (RIGHT, SIX[4:]))], 1, 6, 1),
        ([skeleton_of((LEFT, SIX[:5]), (RIGHT, SIX[5:]))], 1, 6, 0),  # a single joint may lie near by chance
        ([], 0, 0, 0),
    ],
)
def test_skeletons_are_compared_with_people(skeletons: list[np.ndarray], found: int, joined: int, mixed: int) -> None:
    total = Grouping()
    total.add([LEFT, RIGHT], np.stack(skeletons) if skeletons else np.zeros((0, len(PARTS), 3)))
    assert total == Grouping(1, 2, found, 12, joined, len(skeletons), mixed)


def test_joints_of_two_people_in_one_place_mix_nobody() -> None:
    total = Grouping()
    total.add([LEFT, person_at(1)], np.stack([skeleton_of((LEFT, SIX))]))
    assert (total.found, total.mixed) == (2, 0)


def test_only_pictures_that_say_something_are_judged(tmp_path: Path) -> None:
    Image.new("RGB", (64, 64)).save(tmp_path / "a.png")
    keypoints = np.tile([20.0, 30.0, 2.0], (len(COCO17), 1))
    keypoints[[COCO17.index(f"{side}_hip") for side in ("left", "right")], 1] = 50
    few = keypoints.copy()
    few[[COCO17.index(name) for name in ("left_elbow", "left_wrist", "right_elbow", "right_wrist")], 2] = 1

    def entry(identity: int, image: int, joints: np.ndarray) -> dict:
        return {"id": identity, "image_id": image, "bbox": [0, 0, 60, 60], "keypoints": joints.ravel().tolist()}

    index = {
        "images": [{"id": i, "file_name": "a.png", "width": 64, "height": 64} for i in range(3)],
        "annotations": [entry(0, 0, keypoints), entry(1, 0, keypoints), entry(2, 1, keypoints), entry(3, 2, keypoints), entry(4, 2, few)],
    }
    (tmp_path / "annotations.json").write_text(json.dumps(index))
    data = CocoKeypoints(tmp_path, images=tmp_path)
    ((number, people),) = grouping.labelled(data)
    assert (number, len(people)) == (0, 2)
    assert people[0].torso_px == pytest.approx(20)
    assert people[0].counts.sum() == 6

    def seen(image: Image.Image) -> np.ndarray:
        return np.concatenate([people[0].joints_px - COCO_CENTRE_PX, np.ones((len(PARTS), 1))], 1)[None].astype(np.float64)

    assert grouping.judge(data, seen).found == 2
