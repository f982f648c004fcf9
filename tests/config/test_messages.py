"""Messages about a wrong scene: every mistake at once, in the words of scene files."""

from __future__ import annotations

import contextlib

import pytest
from pydantic import BaseModel

from sceniris_gym.config.messages import reading, where_now
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from tests.config.scenes import SMALL, refusal


def test_all_wrong_keys_are_told_at_once():
    """One message lists every problem of a scene, a line for each."""
    with pytest.raises(SceneKeyError) as caught:
        SceneConfig.load(SMALL, {"attempts": 0, "objects.apple.gap": -1, "objects.goal.knd": 1})
    assert len(str(caught.value).splitlines()) == 3


def test_the_word_on_read_as_true_by_another_loader_is_recognised():
    """A loader of YAML 1.1 turns the key `on` into true; the error says so."""
    with pytest.raises(SceneKeyError, match=r"objects\.a\.True.*YAML 1\.1"):
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"a": {"asset": "apple", True: "floor"}}})


def test_only_what_is_found_wrong_with_values_is_said_anew():
    """An error of another kind comes through a reading as it is."""
    problem = KeyError("mug")
    with pytest.raises(KeyError) as caught, reading("scene.yaml"):
        raise problem
    assert caught.value is problem


def test_what_is_read_is_known_inside_of_a_reading_alone():
    """The inner one of two, the outer one again after it, and none when both have failed."""

    def read_both() -> None:
        with contextlib.suppress(ValueError), reading("inner.yaml"):
            assert where_now.get() == "inner.yaml"
            raise ValueError
        assert where_now.get() == "outer.yaml"
        raise KeyError

    assert where_now.get() is None
    with pytest.raises(KeyError), reading("outer.yaml"):
        read_both()
    assert where_now.get() is None


def test_a_mistake_without_words_of_its_own_is_told_with_its_place():
    """By the path of the key, the value, and what pydantic says of it."""

    class Lamp(BaseModel):
        lit: list[bool]

    says = r"^lamp\.yaml: lit\.1: 'dim' is wrong: .*bool"
    with pytest.raises(SceneKeyError, match=says) as caught, reading("lamp.yaml"):
        Lamp.model_validate({"lit": [True, "dim"]})
    assert caught.value.__suppress_context__


def test_a_long_value_is_cut_off_in_a_message():
    """A message stays readable whatever was given; its beginning tells what it was."""
    said = refusal(SMALL, {"objects.apple.clearance": ["0123456789"] * 1000}, SceneKeyError)
    assert said.startswith("scene: objects.apple.clearance: ['0123456789', '0123")
    assert said.endswith("... should be a number.")
    assert len(said) < 150


def test_half_of_a_surrogate_pair_is_refused():
    """Pydantic cannot write it into an error, as a key or as a value."""
    for overrides in ({"\ud800": 1}, {"objects.apple.kind": "\ud800"}, {"objects.apple.\ud800": 1}):
        assert refusal(SMALL, overrides, SceneKeyError).startswith("scene: ")


def test_what_is_wrong_with_a_whole_scene_is_told_without_its_first_words():
    """They are the scene's name and floor, whatever is wrong."""
    words = {"robots": {"left": {"asset": "panda"}}, "objects": {"left": {"asset": "mug", "on": "floor"}}}
    with pytest.raises(SceneKeyError, match=r"scene: scene: it should have a robot and an object of different names"):
        SceneConfig.load({"floor": {"size": [1, 1]}, **words})
