"""Scores on real recordings: readers, windows and counting."""

from __future__ import annotations

from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

from ogg_rs.train import card, real  # noqa: E402
from ogg_rs.train.coco import COCO_CENTRE_PX  # noqa: E402
from ogg_rs.train.skeleton import ARM_PARTS, PARTS  # noqa: E402


def test_labels_set_by_hand_are_whole() -> None:
    people = real.hand_rows()
    assert len(people) == 50
    assert sum(len(joints) for joints, _ in people.values()) == 252
    arms = {PARTS[i] for i in ARM_PARTS}
    for joints, torso in people.values():
        assert set(joints) <= arms
        assert 15 < torso < 800
        places = np.stack(list(joints.values()))
        assert (places > -5).all()
        assert (places < 1930).all()
        assert np.ptp(places, axis=0).max() < 4 * torso


def test_a_window_of_a_picture_maps_back_to_its_pixels() -> None:
    image = Image.fromarray(np.random.default_rng(0).integers(0, 255, (200, 300, 3)).astype(np.uint8))
    seen: list[tuple[int, int]] = []

    def answer(piece: Image.Image) -> np.ndarray:
        seen.append(piece.size)
        return np.array([[piece.size[0] / 2, piece.size[1] / 4, 1.0]] * len(PARTS))

    found = real.look(answer, image, (-20.0, 30.0, 120.0))
    assert seen == [(120, 120)]
    assert found[0].tolist() == [40.0, 60.0, 1.0]
    large = real.look(answer, Image.new("RGB", (2000, 2000)), (100.0, 0.0, 1600.0))
    assert seen[1] == (512, 512)
    assert large[0].tolist() == [900.0, 400.0, 1.0]


def test_a_window_repeats_the_edge_of_the_picture_outside_of_it() -> None:
    pixels = np.zeros((80, 80, 3), np.uint8)
    pixels[:, 0] = 200
    piece, _ = real.square(Image.fromarray(pixels), (-64.0, 0.0, 64.0))
    assert (np.asarray(piece) == 200).all()


def test_the_square_around_a_person_holds_every_sure_joint_above_the_knees() -> None:
    found = np.zeros((len(PARTS), 3))
    rng = np.random.default_rng(1)
    found[:, :2] = rng.uniform(200, 300, (len(PARTS), 2))
    found[:, 2] = 0.9
    found[PARTS.index("left_ankle"), :2] = (300, 900)
    x, y, side = real.around(found, Image.new("RGB", (640, 480)))
    upper = [i for i, name in enumerate(PARTS) if not name.endswith(("knee", "ankle"))]
    assert (found[upper, :2] >= (x, y)).all()
    assert (found[upper, :2] <= (x + side, y + side)).all()
    assert side < 200
    found[:, 2] = 0.05
    assert real.around(found, Image.new("RGB", (640, 480))) is None


def test_joints_count_as_found_within_their_share_of_the_torso_and_missed_below_the_floor() -> None:
    truth = {"right_wrist": np.array([10.0, 10.0]), "left_wrist": np.array([50.0, 10.0])}
    case = real.Judged(Image.new("RGB", (8, 8)), truth, 100.0, "somebody")
    found = np.zeros((len(PARTS), 3))
    found[PARTS.index("right_wrist")] = (10, 25, 0.8)
    found[PARTS.index("left_wrist")] = (50, 10, 0.05)
    tally = real.judge([(case, found)])["somebody"]["wrist"]
    assert tally.errors == [0.15, float("inf")]
    assert tally.pck(0.1) == 0.0
    assert tally.pck(0.2) == 0.5


def test_the_decoder_finds_the_rendered_worker_where_he_is_drawn() -> None:
    sim = pytest.importorskip("ogg_rs.sim", reason="the wheel is not installed")
    frame = sim.Scene(sim.Worker(seed=5), size=(320, 240)).render(1.0)
    answer = real.people_answer(Path(__file__).parents[2] / "crates/pose/models/ogg-lite.onnx")
    found = answer(Image.fromarray(frame.image))
    assert found.shape == (len(PARTS), 3)
    seen = [i for i in ARM_PARTS if found[i, 2] > 0]
    assert len(seen) >= 5
    assert np.abs(found[seen, :2] - (frame.joints_px[seen] + COCO_CENTRE_PX)).max() < 8
    assert not answer(Image.new("RGB", (320, 240)))[:, 2].any(), "nobody in an empty picture"


def test_the_decoder_needs_the_card(tmp_path: Path) -> None:
    pytest.importorskip("ogg_rs.pose", reason="the wheel is not installed")
    with pytest.raises(FileNotFoundError, match=r"lite.toml: expected the card of the network"):
        real.people_answer(tmp_path / "lite.onnx")


def test_crops_are_read_with_their_subjects(tmp_path: Path) -> None:
    path = tmp_path / "crops.npz"
    np.savez(
        path, C=np.zeros((2, 64, 64, 3), np.uint8), U=np.full((2, 8, 2), 7.0, np.float32), T=np.array([20.0, 30.0]),
        tag=np.array(["single1", "walk"]),
    )  # fmt: skip
    first, second = real.crop_cases(path)
    assert (first.subject, second.subject) == ("single", "walk")
    assert first.truth["left_elbow"].tolist() == [7.0 + COCO_CENTRE_PX] * 2
    assert set(first.truth) == {PARTS[i] for i in ARM_PARTS}


def test_a_reference_is_read_frame_by_frame(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    writer = cv2.VideoWriter(str(tmp_path / "cam01.mp4"), cv2.VideoWriter_fourcc(*"mp4v"), 30, (64, 48))
    for i in range(4):
        writer.write(np.full((48, 64, 3), 60 * i, np.uint8))
    writer.release()
    names = [f"{s}{j}_{c}_px" for s in "rl" for j in ("sho", "elb", "wri") for c in "uv"]
    lines = [",".join(["camera", "frame", *names])]
    lines += [",".join(["cam01", str(f), *(str(float(k)) for k in range(12))]) for f in range(4)]
    (tmp_path / "reference2d.csv").write_text("\n".join(lines))
    cases = list(real.reference_cases(tmp_path, 2))
    assert [round(np.asarray(c.image).mean() / 60) for c in cases] == [0, 2]
    assert cases[0].truth["left_wrist"].tolist() == [10.5, 11.5]
    assert cases[0].torso_px == pytest.approx(real.TORSO_PER_UPPER_ARM * 8**0.5)


def test_a_card_says_how_to_feed_its_network() -> None:
    own = Path(__file__).parents[2] / "crates/pose/models/ogg-lite.toml"
    stride, normalise = card.reading(own)
    assert stride == 8
    assert (normalise.mean, normalise.scale, normalise.bgr) == (128.0, 256.0, True)
