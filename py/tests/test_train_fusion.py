"""The study of label fusion: labels as annotators leave them, fabric over arms, pictures side by side, the judge."""

from __future__ import annotations

from pathlib import Path

from train_support import require_training_packages

require_training_packages()

import numpy as np  # noqa: E402
import torch  # noqa: E402
from PIL import Image  # noqa: E402

from ogg_rs.train.augment import Sample  # noqa: E402
from ogg_rs.train.batches import beside  # noqa: E402
from ogg_rs.train.drape import drape  # noqa: E402
from ogg_rs.train.skeleton import NECK, PARTS  # noqa: E402
from ogg_rs.train.targets import State  # noqa: E402
from ogg_rs.train.trunk import FEATURES  # noqa: E402
from ogg_rs.train.trunk.drawing import montage  # noqa: E402
from ogg_rs.train.trunk.head import AROUND, AT, Head  # noqa: E402
from ogg_rs.train.trunk.study import ARM_SIGMAS, Cells, annotated, arm_ap, solve, table  # noqa: E402

ELBOW, WRIST = PARTS.index("right_elbow"), PARTS.index("right_wrist")


def one_person() -> tuple[np.ndarray, np.ndarray]:
    joints = np.zeros((1, len(PARTS), 2), np.float32)
    joints[0, ELBOW], joints[0, WRIST] = (60, 100), (120, 110)
    states = np.full((1, len(PARTS)), State.OUTSIDE)
    states[0, [ELBOW, WRIST]] = State.LABELLED
    return joints, states


def test_only_covered_arm_joints_and_the_neck_lose_their_labels() -> None:
    states = torch.full((2, 1, len(PARTS)), int(State.LABELLED))
    seen = torch.ones_like(states, dtype=torch.bool)
    nose = PARTS.index("nose")
    seen[0, 0, [WRIST, NECK, nose]] = False
    states[1, 0, WRIST] = State.OUTSIDE
    seen[1, 0, WRIST] = False
    left = annotated(states, seen, State.UNKNOWN)
    changed = (left != states).nonzero().tolist()
    assert changed == [[0, 0, NECK], [0, 0, WRIST]]
    assert left[0, 0, WRIST] == State.UNKNOWN
    assert torch.equal(annotated(states, seen, State.LABELLED), states)


def test_fabric_lies_over_the_joints_that_it_says_and_changes_nothing_far_away() -> None:
    joints, states = one_person()
    picture = np.full((200, 200, 3), 77.0, np.float32)
    hits = []
    for seed in range(20):
        covered, under = drape(picture, joints, states, 1.0, np.random.default_rng(seed))
        again, _ = drape(picture, joints, states, 1.0, np.random.default_rng(seed))
        assert np.array_equal(covered, again)
        assert not under[0, [i for i in range(len(PARTS)) if i not in (ELBOW, WRIST)]].any()
        for part in (ELBOW, WRIST):
            x, y = joints[0, part].astype(int)
            if under[0, part]:
                assert np.abs(covered[y - 1 : y + 2, x - 1 : x + 2] - 77).max() > 1
        assert np.array_equal(covered[:8, 190:], picture[:8, 190:])
        hits.append(under[0, WRIST])
    assert np.mean(hits) > 0.7
    untouched, under = drape(picture, joints, states, 0.0, np.random.default_rng(0))
    assert np.array_equal(untouched, picture)
    assert not under.any()


def test_a_picture_beside_another_takes_its_people_along() -> None:
    joints, states = one_person()
    boxes = np.array([[50, 90, 130, 120]], np.float32)
    left = Sample(Image.new("RGB", (200, 100), (255, 0, 0)), joints, states, boxes)
    right = Sample(Image.new("RGB", (300, 200), (0, 0, 255)), joints, states, boxes)
    both = beside(left, right)
    assert both.image.size == (350, 100)
    assert both.image.getpixel((199, 50)) == (255, 0, 0)
    assert both.image.getpixel((201, 50)) == (0, 0, 255)
    assert both.joints_px[0, WRIST].tolist() == [120, 110]
    assert both.joints_px[1, WRIST].tolist() == [260, 55]
    assert both.boxes_px[1].tolist() == [225, 45, 265, 60]


def test_a_fresh_second_stage_repeats_the_first_and_a_trained_one_changes_fields_alone() -> None:
    torch.manual_seed(0)
    features = [torch.randn(1, channels, side, side) for _, channels, side in FEATURES.values()]
    head = Head(19, 38).eval()
    with torch.no_grad():
        (pcm, paf), second = head(*features)
        assert torch.equal(second[0], pcm)
        assert torch.equal(second[1], paf)
        head.fields.correct.bias.fill_(0.5)
        _, second = head(*features)
    assert torch.equal(second[0], pcm)
    assert torch.allclose(second[1], paf + 0.5)


def test_average_precision_of_arms_follows_its_closed_form() -> None:
    labelled = np.ones((4, 6), bool)
    area = np.full(4, 10000.0)
    score = np.array([0.9, 0.8, 0.7, 0.6])
    assert arm_ap(np.zeros((4, 6)), labelled, area, score) == 1.0
    assert arm_ap(np.full((4, 6), np.inf), labelled, area, score) == 0.0
    # The last of four is lost: recall reaches 0.75, precision is 1 until then, so 76 of the 101 recalls have it.
    distance = np.zeros((4, 6))
    distance[3] = np.inf
    assert abs(arm_ap(distance, labelled, area, score) - 76 / 101) < 1e-12
    # An OKS of 0.72 passes the thresholds 0.5 to 0.7, five of ten.
    distance = np.tile(np.sqrt(-2 * np.log(0.72) * 10000.0) * 2 * ARM_SIGMAS, (4, 1))
    assert abs(arm_ap(distance, labelled, area, score) - 0.5) < 1e-12


def test_solved_weights_are_those_of_a_ridge_regression_over_the_drawn_pictures() -> None:
    rng = np.random.default_rng(4)
    size, count, pictures, seed, ridge = AROUND + AT + 1, 1200, 30, 5, 3.0
    values = rng.normal(size=(count, size)).astype(np.float16)
    values[:, -1] = 1
    weights, numbers = rng.uniform(1, 5, count).astype(np.float32), rng.integers(0, pictures, count)
    wanted = rng.uniform(0.01, 1, (count, 2)).astype(np.float32)
    counts = np.ones((count, 2), np.bool_)
    counts[rng.random(count) < 0.3, 1] = False
    cells = object.__new__(Cells)
    cells.values, cells.weights, cells.numbers = (torch.from_numpy(v) for v in (values, weights, numbers))
    cells.pictures, cells._whole = pictures, {}
    got = solve(cells, torch.from_numpy(wanted), torch.from_numpy(counts), seed, ridge=ridge).numpy()
    times = np.bincount(np.random.default_rng((seed, 11)).integers(0, pictures, pictures), minlength=pictures)
    for joint in range(2):
        root = np.sqrt(weights.astype(float) * times[numbers] * counts[:, joint])[:, None]
        penalty = np.sqrt(ridge) * np.eye(size)[:-1]
        rows = np.concatenate((root * values.astype(float), penalty))
        right = np.concatenate((root[:, 0] * wanted[:, joint], np.zeros(size - 1)))
        assert np.abs(np.linalg.lstsq(rows, right, rcond=None)[0] - got[:, joint]).max() < 1e-3


def test_the_table_has_means_and_half_ranges_in_percent() -> None:
    from ogg_rs.train.trunk.study import COLUMNS

    rows = [dict.fromkeys(COLUMNS, value) | {"seed": seed} for seed, value in ((1, 0.5), (2, 0.6))]
    assert table({"empty": rows}).splitlines()[-1] == "| empty | " + " | ".join(["55.0 ± 5.0"] * len(COLUMNS)) + " |"


def test_arms_are_drawn_side_by_side(tmp_path: Path) -> None:
    joints = np.full((6, 3), 40, np.float32)
    tile = (np.zeros((64, 80, 3), np.float32), joints, np.zeros(6, bool))
    montage([[tile, tile]], ["a", "b"], tmp_path / "sheet.jpg")
    with Image.open(tmp_path / "sheet.jpg") as sheet:
        assert sheet.size == (160, 80)
        assert sum(sheet.getpixel((40, 56))) > 100
