"""Errors: what their messages say, what of them can be asked for, and that they survive pickling and copying."""

from __future__ import annotations

import copy
import inspect
import pickle
import re
from pathlib import Path

import pytest

from sceniris_gym import errors
from sceniris_gym.errors import (
    ContactBudgetError,
    FallbackWarning,
    FixedError,
    GraspError,
    InfeasibleSceneError,
    MeshError,
    MissingExtraError,
    OutputError,
    ScenirisError,
    UnknownNameError,
    did_you_mean,
    in_a_cycle,
)

CLASSES = [
    kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, (ScenirisError, UserWarning))
]
EXAMPLES: dict[type, Exception] = {
    type(error): error
    for error in (
        UnknownNameError("body", "lid", "scene.yaml: objects.can.on", ["pot/lid", "pan"]),
        in_a_cycle("scene.yaml", ["a", "b"], "objects are placed relative to each other"),
        GraspError("scene.yaml: objects.can.reachable: it is too wide.", 0.1, 0.08),
        InfeasibleSceneError("it is full.", "scene.yaml", "apple", "collision", {"can": {"collision": 0}}, {"a": "b"}),
        ContactBudgetError("nconmax", 40, 57),
        FixedError("SceneVectorEnv", "compiled"),
        OutputError("/out/a.png", "no space left on device"),
        MissingExtraError("stable-baselines3", "sb3"),
        FallbackWarning("scene.yaml: Write 'restarts' above 8.", 0.45, "can", "blocked", (4, 64)),
        MeshError("scan.stl: it is flat.", "flat"),
    )
}


def test_there_are_at_most_25_classes_all_in_one_module():
    """One for each thing that a caller can do about it; users find them in one place."""
    assert 20 < len(CLASSES) <= 25
    assert {kind.__module__ for kind in CLASSES} == {"sceniris_gym.errors"}
    elsewhere = re.compile(r"^class [A-Za-z]\w*(Error|Warning)\b", re.MULTILINE)
    package = Path(str(errors.__file__)).parent
    assert not [p for p in package.rglob("*.py") if p.name != "errors.py" and elsewhere.search(p.read_text())]


@pytest.mark.parametrize("kind", CLASSES)
def test_an_error_is_the_same_after_pickling_and_copying(kind: type[Exception]):
    """As processes of a vector environment send it: its class, its message, and all that can be asked of it."""
    error = EXAMPLES.get(kind) or kind("scene.yaml: objects.can.gap: -1 should be at least 0.")
    again = [pickle.loads(pickle.dumps(error, protocol)) for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1)]
    for other in (*again, copy.copy(error), copy.deepcopy(error)):
        assert type(other) is kind
        assert str(other) == str(error)
        assert vars(other) == vars(error)


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        ("MissingExtraError", ImportError),
        ("OutputError", OSError),
        ("TaskError", TypeError),
        ("ArgumentTypeError", TypeError),
        ("ArgumentTypeError", ValueError),
        ("ArgumentError", ValueError),
        ("SceneMismatchError", ValueError),
    ],
)
def test_an_error_of_an_argument_is_one_of_python_s_too(error: str, kind: type[Exception]):
    """Callers that know nothing of this package catch what they expect, others the base of all of its errors."""
    found = getattr(errors, error)
    assert issubclass(found, kind)
    assert issubclass(found, ScenirisError)


@pytest.mark.parametrize(
    ("name", "valid", "near"),
    [
        ("aple", ["pear", "apple", "plate"], "apple"),
        ("apple", ["Apple", "apple"], "apple"),
        ("upper_drawr", ["cabinet/lower_drawer", "cabinet/upper_drawer"], "cabinet/upper_drawer"),
        ("cupboard/upper_drawer", ["cabinet/upper_drawer", "cabinet/door"], "cabinet/upper_drawer"),
        ("lid", ["pot/lid", "pan/lid"], "pot/lid"),
        ("zebra", ["apple", "mug"], None),
        ("apple", [], None),
        ("", ["apple"], None),
    ],
)
def test_the_nearest_name_is_advised_if_one_is_near(name: str, valid: list[str], near: str | None):
    """A misspelt one, or the part of an object without its owner; of equals the first; else nothing is said."""
    assert did_you_mean(name, iter(valid)) == ("" if near is None else f" Did you mean '{near}'?")


def test_an_unknown_name_is_told_with_all_that_there_are():
    """By the alphabet, whatever they came in; none is a word too."""
    error = UnknownNameError("body", "lidd", "scene.yaml: objects.can.on", (name for name in ("pan", "lid")))
    assert error.valid == ["lid", "pan"]
    assert str(error) == "scene.yaml: objects.can.on: unknown body 'lidd'. Did you mean 'lid'? Valid: lid, pan."
    assert str(UnknownNameError("body", "lid", "scene", [])) == "scene: unknown body 'lid'. Valid: none."


def test_a_circle_is_closed_in_its_message():
    """The last name depends on the first; one name alone depends on itself."""
    assert "objects are placed on each other: a -> b -> c -> a." in str(
        in_a_cycle("scene.yaml", iter("abc"), "objects are placed on each other")
    )
    assert "a -> a." in str(in_a_cycle("scene.yaml", ["a"], "objects are placed on each other"))


def test_counts_of_rejections_are_the_error_s_own():
    """A caller's later changes to the counts do not change those of the error."""
    counts = {"apple": {"collision": 7}}
    error = InfeasibleSceneError("scene.yaml: it is full.", "scene.yaml", "apple", "collision", counts, {})
    counts["apple"]["collision"] = 0
    assert error.counts == {"apple": {"collision": 7}}


@pytest.mark.parametrize(("room", "wanted"), [(40, 41), (40, 400), (1, 2)])
def test_the_budget_that_is_advised_has_room_to_spare(room: int, wanted: int):
    """More is needed at the next moment, so it is twice what was needed at least."""
    said = str(ContactBudgetError("nconmax", room, wanted))
    assert f"nconmax={room} " in said
    assert str(wanted) in said
    (advised,) = re.findall(r"Pass nconmax=(\d+)", said)
    assert int(advised) >= 2 * max(room, wanted)


def test_a_file_that_cannot_be_written_is_told_in_words():
    """An OSError with two arguments would be told as numbers and names of files."""
    said = str(OutputError("/out/a.png", "it is a folder"))
    assert said.startswith("/out/a.png cannot be written: it is a folder.")
    assert "--out" in said
