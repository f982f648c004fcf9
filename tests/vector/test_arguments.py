"""Arguments of an environment: tasks, scenes, sizes, seeds, masks and actions."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, FixedError, UnknownNameError
from sceniris_gym.layout.masks import as_count
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.arguments import (
    as_action,
    as_autoreset_mode,
    as_compiled_scene,
    as_groups,
    as_reset_mask,
    as_reset_seeds,
    as_task,
    fresh_seed,
    fresh_seeds,
)
from sceniris_gym.vector.ranks import Rank
from sceniris_gym.vector.settings import as_size
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach
from tests.vector.stepping import assert_equal

CPU = torch.device("cpu")
SLIDE = "objects.cabinet.joints.slide"
SPACE = Box(-1.0, 1.0, (2, 3), np.float32)


def test_a_task_is_given_as_itself_as_its_class_or_by_name():
    """The object stays the same one; of a class and of a name a new one is made each time."""
    task = Reach()
    assert as_task(task) is task
    for given in (Reach, "tests.vector.conftest:Reach"):
        assert type(as_task(given)).__name__ == "Reach"
        assert as_task(given) is not as_task(given)


@pytest.mark.parametrize("given", [3, None, dict, SCENE])
def test_what_is_no_task_is_refused(given: Any):
    """The message says what it can be."""
    with pytest.raises(TypeError, match="Task, its class, or 'module:Class'"):
        as_task(given)


def test_a_finished_scene_is_taken_as_it_is(reach_scene: CompiledScene):
    """It cannot be changed any more, nor go to another device; a scene that is given as words can."""
    assert as_compiled_scene(reach_scene, None, None) is reach_scene
    assert as_compiled_scene(reach_scene, {}, "cpu") is reach_scene
    with pytest.raises(ValueError, match="CompiledScene"):
        as_compiled_scene(reach_scene, {"objects.block.clearance": 0.02}, None)
    made = as_compiled_scene(SCENE, {"objects.block.clearance": 0.02}, "cpu")
    assert made.config.objects["block"].clearance == 0.02
    assert made.hash != reach_scene.hash


@pytest.mark.parametrize("given", [7, np.int8(7), np.uint64(7), torch.tensor(7)])
def test_a_count_is_an_integer_of_any_library(given: Any):
    """As an int of Python's own."""
    assert as_count(given, "number") == 7
    assert type(as_count(given, "number")) is int


@pytest.mark.parametrize("given", [0, -1, 1.0, "3", None, True, np.float32(2), [4], torch.tensor(1.5)])
def test_what_is_no_count_is_refused(given: Any):
    """By the name that it has for the user."""
    with pytest.raises(ValueError, match="number should be an integer of at least 1"):
        as_count(given, "number")


def test_a_size_is_two_counts():
    """Of any sequence; a wrong one is named by its place."""
    for given in ((4, 3), [4, 3], np.array([4, 3]), torch.tensor([4, 3])):
        assert as_size(given, "size") == (4, 3)
    for given, words in (((4, 0), r"size\[1\]"), ((4.5, 3), r"size\[0\]"), (4, "width, height"), ((1, 2, 3), "height")):
        with pytest.raises(ValueError, match=words):
            as_size(given, "size")


def test_observation_groups_are_named_one_by_one_or_as_the_only_one():
    """In any sequence, in its order; a word is a group and not its letters."""
    assert as_groups(None) is None
    assert as_groups("policy") == as_groups(["policy"]) == ("policy",)
    assert as_groups(("critic", "policy")) == ("critic", "policy")


@pytest.mark.parametrize("given", [(), [], 3, {"policy"}, [3], ["policy", None], ("policy", ["critic"])])
def test_what_names_no_observation_group_is_refused(given: Any):
    """Without a group nothing would be observed."""
    with pytest.raises(ArgumentError, match=r"observation_groups should be names .*, such as \('policy',\), got"):
        as_groups(given)


def seeds(given: Any, *, first: bool = False) -> tuple[list[int], list[bool]]:
    """Return the seeds of three worlds, and which of them are given one."""
    found = as_reset_seeds(given, 3, Rank(), first=first)
    assert found is not None
    assert (found[0].dtype, found[1].dtype) == (np.uint64, bool)
    return found[0].tolist(), found[1].tolist()


@pytest.mark.parametrize("first", [True, False])
def test_seeds_without_none_are_for_all_worlds(first: bool):
    """One integer counts up, many are taken as they are; without any there is nothing to give."""
    for given in (5, np.uint8(5), [5, 6, 7], (5, 6, 7), np.array([5, 6, 7], np.int16), range(5, 8)):
        assert seeds(given, first=first) == ([5, 6, 7], [True, True, True])
    assert as_reset_seeds(None, 3, Rank(), first=first) is None


def test_none_among_seeds_goes_on():
    """Those worlds are not given one, be the others as large as they may."""
    found, given = seeds([None, 2**64 - 1, None])
    assert given == [False, True, False]
    assert found[1] == 2**64 - 1
    assert seeds((None, None, None))[1] == [False, False, False]


def test_none_among_the_first_seeds_draws_one():
    """All worlds are given one, and no two draws are alike."""
    found = [seeds([None, 4, None], first=True) for _ in range(20)]
    assert all(given == [True, True, True] for _, given in found)
    assert {numbers[1] for numbers, _ in found} == {4}
    assert len({number for numbers, _ in found for number in (numbers[0], numbers[2])}) == 40


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([None, -1, 3], r"seed\[1\]=-1"),
        ([None, 2**64, 3], r"seed\[1\]=18446744073709551616"),
        ((4, None, 1.5), r"seed\[2\]=1\.5"),
        ([None, None, True], r"seed\[2\]=True"),
        ([None, 4], "sequence of 3"),
        ([None] * 4, "sequence of 3"),
        ([1, 2], "sequence of 3"),
        (True, "seed=True"),
        (1.0, "one integer"),
    ],
)
def test_a_wrong_seed_is_named_by_its_place(given: Any, words: str):
    """Also beside those that are None."""
    for first in (True, False):
        with pytest.raises(ArgumentError, match=words):
            as_reset_seeds(given, 3, Rank(), first=first)


@pytest.mark.parametrize(
    "make",
    [
        np.array,
        torch.tensor,
        lambda values: wp.array(values, dtype=wp.bool, device="cpu"),
        lambda values: np.array([[v, True] for v in values])[:, 0],
        lambda values: np.array(values[::-1])[::-1],
        lambda values: np.frombuffer(bytes(values), dtype=bool),
    ],
    ids=["numpy", "torch", "warp", "numpy view", "numpy backwards", "numpy read-only"],
)
def test_a_reset_mask_of_any_library_is_an_array_afterwards(make):
    """With the same worlds; the options, and the mask in them, stay as they were."""
    values = [True, False, False, True]
    options = {"reset_mask": make(values)}
    kept = options["reset_mask"]
    found = as_reset_mask(options, 4)
    assert isinstance(found, np.ndarray)
    assert (found.dtype, found.tolist()) == (bool, values)
    found[:] = True
    assert list(options) == ["reset_mask"]
    assert options["reset_mask"] is kept
    assert np.asarray(kept.numpy() if hasattr(kept, "numpy") else kept).tolist() == values


@pytest.mark.parametrize("options", [None, {}, {"reset_mask": None}])
def test_without_a_reset_mask_all_worlds_are_meant(options: dict | None):
    """None says so, without a mask that is true everywhere."""
    assert as_reset_mask(options, 4) is None


@pytest.mark.parametrize(
    ("mask", "error", "words"),
    [
        ([True, False], ArgumentTypeError, "boolean array of numpy"),
        (np.array([1, 0]), ArgumentTypeError, "int64"),
        (torch.tensor([0.5, 0.0]), ArgumentTypeError, "float32"),
        (wp.ones(2, dtype=wp.int32, device="cpu"), ArgumentTypeError, "int32"),
        (np.ones(3, bool), ArgumentError, r"shape \(2,\).* \(3,\)"),
        (torch.ones(2, 1, dtype=torch.bool), ArgumentError, r"shape \(2,\).* \(2, 1\)"),
        (wp.ones(3, dtype=wp.bool, device="cpu"), ArgumentError, r"shape \(2,\).* \(3,\)"),
        (np.zeros(2, bool), ArgumentError, "at least one world"),
        (torch.zeros(2, dtype=torch.bool), ArgumentError, "at least one world"),
        (wp.zeros(2, dtype=wp.bool, device="cpu"), ArgumentError, "at least one world"),
    ],
)
def test_a_wrong_reset_mask_is_named_as_the_option_that_it_is(mask: Any, error: type[Exception], words: str):
    """Of all libraries: type, shape, and one that would reset nothing."""
    with pytest.raises(error, match=rf"options\['reset_mask'\].*{words}"):
        as_reset_mask({"reset_mask": mask}, 2)


def test_another_option_is_refused():
    """With the one that there is, even where that one is right."""
    names: tuple[Any, ...] = ("mask", 3)
    for name in names:
        with pytest.raises(UnknownNameError, match=f"reset: unknown option '{name}'.*reset_mask"):
            as_reset_mask({"reset_mask": np.ones(2, bool), name: 1}, 2)


@pytest.mark.parametrize("options", [5, 0, "reset_mask", [("reset_mask", None)], np.ones(2, bool)])
def test_options_that_are_no_mapping_are_refused(options: Any):
    """A mask by itself too, with how it is given; a number was a TypeError."""
    with pytest.raises(ArgumentTypeError, match=r"reset: options should be \{'reset_mask': mask\} or None, got"):
        as_reset_mask(options, 2)


def test_drawn_seeds_leave_room_to_count_up():
    """They differ, and with a world's number added they are still below 2^63, so that torch can hold them."""
    drawn = fresh_seeds(1000)
    assert (drawn.dtype, drawn.shape) == (np.uint64, (1000,))
    assert len(set(drawn.tolist())) == 1000
    assert 2**61 < drawn.max() < 2**62
    assert len({fresh_seed() for _ in range(10)}) == 10


def test_an_action_that_is_not_a_number_is_none():
    """It is taken as 0, so that it cannot stay in the controls; infinite ones are cut off like all others."""
    action = as_action([[np.nan, 0.5, np.inf], [-np.inf, 2.0, -0.25]], SPACE, CPU)
    assert action.tolist() == [[0.0, 0.5, 1.0], [-1.0, 1.0, -0.25]]


@pytest.mark.parametrize("shape", [(3,), (3, 2), (1, 3), (2, 3, 1)])
def test_actions_of_another_shape_are_refused(shape: tuple[int, ...]):
    """One row a world; both shapes are named."""
    with pytest.raises(ValueError, match=r"actions .*\(2, 3\)"):
        as_action(np.zeros(shape), SPACE, CPU)


def test_actions_of_a_policy_leave_their_gradients_outside(make_env):
    """Nothing that a step returns or keeps has a history, and the policy's gradient is not touched."""
    envs = make_env(2)
    observation, _ = envs.reset(seed=0)
    policy = torch.nn.Linear(19, 5)
    for _ in range(2):
        observation, reward, *_, info = envs.step(policy(observation["policy"]))
    kept = [envs.state.ctrl, envs.statistics.sums(), *info["reward_terms"].values()]
    assert not any(tensor.requires_grad for tensor in [*observation.values(), reward, *kept])
    assert policy.weight.grad is None


@pytest.mark.parametrize("value", ["sometimes", None, 5])
def test_what_is_no_autoreset_mode_is_refused(value: Any):
    """With those that there are."""
    assert as_autoreset_mode("Disabled") is as_autoreset_mode(AutoresetMode.DISABLED)
    with pytest.raises(ArgumentError, match=r"autoreset_mode should be one of NextStep, SameStep, Disabled"):
        as_autoreset_mode(value)


@pytest.mark.parametrize("actions", [None, "up", [[1, 2], [3]], [[10**400]], torch.ones(2, 3).to_sparse(), object()])
def test_what_are_no_actions_is_refused_in_our_words(actions: Any):
    """Whatever torch says of it."""
    with pytest.raises(ArgumentError, match="actions should"):
        as_action(actions, SPACE, CPU)


@pytest.mark.parametrize(
    "actions",
    [np.full((2, 3), 1j), np.zeros((2, 3), np.complex64), torch.ones(2, 3, dtype=torch.complex64), [[1, 2, 3j]] * 2],
)
def test_actions_of_complex_numbers_are_refused(actions: Any):
    """Their imaginary part was lost without a word."""
    with pytest.raises(ArgumentError, match="actions should be real numbers"):
        as_action(actions, SPACE, CPU)


@pytest.mark.parametrize("kind", [bool, np.int8, np.uint8, np.int64, np.float16, np.float64])
def test_actions_of_any_real_type_are_taken(kind: type):
    """As single precision."""
    action = as_action(np.ones((2, 3), kind), SPACE, CPU)
    assert action.dtype == torch.float32
    assert action.tolist() == [[1.0] * 3] * 2


@pytest.mark.parametrize("task", ["nowhere:Class", "json:Nothing", ":", ""])
def test_a_task_that_cannot_be_imported_is_refused(task: str):
    """By what Python says."""
    with pytest.raises(ArgumentError, match="should be an importable class, as 'module:Class'"):
        as_task(task)


WRONG_CALLS = {
    "task": (FixedError, "task", lambda envs: envs.set_attr("task", {})),
    "autoreset_mode": (FixedError, "autoreset_mode", lambda envs: envs.set_attr("autoreset_mode", {})),
    "steps": (ArgumentError, "max_episode_steps should be", lambda envs: envs.set_attr("max_episode_steps", {})),
    "method": (UnknownNameError, "unknown attribute 'reset'", lambda envs: envs.set_attr("reset", 3)),
    "built in": (UnknownNameError, "unknown attribute '__class__'", lambda envs: envs.set_attr("__class__", int)),
    "attribute": (ArgumentTypeError, "set_attr: name", lambda envs: envs.set_attr(3, 4)),
    "unknown": (UnknownNameError, "max_episode_steps", lambda envs: envs.set_attr("nope", 1)),
    "space": (UnknownNameError, "observation_space", lambda envs: envs.set_attr("observation_space", 1)),
    "masked": (
        ArgumentError,
        SLIDE,
        lambda envs: envs.set_param(SLIDE, np.ma.array([0.05, 0.06], mask=np.array([True, False]))),
    ),
    "nested": (ArgumentError, "dense", lambda envs: envs.step(torch.nested.nested_tensor([torch.zeros(5)] * 2))),
    "id of a number": (ArgumentTypeError, "an integer", lambda envs: envs.compiled.layout_id("x", 0)),
    "id of a half": (ArgumentTypeError, "an integer", lambda envs: envs.compiled.layout_id(1.5, 0)),
    "id of nothing": (ArgumentTypeError, "an integer", lambda envs: envs.compiled.layout_id(3, None)),
    "id of a param": (
        ArgumentError,
        rf"options\['layouts'\].*:train:0:0:{SLIDE}=.*{SLIDE} should be",
        lambda envs: _reset_to(envs, f"{envs.compiled.hash}:train:0:0:{SLIDE}={'41000000' * 2}"),
    ),
    "param": (ArgumentTypeError, "set_param: name", lambda envs: envs.set_param([SLIDE], [0.05, 0.06])),
    "value": (ArgumentError, SLIDE, lambda envs: envs.set_param(SLIDE, 10**400)),
    "ragged": (ArgumentError, SLIDE, lambda envs: envs.set_param(SLIDE, [[0.05], [0.05, 0.06]])),
    "rows": (
        ArgumentError,
        SLIDE,
        lambda envs: _reset_to(envs, {"seed": 0, "episode": 0, "params": {SLIDE: [[1], [1, 2]]}}),
    ),
    "nan": (
        ArgumentError,
        SLIDE,
        lambda envs: _reset_to(envs, {"seed": 0, "episode": 0, "params": {SLIDE: np.full((2, 2), np.nan)}}),
    ),
    "redraw": (ArgumentTypeError, "objects should be one name", lambda envs: envs.redraw(3)),
    "name": (ArgumentTypeError, "random: name should be a str", lambda envs: envs.randomizer.random(3, 3)),
    "shape": (ArgumentError, "random: shape", lambda envs: envs.randomizer.random("a", (10**6, 10**6))),
    "number": (ArgumentError, "uniform: n should be", lambda envs: envs.state.uniform(-1)),
    "stream": (ArgumentError, "stream should be", lambda envs: envs.state.uniform(1, stream="a")),
    "info": (ArgumentError, "layout_ids: info", lambda envs: envs.layout_ids({})),
    "episodes": (ArgumentError, r"\['episode'\]", lambda envs: _reset_to(envs, {"seed": 0, "episode": [[1], [1, 2]]})),
    "last": (ArgumentError, r"2\^31 - 2", lambda envs: _reset_to(envs, {"seed": 0, "episode": 2**31 - 1})),
    "id": (
        ArgumentError,
        r"below 2\^31 - 1",
        lambda envs: _reset_to(envs, f"{envs.compiled.hash}:train:0:{2**31 - 1}"),
    ),
    "meta": (ArgumentError, "seed", lambda envs: _reset_to(envs, {"seed": torch.ones(2, device="meta"), "episode": 0})),
}


def _reset_to(envs: SceneVectorEnv, layouts: Any) -> None:
    envs.reset(options={"layouts": layouts})


def test_calls_with_anything_end_in_errors_of_the_package(make_env):
    """Of methods of an environment and its randomizer; the environment goes on as if nothing had been called."""
    envs, plain = make_env(2, params=SLIDE), make_env(2, params=SLIDE)
    for each in (envs, plain):
        each.reset(seed=0)
    for name, (error, match, call) in WRONG_CALLS.items():
        try:
            call(envs)
        except error as told:
            assert re.search(match, str(told)), name  # noqa: PT017, as the name is of use
        else:
            pytest.fail(name)
    assert_equal(envs.step(torch.zeros(2, 5))[0], plain.step(torch.zeros(2, 5))[0])


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ({"sim_config": {"nconmax": -1}}, ArgumentError),
        ({"sim_config": {"nconmax": 10**10}}, ArgumentError),
        ({"sim_config": {"njmax": 10**10}}, ArgumentError),
        ({"sim_config": {"nconmax": 1.5}}, ArgumentError),
        ({"sim_config": {"nvmax": -1}}, ArgumentError),
        ({"sim_config": {"nvmax": "all"}}, ArgumentError),
        *(({word: 10**5000}, (ArgumentTypeError, ArgumentError)) for word in ("layout_source", "sensing", "output")),
        ({"overrides": 3}, ArgumentError),
    ],
    ids=lambda given: next(iter(given)) if isinstance(given, dict) else "",
)
def test_environments_refuse_wrong_arguments_by_name(make_env, words: dict[str, Any], error: Any):
    """Rather than by an error of MuJoCo-Warp, Warp or Python."""
    name = next(iter(words.get("sim_config", words)))
    with pytest.raises(error, match=name):
        make_env(2, **words)
