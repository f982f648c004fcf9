"""Arguments of `reset`: seeds, masks and options, and the worlds that it changes."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError, UnknownNameError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.levels import LevelReplay
from tests.vector.stepping import actions, assert_equal, state


@pytest.mark.parametrize("mask_type", [np.asarray, torch.as_tensor])
def test_a_masked_reset_changes_the_masked_worlds_alone(make_env, mask_type):
    """State and observation of the others keep their bits, in a reset with a seed too; options stay as they were."""
    envs = make_env(4, autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=10)
    for _ in range(3):
        observation, *_ = envs.step(actions(4))
    before = state(envs)
    mask = mask_type(np.array([True, False, True, False]))
    options = {"reset_mask": mask}
    for seed, seeds, episodes in ((None, [10, 11, 12, 13], [1, 0, 1, 0]), (50, [50, 11, 52, 13], [0, 0, 0, 0])):
        reset, info = envs.reset(seed=seed, options=options)
        assert_equal(state(envs), before, [1, 3])
        assert_equal(reset, observation, [1, 3])
        assert (reset["critic"][[0, 2]] != observation["critic"][[0, 2]]).any(dim=1).all()
        assert info["layout"]["seed"].tolist() == seeds
        assert info["layout"]["episode"].tolist() == episodes
    assert set(options) == {"reset_mask"}
    assert options["reset_mask"] is mask
    assert mask.tolist() == [True, False, True, False]


@pytest.mark.usefixtures("recorded")
def test_a_seed_gives_the_same_bits_whatever_is_beside_it(make_env):
    """Other numbers of worlds, orders of resets, and no graph: world by world the same observation."""
    envs, other = make_env(3), make_env(5, sim_config={"graph": False})
    envs.reset(seed=[7, 8, 9])
    first, _ = envs.reset()
    other.reset(seed=[1, 9, 2, 7, 8])
    for worlds in ([3], [1, 4], [0]):
        mask = np.zeros(5, bool)
        mask[worlds] = True
        second, _ = other.reset(options={"reset_mask": mask})
    for group in first:
        np.testing.assert_array_equal(first[group].numpy(), second[group][[3, 4, 1]].numpy())


def test_an_int_seed_starts_again_and_none_goes_on(make_env):
    """seed=s is s + i and episode 0, every time; without a seed the next episode comes."""
    envs = make_env(2)
    first, _ = envs.reset(seed=3)
    second, info = envs.reset()
    assert info["layout"]["seed"].tolist() == [3, 4]
    assert info["layout"]["episode"].tolist() == [1, 1]
    again, _ = envs.reset(seed=3)
    assert_equal(again, first)
    assert (second["critic"] != first["critic"]).any(dim=1).all()
    assert envs.np_random_seed == 3


def test_none_in_a_list_of_seeds_goes_on(make_env):
    """Only the worlds that are given a seed start again; in a first reset the others draw one."""
    envs = make_env(3)
    _, info = envs.reset(seed=[None, 5, None])
    drawn = info["layout"]["seed"].tolist()
    assert drawn[1] == 5
    assert len(set(drawn)) == 3
    _, info = envs.reset(seed=[6, None, None], options={"reset_mask": np.array([True, True, False])})
    assert info["layout"]["seed"].tolist() == [6, *drawn[1:]]
    assert info["layout"]["episode"].tolist() == [0, 1, 0]
    _, info = envs.reset(seed=[None] * 3)
    assert info["layout"]["episode"].tolist() == [1, 2, 1]


def test_a_large_seed_is_told_as_its_twos_complement(make_env):
    """Modulo 2^64 it is the seed again."""
    _, info = make_env(2).reset(seed=[2**64 - 1, 2**63])
    assert info["layout"]["seed"].tolist() == [-1, -(2**63)]
    assert [int(seed) % 2**64 for seed in info["layout"]["seed"]] == [2**64 - 1, 2**63]


def test_a_first_reset_without_a_seed_draws_one_and_records_it(make_env):
    """Two environments differ, and the recorded seed brings the layout back."""
    envs, other = make_env(2), make_env(2)
    first, info = envs.reset()
    different, _ = other.reset()
    assert (first["critic"] != different["critic"]).any()
    assert info["layout"]["seed"].tolist() == [envs.np_random_seed, envs.np_random_seed + 1]
    again, _ = other.reset(seed=envs.np_random_seed)
    assert_equal(again, first)


def test_the_evaluation_split_has_layouts_of_its_own(make_env):
    """The same seed is another layout in the other split."""
    train, _ = make_env(2).reset(seed=3)
    evaluation, _ = make_env(2, split="eval").reset(seed=3)
    assert (train["critic"] != evaluation["critic"]).any(dim=1).all()


@pytest.mark.parametrize(
    ("mask", "error", "kind"),
    [
        ([True, False], ArgumentTypeError, TypeError),
        (np.array([1, 0]), ArgumentTypeError, TypeError),
        (torch.tensor([1, 0]), ArgumentTypeError, TypeError),
        (np.array([True]), ArgumentError, ValueError),
        (np.array([[True, False]]), ArgumentError, ValueError),
        (np.array([False, False]), ArgumentError, ValueError),
    ],
)
def test_wrong_reset_masks_raise_what_gymnasium_raises(make_env, mask, error, kind):
    """The kind of error is that of Gymnasium's own vector environments, and nothing was reset."""
    envs = make_env(2)
    envs.reset(seed=0)
    before = state(envs)
    with pytest.raises(error, match="reset_mask") as caught:
        envs.reset(options={"reset_mask": mask})
    assert isinstance(caught.value, kind)
    assert_equal(state(envs), before)


def test_other_reset_options_are_refused(make_env):
    """A misspelt option would reset all worlds; no options are fine. Nothing is reset by the wrong ones."""
    envs = make_env(2)
    for options in (None, {}, {"reset_mask": None}):
        envs.reset(seed=0, options=options)
    before = state(envs)
    with pytest.raises(UnknownNameError, match=r"reset: unknown option 'mask'\. Did you mean 'reset_mask'"):
        envs.reset(options={"mask": np.array([True, False])})
    assert_equal(state(envs), before)


@pytest.mark.parametrize("seed", [-1, 1 << 64, 1.5, True, [1], [1, 2, 3], [1, -2], "1", [1, "2"], {1, 2}])
def test_wrong_seeds_are_refused(make_env, seed):
    """A seed is an integer of 64 bits, or one for each world."""
    with pytest.raises(ArgumentError, match=r"^seeds?(=| should|\[)"):
        make_env(2).reset(seed=seed)


@pytest.mark.parametrize("prefetch", [False, True])
def test_chosen_layouts_are_those_of_their_ids(make_env, prefetch):
    """By ids or by the numbers of an info, in the first reset or later; worlds go on from there, others as they would.

    Layouts are compared with those that a world reaches by itself.
    """
    plain, envs = make_env(3), make_env(3, sim_config={"prefetch": prefetch})
    plain.reset(seed=[7, 8, 9])
    wanted = [plain.reset() for _ in range(3)]
    ids = [envs.compiled.layout_id(seed, episode) for seed, episode in ((7, 1), (8, 3), (9, 2))]
    for _ in range(2):  # the first reset, and a later one
        found, info = envs.reset(options={"layouts": ids})
        for world, episode in enumerate((1, 3, 2)):
            assert_equal(found, wanted[episode - 1][0], [world])
        assert info["layout"]["seed"].tolist() == [7, 8, 9]
        assert info["layout"]["episode"].tolist() == [1, 3, 2]
    told = {"seed": info["layout"]["seed"], "episode": info["layout"]["episode"].numpy()}
    for layouts in (told, info["layout"]):
        again, _ = envs.reset(options={"layouts": layouts})
        assert_equal(again, found)
    found, info = envs.reset(options={"layouts": [None, ids[0], None], "reset_mask": np.array([True, True, False])})
    assert info["layout"]["seed"].tolist() == [7, 7, 9]
    assert info["layout"]["episode"].tolist() == [2, 1, 2]
    assert_equal(found, wanted[1][0], [0, 2])
    _, info = envs.reset(options={"layouts": ids[2]})
    assert info["layout"]["seed"].tolist() == [9, 9, 9]


@pytest.mark.parametrize("levels", [None, LevelReplay(replay_prob=0.0)])
def test_the_split_is_that_of_the_source_of_layouts(make_env, levels):
    """Ids name it, and give the layouts and the draws of an environment of that split again."""
    envs = make_env(2, layout_source=lambda compiled, n: LayoutGenerator(compiled, n, split="eval"), curriculum=levels)
    plain = make_env(2, split="eval")
    envs.reset(seed=3)
    ids = envs.layout_ids()
    assert [LayoutId.parse(text).split for text in ids] == ["eval", "eval"] == [envs.split] * 2
    assert_equal(envs.reset(options={"layouts": ids})[0], plain.reset(options={"layouts": ids})[0])
    with pytest.raises(SceneMismatchError, match="not 'eval'"):
        envs.reset(options={"layouts": envs.compiled.layout_id(3, 0)})


def test_a_reseed_shows_once_its_layout_is_served(make_env):
    """The episode that runs keeps its seed and its number in all infos, until the reset."""
    envs = make_env(2)
    envs.reset(seed=3)
    envs.randomizer.pipeline.reseed(layouts={"seed": [50, 60], "episode": 4})
    *_, info = envs.step(actions(2, ending=(1,)))
    assert info["final_info"]["layout"]["seed"].tolist() == [3, 4]
    assert info["final_info"]["layout"]["episode"].tolist() == [0, 0]
    assert info["layout"]["seed"].tolist() == [3, 60]
    assert info["layout"]["episode"].tolist() == [0, 4]


@pytest.mark.parametrize(
    ("layouts", "error", "match"),
    [
        (["a:train:0:0"] * 2, SceneMismatchError, "belongs to scene"),
        (LayoutId("a", "train", 0, 0), SceneMismatchError, "belongs to scene"),
        (["nonsense"] * 2, ArgumentError, "should be scenehash"),
        ([7, 8], ArgumentError, "a sequence of them"),
        ([None], ArgumentError, "a list of 2, one for each world, got a list of 1"),
        (3, ArgumentError, "a sequence of them"),
        ({"seed": 0}, ArgumentError, "keys 'seed' and 'episode'"),
        ({"seed": [0, 1, 2], "episode": 0}, ArgumentError, "a list of 2, one for each world, got a list of 3"),
        ({"seed": 0, "episode": -1}, ArgumentError, r"2\^31"),
    ],
)
def test_wrong_layouts_are_refused(make_env, layouts, error, match):
    """Ids of other scenes or of no scene, and not one for each world."""
    envs = make_env(2)
    with pytest.raises(error, match=match):
        envs.reset(options={"layouts": layouts})
    with pytest.raises(ArgumentError, match="one of seed"):
        envs.reset(seed=1, options={"layouts": [None, None]})
