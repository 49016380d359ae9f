"""Pictures of nobody: what is painted, and that nothing is to be found in them."""

from __future__ import annotations

from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np
from ogg_rs.train import cli, empty
from ogg_rs.train.augment import AugmentParams, Sample
from ogg_rs.train.batches import BatchMaker, Normalisation
from ogg_rs.train.puppets import Puppets
from ogg_rs.train.skeleton import OPENPOSE18
from PIL import Image

BOX = (20.0, 30.0, 60.0, 90.0)
"""Its longer side is 60: painted are 9 pixels more on every side."""


def sample() -> Sample:
    pixels = np.random.default_rng(1).integers(0, 256, (120, 160, 3)).astype(np.uint8)
    joints, states = np.full((1, 18, 2), 40, np.float32), np.full((1, 18), 3, np.int64)
    return Sample(Image.fromarray(pixels), joints, states, np.array([BOX], np.float32))


def test_only_the_person_is_painted_over() -> None:
    before = np.asarray(sample().image)
    inside = np.zeros((120, 160), bool)
    inside[21:99, 11:69] = True
    kinds = set()
    for seed in range(12):
        after = np.asarray(empty.painted_over(sample(), np.random.default_rng(seed)))
        assert (after[~inside] == before[~inside]).all()
        painted = after[21:99, 11:69].astype(int)
        if (painted == painted[0, 0]).all():
            kinds.add("flat")
            assert (before == painted[0, 0]).all(2).any(), "a colour of the picture"
        else:
            kinds.add("slope")
            assert (painted[:, 0] == before[21:99, 10]).all()
            assert np.abs(painted[:, -1] - before[21:99, 69].astype(int)).max() <= 1
            assert np.abs(np.diff(painted, n=2, axis=1)).max() <= 2, "straight from edge to edge"
    assert kinds == {"flat", "slope"}


def test_a_box_beyond_the_picture_is_painted_to_its_edge() -> None:
    whole = sample()
    whole.boxes_px[0] = (-30, -30, 300, 300)
    for seed in range(6):
        after = np.asarray(empty.painted_over(whole, np.random.default_rng(seed)))
        assert after.shape == (120, 160, 3)
        assert (after != np.asarray(whole.image)).any(2).mean() > 0.95


def test_nobody_is_labelled() -> None:
    for seed in range(8):
        alone = empty.nobody(sample(), np.random.default_rng(seed))
        assert alone.image.size == (160, 120)
        assert (alone.joints_px.shape, alone.states.shape, alone.boxes_px.shape) == ((0, 18, 2), (0, 18), (0, 4))


def maker(nobody: float) -> BatchMaker:
    return BatchMaker(Puppets(12, 3), OPENPOSE18, (64, 64), 4, 5, AugmentParams(), Normalisation(), nobody)


def test_empty_pictures_ask_for_empty_maps_everywhere() -> None:
    maps = maker(1.0)(0).maps
    assert maps.pcm[:, :-1].abs().max() == 0
    assert maps.pcm[:, -1].min() == 1
    assert maps.paf.abs().max() == 0
    assert maps.pcm_mask.all() and maps.paf_mask.all()


def test_a_share_of_the_pictures_is_empty() -> None:
    found = [float(m.pcm[k, :-1].max()) > 0.5 for step in range(12) for m in [maker(0.5)(step).maps] for k in range(4)]
    assert 12 <= sum(found) <= 36


def test_a_share_beyond_one_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["fit", "--steps", "1", "--data", str(tmp_path), "--out", str(tmp_path / "run"), "--nobody", "1.5"]
    assert cli.main(arguments) == 2
    assert "--nobody: expected a share from 0 to 1, got 1.5" in capsys.readouterr().err


def test_eval_counts_whom_it_finds_where_nobody_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("ogg_rs.pose", reason="the wheel is not installed")
    model = Path(__file__).parents[2] / "crates/pose/models/ogg-lite.onnx"
    for k, level in enumerate((30, 90, 200)):
        Image.new("RGB", (320, 240), (level, level, level)).save(tmp_path / f"{k}.png")
    assert cli.main(["eval", "--model", str(model), "--nobody", str(tmp_path)]) == 0
    assert "nobody there, 3 pictures: somebody found in 0, surest keypoint 0.00" in capsys.readouterr().out
    assert cli.main(["eval", "--model", str(model), "--nobody", str(tmp_path / "none")]) == 2
    assert "none: expected a folder of pictures" in capsys.readouterr().err
