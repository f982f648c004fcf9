"""Named views of the batch against MuJoCo's own kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.vector import rotations


def oracle(envs, world: int) -> mujoco.MjData:
    """Return plain MuJoCo's data for the state of one world."""
    d, data = envs.batch.data, mujoco.MjData(envs.compiled.mjm)
    data.qpos[:], data.qvel[:] = d.qpos.numpy()[world], d.qvel.numpy()[world]
    data.mocap_pos[:], data.mocap_quat[:] = d.mocap_pos.numpy()[world], d.mocap_quat.numpy()[world]
    mujoco.mj_forward(envs.compiled.mjm, data)
    return data


@pytest.fixture
def moving(make_env):
    """Return an environment some steps after its reset, with the block thrown."""
    envs = make_env(2)
    envs.reset(seed=0)
    qvel = envs.batch.data.qvel.numpy()
    qvel[:, 1:7] = [[0.3, -0.2, 1.0, 2.0, -1.0, 3.0], [-0.1, 0.2, 1.5, 0.0, 4.0, 0.5]]
    envs.batch.data.qvel.assign(qvel)
    for _ in range(3):
        envs.step(torch.full((2, 5), 0.3))
    return envs


def test_poses_and_sites_are_those_of_mujoco(moving):
    """Positions and rotations belong to the present qpos, not to the substep before."""
    s = moving.state
    for world in range(2):
        data = oracle(moving, world)
        for name in ("block", "cabinet", "cabinet/drawer", "arm/fore"):
            pose = s.pose(name)[world].numpy()
            np.testing.assert_allclose(pose[:3], data.body(name).xpos, atol=1e-6)
            assert abs(pose[3:] @ data.body(name).xquat) == pytest.approx(1.0, abs=1e-6)
        tcp = s.site("arm/tcp")[world].numpy()
        np.testing.assert_allclose(tcp[:3], data.site("arm/tcp").xpos, atol=1e-6)
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, tcp[3:].astype(float))
        np.testing.assert_allclose(matrix, data.site("arm/tcp").xmat, atol=1e-5)


def test_the_velocity_of_a_free_object_is_that_of_mujoco(moving):
    """Linear and angular velocity of the body's origin, in the axes of the world (there is no robot)."""
    for world in range(2):
        data, velocity = oracle(moving, world), np.zeros(6)
        body = moving.compiled.mjm.body("block").id
        mujoco.mj_objectVelocity(moving.compiled.mjm, data, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
        ours = moving.state.velocity("block")[world].numpy()
        np.testing.assert_allclose(ours, [*velocity[3:], *velocity[:3]], atol=1e-5)


def test_joints_are_found_by_object_and_by_name(moving):
    """An object stands for its hinges and slides, a joint for itself, both as views of the state."""
    s, qpos = moving.state, moving.batch.data.qpos.numpy()
    np.testing.assert_array_equal(s.qpos("arm").numpy(), qpos[:, 8:12])
    np.testing.assert_array_equal(s.qpos("cabinet").numpy(), qpos[:, :1])
    np.testing.assert_array_equal(s.qpos("cabinet/slide").numpy(), qpos[:, :1])
    np.testing.assert_array_equal(s.qvel("arm").numpy(), moving.batch.data.qvel.numpy()[:, 7:11])
    assert s.dt == pytest.approx(0.01)
    s.ctrl[:, s.actuator("arm/lift")] = 0.3
    assert (moving.batch.data.ctrl.numpy()[:, moving.compiled.mjm.actuator("arm/lift").id] == np.float32(0.3)).all()


@pytest.mark.parametrize(
    ("method", "name", "message"),
    [
        ("pose", "blok", "Did you mean 'block'"),
        ("site", "tcp", "Did you mean 'arm/tcp'"),
        ("qpos", "block", "Valid: .*arm/pan"),
        ("velocity", "cabinet", "Valid: block"),
        ("velocity", "blok", "scene 'scene': State.velocity: unknown body 'blok'"),
        ("qvel", "block", "State.qvel: unknown joint"),
        ("actuator", "pan", "Did you mean 'arm/pan'"),
    ],
)
def test_unknown_names_are_answered_with_the_valid_ones(moving, method, name, message):
    """A misspelt name is refused, with the names there are."""
    with pytest.raises(UnknownNameError, match=message):
        getattr(moving.state, method)(name)


def test_random_numbers_depend_on_seed_episode_step_and_stream(make_env):
    """They are the same in another batch, stay within a step, and change with each of these."""
    envs, other = make_env(3), make_env(2)
    envs.reset(seed=[5, 6, 7])
    other.reset(seed=[7, 5])
    first = envs.state.random(6, -2.0, 3.0)
    assert torch.equal(first, envs.state.random(6, -2.0, 3.0))
    assert torch.equal(first[[2, 0]], other.state.random(6, -2.0, 3.0))
    assert ((first >= -2.0) & (first < 3.0)).all()
    drawn = [first, envs.state.random(6, -2.0, 3.0, stream=1)]
    envs.step(torch.zeros(3, 5))
    drawn.append(envs.state.random(6, -2.0, 3.0))
    envs.reset()
    drawn.append(envs.state.random(6, -2.0, 3.0))
    values = torch.cat(drawn).flatten()
    assert len(torch.unique(values)) == len(values)
    with pytest.raises(ValueError, match="stream must be"):
        envs.state.random(1, stream=-1)


def test_random_numbers_fill_their_range_evenly(make_env):
    """A thousand numbers of a world have the mean and the spread of a uniform distribution."""
    envs = make_env(2)
    envs.reset(seed=0)
    values = envs.state.random(1000)[1].numpy()
    assert values.mean() == pytest.approx(0.5, abs=0.04)
    assert values.std() == pytest.approx(np.sqrt(1 / 12), abs=0.02)


def test_rotations_agree_with_mujoco():
    """Products, inverses and rotated vectors, one quaternion for many vectors included."""
    rng = np.random.default_rng(0)
    left, right = rng.normal(size=(2, 5, 4))
    left, right = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (left, right))
    vectors = rng.normal(size=(5, 3))
    product, rotated, back = np.zeros((5, 4)), np.zeros((5, 3)), np.zeros((5, 3))
    for i in range(5):
        mujoco.mju_mulQuat(product[i], left[i], right[i])
        mujoco.mju_rotVecQuat(rotated[i], vectors[i], left[i])
        mujoco.mju_rotVecQuat(back[i], vectors[i], left[0])
    t = torch.as_tensor
    np.testing.assert_allclose(rotations.multiply(t(left), t(right)).numpy(), product, atol=1e-12)
    np.testing.assert_allclose(rotations.rotate(t(left), t(vectors)).numpy(), rotated, atol=1e-12)
    np.testing.assert_allclose(rotations.rotate(t(left[0]), t(vectors)).numpy(), back, atol=1e-12)
    inverse = rotations.conjugate(t(left))
    np.testing.assert_allclose(rotations.rotate(inverse, t(rotated)).numpy(), vectors, atol=1e-12)


def test_joints_that_are_put_somewhere_are_held_there(make_env):
    """The arm of one world, through gears too: the controls are those that hold the pose; other worlds keep theirs."""
    envs = make_env(2)
    envs.reset(seed=0)
    s = envs.state
    ctrl = s.ctrl.clone()
    wanted = s.qpos("arm")[:, :2] + torch.tensor([0.3, -0.2])
    s.put_joints("arm", wanted, torch.tensor([True, False]))
    assert torch.allclose(s.qpos("arm")[0, :2], wanted[0])
    assert torch.equal(s.ctrl[1], ctrl[1])
    assert torch.allclose(s.ctrl[0, :2], wanted[0] * torch.tensor([1.0, 2.0]))
    np.testing.assert_allclose(s.site("arm/tcp")[0, :3].numpy(), oracle(envs, 0).site("arm/tcp").xpos, atol=1e-6)
