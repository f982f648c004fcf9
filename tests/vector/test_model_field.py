"""Model fields that a task draws for each world: the same for one seed and episode, and read by captured steps."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, FixedError, SceneMismatchError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.state import State
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach
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


@pytest.mark.usefixtures("recorded")
def test_fields_belong_to_seed_and_episode(make):
    """For another number of worlds, masks, layouts made ahead, and without a graph: the same bits."""
    one, other = make(4), make(2, sim_config={"graph": False, "prefetch": True})
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


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("graph", [True, False])
def test_steps_are_those_of_a_model_with_these_values(make, graph: bool):
    """MuJoCo C takes the same step from the same state, held by the same controls, with the mass of that world."""
    envs = make(3, sim_config={"graph": graph})
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
    with pytest.raises(ArgumentError, match=r"State.model_field: 'dof_armature' is requested too late.*Task.bind"):
        envs.state.model_field("dof_armature")
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
    assert torch.equal(s.random("slip", 4), values.flatten(1))
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


@pytest.fixture(scope="module")
def drawn_scene():
    """Return the CompiledScene of the reaching task with physics and looks that are drawn."""
    words = {
        "objects.block.randomize": {"mass": {"scale": [0.5, 2.0]}, "rgba": {"abs": [[0.0] * 3, [1.0] * 3]}},
        "randomize": {
            "gravity": {"add": [[-0.1, -0.1, -0.2], [0.1, 0.1, 0.2]]},
            "cameras": {"overview": {"pos": {"add": [-0.05, 0.05]}, "fovy": {"scale": [0.8, 1.2]}}},
        },
    }
    return compile_scene(SceneConfig.load(SCENE, {"bank": 8} | words), "cpu")


@pytest.mark.usefixtures("recorded")
def test_what_a_scene_draws_belongs_to_seed_and_episode(drawn_scene):
    """For another number of worlds, masks, layouts made ahead, and without a graph; tasks see it, critics too."""
    one = SceneVectorEnv(Reach, 4, scene=drawn_scene)
    other = SceneVectorEnv(Reach, 2, scene=drawn_scene, sim_config={"graph": False, "prefetch": True})
    for envs in (one, other):
        envs.reset(seed=3)
        mask = np.arange(envs.num_envs) == 1
        before = {name: array.numpy().copy() for name, array in envs.state.model_rows.items()}
        observation, _ = envs.reset(options={"reset_mask": mask})
        for name, array in envs.state.model_rows.items():
            np.testing.assert_array_equal(array.numpy()[~mask], before[name][~mask], err_msg=name)
        s = envs.state
        parameters = torch.cat([s.randomized(draw.name) for draw in s.scene.draws], dim=1)
        assert torch.equal(observation["critic"][:, -parameters.shape[1] :], parameters)
        assert "randomized" not in envs.observation_names["policy"]
    for name, array in one.state.model_rows.items():
        np.testing.assert_array_equal(array.numpy()[:2], other.state.model_rows[name].numpy(), err_msg=name)
    with pytest.raises(UnknownNameError, match=r"State.randomized: unknown parameter 'block.mas'. Did you mean"):
        one.state.randomized("block.mas")


def test_own_loops_have_the_same_fields(drawn_scene):
    """As an environment; a Model with one row is refused with the line that mends it. Stored layouts replay theirs."""
    envs = SceneVectorEnv(Reach, 2, scene=drawn_scene)
    envs.reset(seed=3)
    with wp.ScopedDevice("cpu"):
        data = mjw.make_data(drawn_scene.mjm, 2)
        plain = mjw.put_model(drawn_scene.mjm)
    with pytest.raises(SceneMismatchError, match=r"randomize: model.body_mass .* by make_worlds\(compiled, 2"):
        ResetRandomizer(drawn_scene, plain, data)
    randomizer = ResetRandomizer(drawn_scene, *make_worlds(drawn_scene, 2), seed=3)
    randomizer.reset()
    generator = LayoutGenerator(drawn_scene, 2, seed=3)
    generator.generate()
    table, masses = generator.table(), envs.batch.model.body_mass.numpy()
    np.testing.assert_array_equal(randomizer.model.body_mass.numpy(), masses)
    randomizer.reset()
    randomizer.write(table, np.array([1, -1]))
    np.testing.assert_array_equal(randomizer.model.body_mass.numpy()[0], masses[1])


def test_pictures_show_what_is_drawn(drawn_scene):
    """Colours, cameras and fields of view of each world, also with the same layout in all of them."""
    envs = SceneVectorEnv(Reach, 2, scene=drawn_scene, render_mode="rgb_array", render_config={"size": (32, 24)})
    envs.reset(seed=1)
    first = envs.render()
    for name in ("cam_fovy", "cam_pos", "cam_pos0", "geom_rgba"):
        array = envs.state.model_rows[name].numpy()
        array[1] = array[0]
    for name in ("qpos", "mocap_pos", "mocap_quat"):
        array = getattr(envs.batch.data, name).numpy()
        array[1] = array[0]
    same = envs.render()
    assert first is not None
    assert same is not None
    np.testing.assert_array_equal(same[0], first[0])
    np.testing.assert_array_equal(same[0], same[1])
    envs.state.model_rows["cam_fovy"].numpy()[1] *= 0.8
    other = envs.render()
    assert other is not None
    assert (other[0] != other[1]).any()
