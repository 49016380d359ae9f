"""What is read from and written to files: COCO annotations, true places, model cards."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np

from ogg_rs.train import card
from ogg_rs.train.coco import person
from ogg_rs.train.skeleton import COCO17, LIMBS, OPENPOSE18, PARTS, UPPER_LIMB
from ogg_rs.train.targets import State

SIZE = (320, 240)


def annotation(**flags: int) -> dict:
    """Every joint at (10 k, 5 k) for COCO's index k, visible unless `flags` says otherwise."""
    rows: list[float] = []
    for k, name in enumerate(COCO17):
        v = flags.get(name, 2)
        rows += [10.0 * k, 5.0 * k, v] if v else [0, 0, 0]
    return {"id": 1, "bbox": [10, 20, 100, 50], "keypoints": rows}


def test_coco_pixels_become_continuous_ones_and_the_neck_is_between_the_shoulders() -> None:
    joints, states, box = person(annotation(), None, SIZE)
    assert joints[PARTS.index("right_wrist")].tolist() == [100.5, 50.5]
    assert joints[PARTS.index("neck")].tolist() == [55.5, 28.0]
    assert box.tolist() == [10.5, 20.5, 110.5, 70.5]
    assert (states == State.LABELLED).all()


def test_an_unlabelled_joint_is_unknown_and_takes_the_neck_with_it() -> None:
    _, states, _ = person(annotation(left_shoulder=0, right_knee=0), None, SIZE)
    assert [PARTS[k] for k in np.flatnonzero(states == State.UNKNOWN)] == ["neck", "left_shoulder", "right_knee"]


def test_with_true_places_covered_arms_are_labelled_and_other_covered_joints_hidden() -> None:
    places = np.full((18, 2), 60, np.float32)
    places[PARTS.index("right_ankle")] = (60, 500)
    flags = {"right_wrist": 1, "left_elbow": 0, "left_hip": 1, "right_knee": 0, "right_ankle": 0}
    joints, states, _ = person(annotation(**flags), places, SIZE)
    state = {name: State(int(s)) for name, s in zip(PARTS, states, strict=True)}
    assert state["right_wrist"] == state["left_elbow"] == state["neck"] == State.LABELLED
    assert state["left_hip"] == state["right_knee"] == State.HIDDEN
    assert state["right_ankle"] == State.OUTSIDE
    assert joints[PARTS.index("left_elbow")].tolist() == [60.5, 60.5]


def test_a_crowd_is_unknown_whole() -> None:
    _, states, _ = person(annotation() | {"iscrowd": 1}, None, SIZE)
    assert (states == State.UNKNOWN).all()


def test_a_wrong_number_of_keypoints_is_refused_with_the_annotation_named() -> None:
    with pytest.raises(ValueError, match="annotation 7: expected 51 keypoint numbers, got 3"):
        person({"id": 7, "bbox": [0, 0, 1, 1], "keypoints": [1, 2, 2]}, None, SIZE)


def test_the_card_gives_each_limb_the_channels_of_the_published_coco_model(tmp_path: Path) -> None:
    path, model = tmp_path / "x.toml", tmp_path / "x.onnx"
    card.write(path, model, "0" * 64, (256, 192), OPENPOSE18)
    rows = re.findall(r'from = "(\w+)", to = "(\w+)", paf = \[(\d+), (\d+)\]', path.read_text())
    order = [[1, 2], [1, 5], [2, 3], [3, 4], [5, 6], [6, 7], [1, 8], [8, 9], [9, 10], [1, 11], [11, 12], [12, 13],
             [1, 0], [0, 14], [14, 16], [0, 15], [15, 17], [2, 16], [5, 17]]  # fmt: skip
    channels = [12, 20, 14, 16, 22, 24, 0, 2, 4, 6, 8, 10, 28, 30, 34, 32, 36, 18, 26]
    assert [[PARTS.index(a), PARTS.index(b)] for a, b, _, _ in rows] == order
    assert [(int(x), int(y)) for _, _, x, y in rows] == [(c, c + 1) for c in channels]
    assert sorted(int(x) for _, _, x, _ in rows) == list(range(0, 2 * len(LIMBS), 2))


def test_renewing_a_card_keeps_what_people_wrote(tmp_path: Path) -> None:
    path, model = tmp_path / "x.toml", tmp_path / "x.onnx"
    card.write(path, model, "0" * 64, (256, 192), UPPER_LIMB)
    path.write_text(path.read_text().replace('limits = ""', 'limits = "only puppets"'))
    card.write(path, model, "1" * 64, (128, 96), UPPER_LIMB)
    text = path.read_text()
    assert 'limits = "only puppets"' in text
    assert json.dumps("1" * 64) in text
    assert "width = 128" in text
