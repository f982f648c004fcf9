"""Params of environments: through every door a world gets the layout and the physics that its params say."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError, UnknownNameError
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.levels import LevelReplay
from sceniris_gym.vector.evaluation import evaluate
from sceniris_gym.vector.single_env import SceneEnv
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach, make_env, reach_scene  # noqa: F401, fixtures
from tests.vector.stepping import actions, assert_equal

SLIDE = "objects.cabinet.joints.slide"
RANDOM: dict[str, Any] = {**SCENE, "bank": 2, "objects": {**SCENE["objects"]}}
RANDOM["objects"]["block"] = {**SCENE["objects"]["block"], "randomize": {"mass": {"scale": [0.5, 2.0]}}}
MASS = "objects.block.randomize.mass"


def _slides(envs: SceneVectorEnv) -> list[float]:
    return envs.randomizer.layouts.joint("slide").tolist()


def test_a_param_is_set_in_some_worlds_by_every_door(make_env):  # noqa: F811
    """`set_param`, `set_attr`, options of a reset: the next layouts of these worlds alone follow."""
    doors = {
        "set_param": lambda envs, value, mask: envs.set_param(SLIDE, value, mask),
        "set_attr": lambda envs, value, mask: envs.set_attr(SLIDE, np.where(mask[:, None], value, [0.04, 0.16])),
        "options": lambda envs, value, mask: envs.reset(options={"params": {SLIDE: value}, "reset_mask": mask}),
    }
    plain, mask = make_env(4), np.array([True, False, True, False])
    plain.reset(seed=3)
    plain.reset(options={"reset_mask": mask})
    for name, door in doors.items():
        envs = make_env(4, params=["objects.cabinet.joints.*"])
        assert_equal(make_env(4).reset(seed=3)[0], envs.reset(seed=3)[0])
        door(envs, [0.05, 0.06], mask)
        if name != "options":
            envs.reset(options={"reset_mask": mask})
        slides, others = _slides(envs), _slides(plain)
        assert all(0.05 <= slides[i] <= 0.06 for i in (0, 2)), name
        assert [slides[i] for i in (1, 3)] == [others[i] for i in (1, 3)]
    with pytest.raises(UnknownNameError, match=r"`params` should name it\): unknown param 'objects\.block\.region'"):
        envs.set_param("objects.block.region", [[0, 0], [0.1, 0.1]])  # pyrefly: ignore[unbound-name]
    with pytest.raises(UnknownNameError, match=r"Did you mean 'objects\.cabinet\.joints\.slide'"):
        envs.set_attr("objects.cabinet.joints.slid", [0.05, 0.06])
    with pytest.raises(ArgumentError, match=r"from \[0\.04\] to \[0\.16\], as in the scene file, got \[0\.0, 0\.1\]"):
        envs.set_param(SLIDE, [0.0, 0.1])
    with pytest.raises(ArgumentTypeError, match="params should be a Mapping"):
        envs.reset(options={"params": [SLIDE]})
    with pytest.raises(ArgumentTypeError, match="worlds should hold booleans or ids, got float64"):
        envs.set_param(SLIDE, [0.05, 0.06], [1.0] * 4)


def test_an_id_with_params_is_a_layout_through_every_door(make_env):  # noqa: F811
    """Bits of the observation after a reset to the id, or to seed, episode and params of an info."""
    envs = make_env(3, params="*")
    envs.reset(seed=5)
    envs.set_param(SLIDE, [0.07, 0.08], np.array([True, True, False]))
    wanted, info = envs.reset()
    ids = envs.layout_ids()
    assert [name.count(":") for name in ids] == [4, 4, 3]
    ended = envs.step(actions(3, ending=(0, 2)))[-1]
    assert envs.layout_ids(ended["final_info"]) == ids
    assert envs.layout_ids(ended) == envs.layout_ids() != ids
    other = make_env(3, params=[SLIDE, "objects.block.region"])
    assert_equal(other.reset(options={"layouts": ids})[0], wanted)
    assert other.layout_ids() == ids
    told = {"seed": info["layout"]["seed"], "episode": info["layout"]["episode"]}
    told["params"] = {SLIDE: info["layout"]["params"][SLIDE]}
    assert_equal(other.reset(options={"layouts": told})[0], wanted)
    one = SceneEnv(Reach, scene=envs.compiled, params=SLIDE)
    found, _ = one.reset(options={"layouts": ids[1]})
    assert_equal({name: rows[None] for name, rows in found.items()}, {k: v[1:2] for k, v in wanted.items()})
    one.set_param(SLIDE, [0.1, 0.11])
    assert one.reset()[1]["layout"]["params"][SLIDE].tolist() == pytest.approx([0.1, 0.11])
    wrapped = gymnasium.wrappers.TimeLimit(one, 5)
    assert wrapped.set_wrapper_attr(SLIDE, [0.07, 0.08])  # as Gymnasium's own vector environments do in `set_attr`
    assert wrapped.reset()[1]["layout"]["params"][SLIDE].tolist() == pytest.approx([0.07, 0.08])
    assert wrapped.set_wrapper_attr("note", "kept")
    assert wrapped.get_wrapper_attr("note") == "kept"
    with pytest.raises(UnknownNameError, match=SLIDE):
        make_env(3).reset(options={"layouts": ids})
    with pytest.raises(SceneMismatchError):
        other.reset(options={"layouts": f"{'0' * 16}{ids[0][16:]}"})


@pytest.mark.parametrize("prefetch", [False, True])
def test_draws_of_physics_follow_their_params(prefetch: bool):
    """A narrowed factor of mass is what a scene that says so draws, with what follows from it, made ahead or not."""
    narrow = {**RANDOM, "objects": {**RANDOM["objects"]}}
    narrow["objects"]["block"] = {**SCENE["objects"]["block"], "randomize": {"mass": {"scale": [1.5, 1.75]}}}
    words: dict[str, Any] = {"device": "cpu", "sim_config": {"prefetch": prefetch}}
    envs, told = SceneVectorEnv(Reach, 6, scene=RANDOM, params=[MASS], **words), np.arange(6) < 3
    wanted, plain = (SceneVectorEnv(Reach, 6, scene=scene, **words) for scene in (narrow, RANDOM))
    for number in range(4):
        if number == 2:
            envs.set_param(MASS, [1.5, 1.75], told)
        for one in (envs, wanted, plain):
            one.reset(seed=2 if number == 0 else None)
        for field in ("body_mass", "body_inertia", "body_invweight0"):
            found, right, usual = (one.batch.fields.rows[field].numpy() for one in (envs, wanted, plain))
            left = told & (number >= 2)
            np.testing.assert_array_equal(found[left], right[left])
            np.testing.assert_array_equal(found[~left], usual[~left])
            assert (found[left] != usual[left]).any() == (number >= 2)


def test_levels_are_replayed_with_their_params(make_env):  # noqa: F811
    """A replayed level is the layout of its id, params and all, whatever the params are by then."""
    levels = LevelReplay("failure", replay_prob=0.6, refresh_interval=1, capacity=64)
    envs, plain = make_env(4, max_episode_steps=2, curriculum=levels, params="*"), make_env(4, params="*")
    envs.reset(seed=5)
    replayed, seen = 0, set()
    for step in range(40):
        if step % 10 == 0:
            envs.set_param(SLIDE, [0.04 + 0.002 * step, 0.05 + 0.002 * step])
        observation, _, _, _, info = envs.step(actions(4))
        if info["_final_obs"].any():
            told = info["layout"]
            assert_equal(plain.reset(options={"layouts": told})[0], observation)
            replayed += int((info["layout"]["level"] >= 0).sum())
            seen |= {tuple(row) for row in info["layout"]["params"][SLIDE].tolist()}
    assert replayed > 10
    assert len(seen) > 3
    drawn = envs.randomizer.levels.sample(100)
    assert {tuple(row) for row in drawn["params"][SLIDE].tolist()} <= seen | {tuple(map(float, row)) for row in seen}
    envs.randomizer.levels.insert({"seed": [77], "episode": [1], "params": {SLIDE: [0.1, 0.12]}}, [0.0])


@pytest.mark.parametrize("score", ["failure", "custom"])
def test_layouts_from_the_bank_are_no_levels(make_env, score: str):  # noqa: F811
    """Their outcomes count nowhere, nor do scores that are given for them."""
    envs = make_env(4, max_episode_steps=1, curriculum=LevelReplay(score, replay_prob=0.0, refresh_interval=1))
    envs.reset(seed=0)
    envs.state.layout_status.fill_(int(LayoutStatus.FALLBACK))
    for size in (0, 4):
        last = envs.step(actions(4))[-1]["final_info"]
        if score == "custom":
            layouts = last["layout"]
            envs.randomizer.levels.update(layouts, np.ones(4))
        assert envs.randomizer.levels.size == size


def test_gymnasium_makes_environments_with_params():
    """By name, with patterns; a source of layouts of one's own has no params."""
    envs = gymnasium.make_vec("sceniris_gym/TabletopReach-v0", num_envs=2, device="cpu", params="objects.*.region")
    _, info = envs.reset(seed=0)
    assert len(info["layout"]["params"]) == 5
    with pytest.raises(ArgumentError, match="prefetch and params"):
        gymnasium.make_vec(
            "sceniris_gym/TabletopReach-v0",
            num_envs=2,
            scene=envs.unwrapped.compiled,  # pyrefly: ignore[missing-attribute]
            params="*",
            # pyrefly: ignore[missing-attribute]
            layout_source=lambda compiled, num_envs: envs.unwrapped.randomizer.pipeline,
        )


def test_layouts_that_have_params_take_no_others(make_env):  # noqa: F811
    """An id names its params, so an option beside it would be lost."""
    envs = make_env(2, params=[SLIDE])
    _, info = envs.reset(seed=0)
    with pytest.raises(ArgumentError, match="already has params"):
        envs.reset(options={"layouts": envs.layout_ids(), "params": {SLIDE: [0.0, 0.0]}})
    with pytest.raises(ArgumentError, match="already has params"):
        envs.reset(options={"layouts": info["layout"], "params": {SLIDE: [0.0, 0.0]}})


def test_an_evaluation_takes_params_for_all_rows_or_for_each(make_env):  # noqa: F811
    """More rows than worlds; the ids name the params, as those of a reset do."""
    envs = make_env(2, params=[SLIDE], max_episode_steps=2)
    rows = {"seed": [5, 6, 7], "episode": 0}
    one, each = ({**rows, "params": {SLIDE: values}} for values in ([0.05, 0.1], [[0.05, 0.1]] * 3))
    results = evaluate(lambda _: actions(2), envs, one)
    assert evaluate(lambda _: actions(2), envs, each) == results
    assert all(f"{SLIDE}=" in result.id for result in results)
    assert [result.id.split(":")[2] for result in results] == ["5", "6", "7"]


@pytest.mark.parametrize("seed", [-1, "x", [1, 2, 3], np.array(3.5)], ids=str)
def test_a_reset_with_a_wrong_seed_changes_no_param(make_env, seed):  # noqa: F811
    """The seed is checked before the params of the same call are set."""
    envs = make_env(4, params=[SLIDE])
    before = envs.reset(seed=0)[1]["layout"]["params"][SLIDE].clone()
    with pytest.raises(ArgumentError, match="seed"):
        envs.reset(seed=seed, options={"params": {SLIDE: [0.05, 0.06]}})
    assert torch.equal(envs.reset()[1]["layout"]["params"][SLIDE], before)
