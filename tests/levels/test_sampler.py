"""Levels in environments: the layout of a level is that of its id, episodes are told, and a sampler goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from gymnasium.envs.registration import EnvSpec

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError, ScenirisError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.pipeline import LayoutPipeline
from sceniris_gym.levels import ADR, LevelReplay
from sceniris_gym.levels.sampler import LevelSampler
from sceniris_gym.program.compiled import CompiledScene
from tests.vector.conftest import Reach, make_env, reach_scene  # noqa: F401, fixtures
from tests.vector.stepping import actions, assert_equal

SLIDE = "objects.cabinet.joints.slide"
ONE = {"level": np.array([-1]), "seed": np.array([1]), "episode": np.array([0])}
LEVELS = LevelReplay("failure", replay_prob=0.5, refresh_interval=1, capacity=64)


def _play(envs, steps: int) -> list[dict]:
    return [envs.step(actions(envs.num_envs, ending=(k % envs.num_envs,)))[-1] for k in range(steps)]


@pytest.mark.parametrize("prefetch", [False, True])
def test_a_level_is_the_layout_of_its_id(make_env, prefetch):  # noqa: F811
    """With replays in between, and the next ones made ahead or not."""
    envs, plain = make_env(3, max_episode_steps=3, curriculum=LEVELS, sim_config={"prefetch": prefetch}), make_env(3)
    envs.reset(seed=5)
    replayed = 0
    for _ in range(24):
        observation, _, _, _, info = envs.step(actions(3))
        if info["_final_obs"].any():
            named = {"seed": info["layout"]["seed"], "episode": info["layout"]["episode"]}
            assert_equal(plain.reset(options={"layouts": named})[0], observation)
            replayed += int((info["layout"]["level"] >= 0).sum())
    assert replayed > 3
    assert envs.randomizer.levels.size > 3


def test_the_levels_of_worlds_are_read_in_place(make_env):  # noqa: F811
    """As torch tensors, made once, which show the levels that worlds have by then."""
    envs = make_env(3, max_episode_steps=3, curriculum=LEVELS)
    sampler = envs.randomizer.levels
    level, boundary = sampler.level, sampler.boundary
    assert sampler.rows() == {"level": level, "boundary": boundary}
    assert (level.data_ptr(), boundary.data_ptr()) == (sampler._buffer.level.ptr, sampler._buffer.boundary.ptr)
    envs.reset(seed=5)
    seen = {int(value) for _ in range(24) for value in (envs.step(actions(3)), level)[1]}
    assert level is sampler.level
    assert max(seen) >= 0


def test_levels_depend_on_seeds_and_outcomes_alone(make_env):  # noqa: F811
    """The same ones in a second run, and after a seed they begin anew."""
    runs = []
    for _ in range(2):
        envs = make_env(4, max_episode_steps=3, curriculum=LEVELS)
        envs.reset(seed=1)
        runs.append([info["layout"]["seed"].tolist() for info in _play(envs, 20)])
    assert runs[0] == runs[1]
    assert len(set(map(tuple, runs[0]))) > 4


def test_a_sampler_goes_on_where_it_was(make_env):  # noqa: F811
    """From its state in another process's environment: the same levels follow, with weights refreshed as often."""
    levels = replace(LEVELS, refresh_interval=7)
    first, second = (make_env(4, max_episode_steps=3, curriculum=levels) for _ in range(2))
    first.reset(seed=1)
    _play(first, 9)
    second.reset(seed=2)
    second.randomizer.levels.restore(first.randomizer.levels.state())
    assert_equal(first.reset()[1]["layout"], second.reset()[1]["layout"])
    runs = [[info["layout"]["seed"].tolist() for info in _play(envs, 30)] for envs in (first, second)]
    assert runs[0] == runs[1]
    kept, before = first.randomizer.levels.state(), second.randomizer.levels.state()
    for name, shape in (("seed", r"\(64,\)"), ("resets", r"\(\)")):
        with pytest.raises(ArgumentError, match=f"{name}'\\] should be .* of shape {shape}"):
            second.randomizer.levels.restore({key: kept[key] for key in kept if key != name})
    np.testing.assert_equal(second.randomizer.levels.state(), before)  # all of it or nothing


def test_a_snapshot_goes_on_with_the_levels_of_its_step(make_env):  # noqa: F811
    """Of the episodes that follow, too, once the sampler was restored."""
    envs = make_env(3, max_episode_steps=3, curriculum=LEVELS)
    envs.reset(seed=1)
    _play(envs, 8)
    kept, levels, runs = envs.snapshot(), envs.randomizer.levels.state(), []
    for _ in range(2):
        envs.randomizer.levels.restore(levels)
        envs.reset(options={"state": kept})
        infos = _play(envs, 8)
        runs.append([info["layout"][name].tolist() for info in infos for name in ("seed", "level")])
    assert runs[0] == runs[1]


def test_a_sampler_in_a_pipeline_of_ones_own_comes_back_with_its_worlds(make_env):  # noqa: F811
    """A snapshot has their levels, as with `curriculum=`."""
    samplers = []

    def source(compiled: CompiledScene, num_envs: int) -> LayoutPipeline:
        maker = LayoutGenerator(compiled, num_envs)
        samplers.append(LevelSampler(LEVELS, maker.layouts))
        return LayoutPipeline(maker, chooser=samplers[0])

    envs = make_env(3, max_episode_steps=3, layout_source=source)
    envs.reset(seed=1)
    _play(envs, 20)
    kept, played = envs.snapshot(), samplers[0].level.numpy().tolist()
    _play(envs, 9)
    assert samplers[0].level.numpy().tolist() != played
    envs.reset(options={"state": kept})
    assert samplers[0].level.numpy().tolist() == played


def test_scores_can_be_given(make_env):  # noqa: F811
    """By infos of episodes that ended before, as torch tensors or NumPy arrays; wrong lengths are refused."""
    envs = make_env(4, max_episode_steps=2, curriculum=LevelReplay("custom", replay_prob=1.0, refresh_interval=1))
    envs.reset(seed=2**63)
    for _ in range(4):
        info = envs.step(actions(4))[-1]
        last, done = info["final_info"], info["_final_info"]
        layouts = last["layout"]
        envs.randomizer.levels.update(layouts, torch.linspace(0.1, 1.0, 4), done)
    assert envs.randomizer.levels.size > 0
    assert (envs.reset()[1]["layout"]["level"] >= 0).all()
    for seed in ([1, [2, 3]], None, "1"):
        with pytest.raises(ArgumentError, match="the same shape"):
            envs.randomizer.levels.insert({"seed": seed, "episode": [0]}, [0.5])
    with pytest.raises(ArgumentError, match=r"LevelSampler\.insert: .* got None, 'x', \[0\], \[0\.5\]\."):
        envs.randomizer.levels.insert({"seed": "x", "episode": [0]}, [0.5])
    with pytest.raises(ArgumentTypeError, match=r"^LevelSampler\.insert: unknown argument 'seed'\. Valid: layouts"):
        envs.randomizer.levels.insert(seed="x")
    with pytest.raises(ArgumentTypeError, match=r"^LevelSampler\.update: unknown argument 'score'\. Did you mean"):
        envs.randomizer.levels.update(ONE, score=[0.5])
    with pytest.raises(ArgumentError, match="the same shape"):
        envs.randomizer.levels.update(ONE, [0.5, 0.5])
    with pytest.raises(ArgumentError, match=r"shape \(n,\)"):
        envs.randomizer.levels.update({"level": np.int32(-1), "seed": 1, "episode": 0}, 0.5)
    for params in (np.ones(2), [1], 3):
        with pytest.raises(ScenirisError, match="params"):
            envs.randomizer.levels.update(ONE | {"params": params}, [0.5])
        with pytest.raises(ScenirisError, match="params"):
            envs.reset(options={"params": params})
    with pytest.raises(ArgumentTypeError, match=r"^SceneVectorEnv: curriculum should be a LevelReplay, an ADR"):
        make_env(2, curriculum="learnability")
    with pytest.raises(ArgumentError, match=r"^SceneVectorEnv: unknown split 'test'\. Valid: train, eval"):
        make_env(2, split="test")


def test_many_levels_are_inserted_at_once(make_env):  # noqa: F811
    """More than there are worlds: all of them while there is room, and they are drawn without a reset."""
    levels = make_env(2, curriculum=LevelReplay("custom", capacity=64)).randomizer.levels
    seeds = np.arange(50, dtype=np.uint64) + 7
    levels.insert({"seed": seeds, "episode": np.arange(50)}, np.linspace(0.5, 1.0, 50))
    kept = levels.state()
    assert sorted(kept["seed"][kept["age"] >= 0]) == seeds.tolist()
    assert (kept["seed"] == kept["episode"] + np.uint64(7))[kept["age"] >= 0].all()
    assert np.isin(levels.sample(20)["seed"], seeds).all()


def test_levels_of_no_episode_are_left_out(make_env):  # noqa: F811
    """Worlds would play the next episode of their seed in their place, under a wrong name."""
    levels = make_env(2, curriculum=LevelReplay("custom", capacity=8)).randomizer.levels
    levels.insert({"seed": np.array([5, 6, 7]), "episode": np.array([0, -1, 3])}, np.full(3, 0.5))
    kept = levels.state()
    assert sorted(kept["seed"][kept["age"] >= 0]) == [5, 7]


def test_scores_that_are_none_do_not_count(make_env):  # noqa: F811
    """Nor do episodes beyond the last; a state that is kept can be restored. Numbers in between are refused."""
    levels = make_env(2, curriculum=LevelReplay("custom", capacity=8)).randomizer.levels
    episodes = np.array([0, 0, 0, 0, 2**32 + 3])
    levels.insert({"seed": [1, 2, 3, 4, 5], "episode": episodes}, [0.5, np.nan, -1.0, np.inf, 0.5])
    kept = levels.state()
    assert kept["seed"][kept["age"] >= 0].tolist() == [1]
    levels.restore(kept)
    for seed, episode in (([1.5], [0]), ([1], [0.7])):
        with pytest.raises(ArgumentError, match="levels, seeds and episodes should be integers"):
            levels.insert({"seed": seed, "episode": episode}, [0.1])


def test_a_level_beyond_the_buffer_is_inserted(make_env):  # noqa: F811
    """No memory beyond the buffer is read."""
    levels = make_env(2, curriculum=LevelReplay("custom", capacity=64)).randomizer.levels
    levels.update({"level": [1 << 29], "seed": [3], "episode": [0]}, [1.0])
    assert levels.size == 1


OUTSIDE = {
    **{
        "vacant": (64, 10**8, -2),
        "level": (64,),
        "next_level": (10**8, -2),
        "boundary": (2, -2),
        "next_boundary": (10**6,),
    },
    **{
        "column": (10**6, -1),
        "other": (5,),
        "delta": (0.5,),
        "present": (5.0, np.nan),
        "inserted": (-1, 17, 2**31 - 1),
    },
    **{
        "age": (-(2**31),),
        "value": (np.nan, np.inf),
        "episode": (-5, 2**31 - 1),
        "next_episode": (-2, 2**31 - 1),
        "successes": (-1,),
    },
    **{"param": (0.5, np.nan), "next_param": (-1.0,), "base_param": (np.inf,), "cumulative": (-1,), "resets": (-1,)},
}


def test_a_state_with_a_number_out_of_range_is_refused(make_env):  # noqa: F811
    """By the array's name, before anything is written; so are other types, falling sums, and what is no array."""
    words = LevelReplay("failure", capacity=64, refresh_interval=1, adr=ADR({SLIDE: [0.1, 0.11]}))
    levels = make_env(4, curriculum=words).randomizer.levels
    levels.insert({"seed": np.arange(40), "episode": np.zeros(40, int)}, np.full(40, 0.5))
    before = levels.state()
    wrong = [(name, value) for name, values in OUTSIDE.items() for value in values]
    for name, value in wrong:
        array = before[name].copy()
        array[np.unravel_index(array.size - 1, array.shape)] = value
        with pytest.raises(ArgumentError, match=f"({SLIDE}|{name}'\\]) should be"):
            levels.restore(before | {name: array})
    for strange in (before["value"].astype(np.float64), before["value"].tolist(), None, 3):
        with pytest.raises(ArgumentError, match=r"value'\] should be float32 of shape \(64,\)"):
            levels.restore(before | {"value": strange})
    with pytest.raises(ArgumentError, match="cumulative'\\] should be from 7 to inf, got 5 at index 2"):
        levels.restore(before | {"cumulative": np.array([0, 7, 5, *[8] * 61], np.int32)})
    with pytest.raises(ArgumentTypeError, match="state should be a Mapping"):
        levels.restore([before])
    np.testing.assert_equal(levels.state(), before)
    levels.restore(before)


def test_a_state_of_another_scene_split_or_params_is_refused(make_env):  # noqa: F811
    """Its levels would be other layouts under the same seeds."""
    levels = make_env(4, curriculum=LEVELS, params=SLIDE).randomizer.levels
    for words in ({"split": "eval", "params": SLIDE}, {"params": ()}):
        other = make_env(4, curriculum=LEVELS, **words).randomizer.levels.state()
        with pytest.raises(SceneMismatchError, match=rf"\['{levels.layouts.compiled.hash}', 'train', '{SLIDE}'\]"):
            levels.restore(other)
    for source in (None, [["a"], ["b", "c"]], np.array(["0" * 16, "train", SLIDE])):
        with pytest.raises(SceneMismatchError, match="Pass the state of a sampler with this scene"):
            levels.restore(levels.state() | {"source": source})


def test_layouts_are_inserted_and_updated_by_their_ids(make_env):  # noqa: F811
    """One id or several, with their params; other layouts and other scenes are refused."""
    envs = make_env(2, curriculum=LevelReplay("custom", capacity=8), params=SLIDE)
    levels = envs.randomizer.levels
    envs.set_param(SLIDE, [0.1, 0.11])
    envs.reset(seed=2**63)
    ids = envs.layout_ids()
    levels.insert(ids, [0.25, 0.5])
    levels.update(ids[0].rpartition(":")[0], [1.0])
    kept, slide = levels.state(), np.array([0.1, 0.11], np.float32)
    assert kept["seed"][:3].tolist() == [2**63, 2**63 + 1, 2**63]
    assert kept["value"][:3].tolist() == [0.25, 0.5, 1.0]
    np.testing.assert_array_equal(kept["param"][:3], [slide, slide, levels.layouts.params.default])
    with pytest.raises(SceneMismatchError, match="scene"):
        levels.insert("0" * 16 + ids[0][16:], [0.5])
    with pytest.raises(ArgumentTypeError, match=r"LevelSampler.insert: layouts should be a layout id, .* or a mapping"):
        levels.insert(3, [0.5])
    with pytest.raises(ArgumentError, match=r"should have the keys 'seed' and 'episode', got \['seed'\]"):
        levels.update({"seed": [1]}, [0.5])
    assert levels.size == 3


@pytest.mark.parametrize(
    "worlds", [[False, False, True, True], torch.arange(4) > 1, [2, 3], slice(2, None), np.array([3, 2])]
)
def test_worlds_choose_the_rows_that_count(make_env, worlds):  # noqa: F811
    """As booleans, ids or a slice, where layouts and scores have a row for each world."""
    levels = make_env(4, curriculum=LevelReplay("custom", capacity=64)).randomizer.levels
    layouts = {"seed": np.arange(10, 14), "episode": np.zeros(4, int)}
    levels.update(layouts, np.full(4, 0.5), worlds)
    kept = levels.state()
    assert sorted(kept["seed"][kept["age"] >= 0]) == [12, 13]
    with pytest.raises(ArgumentError, match="a row for each of 4 worlds, got 1"):
        levels.update(ONE, [0.5], worlds)


def test_a_level_from_the_bank_is_not_inserted(make_env):  # noqa: F811
    """By the `level` of an info, whose other numbers do not matter to `insert`."""
    levels = make_env(3, curriculum=LevelReplay("custom", capacity=64)).randomizer.levels
    levels.insert({"level": [-2, -1, 40], "seed": [1, 2, 3], "episode": [0, 0, 0]}, [0.5, 0.5, 0.5])
    kept = levels.state()
    assert sorted(kept["seed"][kept["age"] >= 0]) == [2, 3]


@pytest.mark.parametrize(
    "curriculum", [LevelReplay("failure", adr=ADR({SLIDE: [0.1, 0.11]})), ADR({SLIDE: [0.1, 0.11]})]
)
def test_a_curriculum_survives_gymnasiums_json(make_env, curriculum):  # noqa: F811
    """EnvSpec's JSON has mappings for dataclasses."""
    spec = EnvSpec("Levels-v0", kwargs={"curriculum": curriculum})
    read = EnvSpec.from_json(spec.to_json()).kwargs["curriculum"]
    found, wanted = (make_env(2, curriculum=each).randomizer.levels for each in (read, curriculum))
    assert found.replay == wanted.replay
    assert found.ranges.keys() == {SLIDE}
