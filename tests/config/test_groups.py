"""Groups in scene files: how many members are present, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError
from tests.config.scenes import CLUTTER, TABLE, grouped, refused


@pytest.mark.parametrize(("count", "ends"), [(2, (2, 2)), (0, (0, 0)), ([1, 3], (1, 3)), ((0, 1), (0, 1))])
def test_a_count_is_a_number_or_an_interval(count: Any, ends: tuple[int, int]):
    """Both ends are there in the API."""
    group = grouped(CLUTTER | {"count": count}).groups["clutter"]
    assert (group.of, group.count, group.missing) == (("can", "mug", "bowl"), ends, "refuse")


def test_a_count_can_be_overridden():
    """By its dotted key, for a curriculum."""
    config = grouped(CLUTTER)
    assert SceneConfig.load(config, {"groups.clutter.count": 3}).groups["clutter"].count == (3, 3)


WRONG: dict[str, tuple] = {
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
    "a member twice": (
        {"groups.clutter": {"of": ["can", "can"], "count": 1}},
        SceneKeyError,
        ["groups.clutter.of: ['can', 'can'] should name each object once"],
    ),
    "too many": ({"groups.clutter": CLUTTER | {"count": 4}}, SceneKeyError, ["clutter:", "0 <= low <= high <= 3"]),
    "upside down": ({"groups.clutter": CLUTTER | {"count": [2, 1]}}, SceneKeyError, ["0 <= low <= high <= 3"]),
    "a negative end": ({"groups.clutter": CLUTTER | {"count": [-1, 1]}}, SceneKeyError, ["count.0: -1", "at least 0"]),
    "a fractional end": ({"groups.clutter": CLUTTER | {"count": [1, 1.5]}}, SceneKeyError, ["count.1: 1.5", "whole"]),
    "a bad name": ({"groups": {"my clutter": CLUTTER}}, SceneKeyError, ["groups.my clutter", "letters, digits"]),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_group_is_refused_by_file_path_and_advice(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Members, counts and words that cannot be."""
    refused(tmp_path, TABLE, overrides, error, says)


@pytest.mark.parametrize("count", ["two", 0.5, True, None, -1, {"low": 1}])
def test_a_wrong_count_is_one_message_that_says_what_is_right(count: Any):
    """A plain number is right, so it is named before the list."""
    with pytest.raises(SceneKeyError) as caught:
        SceneConfig.load(TABLE, {"groups.clutter": CLUTTER | {"count": count}})
    advice = f"scene: groups.clutter.count: {count!r} should be a whole number, 0 or more, or [low, high]."
    assert str(caught.value) == advice


def test_a_group_made_in_python_is_judged_by_itself():
    """Errors name the class where there is no file."""
    assert GroupConfig(of=("a", "b"), count=(1, 2)).count == (1, 2)
    with pytest.raises(SceneKeyError, match=r"GroupConfig: .*0 <= low <= high <= 1"):
        GroupConfig(of=("a",), count=(2, 2))
