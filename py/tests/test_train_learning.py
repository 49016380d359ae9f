"""Loss, picture changes, data sets, decoding, and whole short runs."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from train_support import require_training_packages

require_training_packages()

import numpy as np
import torch
from PIL import Image

from ogg_rs.train import augment, cli, puppets
from ogg_rs.train.augment import AugmentParams, Sample
from ogg_rs.train.batches import BatchMaker, Normalisation
from ogg_rs.train.coco import CocoKeypoints
from ogg_rs.train.commands import augmentation
from ogg_rs.train.engine import FitParams, fit
from ogg_rs.train.evaluate import Case, decode_single, score
from ogg_rs.train.losses import MapWeights, stage_losses, total_loss
from ogg_rs.train.nets import OggLite
from ogg_rs.train.skeleton import OPENPOSE18, PARTS
from ogg_rs.train.targets import Maps, State, encode


def random_maps(rng: np.random.Generator) -> tuple[list[tuple[torch.Tensor, torch.Tensor]], Maps]:
    shapes = ((2, 19, 3, 4), (2, 38, 3, 4))
    stages = [tuple(torch.from_numpy(rng.normal(size=s)).requires_grad_() for s in shapes) for _ in range(3)]
    pcm, paf = (torch.from_numpy(rng.uniform(0, 1, s)) for s in shapes)
    masks = (torch.from_numpy(rng.uniform(size=s) < 0.7) for s in shapes)
    return stages, Maps(pcm, paf, *masks)


def test_the_loss_is_the_masked_sum_of_equations_1_and_2() -> None:
    stages, maps = random_maps(np.random.default_rng(1))
    want = 0.0
    for pcm, paf in stages:
        for got, target, mask in ((pcm, maps.pcm, maps.pcm_mask), (paf, maps.paf, maps.paf_mask)):
            for index in np.ndindex(*target.shape):
                want += float(mask[index]) * float(got.detach()[index] - target[index]) ** 2
    assert float(total_loss(stages, maps).detach()) == pytest.approx(want / 2, rel=1e-6)
    assert len(stage_losses(stages, maps)) == 3


def test_maps_of_the_arms_count_as_often_as_asked() -> None:
    arms = {f"{side}_{joint}" for side in ("right", "left") for joint in ("shoulder", "elbow", "wrist")}
    stages, maps = random_maps(np.random.default_rng(4))
    want = 0.0
    for pcm, paf in stages:
        for i in range(19):
            error = (maps.pcm_mask[:, i] * (pcm[:, i] - maps.pcm[:, i]) ** 2).sum()
            want += float(error.detach()) * (3 if i < 18 and PARTS[i] in arms else 1)
        for i, (a, b) in enumerate(OPENPOSE18.limbs):
            error = (maps.paf_mask[:, 2 * i : 2 * i + 2] * (paf - maps.paf)[:, 2 * i : 2 * i + 2] ** 2).sum()
            want += float(error.detach()) * (3 if {PARTS[a], PARTS[b]} <= arms | {"neck"} else 1)
    weights = MapWeights.of_arms(OPENPOSE18, 3.0)
    assert float(total_loss(stages, maps, weights=weights).detach()) == pytest.approx(want / 2, rel=1e-6)
    assert int((weights.paf == 3).sum()) == 12, "two channels each of neck to shoulder to elbow to wrist"


def test_every_stage_is_supervised_and_masked_cells_teach_nothing() -> None:
    stages, maps = random_maps(np.random.default_rng(2))
    total_loss(stages, maps, emphasis=4.0).backward()
    for pcm, paf in stages:
        for branch, mask in ((pcm, maps.pcm_mask), (paf, maps.paf_mask)):
            assert (branch.grad[mask == 0] == 0).all()
            assert (branch.grad[mask == 1] != 0).any()


def dot(x: int, y: int) -> Sample:
    pixels = np.zeros((60, 80, 3), np.uint8)
    pixels[y - 1 : y + 2, x - 1 : x + 2] = 255
    joints = np.full((1, 18, 2), -50, np.float32)
    states = np.full((1, 18), State.OUTSIDE, np.int64)
    wrist = PARTS.index("right_wrist")
    joints[0, wrist], states[0, wrist] = (x + 0.5, y + 0.5), State.LABELLED
    return Sample(Image.fromarray(pixels), joints, states, np.array([[0, 0, 80, 60]], np.float32))


@pytest.mark.parametrize("seed", range(12))
def test_joints_follow_the_picture(seed: int) -> None:
    params = AugmentParams(gain=0, gamma=0, grey=0, blur=0, noise=0, covers=0)
    pixels, joints, states, _ = augment.apply(dot(45, 33), (96, 64), OPENPOSE18, params, np.random.default_rng(seed))
    pixels = np.where(np.abs(pixels - 128).max(2) < 8, 0, pixels[..., 0])
    sides = [PARTS.index(f"{side}_wrist") for side in ("right", "left")]
    found = [k for k in sides if states[0, k] == State.LABELLED]
    assert len(found) == 1
    y, x = np.mgrid[: pixels.shape[0], : pixels.shape[1]] + 0.5
    centroid = np.array([(pixels * x).sum(), (pixels * y).sum()]) / pixels.sum()
    assert np.linalg.norm(centroid - joints[0, found[0]]) < 0.3


def test_half_of_the_pictures_are_mirrored_and_change_sides() -> None:
    params = AugmentParams(gain=0, gamma=0, grey=0, blur=0, noise=0, covers=0)
    sample = dot(45, 33)
    left = sum(
        augment.apply(sample, (96, 64), OPENPOSE18, params, np.random.default_rng(s))[2][0, 7] == State.LABELLED
        for s in range(200)
    )
    assert 70 <= left <= 130


def test_a_gaussian_between_cells_is_decoded_to_a_tenth_of_a_pixel() -> None:
    rng = np.random.default_rng(4)
    joints = torch.from_numpy(rng.uniform((12, 12), (84, 52), (8, 1, 18, 2)).astype(np.float32))
    states = torch.full((8, 1, 18), int(State.LABELLED))
    maps = encode(joints, states, torch.zeros(8, 1, 4), OPENPOSE18, (96, 64))
    found = decode_single(maps.pcm.numpy())
    assert np.abs(found[..., :2] - joints[:, 0].numpy()).max() < 0.1


def test_the_score_counts_joints_within_a_share_of_the_torso() -> None:
    truth = np.zeros((18, 2), np.float32) + 100
    counts = np.zeros(18, bool)
    counts[[2, 3, 4]] = True
    joints = torch.full((1, 1, 18, 2), 50.0)
    joints[0, 0, 3, 0] = 51.5
    joints[0, 0, 4, 0] = 60.0
    states = torch.full((1, 1, 18), int(State.LABELLED))
    maps = encode(joints, states, torch.zeros(1, 1, 4), OPENPOSE18, (160, 120))

    def run(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert image.shape == (1, 3, 120, 160)
        return maps.pcm.numpy(), maps.paf.numpy()

    case = Case(Image.new("RGB", (320, 240)), truth, counts, torso_px=40.0)
    scores = score(run, [case], (160, 120), Normalisation())
    assert [scores[PARTS[j]].pck(0.1) for j in (2, 3, 4)] == [1, 1, 0]
    assert scores["right_elbow"].median_px() == pytest.approx(3.0, abs=0.2)
    assert scores["right_wrist"].median_px() == pytest.approx(20.0, abs=0.2)
    assert scores["nose"].errors == []


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("puppets")
    puppets.write(root, 20, 3)
    return root


def test_a_written_data_set_reads_back_as_drawn(data: Path) -> None:
    written, drawn = CocoKeypoints(data), puppets.Puppets(20, 3)
    again = CocoKeypoints(data)
    assert len(written) == 20
    assert list(data.glob(".pixels-*.npy"))
    for i in range(20):
        a, b = written[i], drawn[i]
        assert a.image.tobytes() == b.image.tobytes() == again[i].image.tobytes()
        both = (a.states == State.LABELLED) & (b.states == State.LABELLED)
        assert both.sum() >= 4
        assert np.abs(a.joints_px - b.joints_px)[both].max() < 1e-3
        eyes = [k for k, name in enumerate(PARTS) if name != "neck" and not name.endswith(("shoulder", "elbow", "wrist"))]
        assert (a.states[0, eyes] == b.states[0, eyes]).all()


def make(data: Path, seed: int = 5) -> BatchMaker:
    return BatchMaker(CocoKeypoints(data), OPENPOSE18, (128, 96), 4, seed, AugmentParams(), Normalisation())


def test_a_given_rotation_takes_the_place_of_the_scaled_one() -> None:
    half, turned = augmentation(0.5), augmentation(0.5, 40)
    assert half.rotation_rad == pytest.approx(math.radians(11))
    assert turned == replace(half, rotation_rad=math.radians(40))
    with pytest.raises(ValueError, match="rotation: expected 0 to 180 degrees, got 181"):
        augmentation(0.5, 181)


def test_a_batch_depends_on_seed_and_step_alone(data: Path) -> None:
    one, two = make(data)(7), make(data)(7)
    assert torch.equal(one.image, two.image)
    assert torch.equal(one.maps.paf, two.maps.paf)
    assert not torch.equal(one.image, make(data, seed=6)(7).image)


def test_a_resumed_run_ends_with_the_weights_of_an_uninterrupted_one(data: Path, tmp_path: Path) -> None:
    def network() -> OggLite:
        torch.manual_seed(0)
        return OggLite(19, 38)

    class Stopped(Exception):
        pass

    def stop_at(step: int) -> BatchMaker:
        maker = make(data)

        def inner(k: int) -> object:
            if k >= step:
                raise Stopped
            return maker(k)

        inner.seed = maker.seed
        return inner  # type: ignore[return-value]

    params = FitParams(steps=6, threads=1, checkpoint_every=2)
    whole = fit(network(), make(data), params, tmp_path / "whole")
    with pytest.raises(Stopped):
        fit(network(), stop_at(5), params, tmp_path / "cut")
    resumed = fit(network(), make(data), params, tmp_path / "cut")
    for a, b in zip(whole.state_dict().values(), resumed.state_dict().values(), strict=True):
        assert torch.equal(a, b)


def test_the_loss_falls_within_thirty_steps(data: Path, tmp_path: Path) -> None:
    maker = make(data)
    torch.manual_seed(0)
    network = OggLite(19, 38)
    before = float(total_loss(network(maker(0).image), maker(0).maps).detach())
    fit(network, maker, FitParams(steps=30), tmp_path)
    after = float(total_loss(network(maker(0).image), maker(0).maps).detach())
    assert after < 0.6 * before


def test_the_commands_train_fuse_export_and_score(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    common = ["--size", "64x64", "--batch", "4", "--steps", "3", "--data", f"{data}*2"]
    assert cli.main(["fit", *common, "--out", str(tmp_path / "teacher")]) == 0
    model = tmp_path / "teacher.onnx"
    assert cli.main(["export", "--run", str(tmp_path / "teacher"), "--out", str(model)]) == 0
    assert cli.main(["fit", *common, "--out", str(tmp_path / "fused"), "--teacher", str(model)]) == 0
    assert cli.main(["eval", "--model", str(model), "--data", str(data), "--json", str(tmp_path / "s.json")]) == 0
    assert json.loads((tmp_path / "s.json").read_text())["visible"]["right_wrist"]["n"] > 0
    assert "right_wrist" in capsys.readouterr().out


def test_a_picture_without_a_torso_has_no_measure_and_is_left_out_aloud(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    index = json.loads((data / "annotations.json").read_text())
    for image in index["images"]:
        image["file_name"] = str((data / image["file_name"]).resolve())
    right, left = ({"shoulder": 6, "hip": 12}, {"shoulder": 5, "hip": 11})
    first = index["annotations"][0]["keypoints"]
    for n, annotation in enumerate(index["annotations"]):
        flat = annotation["keypoints"]
        for joint, place in zip((*right.values(), *left.values()), ((10, 10), (10, 50), (30, 10), (30, 60)), strict=True):
            flat[3 * joint : 3 * joint + 3] = (*place, 2)
        unlabelled = [(left["hip"],), (left["hip"], right["shoulder"])][n] if n < 2 else ()
        for joint in unlabelled:
            flat[3 * joint : 3 * joint + 3] = (0, 0, 0)
    assert first[3 * left["hip"] + 2] == 0
    (tmp_path / "annotations.json").write_text(json.dumps(index))
    torn = CocoKeypoints(tmp_path, cache=False)
    assert [torn.torso_px(i) for i in (0, 2)] == [pytest.approx(40), pytest.approx(45)]
    assert np.isnan(torn.torso_px(1))
    fit_out, model = tmp_path / "run", tmp_path / "m.onnx"
    assert cli.main(["fit", "--size", "64x64", "--batch", "4", "--steps", "1", "--data", str(data), "--out", str(fit_out)]) == 0
    assert cli.main(["export", "--run", str(fit_out), "--out", str(model)]) == 0
    assert cli.main(["eval", "--model", str(model), "--data", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "left out of PCK: 0 pictures of several people, 1 without a shoulder and hip of one side" in said
    assert "visible joints, 19 pictures" in said


def test_wrong_input_ends_with_two_and_names_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["fit", "--data", str(tmp_path / "none"), "--out", str(tmp_path), "--steps", "1"]) == 2
    assert "annotations.json: expected a COCO keypoint file" in capsys.readouterr().err
