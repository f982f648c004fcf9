"""Old names: each is refused by the name that replaces it, wherever users write names."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from copy import copy
from dataclasses import fields
from inspect import signature
from pathlib import Path
from typing import Any

import pytest

import sceniris_gym
from docs.make_surface import PAGE
from sceniris_gym import (
    ArmController,
    CompiledScene,
    ContactSensor,
    EpisodeResult,
    SceneConfig,
    SceneModel,
    SceneVectorEnv,
    cli,
    compile_scene,
    evaluate,
)
from sceniris_gym.commands.options import Evaluation
from sceniris_gym.config.relations import Connection
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.settings import as_config
from sceniris_gym.device.fixed import RefusesOldNames
from sceniris_gym.errors import (
    ArgumentTypeError,
    SceneKeyError,
    ScenirisError,
    UnknownNameError,
    did_you_mean,
    new_name,
    old_names,
)
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.wave.search import SearchSize
from sceniris_gym.levels import ADR, LevelReplay, LevelSampler
from sceniris_gym.levels.curriculum import SCORES
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.training.settings import Options
from sceniris_gym.vector.state import State

ROOT = Path(__file__).parents[1]
BESIDE = {"of": "table", "site": "end", "of_site": "end"}
ELSEWHERE = ("world", "scene", "pipeline", "libero", "errors", "narrow_pairs", "benchmarks", "python -m benchmarks")
ELSEWHERE += ("check --picture",)
"""Values, attributes of objects that tests here do not make, modules, programs, and options of another command."""
NOT_REFUSED = {
    "an entry of a dict, a value or a placeholder": """layout_knobs layout_seed layout_episode layout_fallback
        layout_level layout_start layout_variants layout_redraw layout_kept verified fallback_share roof panda N
        lambda stages""",
    "a module or a program that is gone": "randomizer tools dataset reader train_rsl_rl judging write_dataset",
    "of another library, or in a place where its class is gone": "make_data level serve",
    "an attribute that is now a tensor": "kept",
    "a constant of a module that is not public": "TURN_STEP TURN_LEAD TURN_LIMIT",
}
"""Words of the changelog's old names that nothing can refuse, by the reason."""
KEYWORDS: dict[str, tuple[Callable[..., Any], str, str]] = {
    "an environment": (SceneVectorEnv, "knobs", "params"),
    "its curriculum": (SceneVectorEnv, "levels", "curriculum"),
    "a snapshot": (SceneVectorEnv.snapshot, "mask", "worlds"),
    "a randomizer": (ResetRandomizer, "write", "scope"),
    "a reset": (ResetRandomizer.reset, "env_ids", "worlds"),
    "a reset by seeds": (ResetRandomizer.reset, "seeds", "seed"),
    "a reset by episodes": (ResetRandomizer.reset, "episodes", "layouts"),
    "a generator": (LayoutGenerator, "knobs", "params"),
    "layouts": (LayoutGenerator.generate, "mask", "worlds"),
    "other layouts": (LayoutGenerator.reseed, "seeds", "seed"),
    "an evaluation": (evaluate, "ids", "layouts"),
    "a contact sensor": (ContactSensor, "first", "primary"),
    "its other bodies": (ContactSensor, "second", "secondary"),
    "a controller": (ArmController.move_tool, "turns", "yaw_range"),
    "a replay": (LevelReplay, "replay", "replay_prob"),
    "intervals": (ADR, "start", "init_range"),
    "a source of an environment": (SceneVectorEnv, "generator", "layout_source"),
    "a search": (LayoutGenerator, "block_dim", "size"),
    "its queue": (SearchSize, "leaves", "narrow_pairs"),
    "a bank": (compile_scene, "bank_size", "overrides.bank"),
}
ATTRIBUTES: dict[str, tuple[type, str, str]] = {
    "an environment": (SceneVectorEnv, "replace", "redraw"),
    "params of an environment": (SceneVectorEnv, "set_knob", "set_param"),
    "a randomizer": (ResetRandomizer, "PROMISED", "STATE_FIELDS"),
    "a generator": (LayoutGenerator, "extend", "redraw"),
    "params of a generator": (LayoutGenerator, "set_knobs", "set_params"),
    "params of a source": (LayoutGenerator, "launch_set_knobs", "launch_set_params"),
    "a task's reading": (State, "parameter", "randomized"),
    "a compiled scene": (CompiledScene, "bank_size", "bank"),
    "a model of a scene": (SceneModel, "support_body", "support"),
}


@pytest.mark.parametrize(("function", "old", "new"), KEYWORDS.values(), ids=KEYWORDS.keys())
def test_an_old_keyword_is_refused_by_its_new_name(function: Callable[..., Any], old: str, new: str):
    """Constructors, methods and functions of the door."""
    valid = new.partition(".")[0]
    with pytest.raises(
        UnknownNameError, match=f"unknown argument '{old}'. '{old}' is now {new}. Valid: .*{valid}"
    ) as no:
        function(**{old: None})
    assert "self" not in no.value.valid


@pytest.mark.parametrize(("kind", "old", "new"), ATTRIBUTES.values(), ids=ATTRIBUTES.keys())
def test_an_old_attribute_is_refused_by_its_new_name(kind: type, old: str, new: str):
    """`hasattr` is still false."""
    thing = object.__new__(kind)
    vars(thing).setdefault(new, None)
    with pytest.raises(AttributeError, match=f"^{kind.__name__}: '{old}' is now {new}"):
        getattr(thing, old)
    assert not hasattr(thing, old)


@pytest.mark.parametrize(
    ("old", "new"),
    [("set_knob", "set_param"), ("set_knobs", "set_param"), ("set_params", "set_param"), ("ids", "layout_ids")],
)
def test_what_sets_params_of_a_randomizer_has_the_name_of_an_environment_s(old: str, new: str):
    """The same for ids."""
    randomizer = object.__new__(ResetRandomizer)
    randomizer.pipeline = None  # pyrefly: ignore[bad-assignment]
    with pytest.raises(AttributeError, match=f"^ResetRandomizer: '{old}' is now {new}"):
        getattr(randomizer, old)


def test_a_result_of_an_episode_refuses_an_old_name():
    """It can still be copied, compared and pickled."""
    result = EpisodeResult("id", True, True, 1.0, 3, False)
    with pytest.raises(AttributeError, match=r"^EpisodeResult: 'success_ever' is now success_once"):
        result.success_ever  # pyrefly: ignore[missing-attribute]  # noqa: B018
    assert pickle.loads(pickle.dumps(result)) == copy(result) == result


def test_other_attributes_fail_as_ever():
    """With Python's own message, and with the error of a property that has one."""

    class Thing(RefusesOldNames):
        @property
        def broken(self) -> int:
            raise AttributeError("the bearing is worn")

    with pytest.raises(AttributeError, match="'Thing' object has no attribute 'knobs'"):
        Thing().knobs  # pyrefly: ignore[missing-attribute]  # noqa: B018
    with pytest.raises(AttributeError, match="the bearing is worn"):
        Thing().broken  # noqa: B018


def test_an_old_public_name_is_refused_by_its_new_one():
    """As an attribute and in an import. Modules are still found, and unknown names still are not."""
    with pytest.raises(ImportError, match="sceniris_gym: 'place_on' is now edit_spec"):
        sceniris_gym.place_on  # pyrefly: ignore[missing-attribute]  # noqa: B018
    with pytest.raises(ImportError, match="sceniris_gym: 'Touch' is now ContactSensor"):
        from sceniris_gym import Touch  # pyrefly: ignore[missing-module-attribute]  # noqa: F401
    with pytest.raises(ImportError, match=r"sceniris_gym: 'read_bddl' is now libero\.read_bddl"):
        from sceniris_gym import read_bddl  # pyrefly: ignore[missing-module-attribute]  # noqa: F401
    with pytest.raises(ImportError, match=r"sceniris_gym: 'LiberoGoal' is now libero\.LiberoGoal"):
        from sceniris_gym import LiberoGoal  # pyrefly: ignore[missing-module-attribute]  # noqa: F401
    with pytest.raises(ImportError, match="sceniris_gym: 'Status' is now LayoutStatus"):
        from sceniris_gym import Status  # pyrefly: ignore[missing-module-attribute]  # noqa: F401
    from sceniris_gym import levels

    assert levels.LevelReplay is LevelReplay
    assert not hasattr(sceniris_gym, "knobs")


CONFIGS: dict[str, tuple[type, dict[str, Any], str]] = {
    "replay": (LevelReplay, {"replay": 0.5}, "'replay' is now replay_prob"),
    "a score": (LevelReplay, {"score": "given"}, "'given' is now custom"),
    "ADR": (ADR, {"start": {}}, "'start' is now init_range"),
    "its queue": (ADR, {"episodes": 3}, "'episodes' is now queue_length"),
}


@pytest.mark.parametrize(("kind", "given", "says"), CONFIGS.values(), ids=CONFIGS.keys())
def test_an_old_setting_is_refused_by_its_new_name(kind: type, given: dict[str, Any], says: str):
    """Fields of a mapping, and words that are values."""
    with pytest.raises(ScenirisError, match=says):
        as_config(kind, given, "curriculum")


@pytest.mark.parametrize(("old", "new"), [("my", "site"), ("its", "of_site"), ("turn", "angle")])
def test_an_old_word_of_a_connection_is_refused_by_its_new_name(old: str, new: str):
    """By its path in the scene."""
    table = {"asset": "table", "kind": "fixture", "on": "floor"}
    objects = {"table": table, "shelf": {**table, "relations": [{"beside": {**BESIDE, old: "end"}}]}}
    says = rf"objects\.shelf\.relations\.0\.beside\.{old}: unknown key. '{old}' is now {new}."
    with pytest.raises(SceneKeyError, match=says):
        SceneConfig.load({"floor": {"size": [2, 2]}, "objects": objects})


@pytest.mark.parametrize("key", ["robot", "robots.left"])
def test_a_robot_s_model_is_refused_by_the_word_asset(key: str):
    """Also in an override of a scene that has an asset. The word `model` of a scene stays."""
    panda = {"asset": "panda"}
    robot = {"robot": panda} if key == "robot" else {"robots": {"left": panda}}
    with pytest.raises(SceneKeyError, match=rf"{key}\.model: unknown key. 'model' is now asset."):
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {}, **robot}, {f"{key}.model": "arm.xml"})
    assert new_name("model", SceneConfig.model_fields) == ""


MODULES = [
    ("errors", "HeapError", "SceneKeyError"),
    ("errors", "AttemptsWarning", "FallbackWarning"),
    ("levels", "Levels", "LevelReplay"),
    ("training", "judges_of", "load_policy"),
    ("adapters.rsl_rl", "RslRlVecEnv", "RslRlVecEnvWrapper"),
    ("adapters.sb3", "SB3VecEnv", "Sb3VecEnvWrapper"),
    ("adapters.jax", "fresh_training", "wrap_for_brax_training"),
    ("adapters.mjlab", "knob_stages", "scene_param_stages"),
]


@pytest.mark.parametrize(("name", "old", "new"), MODULES)
def test_an_old_name_of_a_module_is_refused_by_its_new_one(name: str, old: str, new: str):
    """Adapters, errors, levels and trainings. An unknown name fails as ever."""
    module = pytest.importorskip(f"sceniris_gym.{name}", exc_type=ImportError)
    with pytest.raises(ImportError, match=rf"sceniris_gym\.{name}: '{old}' is now {new}\."):
        getattr(module, old)
    assert not hasattr(module, "nonsense")


def test_an_error_at_the_door_is_refused_by_its_module():
    """Old names, too."""
    with pytest.raises(ImportError, match=r"sceniris_gym: 'MeshError' is now errors\.MeshError"):
        from sceniris_gym import MeshError  # pyrefly: ignore[missing-module-attribute]  # noqa: F401
    with pytest.raises(ImportError, match=r"sceniris_gym: 'SeedError' is now errors\.ArgumentError"):
        from sceniris_gym import SeedError  # pyrefly: ignore[missing-module-attribute]  # noqa: F401


@pytest.mark.parametrize("name", [name for name in old_names() if " " in name])
def test_an_old_option_of_a_command_is_refused_by_its_new_name(name: str, capfd: pytest.CaptureFixture):
    """Before anything else of the command is read."""
    command, option = name.split()
    with pytest.raises(SystemExit) as stop:
        cli.main([command, f"{option}=5"])
    assert stop.value.code == 2
    assert f"error: {command}: '{option}' is now {old_names()[name]}." in capfd.readouterr().err


@pytest.mark.parametrize("arguments", [(3,), (3, 0.0, 1.0)])
def test_random_numbers_without_a_name_are_refused_by_uniform(arguments: tuple[float, ...]):
    """A name is a string."""
    with pytest.raises(ArgumentTypeError, match=r"name should be a string, got 3\. Call uniform\(n, low, high\)"):
        object.__new__(State).random(*arguments)  # pyrefly: ignore[bad-argument-type]


def test_the_old_names_of_the_changelog_are_refused():
    """Each word of an old name is refused, or still a word of the face, or has a reason."""
    rows = re.findall(r"^\| (.+) \| (.+) \|$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1:]
    known = " ".join([*old_names(), *NOT_REFUSED.values(), PAGE.read_text(), (ROOT / "docs/commands.md").read_text()])
    left = {
        word
        for old, new in rows
        for code in re.findall(r"`([^`]+)`", old)
        for word in re.findall(r"\w+", code)
        if word not in re.findall(r"\w+", f"{new} {known}")
    }
    assert left == set()


def test_every_new_name_is_there():
    """Each is a public name, an argument, a field or a word of scene files."""
    arguments = {
        name
        for function in (*(function for function, _, _ in KEYWORDS.values()), LayoutGenerator.redraw)
        for name in signature(function).parameters
    }
    attributes = {name for kind in (*(kind for kind, _, _ in ATTRIBUTES.values()), LevelSampler) for name in dir(kind)}
    known = arguments | attributes | {*sceniris_gym.__all__, *SCORES, *ELSEWHERE}
    known |= {field.name for kind in (LevelReplay, ADR, EpisodeResult) for field in fields(kind)}
    known |= {*Connection.model_fields, *RobotConfig.model_fields, *re.findall(r"\w+", PAGE.read_text())}
    options = {"set", *(field.name for kind in (Options, Evaluation) for field in fields(kind))}
    options |= {name for command in cli.COMMANDS.values() for name in signature(command).parameters}
    known |= {f"--{name.replace('_', '-')}" for name in options}
    news = {new.partition(".")[0] for names in old_names().values() for new in names.split("|")}
    assert news <= known
    assert not {old for old in old_names() if new_name(old, [old])}


def test_an_old_name_comes_before_one_that_looks_alike():
    """The nearest name is still the guess, if the new name is not valid."""
    assert did_you_mean("nconmax", ["nconmix", "sim_config"]) == " 'nconmax' is now sim_config.nconmax."
    assert did_you_mean("nconmax", ["nconmix"]) == " Did you mean 'nconmix'?"
