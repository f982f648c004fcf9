"""Snapshots: worlds go on where they were, to the bit on a CPU, in their own places or in others."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError
from sceniris_gym.sim.snapshot import Snapshot
from sceniris_gym.vector.task import SLEEPING
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach
from tests.vector.stepping import actions, assert_equal, leaves, state

SLIDE = "objects.cabinet.joints.slide"
SENSING = {"noise": {"tcp": 0.01}, "delay": (0, 2), "dropout": 0.2}


def _run(envs, steps: int) -> list[torch.Tensor]:
    """All that some steps return."""
    return [leaf.clone() for k in range(steps) for leaf in leaves(envs.step(actions(envs.num_envs) * (1 + k)))]


def test_a_refused_state_or_param_changes_nothing(make_env):
    """Whichever of the two is wrong, the other has no effect."""
    envs = make_env(2, params=SLIDE)
    envs.reset(seed=0)
    kept = envs.snapshot()
    envs.reset(seed=5)
    params, before = envs.randomizer.layouts.view.next_param.numpy().copy(), state(envs)
    for options in ({"state": 3, "params": {SLIDE: [0.1, 0.11]}}, {"state": kept, "params": {SLIDE: [7.0, 8.0]}}):
        with pytest.raises(ArgumentError):
            envs.reset(options=options)
        assert_equal(state(envs), before)
        np.testing.assert_array_equal(envs.randomizer.layouts.view.next_param.numpy(), params)


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("words", [{}, {"sensing": SENSING}, {"sim_config": {"graph": False}}])
def test_an_episode_goes_on_to_the_same_bits(make_env, words):
    """Observations with noise and delay, rewards, the ends of episodes and the layouts that follow them."""
    envs = make_env(3, max_episode_steps=5, **words)
    envs.reset(seed=4)
    _run(envs, 3)
    kept, before = envs.snapshot(), state(envs)
    first = _run(envs, 6)
    _, info = envs.reset(options={"state": kept})
    assert_equal(state(envs), before)
    assert info["layout"]["seed"].tolist() == [4, 5, 6]
    assert info["layout"]["episode"].tolist() == [0, 0, 0]
    for one, other in zip(first, _run(envs, 6), strict=True):
        torch.testing.assert_close(one, other, rtol=0.0, atol=0.0, equal_nan=True)


def test_the_critic_sees_the_drawn_numbers_of_the_episode_again():
    """They are observed beside the fields of the model that were drawn by them."""
    block = {**SCENE["objects"]["block"], "randomize": {"mass": {"scale": [0.5, 2.0]}}}
    scene = {**SCENE, "bank": 2, "objects": {**SCENE["objects"], "block": block}}
    envs = SceneVectorEnv(Reach, 3, scene=scene, device="cpu")
    wanted, _ = envs.reset(seed=4)
    kept = envs.snapshot()
    assert not torch.equal(envs.reset()[0]["critic"][:, -1], wanted["critic"][:, -1])
    assert_equal(envs.reset(options={"state": kept})[0], wanted)


class _Sleepers(Reach):
    """Reach with a block that sleeps where it was placed."""

    options = SLEEPING

    def on_reset(self, s, mask):
        """Put the block to sleep."""
        super().on_reset(s, mask)
        s.sleep(("block",), mask)


@pytest.mark.skipif(not SLEEPING, reason="bodies of a batch cannot sleep in this version")
def test_bodies_that_slept_sleep_again(reach_scene):
    """With all that steps count of them, wherever the block has been woken since."""
    envs = SceneVectorEnv(_Sleepers, 2, scene=reach_scene)
    envs.reset(seed=4)
    _run(envs, 2)
    kept, counts = envs.snapshot(), ("tree_asleep", "tree_awake", "nv_awake")
    runs = []
    for _ in range(2):
        _run(envs, 1)
        runs.append([getattr(envs.batch.data, name).numpy().tolist() for name in counts])
        s = envs.state
        s.put_pose("block", s.pose("block"), torch.tensor([True, True]))
        _run(envs, 1)
        envs.reset(options={"state": kept})
    assert runs[0] == runs[1]


class _Tables(Reach):
    """Reach with tensors that nothing writes to, and with one that each step replaces."""

    def bind(self, s):
        """Make indices of worlds, and a table that has as many rows as four worlds."""
        super().bind(s)
        self.index, self.steps = torch.arange(s.num_envs), torch.tensor([1.0, 2.0, 3.0, 4.0])
        self.newest = torch.zeros(s.num_envs)

    def terminated(self, s):
        """Keep a number of the step in a new tensor."""
        self.newest = s.elapsed.float()
        return super().terminated(s)


def test_constants_of_a_task_are_no_memory(reach_scene):
    """They stay as they are in worlds that go on as others; what is replaced instead of written to is restored."""
    envs = SceneVectorEnv(_Tables, 4, scene=reach_scene, sensing=SENSING)
    envs.reset(seed=4)
    _run(envs, 2)
    kept = envs.snapshot()
    task: Any = envs.task
    _run(envs, 3)
    envs.reset(options={"state": kept[[0]], "reset_mask": np.array([False, False, False, True])})
    assert task.index.tolist() == [0, 1, 2, 3]
    assert task.steps.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert task.newest.tolist() == [5.0, 5.0, 5.0, 2.0]
    (name,) = (name for name in kept.rows if name.endswith("newest"))
    with pytest.raises(SceneMismatchError, match="finite numbers, got NaN"):
        envs.reset(options={"state": _with(kept, name, np.nan)})
    task.newest[0] = np.nan
    with pytest.raises(SceneMismatchError, match="finite numbers, got NaN"):  # whatever the worlds have by now
        envs.reset(options={"state": _with(kept, name, np.nan)})


def test_layouts_that_a_task_holds_are_no_memory(make_env):
    """Their tensors are made when they are read, and a snapshot has the rows of the layouts in any case."""
    envs = make_env(3)
    task: Any = envs.task
    task.layouts = envs.randomizer.layouts
    envs.reset(seed=4)
    kept, before = envs.snapshot(), task.layouts.attempts.clone()
    envs.reset(seed=9)
    envs.reset(options={"state": kept})
    assert torch.equal(task.layouts.attempts, before)
    assert not [name for name in kept.rows if name.startswith("task.layouts")]


def test_rows_go_to_the_masked_worlds_in_order(make_env):
    """Without the other worlds being touched; a single row can be put into several worlds one after another."""
    envs = make_env(4)
    envs.reset(seed=4)
    _run(envs, 2)
    kept = envs.snapshot(np.array([False, True, False, True]))
    assert len(kept) == 2
    assert kept.worlds.tolist() == [1, 3]
    _run(envs, 2)
    before, old = state(envs), {name: rows.numpy() for name, rows in kept.rows.items()}
    mask = torch.tensor([True, False, True, False])
    _, info = envs.reset(options={"state": kept, "reset_mask": mask})
    after = state(envs)
    assert_equal(after, before, [1, 3])
    np.testing.assert_array_equal(after["qpos"][[0, 2]], old["data.qpos"])
    assert info["layout"]["seed"].tolist() == [5, 5, 7, 7]
    assert envs.state.elapsed.tolist() == [2, 4, 2, 4]
    envs.reset(options={"state": kept[[1]], "reset_mask": torch.tensor([False, True, False, False])})
    np.testing.assert_array_equal(state(envs)["qpos"][1], old["data.qpos"][1])


def test_the_episodes_that_follow_are_those_that_were_chosen(make_env):
    """By params, also those that no layout has been made with yet, and by seeds; in another environment, too."""
    first, second = (make_env(4, params=SLIDE) for _ in range(2))
    first.reset(seed=4)
    second.reset(seed=9)
    first.set_param(SLIDE, [0.05, 0.06], np.arange(4) < 3)
    first.reset()
    first.set_param(SLIDE, [0.07, 0.08], np.arange(4) == 1)
    first.randomizer.reseed(np.arange(4) == 2, seed=77)
    kept, runs = first.snapshot(), []
    for envs in (first, second, first):
        envs.reset(options={"state": kept})
        runs.append([])
        for _ in range(3):
            runs[-1] += [*envs.layout_ids(), envs.randomizer.layouts.qpos.numpy().tobytes()]
            envs.reset()
        envs.set_param(SLIDE, [0.1, 0.11])
    assert runs[0] == runs[1] == runs[2]
    second.reset(options={"state": kept, "params": {SLIDE: [0.13, 0.14]}})
    second.reset()
    assert (np.abs(second.randomizer.layouts.joint("slide").numpy() - 0.135) <= 0.005).all()


def test_wrong_snapshots_are_refused(make_env):
    """Of another scene, split or type, of other params, too many rows, with a seed, or before the first reset."""
    envs = make_env(2)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"before snapshot"):
        envs.snapshot()
    envs.reset(seed=0)
    kept = envs.snapshot()
    with pytest.raises(gymnasium.error.ResetNeeded, match="Leave out"):
        make_env(2).reset(options={"state": kept})
    with pytest.raises(ArgumentError, match="should have at most one of seed"):
        envs.reset(seed=1, options={"state": kept})
    with pytest.raises(ArgumentTypeError, match="should be a Snapshot"):
        envs.reset(options={"state": {}})
    with pytest.raises(ArgumentError, match="should have 1 rows, one per chosen world, got 2"):
        envs.reset(options={"state": kept, "reset_mask": np.array([True, False])})
    with pytest.raises(ArgumentError, match=r"different worlds with ids below 2, got \[0, 0\]"):
        envs.reset(options={"state": kept[[0, 0]]})
    others = [replace(kept, source=("0123456789abcdef", *kept.source[1:]))]
    finite = kept.rows["finite"]
    others += [replace(kept, rows={**kept.rows, "finite": form}) for form in (finite.to("meta"), finite.to_sparse())]
    for words in ({"split": "eval"}, {"params": SLIDE}):
        foreign = make_env(2, **words)
        foreign.reset(seed=0)
        others.append(foreign.snapshot())
    for other in others:
        with pytest.raises(SceneMismatchError, match=r"the scene, split, task and params of .*, got "):
            envs.reset(options={"state": other})


def test_a_world_that_ended_is_reset_by_the_next_step(make_env):
    """Also after a snapshot of it was restored, with resets in the step after an episode's last one."""
    envs = make_env(2, max_episode_steps=2, autoreset_mode="NextStep")
    envs.reset(seed=3)
    for _ in range(2):
        envs.step(actions(2))
    kept = envs.snapshot()
    wanted, *_, truncated, _ = envs.step(actions(2))
    assert not truncated.any()
    envs.reset(options={"state": kept})
    observation, *_, truncated, _ = envs.step(actions(2))
    assert not truncated.any()
    assert_equal(observation, wanted)


def _with(kept: Snapshot, name: str, value: float) -> Snapshot:
    rows = kept.rows[name].clone()
    rows[1] = value
    return replace(kept, rows={**kept.rows, name: rows})


def test_a_snapshot_with_numbers_that_no_world_has_is_refused(make_env):
    """Edited on the way: the worlds stay as they were, and the rows of the others can still be restored."""
    envs = make_env(2, params=SLIDE)
    envs.reset(seed=4)
    kept, before = envs.snapshot(), state(envs)
    wrong = {
        r"from \[0\.04\] to \[0\.16\]": [_with(kept, f"layout.{name}", 7.0) for name in ("param", "next_param")],
        "finite numbers": [
            *(_with(kept, f"data.{name}", np.nan) for name in ("qpos", "time", "qacc_warmstart", "qfrc_applied")),
            _with(kept, "layout.qpos", np.nan),
            _with(kept, "data.ctrl", np.inf),
        ],
        r"episode should be from -1 to 2147483646, got -5 in row 1": [_with(kept, "layout.episode", -5)],
        r"status should be from 0 to 3, got 9 in row 1": [_with(kept, "layout.status", 9)],
        r"next_episode should be from -1 to 2147483646, got -5 in row 1": [_with(kept, "layout.next_episode", -5)],
        r"attempts should be from 0 to 2147483647, got -5 in row 1": [_with(kept, "layout.attempts", -5)],
        r"elapsed should be from 0 to 2147483647, got -3 in row 1": [_with(kept, "elapsed", -3)],
        r"start should be from -1 to -1, got 5 in row 1": [_with(kept, "layout.start", 5)],
        r"present should be from 0 to 1, got 7 in row 1": [_with(kept, "layout.present", 7)],
        r"the scene, split, task and params of the worlds": [
            replace(kept, rows={**kept.rows, "data.qpos": kept.rows["data.qpos"][:1]}),
            replace(kept, rows={**kept.rows, "elapsed": kept.rows["elapsed"].float()}),
            replace(kept, worlds=kept.worlds.float()),
            replace(kept, worlds=kept.worlds.numpy()),
            replace(kept, rows={**kept.rows, "data.qpos": None}),
        ],
        "different worlds": [replace(kept, worlds=torch.tensor([0, -1]))],
    }
    for match, snapshots in wrong.items():
        for snapshot in snapshots:
            with pytest.raises((ArgumentError, SceneMismatchError), match=match):
                envs.reset(options={"state": snapshot})
    assert_equal(state(envs), before)
    mask = np.array([True, False])
    envs.reset(options={"state": _with(kept, "data.qpos", np.nan)[0], "reset_mask": mask})
    assert_equal(state(envs), before)


def test_one_number_names_one_row_of_a_snapshot(make_env):
    """Of any library; a number beyond the rows ends a loop, and anything else is refused."""
    envs = make_env(3)
    envs.reset(seed=4)
    kept = envs.snapshot()
    rows: list[Any] = [1, -1, np.int64(2), torch.tensor(0), [0, 2], slice(None, 2), torch.tensor([True] * 3)]
    assert [len(kept[row]) for row in rows] == [1, 1, 1, 1, 2, 2, 3]
    envs.reset(options={"state": kept[np.int64(1)], "reset_mask": np.array([True, False, False])})
    np.testing.assert_array_equal(state(envs)["qpos"][0], kept.rows["data.qpos"][1])
    with pytest.raises(IndexError, match="row 9 should be below 3"):
        kept[9]
    for index in ("x", [9], 0.5):
        with pytest.raises(ArgumentError, match="Snapshot: the index should be rows from 0 to 2"):
            kept[index]
    for worlds in (None, kept.worlds.numpy(), torch.tensor(0)):
        with pytest.raises(SceneMismatchError, match=r"the scene, split, task and params of .*, got "):
            envs.reset(options={"state": replace(kept, worlds=worlds)})


def test_the_randomizer_of_an_environment_restores_worlds_without_their_task(make_env):
    """An environment refuses the snapshot of its randomizer, which lacks the memory of the task."""
    envs = make_env(2)
    envs.reset(seed=4)
    _run(envs, 2)
    worlds, kept, before = envs.randomizer.snapshot(), envs.snapshot(), state(envs)
    assert worlds.rows.keys() < kept.rows.keys()
    for snapshot in (worlds, kept):
        _run(envs, 1)
        envs.randomizer.restore(snapshot)
        assert_equal(state(envs), before)
    with pytest.raises(SceneMismatchError, match=r"the scene, split, task and params of .*, got rows of other names"):
        envs.reset(options={"state": worlds})


class _Records(Reach):
    """Reach with a memory that is infinite, or nothing, in some episodes."""

    value = np.inf

    def on_reset(self, s, mask):
        """Forget the best reward."""
        super().on_reset(s, mask)
        self.drawn.masked_fill_(mask[:, None], self.value)


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_a_task_may_remember_what_is_not_finite(reach_scene, value: float):
    """Its snapshot goes back whatever the worlds have by then; numbers that were finite have to be so still."""
    envs = SceneVectorEnv(_Records, 2, scene=reach_scene)
    task: Any = envs.task
    task.value = value
    envs.reset(seed=4)
    kept, task.value = envs.snapshot(), 1.0
    envs.reset()
    envs.reset(options={"state": kept})
    assert torch.equal(task.drawn.isfinite(), torch.zeros(2, 2, dtype=torch.bool))
    for wrong in (np.nan, np.inf):
        with pytest.raises(SceneMismatchError, match="finite numbers, got NaN"):
            envs.reset(options={"state": _with(kept, "task.last", wrong)})


def test_a_restored_world_has_no_rows_of_a_broken_one(make_env):
    """The NaNs of constraint rows of a world that broke go with its contacts, as at a reset."""
    envs = make_env(2, autoreset_mode="Disabled")
    envs.reset(seed=4)
    kept, data = envs.snapshot([1]), envs.batch.data
    _run(envs, 2)
    for name in ("J", "D"):
        getattr(data.efc, name).fill_(float("nan"))
    envs.reset(options={"state": kept})
    for name in ("J", "D"):
        assert np.isnan(getattr(data.efc, name).numpy()).all(
            axis=tuple(range(1, getattr(data.efc, name).ndim))
        ).tolist() == [True, False]
    assert not (data.contact.worldid.numpy()[: data.nacon.numpy()[0]] == 1).any()
