"""Groups in scene files: how many members are present, what may refer to them, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError

SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "objects": {
        "table": {"asset": "table", "kind": "fixture", "on": "floor"},
        "can": {"asset": "can", "on": "table"},
        "mug": {"asset": "mug", "on": "table"},
        "bowl": {"asset": "bowl", "on": "table"},
        "apple": {"asset": "apple", "on": "table"},
        "post": {"asset": "mug", "kind": "static"},
    },
}
CLUTTER = {"of": ["can", "mug", "bowl"], "count": [1, 3]}


def grouped(group: Any, **overrides: Any) -> SceneConfig:
    """Return the scene with a group `clutter`."""
    return SceneConfig.load(SCENE, {"groups.clutter": group, **overrides})


@pytest.mark.parametrize(("count", "ends"), [(2, (2, 2)), (0, (0, 0)), ([1, 3], (1, 3)), ((0, 1), (0, 1))])
def test_a_count_is_a_number_or_an_interval(count: Any, ends: tuple[int, int]):
    """Both ends are there in the API."""
    group = grouped(CLUTTER | {"count": count}).groups["clutter"]
    assert (group.of, group.count, group.missing) == (("can", "mug", "bowl"), ends, "refuse")


def test_a_count_can_be_overridden():
    """By its dotted key, for a curriculum."""
    config = grouped(CLUTTER)
    assert SceneConfig.load(config, {"groups.clutter.count": 3}).groups["clutter"].count == (3, 3)


def test_groups_are_in_the_canonical_form():
    """They shape layouts, so they are in the hash; a scene read again from its parts is the same."""
    config = grouped(CLUTTER)
    texts = {
        SceneConfig.load(SCENE).canonical(),
        config.canonical(),
        grouped(CLUTTER | {"count": 2}).canonical(),
        grouped(CLUTTER | {"missing": "drop"}).canonical(),
    }
    assert len(texts) == 4
    assert SceneConfig.load(config, {"attempts": 10}).canonical() == config.canonical()


REFERENCES = {
    "relations.0.front_of": {"objects.apple.relations": [{"front_of": "can"}]},
    "relations.0.frame": {"objects.apple.relations": [{"front_of": "table", "frame": "can"}]},
    "relations.0.between": {"objects.apple.relations": [{"between": ["table", "can"]}]},
    "orientation.face_to": {"objects.apple.orientation": {"face_to": "can"}},
}


@pytest.mark.parametrize(("path", "overrides"), REFERENCES.items(), ids=REFERENCES.keys())
def test_a_reference_to_what_may_be_absent_is_refused_unless_it_may_be_dropped(path: str, overrides: dict):
    """Anchors, frames and targets; one that is always present may be referred to."""
    with pytest.raises(SceneKeyError, match=rf"objects\.apple\.{path}: 'can' may be absent.*'missing: drop'"):
        grouped(CLUTTER, **overrides)
    assert grouped(CLUTTER | {"missing": "drop"}, **overrides).groups["clutter"].missing == "drop"
    assert grouped(CLUTTER | {"count": 3}, **overrides).groups["clutter"].always_whole


@pytest.mark.parametrize("word", ["on", "inside", "in"])
@pytest.mark.parametrize("missing", ["refuse", "drop"])
def test_nothing_stands_on_what_may_be_absent(word: str, missing: str):
    """Whatever becomes of relations; on what is always present it may stand."""
    place = {f"objects.apple.{word}": "bowl"}
    with pytest.raises(SceneKeyError, match=rf"objects\.apple\.{word}: 'bowl' may be absent.*another support"):
        grouped(CLUTTER | {"missing": missing}, **place)
    assert grouped(CLUTTER | {"missing": missing, "count": 3}, **place).objects["apple"].support is not None


def test_members_of_a_group_may_refer_to_what_is_outside_of_it():
    """A member stands and looks as any other object does."""
    config = grouped(CLUTTER, **{"objects.can.relations": [{"front_of": "apple"}]})
    assert config.objects["can"].needs == ("table", "apple")


WRONG = {
    "no mapping": ({"groups.clutter": ["can"]}, SceneKeyError, ["groups.clutter: ['can']", "mapping of keys"]),
    "an unknown key": ({"groups.clutter": CLUTTER | {"cout": 1}}, SceneKeyError, ["clutter.cout", "mean 'count'"]),
    "no members": ({"groups.clutter": {"of": [], "count": 0}}, SceneKeyError, ["groups.clutter.of", "at least 1"]),
    "no list": ({"groups.clutter": {"of": "can", "count": 0}}, SceneKeyError, ["clutter.of: 'can'", "a list"]),
    "no count": ({"groups.clutter": {"of": ["can"]}}, SceneKeyError, ["groups.clutter.count", "missing"]),
    "an unknown way": (
        {"groups.clutter": CLUTTER | {"missing": "dropp"}},
        SceneKeyError,
        ["groups.clutter.missing: 'dropp'", "mean 'drop'"],
    ),
    "a member twice": ({"groups.clutter": {"of": ["can", "can"], "count": 1}}, SceneKeyError, ["'of' once"]),
    "too many": ({"groups.clutter": CLUTTER | {"count": 4}}, SceneKeyError, ["clutter:", "0 <= low <= high <= 3"]),
    "upside down": ({"groups.clutter": CLUTTER | {"count": [2, 1]}}, SceneKeyError, ["0 <= low <= high <= 3"]),
    "a negative end": ({"groups.clutter": CLUTTER | {"count": [-1, 1]}}, SceneKeyError, ["count.0: -1", "at least 0"]),
    "a fractional end": ({"groups.clutter": CLUTTER | {"count": [1, 1.5]}}, SceneKeyError, ["count.1: 1.5", "whole"]),
    "an unknown member": (
        {"groups.clutter": {"of": ["can", "bowel"], "count": 1}},
        UnknownNameError,
        ["groups.clutter.of", "mean 'bowl'"],
    ),
    "the robot": ({"groups.clutter": {"of": ["robot"], "count": 1}}, UnknownNameError, ["unknown object 'robot'"]),
    "a static member": (
        {"groups.clutter": {"of": ["post"], "count": 1}},
        SceneKeyError,
        ["groups.clutter.of: 'post'", "cannot be absent"],
    ),
    "a member of two groups": (
        {"groups": {"clutter": CLUTTER, "cups": {"of": ["mug"], "count": 1}}},
        SceneKeyError,
        ["groups.cups.of: 'mug'", "the group 'clutter' too"],
    ),
    "a bad name": ({"groups": {"my clutter": CLUTTER}}, SceneKeyError, ["groups.my clutter", "letters, digits"]),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_group_is_refused_by_file_path_and_advice(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Members, counts and words that cannot be."""
    path = tmp_path / "wrong.yaml"
    path.write_text(json.dumps(SCENE))
    with pytest.raises(error) as caught:
        SceneConfig.load(path, overrides)
    for text in (str(path), *says):
        assert text in str(caught.value)
    assert caught.value.__cause__ is None


@pytest.mark.parametrize("count", ["two", 0.5, True, None, -1, {"low": 1}])
def test_a_wrong_count_is_one_complaint_that_says_what_is_right(count: Any):
    """A plain number is right, so it is named before the list."""
    with pytest.raises(SceneKeyError) as caught:
        SceneConfig.load(SCENE, {"groups.clutter": CLUTTER | {"count": count}})
    advice = f"scene: groups.clutter.count: {count!r} should be a whole number of 0 or more, or [low, high]."
    assert str(caught.value) == advice


def test_a_group_made_in_python_is_judged_by_itself():
    """Errors name the class where there is no file."""
    assert GroupConfig(of=("a", "b"), count=(1, 2)).count == (1, 2)
    with pytest.raises(SceneKeyError, match=r"GroupConfig: .*0 <= low <= high <= 1"):
        GroupConfig(of=("a",), count=(2, 2))
