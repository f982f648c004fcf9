"""Groups, heaps and stacks as words: who is present, where their things are, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.groups import GroupConfig, StackConfig
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.relations import Near
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.layout.tables import make_table
from tests.config.scenes import CLUTTER, TABLE, grouped, refused
from tests.layout.scenes import compile_on_cpu

SCENE: dict[str, Any] = {
    "floor": {"size": [1, 1]},
    "objects": {"bin": {"asset": "bowl", "on": "floor"}, "a": {"asset": "lemon"}, "b": {"asset": "apple"}},
    "heaps": {"pile": {"fill": "bin", "of": ["a", "b"]}},
}
STACKS_SCENE: dict[str, Any] = {
    "floor": {"size": [1, 1]},
    "objects": {"a": {"asset": "brick"}, "b": {"asset": "block"}, "c": {"asset": "can"}, "d": {"asset": "mug"}},
    "stacks": {"tower": {"of": ["a", "b", "c"], "on": "floor", "offset": [0, 0.01]}},
}
LOOSE: dict[str, Any] = {**STACKS_SCENE, "objects": {**STACKS_SCENE["objects"], "d": {"asset": "mug", "on": "floor"}}}


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
    "too many": ({"groups.clutter": CLUTTER | {"count": 4}}, SceneKeyError, ["clutter:", "from 0 to 3, its members"]),
    "upside down": ({"groups.clutter": CLUTTER | {"count": [2, 1]}}, SceneKeyError, ["from 0 to 3, its members"]),
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
    advice = f"scene: groups.clutter.count: {count!r} should be a whole number of at least 0, or [low, high]."
    assert str(caught.value) == advice


def test_a_group_made_in_python_is_judged_by_itself():
    """Errors name the class where there is no file."""
    assert GroupConfig(of=("a", "b"), count=(1, 2)).count == (1, 2)
    with pytest.raises(SceneKeyError, match=r"GroupConfig: .*from 0 to 1, its members"):
        GroupConfig(of=("a",), count=(2, 2))


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


HEAPS_WRONG: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
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
    "a place of its own": ({"objects.a.on": "floor"}, SceneKeyError, r"objects\.a: the heap .* Leave out on,"),
    "a condition": ({"objects.a.if": "bin"}, SceneKeyError, "joints, gap, if and unless"),
    "a turn of its own": ({"objects.a.orientation": "fixed"}, SceneKeyError, "Leave out on,"),
    "a heap in a heap": (
        {"heaps.other": {"fill": "a", "of": ["c"]}, "objects.c": {"asset": "lemon"}}, SceneKeyError, "object of a heap",
    ),
    "a container that may lie": ({"objects.bin.orientation": "any"}, SceneKeyError, "should keep this object upright"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "error", "says"), HEAPS_WRONG.values(), ids=HEAPS_WRONG.keys())
def test_a_wrong_heap_is_refused(changes: dict[str, Any], error: type[ScenirisError], says: str):
    """By its key, with what would be right."""
    with pytest.raises(error, match=says):
        SceneConfig.load(SCENE, changes)


def places(config: SceneConfig) -> dict[str, tuple[str | None, list[tuple[str, float, float]]]]:
    """Return the support of each object, and the objects that it is near, with the limits of the distance."""
    return {
        name: (part.on, [(r.near, r.low, r.high) for r in part.relations if isinstance(r, Near)])
        for name, part in config.objects.items()
    }


def test_each_thing_is_on_the_one_before_it_and_near_it():
    """The lowest one is on the support, wherever it is there."""
    chain = {"a": ("floor", []), "b": ("a", [("a", 0.0, 0.01)]), "c": ("b", [("b", 0.0, 0.01)]), "d": ("floor", [])}
    assert places(SceneConfig.load(LOOSE)) == chain
    objects = {**LOOSE["objects"], "c": {"asset": "can", "on": "floor"}}
    anywhere = SceneConfig.load({**LOOSE, "objects": objects, "stacks": {"tower": {"of": ["a", "b"], "on": "d"}}})
    assert places(anywhere) == {"a": ("d", []), "b": ("a", []), "c": ("floor", []), "d": ("floor", [])}


def test_things_keep_their_other_words():
    """A relation of its own comes first, and the stack's is added to it."""
    config = SceneConfig.load(LOOSE, {"objects.c.relations": [{"left_of": "d"}], "objects.c.clearance": 0.02})
    assert [relation.word for relation in config.objects["c"].relations] == ["left_of", "near"]
    assert config.objects["c"].clearance == 0.02


def test_a_stack_is_read_again_as_it_was():
    """With a change of it, too: no relation of the one before is left."""
    config = SceneConfig.load(LOOSE, {"objects.b.relations": [{"left_of": "d"}]})
    assert SceneConfig.load(config, {"bank": 64}).model_dump() == config.model_dump()
    wider = SceneConfig.load(config, {"stacks.tower.offset": [0.01, 0.02]})
    assert places(wider)["c"] == ("b", [("b", 0.01, 0.02)])
    turned = SceneConfig.load(config, {"stacks.tower.of": ["b", "a", "c"]})
    assert [places(turned)[name][0] for name in "abc"] == ["b", "floor", "a"]


def test_a_stack_made_in_python_means_the_same():
    """With arrays of NumPy."""
    stack = StackConfig(of=("a", "b", "c"), on="floor", offset=np.array([0, 0.01]))
    objects = {name: ObjectConfig(**words) for name, words in LOOSE["objects"].items()}
    config = SceneConfig(**(LOOSE | {"objects": objects, "stacks": {"tower": stack}}))
    assert places(config) == places(SceneConfig.load(LOOSE))


def test_pivots_of_a_tower_are_as_far_apart_as_it_says():
    """By the frames of the layouts: blocks and their supports have their origin at the pivot."""
    objects = {name: {"asset": "block"} for name in "abc"}
    stacks = {"tower": {"of": ["a", "b", "c"], "on": "floor", "offset": [0.002, 0.008]}}
    compiled = compile_on_cpu({"floor": {"size": [1, 1]}, "objects": objects, "stacks": stacks})
    qpos = make_table(compiled, 64, 0).qpos.reshape(64, 3, 7)[:, :, :3]
    apart = np.linalg.norm(np.diff(qpos, axis=1)[:, :, :2], axis=-1)
    assert ((apart > 0.0019) & (apart < 0.0081)).all()
    assert np.ptp(apart) > 0.004
    assert (np.diff(qpos[:, :, 2], axis=1) > 0.02).all()


@pytest.mark.parametrize(
    ("on", "feet"),
    [(["floor", "d"], ["floor", "d"]), ({"floor": 2, "d": 0, "e": 1}, ["floor", "e"]), ({"any": "e"}, ["e"])],
)
def test_a_stack_on_several_supports_is_on_one_of_them(on: Any, feet: list[str]):
    """As an object with this value of `on`; the objects above follow, with their offsets."""
    config = SceneConfig.load(LOOSE, {"objects.e": {"asset": "brick", "on": "floor"}, "stacks.tower.on": on})
    assert [config.objects[name].on for name in config.variants["a"]] == feet
    for name, below in (("b", "a"), ("c", "b")):
        assert [config.objects[member].on for member in config.variants[name]] == [*config.variants[below]]
        assert {places(config)[member][1][0] for member in config.variants[name]} == {(below, 0.0, 0.01)}
    again = SceneConfig.load(config, {"bank": 32})
    assert again.groups == config.groups


STACKS_WRONG: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "an unknown thing": ({"stacks.tower.of": ["a", "x"]}, UnknownNameError, r"stacks\.tower\.of: unknown object 'x'"),
    "an unknown support": ({"stacks.tower.on": "flor"}, UnknownNameError, "unknown support 'flor'.*mean 'floor'"),
    "one thing": ({"stacks.tower.of": ["a"]}, SceneKeyError, "at least 2 values"),
    "a thing twice": ({"stacks.tower.of": ["a", "a"]}, SceneKeyError, "should name each object once"),
    "a thing of two stacks": (
        {"stacks.other": {"of": ["c", "d"], "on": "floor"}}, SceneKeyError, "'c' is also in the stack 'tower'",
    ),
    "a thing of a group": (
        {"groups": {"some": {"of": ["b"], "count": 1}}}, SceneKeyError, "'b' is also in the group 'some'",
    ),
    "no support": ({"stacks.tower.on": None}, SceneKeyError, r"stacks\.tower\.on: None should be a support, a list"),
    "an unknown one of several": ({"stacks.tower.on": ["d", "flor"]}, UnknownNameError, "unknown support 'flor'"),
    "a support twice": ({"stacks.tower.on": ["d", "d"]}, SceneKeyError, "should name each support once"),
    "one of its supports": (
        {"stacks.tower.on": ["d", "floor"], "objects.a.on": "d"}, SceneKeyError, r"objects\.a: .* on 'd' or 'floor'",
    ),
    "an optional middle": ({"objects.b.if": "a"}, SceneKeyError, r"stacks\.tower\.of: 'b' may be absent"),
    "a place of its own": ({"objects.b.on": "floor"}, SceneKeyError, r"objects\.b: should not name a support"),
    "a cover of its own": ({"objects.b.inside": "a"}, SceneKeyError, r"objects\.b: should not name a support"),
    "on one of its things": ({"stacks.tower.on": "c"}, SceneKeyError, "a -> c -> b -> a"),
    "no width": ({"stacks.tower.offset": [0.1, 0.1]}, SceneKeyError, r"stacks\.tower\.offset: .*high at least 0\.0002"),
    "a negative offset": ({"stacks.tower.offset": [-1, 1]}, SceneKeyError, r"stacks\.tower\.offset"),
    "a number": ({"stacks.tower.offset": 0.1}, SceneKeyError, r"stacks\.tower\.offset: 0\.1 should be a list"),
    "an unknown word": ({"stacks.tower.ofset": [0, 1]}, SceneKeyError, "mean 'offset'"),
    "no mapping": ({"stacks.tower": 3}, SceneKeyError, r"stacks\.tower: 3 should be a mapping"),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "error", "says"), STACKS_WRONG.values(), ids=STACKS_WRONG.keys())
def test_a_wrong_stack_is_refused(changes: dict[str, Any], error: type[ScenirisError], says: str):
    """By its key, with what would be right, and with nothing about what it would have meant."""
    with pytest.raises(error, match=says) as caught:
        SceneConfig.load(LOOSE, changes)
    assert "distance" not in str(caught.value)
