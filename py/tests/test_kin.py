"""Kinematics against a URDF whose poses can be written down, finite differences and round trips."""

import numpy as np
import pytest

import ogg_rs
from ogg_rs import kin

PLANAR = """<robot name="planar">
  <link name="base"/><link name="upper"/><link name="fore"/><link name="tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="end" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0.3 0 0"/></joint>
</robot>"""


@pytest.fixture
def planar(tmp_path):
    path = tmp_path / "planar.urdf"
    path.write_text(PLANAR)
    return path


def test_a_planar_arm_is_where_trigonometry_says(planar):
    robot = kin.Robot.from_urdf(planar)
    assert (robot.base, robot.tip, robot.joint_names) == ("base", "tip", ["shoulder", "elbow"])
    q = np.random.default_rng(0).uniform(-3, 3, (4, 5, 2))
    pose = robot.fk(q)
    one, both = q[..., 0], q.sum(axis=-1)
    np.testing.assert_allclose(pose[..., 0, 3], 0.5 * np.cos(one) + 0.3 * np.cos(both), atol=1e-12)
    np.testing.assert_allclose(pose[..., 1, 3], 0.5 * np.sin(one) + 0.3 * np.sin(both), atol=1e-12)
    np.testing.assert_allclose(pose[..., 0, 0], np.cos(both), atol=1e-12)
    np.testing.assert_allclose(pose[..., 1, 0], np.sin(both), atol=1e-12)
    np.testing.assert_array_equal(pose[..., 3, :], np.broadcast_to([0.0, 0.0, 0.0, 1.0], (4, 5, 4)))
    jacobian = robot.jacobian(q)
    assert jacobian.shape == (4, 5, 6, 2)
    np.testing.assert_allclose(jacobian[..., 1, 1], 0.3 * np.cos(both), atol=1e-12)
    np.testing.assert_allclose(jacobian[..., 5, :], 1.0, atol=1e-12)


def test_base_and_tip_choose_the_chain(planar):
    robot = kin.Robot.from_urdf(planar, "upper", "fore")
    assert robot.joint_names == ["elbow"]
    np.testing.assert_allclose(robot.fk([0.0])[:3, 3], [0.5, 0.0, 0.0])
    with pytest.raises(ogg_rs.InvalidParameter, match="hand"):
        kin.Robot.from_urdf(planar, tip="hand")


def test_the_jacobian_is_the_derivative_of_the_pose():
    robot = kin.Robot.builtin()
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 6))
    jacobian, pose, h = robot.jacobian(q), robot.fk(q), 1e-6
    for j in range(6):
        step = h * np.eye(6)[j]
        rate = (robot.fk(q + step) - robot.fk(q - step)) / (2 * h)
        np.testing.assert_allclose(jacobian[:, :3, j], rate[:, :3, 3], atol=1e-8)
        spin = rate[:, :3, :3] @ pose[:, :3, :3].swapaxes(1, 2)
        vector = np.stack((spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]), axis=1)
        np.testing.assert_allclose(jacobian[:, 3:, j], vector, atol=1e-8)


def test_inverse_kinematics_comes_back_to_the_pose():
    robot = kin.Robot.builtin()
    limits = robot.position_limits
    q = np.random.default_rng(2).uniform(np.maximum(limits[:, 0], -2.5), np.minimum(limits[:, 1], 2.5), (6, 7, 6))
    target = robot.fk(q)
    for seed in (None, np.full(6, 0.1), q + 0.05):
        found = robot.ik(target, seed)
        assert found.q.shape == (6, 7, 6)
        assert found.reached.all()
        np.testing.assert_allclose(robot.fk(found.q), target, atol=2e-6)
        assert (found.q >= limits[:, 0]).all()
        assert (found.q <= limits[:, 1]).all()


def test_a_target_out_of_reach_is_not_called_reached():
    target = np.eye(4)
    target[0, 3] = 5.0
    found = kin.Robot.builtin().ik(target)
    assert not found.reached
    assert found.q.shape == (6,)
    assert 4.0 < found.position_error_m < 5.0


def test_an_empty_batch_is_an_empty_answer():
    robot = kin.Robot.builtin()
    assert robot.fk(np.empty((0, 6))).shape == (0, 4, 4)
    assert robot.jacobian(np.empty((3, 0, 6))).shape == (3, 0, 6, 6)
    assert robot.ik(np.empty((0, 4, 4))).q.shape == (0, 6)


def test_what_is_no_pose_is_refused():
    robot = kin.Robot.builtin()
    for wrong in (np.zeros((4, 4)), np.diag([1.0, 1.0, -1.0, 1.0]), np.full((4, 4), np.nan), np.eye(3)):
        with pytest.raises(ogg_rs.InvalidParameter):
            robot.ik(wrong)
    with pytest.raises(ogg_rs.InvalidParameter, match=r"\(\.\.\., 6\)"):
        robot.fk(np.zeros(5))
    with pytest.raises(ogg_rs.InvalidParameter, match="seed"):
        robot.ik(np.eye(4), np.zeros((3, 6)))


PENDULUM = """<robot name="pendulum">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.25 0 0"/><mass value="2"/>
    <inertia ixx="0" iyy="0" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
    <inertia ixx="0" iyy="0" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="gripper"><inertial><mass value="0.5"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.5 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="fore"/><child link="gripper"/><origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0.1" upper="0.2" velocity="1" effort="1"/></joint>
</robot>"""


def pendulum_matrix(q):
    """Textbook mass matrix of two bars; the gripper rests at its lower limit and counts as mass at 0.4 m."""
    l1, parts = 0.5, [(1.0, 0.2, 0.01), (0.5, 0.4, 0.0)]
    m = np.zeros((*q.shape[:-1], 2, 2))
    m[..., 0, 0] += 2.0 * 0.25**2 + 0.03
    for mass, reach, inertia in parts:
        c = np.cos(q[..., 1])
        m[..., 0, 0] += inertia + mass * (l1**2 + reach**2 + 2 * l1 * reach * c)
        m[..., 0, 1] += inertia + mass * (reach**2 + l1 * reach * c)
        m[..., 1, 0] += inertia + mass * (reach**2 + l1 * reach * c)
        m[..., 1, 1] += inertia + mass * reach**2
    return m


def test_the_mass_matrix_is_that_of_the_textbook(tmp_path):
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM)
    robot = kin.Robot.from_urdf(path, tip="fore")
    q = np.random.default_rng(0).uniform(-3, 3, (3, 4, 2))
    np.testing.assert_allclose(robot.mass_matrix(q), pendulum_matrix(q), atol=1e-12)
    qdd = np.random.default_rng(1).normal(size=(3, 4, 2))
    still = robot.inverse_dynamics(q, qdd=qdd, gravity_m_s2=(0, 0, 0))
    np.testing.assert_allclose(still, np.einsum("...ij,...j->...i", pendulum_matrix(q), qdd), atol=1e-12)
    # Gravity along -y: the torque is the derivative of the potential energy.
    weight = robot.inverse_dynamics(q, gravity_m_s2=(0, -10.0, 0))
    one, both = q[..., 0], q.sum(axis=-1)
    elbow = 10.0 * (1.0 * 0.2 + 0.5 * 0.4) * np.cos(both)
    np.testing.assert_allclose(weight[..., 1], elbow, atol=1e-12)
    np.testing.assert_allclose(weight[..., 0], elbow + 10.0 * (2.0 * 0.25 + 1.5 * 0.5) * np.cos(one), atol=1e-12)


def test_inverse_dynamics_is_linear_in_the_acceleration_and_broadcasts():
    robot = kin.Robot.builtin()
    rng = np.random.default_rng(2)
    q, qd = rng.uniform(-1, 1, (5, 6)), rng.normal(size=6)
    qdd = rng.normal(size=(5, 6))
    full = robot.inverse_dynamics(q, qd, qdd)
    bias = robot.inverse_dynamics(q, np.tile(qd, (5, 1)))
    np.testing.assert_allclose(full - bias, np.einsum("nij,nj->ni", robot.mass_matrix(q), qdd), atol=1e-9)
    assert robot.mass_matrix(np.zeros((0, 6))).shape == (0, 6, 6)
    with pytest.raises(ogg_rs.InvalidParameter, match="qd"):
        robot.inverse_dynamics(q, np.zeros((2, 6)))
    with pytest.raises(ogg_rs.InvalidParameter, match="gravity"):
        robot.inverse_dynamics(q, gravity_m_s2=[np.nan, 0, 0])
