"""Heaps as words: where their things are, and what they cannot be."""

from __future__ import annotations

from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError

SCENE: dict[str, Any] = {
    "floor": {"size": [1, 1]},
    "objects": {"bin": {"asset": "bowl", "on": "floor"}, "a": {"asset": "lemon"}, "b": {"asset": "apple"}},
    "heaps": {"pile": {"fill": "bin", "of": ["a", "b"]}},
}


def test_things_of_a_heap_are_in_what_it_fills():
    """In any orientation, and after it; also when the scene is read again with a change."""
    config = SceneConfig.load(SceneConfig.load(SCENE), {"objects.bin.clearance": 0.01})
    for name in ("a", "b"):
        thing = config.objects[name]
        assert (thing.in_, thing.drawn_orientation.kind, thing.needs) == ("bin", "any", ("bin",))


def test_the_name_of_the_rows_is_no_word_of_the_scene():
    """Their content is in the hash in its place."""
    named = SceneConfig.load(SCENE, {"heaps.pile.rows": "/somewhere/rows.npz"})
    assert named.canonical() == SceneConfig.load(SCENE).canonical()


WRONG: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "an unknown thing": ({"heaps.pile.of": ["a", "c"]}, UnknownNameError, r"heaps\.pile\.of: unknown object 'c'"),
    "an unknown container": ({"heaps.pile.fill": "bni"}, UnknownNameError, "unknown support 'bni'.*mean 'bin'"),
    "no things": ({"heaps.pile.of": []}, SceneKeyError, "at least 1 values"),
    "a thing twice": (
        {"heaps.pile.of": ["a", "a"]},
        SceneKeyError,
        r"heaps\.pile\.of: \['a', 'a'\] should name each object once",
    ),
    "a thing of two heaps": (
        {"heaps.other": {"fill": "bin", "of": ["a"]}}, SceneKeyError, "'a' is also in the heap 'pile'",
    ),
    "a thing of a group": (
        {"groups": {"some": {"of": ["a"], "count": 1}}}, SceneKeyError, "'a' is also in the group 'some'",
    ),
    "a place of its own": ({"objects.a.on": "floor"}, SceneKeyError, r"objects\.a: should have no place of its own"),
    "a turn of its own": ({"objects.a.orientation": "fixed"}, SceneKeyError, "should have no place of its own"),
    "a heap in a heap": (
        {"heaps.other": {"fill": "a", "of": ["c"]}, "objects.c": {"asset": "lemon"}}, SceneKeyError, "thing of a heap",
    ),
    "a container that may lie": ({"objects.bin.orientation": "any"}, SceneKeyError, "should keep it upright"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_heap_is_refused(changes: dict[str, Any], error: type[ScenirisError], says: str):
    """By its key, with what would be right."""
    with pytest.raises(error, match=says):
        SceneConfig.load(SCENE, changes)
