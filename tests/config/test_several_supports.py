"""Objects on one of several supports, as words: their members, their weights, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ScenirisError

SCENE: dict[str, Any] = {
    "floor": {"size": [3, 3]},
    "objects": {
        "table": {"asset": "table", "kind": "fixture", "on": "floor"},
        "shelf": {"asset": "cabinet", "kind": "fixture", "on": "floor"},
        "unit": {"asset": ["tin", "plate"], "kind": "fixture", "on": "table"},
        "goal": {"kind": "marker", "on": "floor"},
        "mug": {"asset": "mug", "on": "floor", "orientation": "stable"},
    },
}


def supports(config: SceneConfig, name: str) -> dict[str, tuple[str, float]]:
    """Return the support and the weight of each member of an object."""
    group, found = config.groups[name], {}
    for member, weight in zip(group.of, group.weights_in("train"), strict=True):
        support = config.objects[member].support
        assert support is not None
        found[member] = (support.parent, weight)
    return found


def placed(**words: Any) -> SceneConfig:
    """Return the scene with an apple that has these words."""
    return SceneConfig.load(SCENE, {"objects.apple": {"asset": "apple", **words}})


def placed_with(groups: dict[str, Any], **words: Any) -> SceneConfig:
    """Return the scene with such an apple and these groups."""
    return SceneConfig.load({**SCENE, "groups": groups}, {"objects.apple": {"asset": "apple", **words}})


def test_a_list_is_by_area_and_a_mapping_by_weight():
    """A member on each; a weight of 0 is none."""
    config = placed(on=["table", "floor"])
    assert supports(config, "apple") == {"apple/@table": ("table", 1.0), "apple/@floor": ("floor", 1.0)}
    assert config.groups["apple"].by_area
    config = placed(**{"in": {"table": 2, "shelf/upper_drawer": 0.5, "floor": 0}})
    assert supports(config, "apple") == {
        "apple/@table": ("table", 2.0),
        "apple/@shelf:upper_drawer": ("shelf/upper_drawer", 0.5),
    }
    assert not config.groups["apple"].by_area
    assert {config.objects[name].in_ for name in config.groups["apple"].of} == {"table", "shelf/upper_drawer"}


def test_a_support_with_variants_stands_for_whichever_is_there():
    """Alone or among others; a single variant may be named, too."""
    assert supports(placed(on="unit"), "apple") == {
        "apple/@unit:tin": ("unit/tin", 1.0),
        "apple/@unit:plate": ("unit/plate", 1.0),
    }
    both = supports(placed(on={"unit": 3, "table": 1}), "apple")
    assert dict(both.values()) == {"unit/tin": 3.0, "unit/plate": 3.0, "table": 1.0}
    config = placed(on="unit/tin")
    assert (config.objects["apple"].on, config.absent["apple"]) == ("unit/tin", "apple")


def test_variants_and_supports_multiply():
    """Weights and splits are those of the variants, times those of the supports."""
    variants = {"can": {"asset": "can", "weight": 2}, "mug": {"asset": "mug", "split": "train"}}
    config = SceneConfig.load(SCENE, {"objects.thing": {"variants": variants, "on": {"table": 3, "floor": 1}}})
    found = {member: weight for member, (_, weight) in supports(config, "thing").items()}
    assert found == {"thing/can@table": 6.0, "thing/can@floor": 2.0, "thing/mug@table": 3.0, "thing/mug@floor": 1.0}
    assert set(config.groups["thing"].splits) == {"thing/mug@table", "thing/mug@floor"}
    assert config.key("thing/can@table") == "objects.thing/can"
    assert placed(on=["table", "floor"]).key("apple/@table") == "objects.apple"


def test_what_is_on_an_object_with_several_supports_has_a_member_for_each():
    """A tower follows its foot, and a condition may name a variant that has several members."""
    objects = {
        "thing": {"asset": ["can", "book"], "on": ["table", "floor"]},
        "leaf": {"asset": "apple", "on": "thing"},
        "mark": {"asset": "apple", "on": "floor", "if": "thing/book"},
    }
    config = SceneConfig.load(SCENE, {f"objects.{name}": part for name, part in objects.items()})
    assert [parent for parent, _ in supports(config, "leaf").values()] == list(config.groups["thing"].of)
    terms = config.presence.terms("mark")
    assert [term.of for term in terms] == [("thing/book@table", "thing/book@floor")]


def test_conditions_of_an_object_with_members_are_those_of_its_group():
    """So that another group can tell whether the object can be there."""
    config = placed(on=["table", "floor"], **{"if": "mug"})
    assert config.groups["apple"].if_ == ("mug",)
    assert all(not config.objects[name].if_ for name in config.groups["apple"].of)


def test_a_scene_is_read_again_as_it_was():
    """Also with overrides, and objects made in Python."""
    config = placed(on=["table", "floor"])
    assert SceneConfig.load(config, {"attempts": 3}).groups == config.groups
    assert SceneConfig.load(config, {"objects.apple.on": "table"}).objects["apple"].on == "table"
    parts = {name: ObjectConfig(**part) for name, part in SCENE["objects"].items() if name != "unit"}
    assert SceneConfig(floor={"size": (3, 3)}, objects=parts).objects["mug"].on == "floor"


BOOK = {"asset": "book", "on": "table"}
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no support": ({"on": []}, r"objects\.apple\.on: \[\] should be a support, a list of supports, or"),
    "no names": ({"on": ["table", 1]}, r"objects\.apple\.on: \['table', 1\] should be a support, a list"),
    "one twice": ({"in": ["table", "table"]}, r"apple\.in: \['table', 'table'\] should name each support once"),
    "no weight": ({"on": {"table": "much"}}, r"apple\.on: .* should have a weight of at least 0 for each"),
    "a negative weight": ({"on": {"table": -1, "floor": 1}}, r"apple\.on: .* should have a weight of at least 0"),
    "weights of 0": ({"on": {"table": 0, "floor": 0}}, r"apple\.on: .* should have a weight above 0"),
    "a typo": ({"on": ["table", "flor"]}, r"objects\.apple\.on: unknown support 'flor'.*'floor'"),
    "a typo among objects with variants": ({"on": ["table", "unti"]}, r"unknown support 'unti'. Did you mean 'unit'\?"),
    "any of two": (
        {"on": {"any": ["table", "shelf"]}},
        r"should have a weight .* for each support, or be {any: OBJECT}",
    ),
    "no name in a mapping": ({"on": {3: 1}}, r"apple\.on: \{3: 1\} should be a support, a list of supports, or"),
    "a marker": ({"on": ["table", "goal"]}, r"objects\.apple\.on: 'goal' is a marker"),
    "what may lie": ({"on": ["table", "mug"]}, r"objects\.apple\.on: 'mug' may lie on its side"),
    "no asset": ({"asset": None, "on": ["table", "floor"]}, r"objects\.apple: has several supports but has no asset"),
    "too many": ({"scale": [0.5 + 0.001 * i for i in range(600)], "on": ["table", "floor"]}, "at most 1,000 supports"),
    "itself": ({"on": ["table", "apple"]}, r"objects\.apple: .* should not be on or in an object that is"),
    "variants on different supports": (
        {"asset": None, "variants": {"a": {"asset": "can", "on": ["table", "floor"]}, "b": BOOK}},
        r"objects\.apple: .* should have the same supports for all variants",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused_with_its_place(name: str):
    """One error each, which says what would be right."""
    words, message = WRONG[name]
    with pytest.raises(ScenirisError, match=message):
        placed(**words)


@pytest.mark.parametrize("group", [{"of": ["mug"], "count": 1}, {}, 3, ["mug"]])
def test_a_group_of_the_same_name_is_refused(group: Any):
    """The members are in a group of the object's name. It may be written wrongly, too."""
    with pytest.raises(ScenirisError, match=r"groups\.apple: .* should have another name"):
        placed_with({"apple": group}, on=["table", "floor"])


@pytest.mark.parametrize("name", ["a/b", "a@b", 3, "shelf/b"])
def test_a_name_that_is_no_name_is_refused(name: Any):
    """At its place among the objects, as for an object on one support."""
    objects = {**SCENE["objects"], name: {"asset": "apple", "on": ["table", "floor"]}}
    with pytest.raises(ScenirisError, match=rf"objects\.{name}: .* should be a name of letters"):
        SceneConfig.load({**SCENE, "objects": objects})


def test_any_stands_for_the_root_until_bodies_are_known():
    """Alone or in a list, and then for all bodies that the model has."""
    config = placed(on=["table", {"any": "shelf"}])
    assert [parent for parent, _ in supports(config, "apple").values()] == ["table", "shelf"]
    assert config.any_supports == {("shelf", "on")}
    known = config.with_bodies({("shelf", "on"): ["shelf", "shelf/drawer"]})
    assert [parent for parent, _ in supports(known, "apple").values()] == ["table", "shelf", "shelf/drawer"]
    assert known.groups["apple"].by_area
    assert known.any_supports == set()
    assert [parent for parent, _ in supports(placed(on={"any": "unit"}), "apple").values()] == [
        "unit/tin",
        "unit/plate",
    ]
