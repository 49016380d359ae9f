"""Rendered people: labels, cameras, looks; the rendering itself where its packages are installed."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

from ogg_rs.train.coco import COCO_CENTRE_PX, CocoKeypoints  # noqa: E402
from ogg_rs.train.people import look, scene, writing  # noqa: E402
from ogg_rs.train.people.body import TEXELS, Region, between, rotation, turned  # noqa: E402
from ogg_rs.train.skeleton import COCO17, PARTS  # noqa: E402
from ogg_rs.train.targets import State  # noqa: E402


def person(visible: list[str], fabric: list[str]) -> scene.Person:
    places = np.stack((np.linspace(20, 200, 17), np.linspace(30, 150, 17)), 1)
    metres = np.concatenate((places / 100, np.full((17, 1), 2.0)), 1)
    return scene.Person(places, metres, np.isin(COCO17, visible), np.isin(COCO17, fabric))


def test_labels_say_what_is_seen_what_is_covered_and_where_everything_is(tmp_path: Path) -> None:
    size = (288, 256)
    shown = person(["left_shoulder", "right_shoulder", "nose"], ["left_wrist"])
    shot = scene.Shot(Image.new("RGB", size, (9, 9, 9)), [shown])
    (tmp_path / "images").mkdir()
    (tmp_path / "labels").mkdir()
    writing._keep(shot, tmp_path, 0, size)
    writing.write(tmp_path, 1, 0, size=size)
    data = CocoKeypoints(tmp_path)
    sample = data[0]
    wrist, knee = PARTS.index("left_wrist"), PARTS.index("left_knee")
    place = shown.joints_px[COCO17.index("left_wrist")]
    assert np.abs(sample.joints_px[0, wrist] - place).max() < 0.02
    assert sample.states[0, wrist] == State.LABELLED
    assert sample.states[0, knee] == State.HIDDEN
    assert data.visible(0)[0, PARTS.index("neck")]
    assert not data.visible(0)[0, wrist]
    assert [PARTS[i] for i in np.flatnonzero(data.under_fabric()[0])] == ["left_wrist"]
    neck = np.array(json.loads((tmp_path / "extras.json").read_text())["annotations"][0]["keypoints18"][PARTS.index("neck")])
    shoulders = shown.joints_px[[COCO17.index("left_shoulder"), COCO17.index("right_shoulder")]].mean(0)
    assert np.abs(neck + COCO_CENTRE_PX - shoulders).max() < 1e-3


def test_a_camera_projects_by_hand_computed_similar_triangles() -> None:
    pose = np.eye(4)
    pose[:3, 3] = (0, 0, 5)
    camera = scene._Camera(pose, 100.0, (50.0, 40.0))
    pixels, local = camera.project(np.array([[1.0, 2.0, 0.0]]))
    assert np.allclose(pixels, [[70.0, 0.0]])
    assert np.allclose(local, [[1.0, -2.0, 5.0]])


def test_a_surface_over_a_grid_looks_up_whichever_way_the_grid_runs() -> None:
    for rows in (np.linspace(0, 1, 3), np.linspace(1, 0, 3)):
        x, y = np.meshgrid(np.linspace(0, 1, 4), rows)
        points = np.stack((x, y, 0 * x), -1).reshape(-1, 3)
        a, b, c = (points[scene.upward_faces(x, y)[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_rotations_turn_what_they_say() -> None:
    assert np.allclose(rotation((0, 0, 1), np.pi / 2) @ (1, 0, 0), (0, 1, 0))
    assert np.allclose(turned(90, 0, 90) @ (0, 1, 0), (0, 0, 1))
    rng = np.random.default_rng(0)
    for a, b in rng.normal(size=(50, 2, 3)):
        turn = between(a, b)
        assert np.allclose(turn @ a / np.linalg.norm(a), b / np.linalg.norm(b))
        assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.allclose(between(np.array([0, 0, 1.0]), np.array([0, 0, -1.0])) @ (0, 0, 1), (0, 0, -1))


def test_looks_follow_the_seed_and_dress_what_they_say() -> None:
    regions = np.full((TEXELS, TEXELS), Region.TORSO, np.uint8)
    rooms = look.Backgrounds(None)
    first = look.outfit(np.random.default_rng(5), regions, rooms)
    again = look.outfit(np.random.default_rng(5), regions, rooms)
    other = look.outfit(np.random.default_rng(6), regions, rooms)
    assert first[0].tobytes() == again[0].tobytes() != other[0].tobytes()
    assert look.room(np.random.default_rng(1), (40, 30)).shape == (30, 40, 3)


def test_a_folder_without_photographs_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="expected pictures"):
        look.Backgrounds(tmp_path)


@pytest.mark.skipif(importlib.util.find_spec("anny") is not None, reason="the body model is installed")
def test_without_the_body_model_the_error_names_what_to_install() -> None:
    with pytest.raises(ImportError, match="pip install anny"):
        scene.load_renderer()
