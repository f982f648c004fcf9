"""Model fields that a task draws for each world: the same for one seed and episode, and read by captured steps."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.errors import FixedError, NotSupportedError, UnknownNameError
from sceniris_gym.vector.state import State
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach
from tests.vector.stepping import actions

FIELDS = ("body_mass", "body_invweight0", "dof_invweight0", "body_subtreemass", "actuator_gainprm", "geom_friction")


class Drawn(Reach):
    """Reach with another block and other gains in every episode."""

    def bind(self, s: State) -> None:
        """Ask for the fields."""
        super().bind(s)
        self.mass, self.friction = s.model_field("body_mass", "block"), s.model_field("geom_friction", "block")
        self.gains = [s.model_field(f"actuator_{name}prm", "arm/pan") for name in ("gain", "bias")]

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Draw them."""
        super().on_reset(s, mask)
        u = s.random("block", (3,))
        self.mass[:] = torch.where(mask, 0.05 + 0.2 * u[:, 0], self.mass)
        self.friction[:, 0, 0] = torch.where(mask, 0.5 + u[:, 1], self.friction[:, 0, 0])
        self.gains[0][:, 0] = torch.where(mask, 30.0 + 40.0 * u[:, 2], self.gains[0][:, 0])
        self.gains[1][:, 1] = -self.gains[0][:, 0]


def fields(envs: SceneVectorEnv) -> dict[str, np.ndarray]:
    """Copy the fields that differ by world."""
    return {name: getattr(envs.batch.model, name).numpy().copy() for name in FIELDS}


@pytest.fixture
def make(reach_scene):
    """Return a function that makes environments with drawn fields."""

    def make_env(num_envs: int = 4, task: Any = Drawn, **kwargs) -> SceneVectorEnv:
        return SceneVectorEnv(task, num_envs, scene=reach_scene, **kwargs)

    return make_env


def test_fields_belong_to_seed_and_episode(make):
    """For another number of worlds, masks, layouts made ahead, and without a graph: the same bits."""
    one, other = make(4), make(2, graph=False, prefetch=True)
    for envs in (one, other):
        envs.reset(seed=3)
        n = envs.num_envs
        before = fields(envs)
        envs.step(actions(n))
        mask = np.arange(n) == 1
        envs.reset(options={"reset_mask": mask})
        for name, values in fields(envs).items():
            np.testing.assert_array_equal(values[~mask], before[name][~mask], err_msg=name)
            assert (values[mask] != before[name][mask]).any(), name
    for name, values in fields(one).items():
        np.testing.assert_array_equal(values[:2], fields(other)[name], err_msg=name)


@pytest.mark.parametrize("graph", [True, False])
def test_steps_are_those_of_a_model_with_these_values(make, graph: bool):
    """MuJoCo C takes the same step from the same state, held by the same controls, with the mass of that world."""
    envs = make(3, graph=graph)
    envs.reset(seed=1)
    m, d = envs.batch.model, envs.batch.data
    starts = [(d.qpos.numpy()[w].copy(), d.ctrl.numpy()[w].copy(), d.act.numpy()[w].copy()) for w in range(3)]
    action = torch.zeros(3, 5)
    envs.step(action)
    for world, (qpos, ctrl, act) in enumerate(starts):
        mjm = copy.copy(envs.compiled.mjm)
        for name in ("body_mass", "geom_friction", "actuator_gainprm", "actuator_biasprm"):
            getattr(mjm, name)[:] = getattr(m, name).numpy()[world]
        data = mujoco.MjData(mjm)
        mujoco.mj_setConst(mjm, data)
        mujoco.mj_resetData(mjm, data)
        data.qpos[:], data.ctrl[:], data.act[:] = qpos, ctrl, act
        data.mocap_pos[:], data.mocap_quat[:] = d.mocap_pos.numpy()[world], d.mocap_quat.numpy()[world]
        mujoco.mj_step(mjm, data, 2)
        np.testing.assert_allclose(d.qvel.numpy()[world], data.qvel, atol=2e-4)


def test_controls_hold_the_pose_with_the_gains_of_their_world(make):
    """The arm stays where the layout has it; also where a task has put it."""

    class Put(Drawn):
        def on_reset(self, s: State, mask: Tensor) -> None:
            super().on_reset(s, mask)
            s.put_joints("arm", s.qpos("arm")[:, :2] + 0.1, mask)

    for task in (Drawn, Put):
        envs = make(3, task)
        envs.reset(seed=2)
        gain, bias = (wp.to_torch(getattr(envs.batch.model, f"actuator_{n}prm"))[:, 0] for n in ("gain", "bias"))
        force = gain[:, 0] * envs.state.ctrl[:, 0] + bias[:, 1] * envs.state.qpos("arm/pan")[:, 0]
        assert force.abs().max() < 1e-4
        assert len(set(gain[:, 0].tolist())) == 3


def test_what_has_no_effect_is_an_error(make):
    """A field that is asked for after `bind`, an array that is replaced, and a field that layouts depend on."""
    envs = make(2)
    envs.reset(seed=0)
    assert envs.state.model_field("body_mass").shape == (2, envs.compiled.mjm.nbody)
    with pytest.raises(NotSupportedError, match=r"State.model_field: 'body_inertia' is asked for too late.*Task.bind"):
        envs.state.model_field("body_inertia")
    with pytest.raises(UnknownNameError, match="unknown model field 'body_pos'"):
        envs.state.model_field("body_pos")
    for name in ("body_mass", "dof_damping"):
        kept = getattr(envs.batch.model, name)
        setattr(envs.batch.model, name, wp.clone(kept))
        for call in (envs.reset, lambda: envs.step(actions(2))):
            with pytest.raises(FixedError, match=f"model.{name} cannot be changed.*model_field"):
                call()
        setattr(envs.batch.model, name, kept)


def test_random_numbers_by_name_last_for_an_episode(make):
    """They do not depend on the step; two names have other numbers."""
    envs = make(3)
    envs.reset(seed=5)
    s = envs.state
    values = s.random("slip", (2, 2))
    assert values.shape == (3, 2, 2)
    envs.step(actions(3))
    assert torch.equal(s.random("slip", (2, 2)), values)
    assert not torch.isin(s.random("grip", (4,)), values).any()
    np.testing.assert_array_equal(envs.randomizer.random("slip", (2, 2)).numpy(), values.numpy())
    assert s.random("slip").shape == (3,)


def test_a_snapshot_keeps_the_fields_of_its_worlds(make):
    """Also put into another world: masses and what follows from them move there."""
    envs = make(3)
    envs.reset(seed=5)
    kept, before = envs.snapshot(np.array([True, False, False])), fields(envs)
    envs.reset()
    mask = torch.tensor([False, True, False])
    envs.reset(options={"state": kept, "reset_mask": mask})
    for name, values in fields(envs).items():
        np.testing.assert_array_equal(values[1], before[name][0], err_msg=name)
