"""Conditions that cannot be: each is refused with its place and what would be right."""

from __future__ import annotations

from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError

CAN = {"asset": "can", "on": "floor"}
SCENE: dict[str, Any] = {
    "floor": {"size": [2, 2]},
    "robot": {"asset": "panda"},
    "objects": {
        **dict.fromkeys(("tray", "apple", "pear", "lemon", "spoon", "book"), CAN),
        "unit": {"asset": ["can", "book"], "on": "floor"},
        "post": {"asset": "mug", "kind": "static"},
        "goal": {"kind": "marker", "on": "floor"},
        "mug": {"asset": "mug", "on": "floor", "orientation": "stable"},
        "bowl": {"asset": "bowl", "kind": "fixture", "on": "floor"},
    },
    "groups": {"meal": {"of": ["tray", "apple"], "count": 1}, "sweets": {"of": ["pear", "lemon"], "count": [0, 2]}},
}
WRONG: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "a typo": ({"objects.spoon.if": "trey"}, UnknownNameError, r"spoon\.if: unknown object or group 'trey'.*'tray'"),
    "a typo of a variant": (
        {"objects.spoon.if": "unit/typo"},
        UnknownNameError,
        r"spoon\.if: unknown object or group 'unit/typo'",
    ),
    "no name": ({"objects.spoon.if": 3}, SceneKeyError, r"spoon\.if: 3 should be"),
    "itself": ({"objects.spoon.if": "spoon"}, SceneKeyError, r"spoon\.if: 'spoon' should be another object"),
    "its own variant": (
        {"objects.unit.unless": "unit/can"},
        SceneKeyError,
        r"unless: 'unit/can' should be another",
    ),
    "a group's own member": ({"groups.sweets.if": "pear"}, SceneKeyError, r"sweets\.if: 'pear' should be another"),
    "a static object": ({"objects.spoon.if": "post"}, SceneKeyError, r"spoon\.if: 'post' keeps its pose"),
    "a robot": ({"objects.spoon.unless": ["robot"]}, SceneKeyError, r"spoon\.unless: 'robot' is a robot"),
    "of a static object": ({"objects.post.if": "tray"}, SceneKeyError, r"objects\.post: 'post' keeps its pose"),
    "a circle": (
        {"objects.spoon.if": "book", "objects.book.if": "spoon"},
        SceneKeyError,
        "present depending on each other: (spoon -> book -> spoon|book -> spoon -> book)",
    ),
    "a circle through a group": (
        {"groups.meal.if": "spoon", "objects.spoon.if": "tray"},
        SceneKeyError,
        "present depending on each other: .*spoon.*meal",
    ),
    "a circle through a support": (
        {"groups.meal.if": "spoon", "objects.spoon.on": "tray"},
        SceneKeyError,
        "present depending on each other: .*spoon.*meal",
    ),
    "a member of the same group": ({"objects.pear.if": "lemon"}, SceneKeyError, "depending on each other: sweets"),
    "both": (
        {"objects.spoon": {**CAN, "if": "tray", "unless": "tray"}},
        SceneKeyError,
        r"objects\.spoon: its conditions",
    ),
    "a member and its group": (
        {"objects.spoon": {**CAN, "if": "tray", "unless": "meal"}},
        SceneKeyError,
        r"objects\.spoon: its conditions exclude each other: 'meal' would be both",
    ),
    "two of one": ({"objects.spoon.if": ["tray", "apple"]}, SceneKeyError, r"objects\.spoon: its conditions exclude"),
    "two variants": ({"objects.spoon.if": ["unit/can", "unit/book"]}, SceneKeyError, r"spoon: its conditions exclude"),
    "its support": ({"objects.spoon": {**CAN, "on": "tray", "if": "apple"}}, SceneKeyError, r"spoon: its conditions"),
    "what is always there": ({"objects.spoon.unless": "bowl"}, SceneKeyError, r"spoon: its conditions .* 'bowl'"),
    "an object with variants that is always there": (
        {"objects.spoon.unless": "unit"},
        SceneKeyError,
        r"objects\.spoon: its conditions exclude each other: 'unit' would be both present and absent in each layout",
    ),
    "a group in itself": ({"groups.meal.of": ["tray", "meal"]}, SceneKeyError, "groups contain each other: meal"),
    "two groups in each other": (
        {"groups.a": {"of": ["b"], "count": 1}, "groups.b": {"of": ["a"], "count": 1}},
        SceneKeyError,
        "groups contain each other: (a -> b -> a|b -> a -> b)",
    ),
    "two groups in each other, and a heap": (
        {
            "groups": {"a": {"of": ["b", "apple"], "count": 1}, "b": {"of": ["a"], "count": 1}},
            "heaps.pile": {"fill": "bowl", "of": ["ball"]},
            "objects.ball": {"asset": "lemon"},
        },
        SceneKeyError,
        "groups contain each other: (a -> b -> a|b -> a -> b)",
    ),
    "a group in two": (
        {"groups.a": {"of": ["meal"], "count": 1}, "groups.b": {"of": ["meal"], "count": 1}},
        SceneKeyError,
        r"groups\.b\.of: 'meal' is also in the group 'a'",
    ),
    "more than there can be": (
        {"objects.pear.if": "tray", "objects.lemon.if": "apple"},
        SceneKeyError,
        r"groups\.sweets\.count: at most 1 of its members can be present together",
    ),
    "a container": (
        {"heaps.pile": {"fill": "tray", "of": ["ball"]}, "objects.ball": {"asset": "lemon"}},
        SceneKeyError,
        r"heaps\.pile\.fill: 'tray' has variants or may be absent",
    ),
    "a container with variants": (
        {"heaps.pile": {"fill": "unit", "of": ["ball"]}, "objects.ball": {"asset": "lemon"}},
        SceneKeyError,
        r"heaps\.pile\.fill: 'unit' has variants or may be absent",
    ),
    "a target": (
        {"objects.spoon.orientation": {"face_to": "tray"}},
        SceneKeyError,
        r"spoon\.orientation\.face_to: 'tray' may be absent\. .*write 'if: tray'.*'missing: drop'",
    ),
    "an anchor with a condition": (
        {"objects.spoon.if": "tray", "objects.book.relations": [{"left_of": "spoon"}]},
        SceneKeyError,
        r"book\.relations\.0\.left_of: 'spoon' may be absent\. .*write 'if: spoon' to place 'book'",
    ),
    "an anchor with variants": (
        {"objects.unit.if": "tray", "objects.book.relations": [{"left_of": "unit"}]},
        SceneKeyError,
        r"book\.relations\.0\.left_of: 'unit' may be absent",
    ),
    "an anchor with variants in a group": (
        {
            "groups.some": {"of": ["unit"], "count": [0, 1], "missing": "drop"},
            "objects.book.relations": [{"left_of": "unit"}],
        },
        SceneKeyError,
        r"left_of: 'unit' may be absent; .* 'missing: drop' has no effect here\. .* or write 'if: unit' to .*'\.$",
    ),
    "a start": (
        {"start": [{"robot": "grasp", "of": "unit"}], "objects.unit.if": "tray", "objects.unit.reachable": True},
        SceneKeyError,
        r"start\.0\.of: 'unit' may be absent",
    ),
    "an unknown key": (
        {"groups.meal.cuont": 1},
        SceneKeyError,
        r"Valid: of, count, missing, weights, splits, if, unless\.$",
    ),
    "no key of a file": ({"groups.meal.by_area": True}, SceneKeyError, r"groups\.meal\.by_area: is no key"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused_with_its_place(name: str):
    """One error each."""
    overrides, error, message = WRONG[name]
    with pytest.raises(error, match=message):
        SceneConfig.load(SCENE, overrides)


def test_a_reference_needs_no_permission_if_presence_implies_presence():
    """By a condition, by the same group as a whole, or by the support."""
    near = {"relations": [{"near": "tray", "distance": {"max": 1}}]}
    for words in ({"if": "tray"}, {"on": "tray"}):
        assert SceneConfig.load(SCENE, {"objects.spoon": {**CAN, **near, **words}}).absent["spoon"] == "spoon"
    SceneConfig.load(SCENE, {"objects.spoon": {**CAN, **near, "if": "book"}, "objects.book.if": "tray"})
    SceneConfig.load(SCENE, {"objects.pear": {**CAN, **near}, "groups.sweets.if": "tray"})


def test_an_object_with_variants_may_be_in_a_group_or_a_stack():
    """As any other object."""
    stack = {"of": ["bowl", "unit", "spoon"], "on": "floor"}
    loose = {"bowl": {"asset": "bowl"}, "unit": {"asset": ["can", "book"]}, "spoon": {"asset": "can"}}
    config = SceneConfig.load({**SCENE, "objects": {**SCENE["objects"], **loose}}, {"stacks.tower": stack})
    assert {config.objects[name].on for name in config.variants["spoon"]} == {"unit/can", "unit/book"}
    config = SceneConfig.load(SCENE, {"groups.some": {"of": ["unit", "book"], "count": 1}})
    assert not config.presence.is_sure("unit")
