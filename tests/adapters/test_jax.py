"""Layouts in JAX, and Playground's task with clutter: same bits, nothing overlaps at a start, nothing else is written.

MJX needs MuJoCo 3.17, so this runs in a venv of its own: `make test-jax`. Playground's arm is a stand-in.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, NotSupportedError, SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.adopt import edit_spec
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.adapters.playground_arm import write_menagerie

jax: Any = pytest.importorskip("jax", reason="needs JAX: make test-jax")
jnp: Any = jax.numpy
from sceniris_gym.adapters.jax import LayoutAutoResetWrapper, LayoutFunction, wrap_for_brax_training  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "jax.md"
OWN, CLUTTER, FUNCTION = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
WORLDS = 6
LENGTH = 3
SEEDS = np.array([[0, 7], [5, 7], [0, 9], [2**32 - 1, 1], [0, 8], [1, 0]], np.uint32)


@pytest.fixture(scope="module")
def mid() -> CompiledScene:
    """A shipped scene on the CPU."""
    return compile_scene("mid", "cpu")


@pytest.fixture(scope="module")
def layouts(mid: CompiledScene) -> LayoutFunction:
    """Its layouts as a function."""
    return LayoutFunction(mid)


def made(compiled: CompiledScene, words: np.ndarray, episode: int, split: str = "train") -> np.ndarray:
    """Return the joints of layouts as a generator makes them, shape (n, nq)."""
    seeds = words[:, 0].astype(np.uint64) << np.uint64(32) | words[:, 1].astype(np.uint64)
    generator = LayoutGenerator(compiled, len(seeds), seed=seeds, split=split)
    for _ in range(episode + 1):
        generator.generate()
    return generator.layouts.qpos.cpu().numpy().copy()


def several(call: Callable[..., Any]) -> Callable[..., Any]:
    """Return a call of a member as a call of a batch of batches."""
    twice = jax.vmap(jax.vmap(call, in_axes=(0, None)), in_axes=(1, None))

    def calls(seeds: Any, episode: Any) -> Any:
        swapped = twice(seeds.reshape(2, 3, 2), episode)
        return jax.tree.map(lambda a: jnp.swapaxes(a, 0, 1).reshape(6, *a.shape[2:]), swapped)

    return calls


WAYS = {
    "a call": lambda call: call,
    "jit": lambda call: jax.jit(call),
    "vmap": lambda call: jax.vmap(call, in_axes=(0, None)),
    "jit of vmap": lambda call: jax.jit(jax.vmap(call, in_axes=(0, None))),
    "vmap of jit": lambda call: jax.vmap(jax.jit(call), in_axes=(0, None)),
    "vmap of vmap": several,
    "map": lambda call: lambda seeds, episode: jax.lax.map(lambda seed: call(seed, episode), seeds),
}


@pytest.mark.parametrize("way", WAYS)
def test_layouts_are_those_of_a_generator(layouts: LayoutFunction, mid: CompiledScene, way: str):
    """Under every transformation, of seeds with 64 bits."""
    found = WAYS[way](layouts.qpos)(jnp.array(SEEDS), jnp.int32(1))
    assert np.array_equal(found.qpos, made(mid, SEEDS, 1))
    assert found.mocap_pos.shape == (6, mid.mjm.nmocap, 3) and found.mocap_quat.shape == (6, mid.mjm.nmocap, 4)
    assert not found.fallback.any()


def test_a_scan_goes_through_episodes(mid: CompiledScene):
    """With a mask: the others get the start pose. The other split has other layouts."""
    layouts, mask = LayoutFunction(mid, split="eval"), np.arange(6) % 2 == 0

    def body(episode: Any, _: None) -> tuple[Any, Any]:
        return episode + 1, layouts.qpos(jnp.array(SEEDS), episode, jnp.array(mask))

    _, found = jax.jit(lambda: jax.lax.scan(body, jnp.int32(0), None, 3))()
    for episode in range(3):
        expected = np.where(mask[:, None], made(mid, SEEDS, episode, "eval"), mid.home_qpos.astype(np.float32))
        assert np.array_equal(found.qpos[episode], expected)


def test_shapes_are_known_without_a_layout(layouts: LayoutFunction, mid: CompiledScene):
    """As Playground asks for the size of observations; also where nothing is a batch."""
    found = jax.eval_shape(jax.vmap(layouts.qpos, in_axes=(0, None)), jnp.array(SEEDS), 0)
    assert found.qpos.shape == (6, mid.mjm.nq)
    one = layouts.qpos(jax.random.PRNGKey(7), 1)
    assert one.qpos.shape == (mid.mjm.nq,) and one.fallback.shape == ()
    assert np.array_equal(one.qpos, made(mid, SEEDS[:1], 1)[0])


def test_keys_and_64_bit_integers_are_seeds(layouts: LayoutFunction, mid: CompiledScene):
    """The key of 7 is the seed 7."""
    assert np.array_equal(layouts.qpos(jax.random.key(7), 0).qpos, made(mid, SEEDS[:1], 0)[0])
    with jax.enable_x64(True):
        found = layouts.qpos(jnp.array([5 * 2**32 + 7], jnp.uint64), 0).qpos
    assert np.array_equal(found, made(mid, SEEDS[1:2], 0))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((jnp.arange(6), 0), ArgumentError, r"two uint32 words, .* got int32 of shape \(\)"),
        (
            (jnp.zeros((6, 2), jnp.int32), 0),
            ArgumentError,
            r"as jax\.random\.PRNGKey\(7\) .* got int32 of shape \(2,\)",
        ),
        ((jnp.zeros((6, 3), jnp.uint32), 0), ArgumentError, r"got uint32 of shape \(3,\)"),
        ((jnp.array(SEEDS), 0.0), ArgumentTypeError, "episode should be integers"),
        ((jnp.array(SEEDS), 0, 1), ArgumentTypeError, "where should be booleans"),
    ],
)
def test_other_arguments_are_refused(layouts: LayoutFunction, arguments: Any, error: type, message: str):
    """Also inside vmaps of vmaps, where the error is that of the inner call."""
    seeds, *rest = arguments

    def call(seed: Any) -> Any:
        return layouts.qpos(seed, *rest)

    with pytest.raises(error, match=message):
        jax.vmap(jax.vmap(call))(seeds.reshape(2, 3, *seeds.shape[1:]))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((None, 0), ArgumentError, r"two uint32 words.* got <class 'NoneType'>"),
        (("7", 0), ArgumentError, "got <class 'str'>"),
        ((2**40, 0), ArgumentError, "got <class 'int'>"),
        (([[0, 7], [8]], 0), ArgumentError, "got <class 'list'>"),
        (
            (np.array([7, 8], np.uint64), 0),
            ArgumentError,
            r"got uint64 of shape \(2,\)",
        ),  # which is not the seed 7 << 32 | 8
        ((SEEDS, None), ArgumentTypeError, r"episode should be integers .* got <class 'NoneType'>"),
        ((SEEDS, "1"), ArgumentTypeError, "episode should be integers"),
        ((SEEDS, 2**31), ArgumentTypeError, r"integers from 0 to 2\*\*31 - 1, got <class 'int'>"),
        ((SEEDS, 0, None), ArgumentTypeError, "where should be booleans, got <class 'NoneType'>"),
        ((SEEDS, 0, "all"), ArgumentTypeError, "where should be booleans"),
        ((SEEDS, np.arange(4)), ArgumentError, r"should broadcast together: .*\(6,\), \(4,\)"),
        ((SEEDS, 0, np.ones(5, bool)), ArgumentError, r"should broadcast together: .*\(5,\)"),
    ],
)
def test_arguments_that_are_no_arrays_or_do_not_fit_each_other_are_refused(
    layouts: LayoutFunction, arguments: Any, error: type, message: str
):
    """By their names, and not by JAX."""
    with pytest.raises(error, match=message):
        layouts.qpos(*arguments)


def test_words_of_randomize_are_refused(mid: CompiledScene):
    """By the name of the first, as nothing draws them here."""
    drawn = SceneConfig.load("mid", {"objects.apple.randomize": {"mass": {"scale": [0.5, 2.0]}}})
    compiled = compile_scene(drawn, mid.device)
    with pytest.raises(
        NotSupportedError, match=r"LayoutFunction: the scene 'mid' has 'randomize' \(apple\.mass\), .*draw by the"
    ):
        LayoutFunction(compiled)


def test_a_scene_on_another_device_is_refused(mid: CompiledScene):
    """JAX computes on the CPU here."""
    with pytest.raises(SceneMismatchError, match=r"on cuda:0, but JAX computes on cpu.*'cpu'\)"):
        LayoutFunction(replace(mid, device="cuda:0")).qpos(jnp.array(SEEDS), 0)


def small(program: str) -> str:
    """Return the page's program with small batches, on the CPU."""
    program = program.replace("super().__init__()", f"super().__init__(config_overrides={SMALL})")
    program = program.replace('"objects": things}', '"objects": things, "bank": 2}, "cpu"')
    program = program.replace('"num_envs": 2048, "batch_size": 512, "num_minibatches": 32', SIZES)
    return program.replace("150}", f"{LENGTH}}}").replace("20_000_000", "240").replace("num_evals=5", "num_evals=2")


SMALL = {"naconmax": 64 * WORLDS, "naccdmax": 64 * WORLDS}
SIZES_AS_ARGUMENTS = f"num_envs={WORLDS}, num_eval_envs={WORLDS}, batch_size={WORLDS}, num_minibatches=1"
SIZES = f'"num_envs": {WORLDS}, "num_eval_envs": {WORLDS}, "batch_size": {WORLDS}, "num_minibatches": 1'


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the names of the page's program, which has not trained yet."""
    pytest.importorskip("mujoco_playground")
    from etils import epath
    from mujoco_playground._src import mjx_env

    mjx_env.MENAGERIE_PATH = epath.Path(write_menagerie(tmp_path_factory.mktemp("menagerie")))
    names: dict[str, Any] = {}
    setup, sizes, _ = small(CLUTTER).partition("sizes = ")
    assert sizes
    exec(compile(setup, "jax.md", "exec"), names)
    return names


@pytest.fixture(scope="module")
def fresh(page: dict[str, Any]) -> LayoutAutoResetWrapper:
    """The page's environment, wrapped for training."""
    return page["wrap"](page["env"], episode_length=LENGTH, action_repeat=1)


@pytest.fixture(scope="module")
def rollout(fresh: LayoutAutoResetWrapper) -> list[Any]:
    """States of two episodes and a step, with random actions."""
    state, step = jax.jit(fresh.reset)(jax.random.split(jax.random.PRNGKey(3), WORLDS)), jax.jit(fresh.step)
    states = [state]
    for i in range(2 * LENGTH + 1):
        if i == 1:  # one world leaves the others behind: it is done a step earlier in all that follows
            steps = states[-1].info["steps"]
            states[-1].info["steps"] = steps.at[2].add(1)
        states.append(step(states[-1], jax.random.uniform(jax.random.PRNGKey(i), (WORLDS, 8), minval=-1.0)))
    return states


def words_of(state: Any) -> np.ndarray:
    """Return the seeds of a state as words."""
    return np.asarray(state.info["layout"]["seed"])


def placed(compiled: CompiledScene) -> np.ndarray:
    """Return the addresses in qpos of the box and the blocks, which come last."""
    return np.arange(compiled.mjm.nq - 4 * 7, compiled.mjm.nq)


def test_every_episode_starts_in_the_next_layout_of_its_seed(page: dict[str, Any], rollout: list[Any]):
    """Bit for bit what a generator makes; the world that is done earlier is reset alone."""
    compiled, last = page["compiled"], np.zeros(WORLDS, int)
    adr, words = placed(compiled), words_of(rollout[0])
    assert len(np.unique(words, axis=0)) == WORLDS
    assert np.array_equal(rollout[0].data.qpos[:, adr], made(compiled, words, 0)[:, adr])
    resets = []
    for state in rollout[1:]:
        done = np.asarray(state.done, bool)
        last += done
        assert np.array_equal(state.info["layout"]["episode"], last)
        assert np.array_equal(state.info["AutoResetWrapper_done_count"], last)
        assert np.array_equal(words_of(state), words)
        resets.append(done.tolist())
        for world in np.flatnonzero(done):
            expected = made(compiled, words[[world]], last[world])[0]
            assert np.array_equal(state.data.qpos[world, adr], expected[adr])
            assert not state.data.qvel[world].any() and state.data.time[world] == 0.0
    alone = [world == 2 for world in range(WORLDS)]
    assert resets == [[False] * WORLDS, alone, [not one for one in alone], [False] * WORLDS, alone] + resets[5:]


def test_layouts_of_a_training_have_ids(page: dict[str, Any], rollout: list[Any]):
    """A generator makes them again by these ids. It refuses `info["layout"]` itself, whose seeds are words."""
    compiled, state, adr = page["compiled"], rollout[3], placed(page["compiled"])
    done, layout = np.asarray(state.done, bool), state.info["layout"]
    seeds = [int(high) << 32 | int(low) for high, low in words_of(state)]
    ids = [compiled.layout_id(seed, int(episode)) for seed, episode in zip(seeds, layout["episode"], strict=True)]
    generator = LayoutGenerator(compiled, WORLDS)
    generator.reseed(layouts=ids)
    generator.generate()
    assert 0 < done.sum() < WORLDS
    assert np.array_equal(state.data.qpos[done][:, adr], generator.layouts.qpos.numpy()[done][:, adr])
    assert np.array_equal(layout["fallback"], generator.layouts.status == LayoutStatus.FALLBACK)
    with pytest.raises(ArgumentError, match=r"layouts\['seed'\] should be an integer, or 6 of them"):
        generator.reseed(layouts=layout)


def test_nothing_else_of_a_start_is_written(page: dict[str, Any], rollout: list[Any]):
    """The target stays the environment's own, on its mocap body and in `info`; the arm stands at home."""
    home = page["env"].mj_model.key_qpos[0]
    for state in rollout:
        assert np.array_equal(state.data.mocap_pos[:, 0], state.info["target_pos"])
        assert np.array_equal(state.info["target_pos"], rollout[0].info["target_pos"])
        done = np.asarray(state.done, bool)
        np.testing.assert_allclose(state.data.qpos[done, :9], np.tile(home[:9], (done.sum(), 1)), atol=1e-6)
    assert len(np.unique(rollout[0].info["target_pos"], axis=0)) == WORLDS


def test_worlds_that_go_on_keep_their_bits(page: dict[str, Any], fresh: LayoutAutoResetWrapper, rollout: list[Any]):
    """All that MJX steps is what the environment without the wrapper makes of it."""
    before, after = rollout[1], rollout[2]
    action = jax.random.uniform(jax.random.PRNGKey(1), (WORLDS, 8), minval=-1.0)
    inner = jax.jit(fresh.env.step)(before, action)
    others = np.arange(WORLDS) != 2
    for name in ("qpos", "qvel", "ctrl", "qacc_warmstart", "xpos", "site_xpos", "time", "mocap_pos"):
        assert np.array_equal(getattr(after.data, name)[others], getattr(inner.data, name)[others]), name
    assert np.array_equal(after.obs[others], inner.obs[others]) and np.array_equal(after.reward, inner.reward)
    assert np.array_equal(after.info["truncation"], inner.info["truncation"]) and after.info["truncation"][2] == 1.0


def test_observations_are_those_of_the_fresh_start(page: dict[str, Any], rollout: list[Any]):
    """By MuJoCo C: the gripper, and the box seen from there, which follow positions and sizes."""
    mjm = page["env"].mj_model
    state, data = rollout[2], mujoco.MjData(mjm)
    data.qpos[:] = state.data.qpos[2]
    mujoco.mj_forward(mjm, data)
    tool, first = data.site("gripper").xpos, mjm.nq + mjm.nv
    np.testing.assert_allclose(state.obs[2, : mjm.nq], data.qpos, atol=1e-6)
    np.testing.assert_allclose(state.obs[2, first : first + 3], tool, atol=1e-5)
    found = state.obs[2, first + 3 + 6 + 6 : first + 3 + 6 + 6 + 3]
    np.testing.assert_allclose(found, data.body("box").xpos - tool, atol=1e-5)


def test_no_start_has_a_contact(page: dict[str, Any], rollout: list[Any]):
    """By MuJoCo C, without contacts with the floor; independent draws over the same region have many."""
    mjm = page["env"].mj_model
    data, random = mujoco.MjData(mjm), np.random.default_rng(0)

    def touches(qpos: Any) -> bool:
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(mjm, data)
        return any(mjm.geom("floor").id not in contact.geom for contact in data.contact)

    starts = [state.data.qpos[i] for state in rollout for i in range(WORLDS) if state is rollout[0] or state.done[i]]
    assert len(starts) == 3 * WORLDS
    assert len(np.unique(np.round(starts, 6), axis=0)) == 3 * WORLDS
    assert not any(map(touches, starts))
    drawn = np.array(starts)
    for k in range(4):
        drawn[:, 9 + 7 * k : 11 + 7 * k] = random.uniform([0.5, -0.2], [0.9, 0.2], (len(starts), 2))
    assert sum(map(touches, drawn)) > 2


def test_a_full_reset_draws_the_rest_anew(page: dict[str, Any]):
    """The target of a world that is done, and of no other; what wrappers count goes on."""
    env = page["wrap_for_brax_training"](page["compiled"], full_reset=True, update=page["mjx"].kinematics)(
        page["env"], episode_length=LENGTH, action_repeat=1
    )
    before = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(3), WORLDS))
    assert "AutoResetWrapper_first_data" not in before.info
    before.info["steps"] = before.info["steps"].at[2].set(LENGTH - 1)
    targets = np.asarray(before.info["target_pos"])
    state = jax.jit(env.step)(before, jnp.zeros((WORLDS, 8)))
    changed = (np.asarray(state.info["target_pos"]) != targets).any(axis=1)
    assert changed.tolist() == [world == 2 for world in range(WORLDS)]
    assert np.array_equal(state.data.mocap_pos[:, 0], state.info["target_pos"])
    assert state.info["steps"].tolist() == [LENGTH if world == 2 else 1 for world in range(WORLDS)]
    assert state.info["truncation"][2] == 1.0 and state.info["episode_done"][2] == 1.0
    adr = placed(page["compiled"])
    assert np.array_equal(state.data.qpos[2, adr], made(page["compiled"], words_of(state)[[2]], 1)[0, adr])


CART = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <body name="cart" mocap="true"><geom name="bed" type="box" size=".2 .2 .05" pos="0 0 .05"/>
      <body name="lid" pos="0 0 .15"><joint name="slide" type="slide" axis="1 0 0" range="0 .2"/>
        <geom name="plate" type="box" size=".1 .1 .01"/></body></body>
    <body name="lamp" pos=".7 .7 .2"><joint name="neck" axis="0 0 1"/><geom type="box" size=".02 .02 .1"/></body>
    <body name="post" pos="-.7 -.7 .1" mocap="true"><geom type="box" size=".02 .02 .1"/></body>
    <body name="cube" pos=".5 0 .5"><freejoint/><geom type="box" size=".02 .02 .02"/></body>
  </worldbody>
  <actuator>
    <position name="slide" joint="slide" kp="5" ctrlrange="0 .12"/>
    <general name="slow" joint="slide" dyntype="filter" dynprm=".1" gainprm="3" biastype="affine" biasprm="0 -3 0"/>
    <motor name="push" joint="slide"/>
    <position name="neck" joint="neck" kp="1"/>
  </actuator>
</mujoco>
"""


class Carts:
    """A batch of worlds without a task, on MJX's own engine, in which nothing is at rest."""

    def __init__(self, mj_model: mujoco.MjModel) -> None:
        from mujoco import mjx

        self.mj_model = mj_model
        self.mjx_model = mjx.put_model(self.mj_model, impl="jax")
        self.make_data, self.update = mjx.make_data, mjx.kinematics
        self.unwrapped = self

    def _get_obs(self, data: Any, info: dict[str, Any]) -> Any:
        return data.ctrl

    def reset(self, keys: Any) -> Any:
        """Return a state with other numbers than zero everywhere."""
        from mujoco_playground import State

        def one(key: Any) -> Any:
            data = self.make_data(self.mj_model, impl="jax")
            moved = {name: getattr(data, name) + 0.5 for name in ("qpos", "qvel", "ctrl", "act", "mocap_pos")}
            return data.replace(**moved)

        data, none = jax.vmap(one)(keys), jnp.zeros(len(keys))
        return State(data, data.ctrl, none, none, {}, {})

    def step(self, state: Any, done: Any) -> Any:
        """Let the worlds of a mask be done."""
        return state.replace(done=done, data=state.data.replace(qvel=state.data.qvel + 1.0))


def test_what_a_start_writes_is_what_a_reset_of_placed_bodies_writes_in_mujoco_warp():
    """Poses, velocities and the controls and activations that hold them; of all else nothing, in no world."""
    pytest.importorskip("mujoco_playground")
    objects = {
        "cart": {"kind": "fixture", "on": "ground", "joints": {"slide": {"range": [0.05, 0.15]}}},
        "cube": {"on": "ground"},
    }
    carts = Carts(mujoco.MjModel.from_xml_string(CART))
    compiled = compile_scene({"model": carts.mj_model, "objects": objects, "bank": 2}, "cpu")
    env = LayoutAutoResetWrapper(carts, compiled, update=carts.update)
    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(1), 3))
    stepped = jax.jit(env.step)(state, jnp.array([0.0, 1.0, 0.0]))
    m, d = mjw.put_model(carts.mj_model), mjw.make_data(carts.mj_model, nworld=3)
    for name in ("qpos", "qvel", "ctrl", "act", "mocap_pos"):
        array = getattr(d, name)
        array.assign(array.numpy() + 0.5)
    words = words_of(state)
    seeds = words[:, 0].astype(np.uint64) << np.uint64(32) | words[:, 1].astype(np.uint64)
    randomizer = ResetRandomizer(compiled, m, d, seed=seeds.tolist(), scope="scene")
    randomizer.reset()
    written = ("qpos", "qvel", "ctrl", "act", "mocap_pos", "mocap_quat")
    for name in written:
        np.testing.assert_allclose(getattr(state.data, name), getattr(d, name).numpy(), rtol=0, atol=1e-6, err_msg=name)
    ctrl, slide = np.asarray(state.obs), np.asarray(state.data.qpos)[:, 0]
    np.testing.assert_allclose(ctrl[:, 0], np.minimum(slide, 0.12), atol=1e-6)
    np.testing.assert_allclose(ctrl[:, 2:], 0.5)  # a motor, and the lamp's
    d.qvel.assign(d.qvel.numpy() + 1.0)
    randomizer.reset(np.array([False, True, False]))
    for name in written:
        found, wanted = getattr(stepped.data, name), getattr(d, name).numpy()
        if name == "qvel":
            wanted[1, ~np.isin(np.arange(carts.mj_model.nv), placed_dofs(compiled))] -= 1.0  # of the first start
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6, err_msg=name)


def test_a_group_of_bodies_is_another_thing_in_every_episode():
    """As objects with variants are refused: `edit_spec` adds the ground where the other one is parked."""
    pytest.importorskip("mujoco_playground")
    spec, wide = mujoco.MjSpec(), {"region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}}
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.1])
    for name in ("cube", "brick"):
        body = spec.worldbody.add_body(name=name)
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.02 if name == "cube" else 0.04])
    objects = {name: {"on": "table", **wide} for name in ("cube", "brick")}
    scene = {"objects": objects, "groups": {"thing": {"of": ["cube", "brick"], "count": 1}}, "bank": 2}
    edit_spec(spec, scene)
    carts = Carts(spec.compile())
    env = LayoutAutoResetWrapper(carts, compile_scene({"model": carts.mj_model, **scene}, "cpu"), update=carts.update)
    states = [jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(1), 8))]
    states.append(jax.jit(env.step)(states[0], jnp.ones(8)))
    near = [np.asarray(state.data.qpos).reshape(8, 2, 7)[..., 0] < 1.0 for state in states]
    assert all((one.sum(axis=1) == 1).all() for one in near)
    assert (near[0] != near[1]).any()


def test_conditions_park_bodies_in_every_episode():
    """A brick on a cube that may be absent is absent with it, and a ball is there only without it."""
    pytest.importorskip("mujoco_playground")
    spec, wide = mujoco.MjSpec(), {"region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}}
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.1])
    for name, half in (("cube", 0.04), ("brick", 0.02), ("ball", 0.03)):
        body = spec.worldbody.add_body(name=name)
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3)
    objects = {"cube": {"on": "table", **wide}, "brick": {"on": "cube"}, "ball": {"on": "table", "unless": "cube"}}
    scene = {"objects": objects, "groups": {"some": {"of": ["cube"], "count": [0, 1]}}, "bank": 2}
    edit_spec(spec, scene)
    carts = Carts(spec.compile())
    compiled = compile_scene({"model": carts.mj_model, **scene}, "cpu")
    env = LayoutAutoResetWrapper(carts, compiled, update=carts.update)
    states = [jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(1), 8))]
    states.append(jax.jit(env.step)(states[0], jnp.ones(8)))
    for state in states:
        near = np.abs(np.asarray(state.data.qpos).reshape(8, 3, 7)[..., 0]) < 1.0
        assert (near[:, 0] == near[:, 1]).all() and (near[:, 0] != near[:, 2]).all()
        assert 0 < near[:, 0].sum() < 8


def test_several_supports_are_refused():
    """By the name of the object, with a remedy: all worlds share one model."""
    pytest.importorskip("mujoco_playground")
    objects = {"apple": {"asset": "apple", "on": ["floor", "shelf"]}, "shelf": {"asset": "table", "kind": "static"}}
    other = compile_scene({"floor": {"size": [2, 2]}, "objects": objects, "bank": 2}, "cpu")
    carts = Carts(mujoco.MjModel.from_xml_string(CART))
    with pytest.raises(SceneMismatchError, match=r"objects\.apple has variants or several supports.*name one support"):
        LayoutAutoResetWrapper(carts, other, update=carts.update)


def placed_dofs(compiled: CompiledScene) -> np.ndarray:
    """Return the degrees of freedom of the cart and the cube."""
    names = ("cart", "lid", "cube")
    return np.flatnonzero(np.isin(compiled.mjm.dof_bodyid, [compiled.mjm.body(name).id for name in names]))


def test_other_models_and_observations_are_refused(
    page: dict[str, Any], fresh: LayoutAutoResetWrapper, mid: CompiledScene
):
    """With a word on what would be right."""
    with pytest.raises(
        ArgumentTypeError, match=r"LayoutAutoResetWrapper: env\.mj_model should be a MjModel, got .*NoneType"
    ):
        LayoutAutoResetWrapper(None, mid)
    with pytest.raises(ArgumentTypeError, match="wrap_for_brax_training: compiled should be a CompiledScene"):
        wrap_for_brax_training("mid")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(SceneMismatchError, match=r"LayoutAutoResetWrapper: model\.nq is 37, .* model: env\.mj_model"):
        LayoutAutoResetWrapper(fresh.env, mid)
    with pytest.raises(ArgumentError, match=r"observe should return .*float32\(\d+, \d+\).*got float32\(\d+, 3\)"):
        LayoutAutoResetWrapper(fresh.env, page["compiled"], observe=lambda data, info: data.qpos[:3]).reset(
            jax.random.split(jax.random.PRNGKey(3), WORLDS)
        )
    with pytest.raises(ArgumentError, match=r"observe should return .*got {'state': 'float32\("):
        LayoutAutoResetWrapper(fresh.env, page["compiled"], observe=lambda data, info: {"state": data.qpos}).reset(
            jax.random.split(jax.random.PRNGKey(3), WORLDS)
        )

    class Other(page["PickFromClutter"]):  # pyrefly: ignore[invalid-inheritance, unknown-name]
        def _get_obs(self, data: Any) -> Any:
            return data.qpos

    env = wrap_for_brax_training(page["compiled"])
    other = object.__new__(Other)
    other.__dict__.update(vars(page["env"]))
    wrong = r"observe should be a function of \(data, info\), because Other has no method _get_obs\(data, info\)"
    with pytest.raises(ArgumentError, match=wrong):
        env(other, episode_length=LENGTH, action_repeat=1)
    with pytest.raises(ArgumentError, match=r"observe should be a function of \(data, info\)"):
        # pyrefly: ignore[bad-argument-type]
        LayoutAutoResetWrapper(fresh.env, page["compiled"], observe=lambda data: data)


def test_the_program_of_the_page_trains_ten_iterations(page: dict[str, Any]):
    """With Brax's PPO as it stands, in short episodes: six worlds of ten unrolls of ten steps."""
    _, line, training = small(CLUTTER).partition("sizes = ")
    program = training.replace("240", str(10 * 10 * WORLDS))
    calls = []
    names = page | {"progress": lambda steps, metrics: calls.append(steps)}
    program = program.replace("num_evals=2", "num_evals=2, progress_fn=progress")
    exec(compile(line + program, "jax.md", "exec"), names)
    assert calls == [0, 10 * 10 * WORLDS]
    about = [text for text in CLUTTER.splitlines() if re.search("sceniris|region|things|compiled|wrap", text)]
    assert len(about) == 7  # as the page says


def test_an_own_environment_of_the_page_trains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The page has the environment in a file, and ten lines around it."""
    pytest.importorskip("mujoco_playground")
    monkeypatch.syspath_prepend(tmp_path)
    files = re.findall(r'```python title="([^"]+)"\n(.*?)```', PAGE.read_text(), re.DOTALL)
    assert [name for name, _ in files] == ["above.py"]
    (tmp_path / "above.py").write_text(files[0][1])
    program = OWN.replace('"objects": things}', '"objects": things, "bank": 2}, "cpu"')
    program = program.replace("num_envs=2048, batch_size=512", SIZES_AS_ARGUMENTS)
    program = program.replace("2_000_000", "240").replace("episode_length=150", f"episode_length={LENGTH}")
    exec(compile(program, "jax.md", "exec"), {})


def test_the_function_of_the_page_runs():
    """As it stands, on the CPU."""
    exec(compile(FUNCTION.replace('"mid"', '"mid", "cpu"'), "jax.md", "exec"), {})
