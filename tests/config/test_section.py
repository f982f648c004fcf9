"""Parts of a scene: frozen, with no keys but their own, and judged alike in files and in Python."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.config.objects import JointConfig, ObjectConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.section import Section, check_one_of
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from tests.config.scenes import SMALL, refused

WRONG: dict[str, tuple] = {
    "unknown key": (
        {"objects.apple.clearence": 1},
        SceneKeyError,
        ["objects.apple.clearence", "mean 'clearance'"],
    ),
    "unknown key on top": ({"flor.size": [1, 1]}, SceneKeyError, ["flor:", "Did you mean 'floor'"]),
    "misplaced base": ({"objects.apple.base": "mid"}, SceneKeyError, ["objects.apple.base", "unknown key"]),
    "no mapping": ({"objects.apple": 3}, SceneKeyError, ["objects.apple: 3", "a mapping"]),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_key_that_a_part_has_not_is_refused(
    tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]
):
    """Wherever it stands, with the nearest of those that there are."""
    refused(tmp_path, SMALL, overrides, error, says)


def test_a_config_is_frozen():
    """A scene cannot change after it was validated."""
    with pytest.raises(ValueError, match="frozen"):
        SceneConfig.load("mid").attempts = 3  # pyrefly: ignore[read-only]


def test_python_construction_is_judged_like_a_file():
    """Parts and scenes made in Python raise the same errors, without pydantic's."""
    with pytest.raises(SceneKeyError, match=r"ObjectConfig: clearance: -1 should be at least 0"):
        ObjectConfig(asset="apple", clearance=-1)
    with pytest.raises(SceneKeyError, match=r"ObjectConfig: onn: unknown key\. Did you mean 'on'"):
        ObjectConfig(asset="apple", onn="floor")  # pyrefly: ignore[unexpected-keyword]
    with pytest.raises(SceneKeyError, match=r"JointConfig: scene: .*exactly one of .*, but has value and noise"):
        JointConfig(value=1.0, noise=1.0)
    with pytest.raises(SceneKeyError, match=r"SceneConfig: objects\.a\.gap: 'x' should be a number"):
        SceneConfig(objects={"a": {"asset": "apple", "gap": "x"}})
    with pytest.raises(UnknownNameError, match="unknown support 'floor'"):
        SceneConfig(objects={"a": ObjectConfig(asset="apple", on="floor")})


class Shade(Section):
    """A part of another, with words that belong somewhere else."""

    misplaced = dict.fromkeys(("watts", "lumens"), "should stand beside 'shade'")
    colour: str = "white"


class Lamp(Section):
    """A part with two words of which one is given, and with a part of its own."""

    watts: float | None = None
    lumens: float | None = None
    shade: Shade | None = None


def test_the_words_that_are_given_are_those_with_a_value():
    """In the order asked for; a word set to null is not given, and nought is."""
    lamp = Lamp(watts=None, lumens=0.0)
    assert lamp.given(("watts", "lumens", "shade")) == ["lumens"]
    assert Lamp(lumens=2.0, watts=1.0).given(("lumens", "watts")) == ["lumens", "watts"]
    assert Lamp().given(("watts", "lumens")) == []


class Bulb(Section):
    """A part with two words of which exactly one is given."""

    one_of = ("watts", "lumens")
    watts: float | None = None
    lumens: float | None = None


def test_one_of_some_words_is_given():
    """Whoever makes the part; the error counts what it has."""
    assert Bulb(watts=1.0).watts == 1.0
    check_one_of(["watts"], ("watts", "lumens"))
    with pytest.raises(SceneKeyError, match="Bulb: scene: it should have exactly one of watts, lumens, but has none"):
        Bulb()
    with pytest.raises(SceneKeyError, match="should have exactly one of watts, lumens, but has watts and lumens"):
        Bulb(watts=1.0, lumens=1.0)


def test_a_word_that_belongs_somewhere_else_is_told_where():
    """In place of what is said of unknown keys, by the path of the part it was found in."""
    with pytest.raises(SceneKeyError, match=r"^Lamp: shade\.watts: 40 should stand beside 'shade'\.$"):
        Lamp.model_validate({"shade": {"watts": 40}})


def test_every_part_with_a_wrong_key_is_told():
    """Keys of a part and of the parts inside of it, a line for each."""
    with pytest.raises(SceneKeyError) as caught:
        SceneConfig.load({"objects": {"a": {"asset": "mug", "knd": 1, "onn": 2}, "b": {"region": {"bx": 3}}}})
    told = [line.split(": ")[1] for line in str(caught.value).splitlines()]
    assert told == ["objects.a.knd", "objects.a.onn", "objects.b.region.bx"]
