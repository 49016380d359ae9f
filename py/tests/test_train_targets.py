"""Targets, masks and label fusion against loops that follow the definitions word by word."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np
import torch

from ogg_rs.train.skeleton import LIMBS, OPENPOSE18, PARTS, UPPER_LIMB
from ogg_rs.train.targets import LIMB_HALF_WIDTH_PX, MASK_RADIUS, SIGMA_PX, Maps, State, encode, encode_in_torch, fuse

SIZE = (96, 64)
TOLERANCE = 1e-6


def scene(seed: int, people: int = 3) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    joints = rng.uniform((-10, -10), (SIZE[0] + 10, SIZE[1] + 10), (2, people, len(PARTS), 2))
    states = rng.choice([s.value for s in State], (2, people, len(PARTS)), p=[0.1, 0.15, 0.15, 0.6])
    corner = rng.uniform(0, 40, (2, people, 2))
    boxes = np.concatenate((corner, corner + rng.uniform(10, 50, (2, people, 2))), 2)
    return (
        torch.from_numpy(joints.astype(np.float32)), torch.from_numpy(states), torch.from_numpy(boxes.astype(np.float32))
    )  # fmt: skip


def slow(joints: np.ndarray, states: np.ndarray, boxes: np.ndarray) -> tuple[np.ndarray, ...]:
    """One picture, cell by cell."""
    w, h = SIZE[0] // 8, SIZE[1] // 8
    pcm, paf = np.zeros((19, h, w)), np.zeros((38, h, w))
    pcm_mask, paf_mask = np.ones((19, h, w), bool), np.ones((38, h, w), bool)
    for row in range(h):
        for column in range(w):
            x, y = 8 * column + 4.0, 8 * row + 4.0
            for person in range(len(joints)):
                x0, y0, x1, y1 = boxes[person]
                inside = x0 <= x <= x1 and y0 <= y <= y1
                for j in range(18):
                    d2 = (x - joints[person, j, 0]) ** 2 + (y - joints[person, j, 1]) ** 2
                    state = states[person, j]
                    if state == State.LABELLED:
                        pcm[j, row, column] = max(pcm[j, row, column], math.exp(-d2 / (2 * SIGMA_PX**2)))
                    if state == State.HIDDEN and d2 < (MASK_RADIUS * SIGMA_PX) ** 2:
                        pcm_mask[j, row, column] = pcm_mask[18, row, column] = 0
                    if state == State.UNKNOWN and inside:
                        pcm_mask[j, row, column] = 0
            for c, (a, b) in enumerate(LIMBS):
                vectors = []
                for person in range(len(joints)):
                    ends = (states[person, a], states[person, b])
                    x0, y0, x1, y1 = boxes[person]
                    if State.UNKNOWN in ends and State.OUTSIDE not in ends and x0 <= x <= x1 and y0 <= y <= y1:
                        paf_mask[2 * c : 2 * c + 2, row, column] = 0
                    if not all(e in (State.LABELLED, State.HIDDEN) for e in ends):
                        continue
                    p, q = joints[person, a], joints[person, b]
                    length = math.hypot(*(q - p))
                    v = (q - p) / length
                    forward = (x - p[0]) * v[0] + (y - p[1]) * v[1]
                    sideways = (x - p[0]) * v[1] - (y - p[1]) * v[0]
                    if 0 <= forward <= length and abs(sideways) <= LIMB_HALF_WIDTH_PX:
                        if ends == (State.LABELLED, State.LABELLED):
                            vectors.append(v)
                        else:
                            paf_mask[2 * c : 2 * c + 2, row, column] = 0
                if vectors:
                    paf[2 * c : 2 * c + 2, row, column] = np.mean(vectors, 0)
            pcm[18, row, column] = 1 - pcm[:18, row, column].max()
            for person in range(len(joints)):
                x0, y0, x1, y1 = boxes[person]
                if (states[person] == State.UNKNOWN).any() and x0 <= x <= x1 and y0 <= y <= y1:
                    if pcm[18, row, column] > 0.5:
                        pcm_mask[18, row, column] = 0
    return pcm, paf, pcm_mask, paf_mask


@pytest.mark.parametrize("encoder", [encode, encode_in_torch])
@pytest.mark.parametrize("seed", range(5))
def test_encoding_equals_the_definition_cell_by_cell(seed: int, encoder: Callable[..., Maps]) -> None:
    joints, states, boxes = scene(seed)
    maps = encoder(joints, states, boxes, OPENPOSE18, SIZE)
    for b in range(2):
        expected = slow(joints[b].numpy().astype(float), states[b].numpy(), boxes[b].numpy())
        for got, want in zip((maps.pcm, maps.paf, maps.pcm_mask, maps.paf_mask), expected, strict=True):
            assert np.abs(got[b].numpy().astype(float) - want).max() < 10 * TOLERANCE


def test_a_hidden_joint_is_neither_taught_nor_allowed_elsewhere() -> None:
    joints = torch.full((1, 1, 18, 2), 20.0)
    states = torch.full((1, 1, 18), int(State.OUTSIDE))
    knee = PARTS.index("left_knee")
    states[0, 0, knee] = State.HIDDEN
    maps = encode(joints, states, torch.zeros(1, 1, 4), OPENPOSE18, SIZE)
    assert maps.pcm[0, knee].abs().max() == 0
    assert maps.pcm_mask[0, knee, 2, 2] == 0
    assert maps.pcm_mask[0, knee, 7, 11] == 1
    assert maps.pcm_mask[0, PARTS.index("right_knee")].all()


def test_an_empty_picture_is_background_everywhere() -> None:
    maps = encode(
        torch.zeros(1, 1, 18, 2), torch.full((1, 1, 18), int(State.OUTSIDE)), torch.zeros(1, 1, 4), OPENPOSE18, SIZE
    )
    assert (maps.pcm[0, 18] == 1).all()
    assert maps.pcm[0, :18].abs().max() == 0
    assert maps.paf.abs().max() == 0
    assert maps.pcm_mask.all() and maps.paf_mask.all()


def test_mirroring_the_joints_mirrors_the_maps() -> None:
    joints, states, boxes = scene(11)
    order = list(OPENPOSE18.mirror)
    flipped = joints[:, :, order].clone()
    flipped[..., 0] = SIZE[0] - flipped[..., 0]
    mirrored_boxes = boxes.clone()
    mirrored_boxes[..., 0], mirrored_boxes[..., 2] = SIZE[0] - boxes[..., 2], SIZE[0] - boxes[..., 0]
    here = encode(joints, states, boxes, OPENPOSE18, SIZE)
    there = encode(flipped, states[:, :, order], mirrored_boxes, OPENPOSE18, SIZE)
    assert torch.allclose(here.pcm[:, :18].flip(-1), there.pcm[:, order], atol=1e-5)
    limb_of = {limb: c for c, limb in enumerate(LIMBS)}
    for c, (a, b) in enumerate(LIMBS):
        other = limb_of[(order[a], order[b])]
        assert torch.allclose(-here.paf[:, 2 * c].flip(-1), there.paf[:, 2 * other], atol=1e-5)
        assert torch.allclose(here.paf[:, 2 * c + 1].flip(-1), there.paf[:, 2 * other + 1], atol=1e-5)


def test_a_picture_that_is_no_multiple_of_the_stride_is_refused() -> None:
    with pytest.raises(ValueError, match="multiples of 8, got 100x64"):
        encode(torch.zeros(1, 1, 18, 2), torch.zeros(1, 1, 18), torch.zeros(1, 1, 4), OPENPOSE18, (100, 64))


def test_fusion_equals_equation_3_cell_by_cell() -> None:
    rng = np.random.default_rng(5)
    shape = (2, 19, 4, 5)
    field = (2, 38, 4, 5)
    masks = (torch.from_numpy(rng.uniform(size=s) < 0.5) for s in (shape, field))
    own = Maps(*(torch.from_numpy(rng.uniform(0, 1, s)) for s in (shape, field)), *masks)
    own.paf[rng.uniform(size=field) < 0.3] = 0
    teacher_pcm = torch.from_numpy(rng.uniform(0, 1, shape))
    teacher_paf = torch.from_numpy(rng.uniform(-1, 1, field))
    fused = fuse(own, teacher_pcm, teacher_paf, floor=0.1)
    for b, y, x in np.ndindex(2, 4, 5):
        for j in range(18):
            assert fused.pcm[b, j, y, x] == max(own.pcm[b, j, y, x], teacher_pcm[b, j, y, x])
            answered = teacher_pcm[b, j, y, x] >= 0.1
            assert fused.pcm_mask[b, j, y, x] == (answered or own.pcm_mask[b, j, y, x])
        assert fused.pcm[b, 18, y, x] == 1 - fused.pcm[b, :18, y, x].max()
        for c in range(19):
            mine, theirs = own.paf[b, 2 * c : 2 * c + 2, y, x], teacher_paf[b, 2 * c : 2 * c + 2, y, x]
            want = mine if math.hypot(*mine) > math.hypot(*theirs) else theirs
            assert torch.equal(fused.paf[b, 2 * c : 2 * c + 2, y, x], want)


def test_the_upper_limb_profile_keeps_the_order_of_the_full_one() -> None:
    assert UPPER_LIMB.parts == PARTS[:8]
    assert UPPER_LIMB.limbs == ((1, 2), (2, 3), (3, 4), (1, 5), (5, 6), (6, 7), (1, 0))
    assert (UPPER_LIMB.part_maps, UPPER_LIMB.field_maps) == (9, 14)
    assert (OPENPOSE18.part_maps, OPENPOSE18.field_maps) == (19, 38)
