"""The frame of a robot's base that is moved and turned, against MuJoCo's own arithmetic."""

from __future__ import annotations

import mujoco
import numpy as np
import torch

from sceniris_gym.vector.base_frame import BaseFrame, DrawnBaseFrame

MJCF = """
<mujoco>
  <worldbody>
    <body name="foot" pos="0.3 -0.2 0.4" quat="0.5 0.5 -0.5 0.5"/>
    <body name="base" pos="-1 0.5 0.7" euler="20 -35 130"/>
  </worldbody>
</mujoco>
"""


def frame(robot: str | None) -> tuple[BaseFrame, mujoco.MjData]:
    """Return the frame of a body, and MuJoCo's data of the model it is in."""
    mjm = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    return BaseFrame(mjm, 0 if robot is None else mjm.body(robot).id, torch.device("cpu")), data


def drawn(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and unit quaternions."""
    rng = np.random.default_rng(0)
    quat = rng.normal(size=(n, 4))
    return rng.uniform(-2.0, 2.0, (n, 3)), quat / np.linalg.norm(quat, axis=1, keepdims=True)


def test_poses_are_seen_from_the_base():
    """Positions and orientations of bodies, and of sites that are turned against their body."""
    positions, quats = drawn(20)
    site = drawn(1)[1][0]
    for robot in ("foot", "base"):
        base, data = frame(robot)
        origin, turn = data.body(robot).xpos, data.body(robot).xquat * [1, -1, -1, -1]
        found = base.pose(torch.tensor(positions).float(), torch.tensor(quats).float()).numpy()
        turned = base.pose(torch.tensor(positions).float(), torch.tensor(quats).float(), base.seen(site)).numpy()
        for i in range(20):
            expected, seen, whole = np.zeros(3), np.zeros(4), np.zeros(4)
            mujoco.mju_rotVecQuat(expected, positions[i] - origin, turn)
            mujoco.mju_mulQuat(seen, turn, quats[i])
            mujoco.mju_mulQuat(whole, seen, site)
            np.testing.assert_allclose(found[i], [*expected, *seen], atol=1e-6)
            np.testing.assert_allclose(turned[i], [*expected, *whole], atol=1e-6)


def test_poses_go_to_the_world_and_back():
    """From a base that stands still and from one that is drawn."""
    positions, quats = (torch.tensor(values).float() for values in drawn(20))
    at, turned = positions.flip(0), quats.flip(0)
    for base in (frame("base")[0], frame(None)[0], DrawnBaseFrame(at, turned)):
        found = base.to_world(base.pose(positions, quats))
        torch.testing.assert_close(found, torch.cat([positions, quats], dim=1), rtol=0, atol=2e-6)


def test_vectors_are_turned_and_not_moved():
    """Two at once, in any leading shape."""
    base, data = frame("base")
    vectors = drawn(6)[0].reshape(2, 3, 3)
    found = base.vectors(torch.tensor(vectors).float(), torch.tensor(-2.0 * vectors).float()).numpy()
    matrix = data.body("base").xmat.reshape(3, 3)
    np.testing.assert_allclose(found[..., :3], vectors @ matrix, atol=1e-6)
    np.testing.assert_allclose(found[..., 3:], -2.0 * vectors @ matrix, atol=1e-6)


def test_without_a_robot_it_is_the_world():
    """Numbers stay as they are, to the bit."""
    base, _ = frame(None)
    position, quat = (torch.tensor(array).float() for array in drawn(5))
    assert torch.equal(base.pose(position, quat), torch.cat([position, quat], dim=1))


def test_a_base_that_is_drawn_is_another_frame_in_every_world():
    """Each world against the frame of a base that stands there for good; with an axis more for several bodies."""
    at, turn = (torch.tensor(x).float() for x in drawn(5))
    position, quat = (torch.tensor(x).float().reshape(5, 4, -1) for x in drawn(20))
    site = drawn(1)[1][0]
    base = DrawnBaseFrame(at, turn)
    found, turned = base.pose(position, quat), base.pose(position[:, 0], quat[:, 0], base.seen(site))
    moved = base.vectors(position, position.flip(1))
    for i in range(5):
        spec = mujoco.MjSpec()
        spec.worldbody.add_body(name="base", pos=at[i].tolist(), quat=turn[i].tolist())
        still = BaseFrame(spec.compile(), 1, torch.device("cpu"))
        torch.testing.assert_close(found[i], still.pose(position[i], quat[i]), atol=1e-5, rtol=0.0)
        torch.testing.assert_close(
            turned[i], still.pose(position[i, 0], quat[i, 0], still.seen(site)), atol=1e-5, rtol=0
        )
        torch.testing.assert_close(moved[i], still.vectors(position[i], position[i].flip(0)), atol=1e-5, rtol=0.0)
