"""Targets, decoding, networks, evaluation and orders of keypoints, against closed forms and each other."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ogg_rs
from ogg_rs import pose, sim

SIZE = (128, 96)


def person(rng, people=1, batch=1):
    joints = rng.uniform((8, 8), (120, 88), (batch, people, 18, 2)).astype(np.float32)
    states = np.full((batch, people, 18), pose.State.LABELLED, np.uint8)
    return joints, states, np.tile(np.float32([0, 0, 127, 95]), (batch, people, 1))


def cells():
    u, v = np.meshgrid(8.0 * np.arange(16) + 3.5, 8.0 * np.arange(12) + 3.5)
    return u, v


def test_confidence_maps_are_gaussians_about_the_joints():
    rng = np.random.default_rng(0)
    joints, states, boxes = person(rng, people=2, batch=3)
    maps = pose.encode_targets(joints, states, boxes, size=SIZE)
    assert maps.pcm.shape == (3, 19, 12, 16) and maps.paf.shape == (3, 38, 12, 16)
    assert [array.dtype for array in maps] == [np.float32, np.float32, np.bool_, np.bool_]
    u, v = cells()
    square = (u - joints[..., 0, None, None]) ** 2 + (v - joints[..., 1, None, None]) ** 2
    want = np.exp(-square / (2 * 7.0**2)).max(axis=1)
    np.testing.assert_allclose(maps.pcm[:, :18], want, atol=2e-6)
    np.testing.assert_allclose(maps.pcm[:, 18], 1.0 - want.max(axis=1), atol=2e-6)
    assert maps.pcm_mask.all() and maps.paf_mask.all()


def test_fields_are_unit_vectors_along_limbs():
    joints, states, boxes = person(np.random.default_rng(1))
    states[:] = pose.State.OUTSIDE
    limb = pose.LIMBS.index((3, 4))
    joints[0, 0, 3], joints[0, 0, 4] = (11.5, 35.5), (99.5, 35.5)
    states[0, 0, [3, 4]] = pose.State.LABELLED
    maps = pose.encode_targets(joints, states, boxes, size=SIZE)
    assert maps.paf[0, 2 * limb, 4, 5] == 1.0 and maps.paf[0, 2 * limb + 1, 4, 5] == 0.0
    assert np.count_nonzero(maps.paf[0]) == np.count_nonzero(maps.paf[0, 2 * limb])


def test_the_published_channel_order_is_kept():
    # Channels 12 and 13 of the published COCO model hold neck to right shoulder.
    assert pose.LIMBS[6] == (1, 2) and len(pose.LIMBS) == 19


def test_fusion_is_equation_three():
    rng = np.random.default_rng(2)
    joints, states, boxes = person(rng, batch=2)
    states[:, :, 8:14] = pose.State.HIDDEN
    labels = pose.encode_targets(joints, states, boxes, size=SIZE)
    before = [array.copy() for array in labels]
    teacher_pcm = rng.uniform(-0.2, 1.2, labels.pcm.shape).astype(np.float32)
    teacher_paf = rng.normal(0, 0.3, labels.paf.shape).astype(np.float32)
    fused = pose.fuse_labels(labels, teacher_pcm, teacher_paf, floor=0.1)
    for array, old in zip(labels, before, strict=True):
        np.testing.assert_array_equal(array, old)
    want = np.maximum(labels.pcm[:, :18], teacher_pcm[:, :18].clip(0, 1))
    np.testing.assert_allclose(fused.pcm[:, :18], want, atol=1e-6)
    np.testing.assert_allclose(fused.pcm[:, 18], 1.0 - want.max(axis=1), atol=1e-6)
    own, other = (f.reshape(2, 19, 2, 12, 16) for f in (labels.paf, teacher_paf))
    own_norm, other_norm = (np.linalg.norm(f, axis=2, keepdims=True) for f in (own, other))
    np.testing.assert_allclose(fused.paf.reshape(own.shape), np.where(own_norm > other_norm, own, other), atol=1e-6)
    answered = teacher_pcm[:, :18] >= 0.1
    np.testing.assert_array_equal(fused.pcm_mask[:, :18], answered | labels.pcm_mask[:, :18])


def test_decoding_undoes_encoding():
    rng = np.random.default_rng(3)
    # One upright figure, so that no two parts of one kind compete.
    figure = np.float32(
        [[64, 14], [64, 26], [52, 26], [44, 42], [40, 58], [76, 26], [84, 42], [88, 58], [57, 56], [57, 70], [57, 84],
         [71, 56], [71, 70], [71, 84], [61, 11], [67, 11], [57, 13], [71, 13]]
    )  # fmt: skip
    joints = (figure * 4.0 + rng.uniform(-2, 2, figure.shape)).astype(np.float32)[None, None]
    states = np.full((1, 1, 18), pose.State.LABELLED, np.uint8)
    maps = pose.encode_targets(joints, states, [[[0, 0, 511, 383]]], size=(512, 384))
    people = pose.decode(maps.pcm[0], maps.paf[0])
    assert people.keypoints.shape == (1, 18, 3) and people.scores.shape == (1,)
    np.testing.assert_allclose(people.keypoints[0, :, :2], joints[0, 0], atol=0.25)
    [same] = pose.decode(maps.pcm, maps.paf)
    np.testing.assert_array_equal(same.keypoints, people.keypoints)
    nobody = pose.decode(np.zeros((19, 6, 8)), np.zeros((38, 6, 8)))
    assert nobody.keypoints.shape == (0, 18, 3)


def test_every_conversion_keeps_the_parts_by_name():
    for source in pose.SKELETONS.values():
        names = {part: i for i, part in enumerate(source.parts)}
        points = np.stack((np.arange(len(source.parts)), np.arange(len(source.parts)) ** 2), axis=1) * 1.0
        assert [source.mirror[i] for i in source.mirror] == list(range(len(source.parts)))
        for target in pose.SKELETONS.values():
            got = pose.convert(points[None], source.name, target.name)[0]
            for place, part in enumerate(target.parts):
                if part in names:
                    np.testing.assert_array_equal(got[place], points[names[part]])
                elif part == "neck":
                    middle = (points[names["left_shoulder"]] + points[names["right_shoulder"]]) / 2
                    np.testing.assert_array_equal(got[place], middle)
    assert pose.SKELETONS["coco-17"].index("right_wrist") == 10


def test_the_built_in_network_finds_the_synthetic_worker():
    estimator = pose.Estimator("builtin:ogg-lite", onnxruntime="tract")
    frame = sim.Scene(sim.Worker(seed=5), size=(320, 240)).render(1.0)
    people = estimator.estimate(frame.image)
    assert len(people.scores) >= 1
    arm = [2, 3, 4]
    miss = np.linalg.norm(people.keypoints[0, arm, :2] - frame.joints_px[arm], axis=1)
    assert miss.max() < 8.0, miss
    estimator.reset()
    assert "tract" in estimator.runtime and repr(estimator).startswith("Estimator('ogg-lite'")
    with pytest.raises(ogg_rs.InvalidParameter, match="uint8"):
        estimator.estimate(frame.image.astype(np.float32))
    with pytest.raises(ogg_rs.DeviceError) as caught:
        pose.Estimator("builtin:ogg-lite", onnxruntime="tract", provider="cuda")
    assert caught.value.kind == "Provider"
    with pytest.raises(ogg_rs.InvalidParameter, match="builtin:ogg-lite"):
        pose.Estimator("nobody")
    with pytest.raises(ogg_rs.DeviceError, match="absent"):
        pose.Estimator("absent.toml")


def test_two_looks_say_of_the_mirrored_picture_the_mirror_of_what_they_say():
    frame = sim.Scene(sim.Worker(seed=5), size=(320, 240)).render(1.0)
    exchanged = list(pose.SKELETONS["openpose-18"].mirror)

    def apart(mirror: bool) -> float:
        estimator = pose.Estimator("builtin:ogg-lite", onnxruntime="tract", mirror=mirror)
        straight = estimator.estimate(frame.image).keypoints[0]
        turned = estimator.estimate(np.ascontiguousarray(frame.image[:, ::-1])).keypoints[0, exchanged]
        assert np.linalg.norm(straight[2:5, :2] - frame.joints_px[2:5], axis=1).max() < 8.0
        turned[:, 0] = 319.0 - turned[:, 0]
        both = (straight[:, 2] > 0.3) & (turned[:, 2] > 0.3)
        assert both[2:5].all()
        return np.abs(straight - turned)[both].max()

    assert apart(mirror=True) < 0.05 < 0.5 < apart(mirror=False)


def annotation(image, points, visibility=2, **rest):
    flat = [number for u, v in points for number in (float(u), float(v), visibility)]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    box = [*low.tolist(), *(high - low).tolist()]
    return {"image_id": image, "keypoints": flat, "bbox": box, "area": 5000.0, "iscrowd": 0, **rest}


def test_evaluation_has_the_values_that_can_be_written_down(tmp_path):
    rng = np.random.default_rng(4)
    points = rng.uniform(0, 90, (17, 2))
    label = annotation(1, points)
    exact = {"image_id": 1, "keypoints": label["keypoints"], "score": 0.8}
    far = {"image_id": 1, "keypoints": [500.0] * 51, "score": 0.9}
    assert pose.evaluate_keypoints([label], [exact]).ap == pytest.approx(1.0)
    assert pose.evaluate_keypoints({"annotations": [label]}, [exact, far]).ap == pytest.approx(0.5)
    # One keypoint counts: its similarity is the Gaussian of its distance.
    shifted = points.copy()
    shifted[9, 0] += np.sqrt(-2.0 * np.log(0.72) * 5000.0) * 2 * pose.COCO_17_SIGMAS[9]
    found = {**exact, "keypoints": annotation(1, shifted)["keypoints"]}
    # 0.50, 0.55, 0.60, 0.65 and 0.70 of the ten similarities are passed by 0.72.
    one = pose.evaluate_keypoints([label], [found], keypoints=[9])
    assert one.ap == pytest.approx(0.5) and one.ap_75 == pytest.approx(0.0)
    assert np.isnan(pose.evaluate_keypoints([label], [exact], visibility=1).ap)
    (tmp_path / "gt.json").write_text(json.dumps({"annotations": [label]}))
    (tmp_path / "dt.json").write_text(json.dumps([exact]))
    assert pose.evaluate_keypoints(tmp_path / "gt.json", tmp_path / "dt.json").ar == pytest.approx(1.0)
    with pytest.raises(ogg_rs.DeviceError, match="absent"):
        pose.evaluate_keypoints(tmp_path / "absent.json", [])
    with pytest.raises(ogg_rs.InvalidParameter, match="'keypoints'"):
        pose.evaluate_keypoints([label], [{"image_id": 1, "score": 1.0}])
    with pytest.raises(ogg_rs.InvalidParameter, match="51 numbers"):
        pose.evaluate_keypoints([label], [{**exact, "keypoints": [1.0]}])


@pytest.mark.parametrize(
    "wrong",
    [{"skeleton": "coco-18"}, {"skeleton": "coco-17"}, {"size": (100, 96)}, {"stride": 0}, {"sigma_px": 0.0},
     {"sigma_px": np.nan}, {"half_width_px": -1.0}, {"limbs": [(0, 18)]}, {"limbs": []}, {"limbs": [(0, 1, 2)]}],
)  # fmt: skip
def test_targets_refuse_what_makes_no_sense(wrong):
    joints, states, boxes = person(np.random.default_rng(0))
    with pytest.raises(ogg_rs.InvalidParameter):
        pose.encode_targets(joints, states, boxes, **{"size": SIZE, **wrong})


def test_labelled_places_must_be_finite():
    joints, states, boxes = person(np.random.default_rng(0))
    joints[0, 0, 0] = np.nan
    with pytest.raises(ogg_rs.InvalidParameter, match="finite"):
        pose.encode_targets(joints, states, boxes, size=SIZE)
    states[0, 0, 0] = pose.State.UNKNOWN
    assert np.isfinite(pose.encode_targets(joints, states, boxes, size=SIZE).pcm).all()
    with pytest.raises(ogg_rs.InvalidParameter, match="State"):
        pose.encode_targets(joints, states + 7, boxes, size=SIZE)
    with pytest.raises(ogg_rs.InvalidParameter, match="of one size"):
        maps = pose.encode_targets(joints, states, boxes, size=SIZE)
        pose.fuse_labels(maps, maps.pcm[:, :5], maps.paf)
    with pytest.raises(ogg_rs.InvalidParameter, match="labels.paf_mask: expected bool, got float32"):
        pose.fuse_labels(maps._replace(paf_mask=maps.paf), maps.pcm, maps.paf)
    with pytest.raises(ogg_rs.InvalidParameter, match="finite"):
        pose.decode(np.full((19, 4, 4), np.nan), np.zeros((38, 4, 4)))


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 3), st.integers(0, 3))
def test_any_mixture_of_states_gives_maps_within_bounds(seed, batch, people):
    rng = np.random.default_rng(seed)
    joints = rng.uniform(-50, 200, (batch, people, 18, 2)).astype(np.float32)
    states = rng.integers(0, 4, (batch, people, 18)).astype(np.uint8)
    boxes = rng.uniform(0, 100, (batch, people, 4)).astype(np.float32)
    maps = pose.encode_targets(joints, states, boxes, size=SIZE)
    assert maps.pcm.shape == (batch, 19, 12, 16)
    assert ((maps.pcm >= 0) & (maps.pcm <= 1)).all() and (np.abs(maps.paf) <= 1 + 1e-6).all()
    # Nothing but an unknown or a hidden joint leaves a cell out.
    assert maps.pcm_mask.all() or (states < pose.State.OUTSIDE).any()
    assert maps.pcm_mask.dtype == maps.paf_mask.dtype == np.bool_
