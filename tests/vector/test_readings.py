"""Named views of the batch against MuJoCo's own kinematics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.errors import UnknownNameError
from tests.vector.stepping import oracle
from tests.vector.workshop import mjcf, mujocos, state_of


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


def test_of_no_names_there_are_no_columns(moving):
    """An empty list is one of the lists that a program may make of names."""
    s = moving.state
    assert s.present([]).shape == (2, 0)
    assert s.present([]).dtype == torch.bool
    assert s.poses([]).shape == (2, 0, 7)
    assert s.velocities([]).shape == (2, 0, 6)


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


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """Return worlds with two arms with slides, by names of the scene that are not those of their bodies."""
    path = tmp_path_factory.mktemp("arms") / "arms.xml"
    path.write_text(mjcf({"one": ("mimic", "0 0 0", 20.0), "two": ("none", "1 0 0", 0.0)}))
    robots = {"left": {"in_model": "one", "tcp": "one:point"}, "right": {"in_model": "two", "tcp": "two:point"}}
    s = state_of({"model": str(path), "robots": robots})
    s.data.qpos.assign(np.random.default_rng(0).uniform(-0.3, 0.3, (2, s.mjm.nq)))
    s._batch.update()
    return s


def test_the_jacobian_of_hinges_slides_and_joints_that_do_not_carry_the_site_is_mujocos(arms):
    """Of a whole robot, fingers included, of another robot, and of joints by their numbers, in any order."""
    mjm, jacobian = arms.mjm, np.zeros((6, arms.mjm.nv))
    numbers = tuple(mjm.joint(f"one:{name}").id for name in ("run", "swing", "p"))
    left, right = ([j for j in range(mjm.njnt) if mjm.joint(j).name.startswith(f"{arm}:")] for arm in ("one", "two"))
    for world in range(2):
        data = mujocos(arms, world)
        mujoco.mj_jacSite(mjm, data, jacobian[:3], jacobian[3:], mjm.site("one:point").id)
        for name, joints in (("left", left), ("one", left), ("right", right), (numbers, list(numbers))):
            found = arms.jacobian("one:point", name)[world]
            np.testing.assert_allclose(found, jacobian[:, mjm.jnt_dofadr[joints]], atol=1e-6)


def test_robots_and_joints_are_found_by_the_names_of_the_scene_and_by_numbers(arms):
    """A robot of a user's model has two names; joints without a name have their number."""
    mjm, qpos = arms.mjm, arms.data.qpos.numpy()
    np.testing.assert_array_equal(arms.pose("left"), arms.pose("one"))
    np.testing.assert_array_equal(arms.qpos("right"), arms.qpos("two"))
    np.testing.assert_array_equal(arms.qpos((4, 1)), qpos[:, mjm.jnt_qposadr[[4, 1]]])
    arms.put_joints((0, 2), torch.tensor([[0.25, 0.125]] * 2), torch.tensor([False, True]))
    np.testing.assert_array_equal(arms.data.qpos.numpy()[:, mjm.jnt_qposadr[[0, 2]]], [qpos[0, [0, 2]], [0.25, 0.125]])
    with pytest.raises(UnknownNameError, match=r"State.pose: unknown body 'lef'. Did you mean 'left'\?"):
        arms.pose("lef")
