"""The simulated arm and worker, from outside."""

import numpy as np
import pytest

import ogg_rs
from ogg_rs import kin, sim

HOME = [0.0, 0.6, -1.2, 0.3, 0.0, 0.0]


def test_the_arm_holds_its_start_and_follows_a_ramp():
    arm = sim.Arm(start=HOME)
    assert arm.joint_names == kin.Robot.builtin().joint_names and repr(arm) == "Arm(6 joints)"
    np.testing.assert_allclose(arm.step(HOME, dt=0.3).position_rad, HOME, atol=1e-3)
    times = np.arange(1, 501) * 0.002
    speed = np.array([0.2, -0.1, 0.1, 0.0, 0.1, 0.2])
    setpoints = HOME + times[:, None] * speed
    motion = arm.run(setpoints, np.tile(speed, (500, 1)), dt=0.002)
    assert motion.position_rad.shape == motion.velocity_rad_s.shape == (500, 6)
    np.testing.assert_allclose(motion.position_rad[-1], setpoints[-1], atol=5e-3)
    np.testing.assert_array_equal(arm.state.position_rad, motion.position_rad[-1])


def test_brakes_hold_without_a_setpoint():
    arm = sim.Arm(start=HOME)
    before = arm.state.position_rad
    np.testing.assert_allclose(arm.step(brake=True, dt=0.5).position_rad, before, atol=2e-3)
    with pytest.raises(ogg_rs.InvalidParameter, match="unless braking"):
        arm.step()


def test_the_gravity_load_is_that_of_the_inverse_dynamics():
    load = sim.Arm(start=HOME).gravity_load(HOME)
    np.testing.assert_allclose(load, kin.Robot.builtin().inverse_dynamics(HOME), rtol=1e-9, atol=1e-9)


def test_steps_do_not_depend_on_how_time_is_cut():
    one, many = sim.Arm(start=HOME), sim.Arm(start=HOME)
    target = np.array(HOME) + 0.05
    one.step(target, dt=0.1)
    for _ in range(100):
        many.step(target, dt=0.001)
    np.testing.assert_array_equal(one.state.position_rad, many.state.position_rad)


@pytest.mark.parametrize(
    "wrong", [{"start": [0.0]}, {"start": [99.0] * 6}, {"servo_hz": 0.0}, {"damping_ratio": np.nan}, {"substep_s": 1.0}]
)
def test_settings_out_of_their_intervals_are_refused(wrong):
    with pytest.raises(ogg_rs.InvalidParameter):
        sim.Arm(**wrong)


def test_a_missing_urdf_is_a_device_error(tmp_path):
    with pytest.raises(ogg_rs.DeviceError, match="absent"):
        sim.Arm(tmp_path / "absent.urdf")


def test_the_worker_has_bones_of_constant_length_and_repeats_by_seed():
    worker = sim.Worker(seed=3, action="flip", period_s=2.0)
    poses = worker.poses(np.linspace(0.0, 6.0, 61))
    arm = poses.arm("right")
    assert arm.shape == (61, 3, 3) and set(poses.action) == {"flip"}
    np.testing.assert_allclose(np.linalg.norm(arm[:, 2] - arm[:, 1], axis=1), 0.25, atol=1e-9)
    np.testing.assert_array_equal(sim.Worker(seed=3, action="flip", period_s=2.0).poses([1.0]).joints_m, poses.joints_m[10:11])
    assert (sim.Worker(seed=4).poses([1.0]).joints_m != poses.joints_m[10]).any()
    with pytest.raises(ogg_rs.InvalidParameter, match="'round'"):
        sim.Worker(action="sleep")
    with pytest.raises(ogg_rs.InvalidParameter, match="not negative"):
        worker.poses([-1.0])
    with pytest.raises(ogg_rs.InvalidParameter, match="'left' or 'right'"):
        poses.arm("top")


def test_pictures_come_with_what_is_true_in_them():
    frames = list(sim.Scene(sim.Worker(), size=(160, 120)).frames([0.0, 0.5]))
    for frame in frames:
        assert frame.image.shape == (120, 160, 3) and frame.image.dtype == np.uint8
        assert frame.visibility[4] == 2 and 0 < frame.joints_px[4, 0] < 160
        assert frame.area_px > 0 and frame.joints_m.shape == (18, 3)
    assert (frames[0].image != frames[1].image).any()
    again = [next(sim.random_frames([7], size=(64, 48))) for _ in range(2)]
    np.testing.assert_array_equal(again[0].image, again[1].image)
    with pytest.raises(ogg_rs.InvalidParameter):
        next(sim.random_frames([7], size=(4, 4)))
