"""The tracker keeps its limits and follows; motion models are the closed form of one Gaussian."""

import json
import pickle

import numpy as np
import pytest

import ogg_rs
from ogg_rs import sim
from ogg_rs.motion import JointLimits, Tracker

LIMIT = {"lower_rad": -1.0, "upper_rad": 1.0, "velocity_rad_s": 2.0, "acceleration_rad_s2": 15.0, "jerk_rad_s3": 300.0}


def test_the_commands_never_leave_the_limits():
    targets = np.random.default_rng(0).uniform(-3.0, 3.0, (2000, 3))
    motion = Tracker([JointLimits(**LIMIT)] * 3, 0.005).track(targets)
    slack = 1e-9
    assert np.abs(motion.position_rad).max() <= 1.0 + slack
    assert np.abs(motion.velocity_rad_s).max() <= 2.0 + slack
    assert np.abs(motion.acceleration_rad_s2).max() <= 15.0 + slack
    jerk = np.diff(motion.acceleration_rad_s2, axis=0) / 0.005
    assert np.abs(jerk).max() <= 300.0 * (1 + 1e-9)


def test_a_moving_target_is_followed_without_lag():
    times = 0.005 * np.arange(600)[:, None]
    motion = Tracker([JointLimits(**LIMIT)], 0.005).track(-0.5 + 0.25 * times, np.full_like(times, 0.25))
    assert motion.position_rad[-1, 0] == pytest.approx(-0.5 + 0.25 * (times[-1, 0] + 0.005), abs=1e-6)


def test_single_steps_are_the_rows_of_a_track():
    targets = np.linspace(0.0, 0.5, 50)[:, None]
    whole = Tracker([JointLimits(**LIMIT)], 0.01).track(targets)
    tracker = Tracker([JointLimits(**LIMIT)], 0.01)
    for row, target in enumerate(targets):
        tracker.offer(target)
        np.testing.assert_array_equal(tracker.step().position_rad, whole.position_rad[row])
    tracker.stop()
    for _ in range(200):
        tracker.step()
    assert tracker.is_at_rest
    assert tracker.command.velocity_rad_s[0] == pytest.approx(0.0, abs=1e-9)


def test_what_makes_no_sense_is_refused():
    with pytest.raises(ogg_rs.InvalidParameter, match="velocity_rad_s"):
        Tracker([JointLimits(**{**LIMIT, "velocity_rad_s": -1.0})], 0.01)
    for dt in (0.0, -1.0, np.nan):
        with pytest.raises(ogg_rs.InvalidParameter):
            Tracker([JointLimits(**LIMIT)], dt)
    tracker = Tracker([JointLimits(**LIMIT)], 0.01)
    with pytest.raises(ogg_rs.InvalidParameter, match="not finite"):
        tracker.offer([np.nan])
    with pytest.raises(ogg_rs.InvalidParameter, match="shape"):
        tracker.offer([0.0, 0.0])


def model_text(covariance, mean, seam_s=0.0):
    mixture = {"kind": "full", "dim": 7, "weights": [1.0], "means": mean.tolist(), "covariances": covariance.ravel().tolist()}
    element = {"element": {"start_s": 0.0, "end_s": 2.0}, "mixture": mixture}
    return json.dumps(
        {
            "format": "ogg-motion-model/1",
            "duration_s": 2.0,
            "seam_s": seam_s,
            "centre": [0.0] * 6,
            "demonstrations": 3,
            "sequence": {"elements": [element], "blend_s": 0.2},
        }
    )


def test_a_motion_model_of_one_gaussian_is_a_line(tmp_path):
    rng = np.random.default_rng(3)
    root = rng.normal(size=(7, 7))
    covariance, mean = root @ root.T + np.eye(7), rng.normal(size=7)
    path = tmp_path / "motion.json"
    path.write_text(model_text(covariance, mean))
    model = ogg_rs.MotionModel.load(path)
    assert (model.duration_s, model.elements, model.demonstrations, model.is_cyclic) == (2.0, 1, 3, False)
    times = np.linspace(0.0, 2.0, 12).reshape(3, 4)
    slope = covariance[1:, 0] / covariance[0, 0]
    want = mean[1:] + (times[..., None] - mean[0]) * slope
    got, spread = model.predict(times, return_cov=True)
    np.testing.assert_allclose(got, want, atol=1e-12)
    residual = covariance[1:, 1:] - np.outer(slope, covariance[0, 1:])
    np.testing.assert_allclose(spread, np.broadcast_to(residual, (3, 4, 6, 6)), atol=1e-12)
    np.testing.assert_allclose(model.predict_derivative(times[1]), np.tile(slope, (4, 1)), atol=1e-12)
    np.testing.assert_array_equal(model.predict(5.0), model.predict(2.0))
    model.save(tmp_path / "copy.json")
    for twin in (ogg_rs.MotionModel.load(tmp_path / "copy.json"), pickle.loads(pickle.dumps(model))):
        np.testing.assert_array_equal(twin.predict(times), got)
    with pytest.raises(ogg_rs.InvalidParameter, match="finite"):
        model.predict([0.0, np.nan])


def test_teaching_finds_the_action_in_a_stream_and_takes_several_as_repetitions():
    worker = sim.Worker(seed=1, action="move", period_s=4.0, variation=0.0)
    t = np.arange(0.0, 18.0, 0.02)
    joints = worker.poses(t).arm()
    model = ogg_rs.MotionModel.teach([(t, joints)])
    assert model.is_cyclic and model.duration_s == pytest.approx(4.0, abs=0.02)
    assert model.teach_report["demonstrations"] == 4 and model.teach_report["samples"] == len(t)
    at = np.linspace(0.0, 3.9, 40)
    np.testing.assert_allclose(model.predict(at)[:, :3], worker.poses(at).arm()[:, 2], atol=6e-3)
    # The same action as three separate recordings, one of them slower by a tenth.
    once = t <= 4.0
    several = [(t[once] * pace, joints[once]) for pace in (1.0, 1.1, 1.0)]
    apart = ogg_rs.MotionModel.teach(several, components=4)
    assert (apart.demonstrations, apart.is_cyclic) == (3, False)
    assert apart.duration_s == pytest.approx(4.0, abs=0.03)
    np.testing.assert_allclose(apart.predict(at)[:, :3], worker.poses(at).arm()[:, 2], atol=8e-3)
    assert pickle.loads(pickle.dumps(model)).teach_report is None


def test_teaching_leaves_out_what_was_not_seen_and_refuses_too_little():
    t = np.arange(0.0, 9.0, 0.02)
    joints = sim.Worker(seed=1, action="align", period_s=2.0).poses(t).arm()
    joints[100:104, 1, 0] = np.nan
    report = ogg_rs.MotionModel.teach([(t, joints)]).teach_report
    assert report["complete"] == len(t) - 4 and report["bridged"] == 1
    with pytest.raises(ogg_rs.InvalidParameter) as caught:
        ogg_rs.MotionModel.teach([(t, np.full_like(joints, np.nan))])
    assert caught.value.kind == "TooLittleSeen"
    for wrong in ([], [(t, joints[:5])], [(t[::-1], joints)], [(t * np.nan, joints)], [(t,)], [(t, joints[:, :2])]):
        with pytest.raises(ogg_rs.InvalidParameter):
            ogg_rs.MotionModel.teach(wrong)
    for setting in ({"element_s": np.nan}, {"rate_hz": 0.0}, {"components": 0}, {"smoothing_s": -1.0}):
        with pytest.raises(ogg_rs.InvalidParameter):
            ogg_rs.MotionModel.teach([(t, joints)], **setting)
