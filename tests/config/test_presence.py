"""Conclusions from groups and conditions that hold in every layout, against layouts enumerated from the words."""

from __future__ import annotations

import copy
import pickle
from itertools import permutations
from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from tests.oracle.presence import outcomes

CAN = {"asset": "can", "on": "floor"}
SCENES: dict[str, dict[str, Any]] = {
    "conditions": {
        "objects": {
            **dict.fromkeys("abc", CAN),
            "d": {**CAN, "if": "a"},
            "e": {**CAN, "if": ["d", "c"]},
            "f": {**CAN, "unless": "d"},
            "g": {**CAN, "if": "some", "unless": "b"},
        },
        "groups": {"some": {"of": ["a", "b"], "count": [0, 1]}, "more": {"of": ["c"], "count": [0, 1]}},
    },
    "towers": {
        "objects": {
            "a": CAN,
            "b": {**CAN, "on": "a"},
            "c": {"asset": "can", "in": "b"},
            "d": {**CAN, "on": {"a": 1, "e": 2}},
            "e": CAN,
            "f": {**CAN, "on": "d"},
        },
        "groups": {"some": {"of": ["a", "e"], "count": [0, 2]}},
    },
    "a group on its neighbour": {
        "objects": {**dict.fromkeys("abcd", CAN), "e": {**CAN, "on": "a"}, "f": {**CAN, "if": "sweets"}},
        "groups": {
            "meal": {"of": ["a", "b"], "count": 1},
            "sweets": {"of": ["c", "d"], "count": [0, 2], "if": "a"},
            "guests": {"of": ["meal", "sweets"], "count": [1, 2]},
        },
    },
    "groups of groups": {
        "objects": {**dict.fromkeys("abcde", CAN), "f": {**CAN, "if": "outer"}},
        "groups": {
            "outer": {"of": ["one", "two"], "count": 1, "if": "e"},
            "one": {"of": ["a", "b"], "count": 2},
            "two": {"of": ["c", "d"], "count": [1, 2]},
            "some": {"of": ["e"], "count": [0, 1]},
        },
    },
    "variants": {
        "objects": {
            "a": {"asset": ["can", "mug"], "on": "floor"},
            "b": {**CAN, "on": "a"},
            "c": {**CAN, "if": "a/mug"},
            "d": {"asset": ["can", "mug"], "on": "floor", "unless": "c"},
        },
    },
}


@pytest.mark.parametrize("name", SCENES)
def test_conclusions_hold_in_every_layout(name: str):
    """An object never goes without another that it implies, or together with one that it excludes."""
    config = SceneConfig.load({"floor": {"size": [2, 2]}, **SCENES[name]})
    sets = [{owner for owner, _, _ in items} for items in outcomes(SCENES[name])]
    objects, presence, found = SCENES[name]["objects"], config.presence, 0
    for one, other in permutations(objects, 2):
        together = [other in there for there in sets if one in there]
        members = config.variants.get(one, (one,))
        implied = all(presence.implies(member, other) for member in members)
        assert not implied or all(together)
        assert presence.conflict(presence.key(one), presence.key(other)) is None or not any(together)
        found += implied
    assert found >= 3
    for one in objects:
        assert presence.is_sure(one) == all(one in there for there in sets)
        absent = {member in config.absent for member in config.variants.get(one, (one,))}
        assert not presence.is_sure(one) or one in config.variants or absent == {False}


def test_groups_may_be_nested_deeply():
    """Each is followed once: each of two ways at each level would be 2^60."""
    groups = {f"g{i}": {"of": [f"g{i - 1}" if i else "a"], "count": 1} for i in range(60)}
    objects = {"a": CAN, "b": {**CAN, "if": "g59"}}
    config = SceneConfig.load({"floor": {"size": [2, 2]}, "objects": objects, "groups": groups})
    assert config.presence.implies("b", "a")
    assert config.presence.must("groups.g59") == {"a", *config.presence.groups}


def test_what_a_member_stands_on_is_implied():
    """A banana on either variant of a unit implies the unit, so it may refer to it."""
    unit = {"asset": ["can", "book"], "on": "floor", "if": "lamp"}
    near = {"relations": [{"near": "unit", "distance": {"max": 0.5}}]}
    objects = {"lamp": CAN, "unit": unit, "banana": {"asset": "banana", "on": "unit", **near}}
    groups = {"some": {"of": ["lamp"], "count": [0, 1]}}
    config = SceneConfig.load({"floor": {"size": [2, 2]}, "objects": objects, "groups": groups})
    assert all(config.presence.implies(name, "lamp") for name in config.variants["banana"])


def test_an_object_whose_variants_are_divided_among_the_splits_is_sure():
    """Others may refer to it if each split has some. If a condition binds all of one split, it may be absent."""
    variants: dict[str, dict[str, Any]] = {"can": {**CAN, "split": "train"}, "mug": {"asset": "mug", "split": "eval"}}
    unit = {"on": "floor", "variants": variants}
    near = {"relations": [{"near": "unit", "distance": {"max": 0.5}}]}
    scene: dict[str, Any] = {
        "floor": {"size": [2, 2]},
        "objects": {"lamp": CAN, "unit": unit, "spoon": {**CAN, **near}},
    }
    assert SceneConfig.load(scene).presence.is_sure("unit")
    variants["mug"]["if"] = "lamp"
    scene["groups"] = {"some": {"of": ["lamp"], "count": [0, 1]}}
    with pytest.raises(SceneKeyError, match="'unit' may be absent"):
        SceneConfig.load(scene)


def test_draws_come_after_those_they_depend_on():
    """Groups first, as they are in the file; each condition is one more draw."""
    config = SceneConfig.load({"floor": {"size": [2, 2]}, **SCENES["groups of groups"]})
    draws = [*config.presence.draws]
    assert draws == ["groups.outer", "groups.one", "groups.two", "groups.some", "if f", "if groups.outer"]
    order = [draws[i] for i in config.presence.order]
    assert order.index("groups.some") < order.index("if groups.outer") < order.index("groups.outer")
    assert order.index("groups.outer") < min(order.index("groups.one"), order.index("groups.two"))
    assert max(order.index("groups.one"), order.index("groups.two")) < order.index("if f")
    assert config.presence.has_conditions
    plain = SceneConfig.load(
        {"floor": {"size": [2, 2]}, "objects": {"a": CAN}, "groups": {"g": {"of": ["a"], "count": 0}}}
    )
    assert not plain.presence.has_conditions


def test_a_scene_is_copied_and_pickled_with_its_conclusions():
    """Also after conclusions were drawn and kept."""
    config = SceneConfig.load({"floor": {"size": [2, 2]}, **SCENES["conditions"]})
    assert config.presence.implies("e", "a")
    for again in (pickle.loads(pickle.dumps(config)), copy.deepcopy(config)):
        assert again.presence.draws == config.presence.draws
        assert again.presence.implies("e", "a")
