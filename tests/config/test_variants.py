"""Objects with variants in scene files: what their words mean, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import Floor
from sceniris_gym.errors import ScenirisError
from tests.config.scenes import TABLE

TARGET = {"variants": {"can": {"asset": "can"}, "mug": {"asset": "mug", "orientation": "stable"}}, "on": "table"}


def with_target(words: dict[str, Any] | None = None, **overrides: Any) -> SceneConfig:
    """Return a scene with an object that has variants."""
    named = {key.replace("__", "."): value for key, value in overrides.items()}
    return SceneConfig.load(TABLE, {"objects.target": words or TARGET, **named})


def test_variants_are_objects_of_a_group():
    """With the words of both levels, of which those of the variant win; one of them is present."""
    words = {**TARGET, "gap": 0.002, "variants": {**TARGET["variants"], "low": {"asset": "can", "inside": "table"}}}
    config = with_target(words)
    assert config.variants == {"target": ("target/can", "target/mug", "target/low")}
    assert config.groups["target"].count == (1, 1)
    can, mug, low = (config.objects[name] for name in config.variants["target"])
    assert (can.asset, can.on, can.gap, can.drawn_orientation.kind) == ("can", "table", 0.002, "yaw")
    assert (mug.asset, mug.drawn_orientation.kind) == ("mug", "stable")
    assert (low.on, low.inside) == (None, "table")


def test_a_list_of_assets_is_short_for_variants():
    """Named after the assets, which say the same as variants written at length."""
    short = with_target({"asset": ["can", "mug"], "on": "table"})
    long = with_target({"variants": {"can": {"asset": "can"}, "mug": {"asset": "mug"}}, "on": "table"})
    assert short.canonical() == long.canonical()


def test_a_pattern_of_files_is_short_for_a_list(tmp_path: Path):
    """All MJCF files of a folder beside the scene, in the order of their names; other files do not count."""
    for name in ("b.xml", "a.xml", "manifest.json"):
        (tmp_path / "things").mkdir(exist_ok=True)
        (tmp_path / "things" / name).write_text("<mujoco/>")
    scene = tmp_path / "scene.yaml"
    scene.write_text("floor: {size: [1, 1]}\nobjects: {target: {asset: things/*, on: floor}}\n")
    config = SceneConfig.load(scene)
    assert config.variants == {"target": ("target/a", "target/b")}
    assert config.objects["target/a"].asset == str(tmp_path / "things" / "a.xml")
    with pytest.raises(ScenirisError, match=r"objects\.target\.asset: .* should match at least one MJCF file"):
        SceneConfig.load(scene, {"objects.target.asset": str(tmp_path / "*")})


def test_what_others_refer_to_is_placed_first():
    """All variants come before an object that is near the one that is there."""
    near = [{"near": "target", "distance": {"max": 0.3}}]
    config = with_target(objects__apple__relations=near)
    assert config.needs("apple") == ("table", "target/can", "target/mug")


def test_overrides_reach_the_words_as_written():
    """Of a scene that was loaded already, too, as often as wanted."""
    config = SceneConfig.load(with_target(), {"objects.target.variants.mug.asset": "bowl"})
    config = SceneConfig.load(config, {"objects.target.gap": 0.003})
    assert [config.objects[name].asset for name in config.variants["target"]] == ["can", "bowl"]
    assert {config.objects[name].gap for name in config.variants["target"]} == {0.003}


def test_overrides_reach_a_single_variant():
    """By its full name, also after another override, and after the variants were written as a list."""
    config = SceneConfig.load(with_target({"asset": ["can", "mug"], "on": "table"}), {"objects.target/can.gap": 0.003})
    config = SceneConfig.load(config, {"objects.apple.gap": 0.002, "objects.target/can.weight": 3})
    assert config.groups["target"].weights == {"target/can": 3.0}
    written = {**TABLE, "objects": {**TABLE["objects"], "target": TARGET}}
    config_of_file = SceneConfig.load(written, {"objects.target/can.gap": 0.003, "objects.target.gap": 0.004})
    assert [config_of_file.objects[name].gap for name in config.variants["target"]] == [0.003, 0.004]
    assert [config.objects[name].gap for name in (*config.variants["target"], "apple")] == [0.003, 0.0005, 0.002]


def test_overrides_keep_the_words_of_parts_made_in_python():
    """Also beside variants, whose words are kept as they were given."""
    objects = {"target": {"asset": ["can", "mug"], "on": "floor"}, "apple": ObjectConfig(asset="apple", on="floor")}
    config = SceneConfig(floor=Floor(size=(1.0, 1.0)), objects=objects)
    assert SceneConfig.load(config, {"objects.apple.gap": 0.002}).objects["apple"].asset == "apple"


def test_a_wrong_word_of_all_variants_is_told_once():
    """At the object, and at the variant if it is its own."""
    with pytest.raises(ScenirisError) as told:
        with_target(objects__target__gap=-1, objects__target__variants__can__clearance=-1)
    places = [line.split(": ")[1] for line in str(told.value).splitlines()]
    assert sorted(places) == ["objects.target.gap", "objects.target/can.clearance"]
    with pytest.raises(ScenirisError) as told:
        with_target(objects__apple__joints={"box/lid": {"vale": 1}, "box/door": {"vale": 1}})
    assert [line.split(": ")[1] for line in str(told.value).splitlines()] == [
        "objects.apple.joints.box/lid.vale",
        "objects.apple.joints.box/door.vale",
    ]


def test_weights_and_splits_are_those_of_the_group():
    """A weight of 1 unless a variant has one; a split of its own takes a variant out of the other."""
    variants = {"can": {"asset": "can", "weight": 3}, "mug": {"asset": "mug", "split": "train"}, "x": {"asset": "bowl"}}
    group = with_target({"variants": variants, "on": "table"}).groups["target"]
    assert group.weights_in("train") == [3.0, 1.0, 1.0]
    assert group.weights_in("eval") == [3.0, 0.0, 1.0]
    assert not group.is_uniform


def test_a_share_is_held_out_by_name():
    """Half of them for the split `eval` alone, the same ones in whatever order; the others for `train` alone."""
    names = ["can", "mug", "bowl", "apple"]
    found = [
        with_target({"asset": order, "on": "table", "holdout": 0.5}).groups["target"] for order in (names, names[::-1])
    ]
    held = [{name for name, split in group.splits.items() if split == "eval"} for group in found]
    assert held[0] == held[1]
    assert len(held[0]) == 2
    assert set(found[0].splits.values()) == {"train", "eval"}


NEAR = {"near": "target/can", "distance": {"max": 0.3}}
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "none": ({"objects.other": {"variants": {}, "on": "table"}}, r"objects\.other\.variants: .*at least one"),
    "a misspelt word": ({"objects.apple.varients": {}}, r"objects\.apple\.varients: .*mean 'variants'"),
    "a misspelt word of one": (
        {"objects.target.variants.can.weigth": 2},
        r"objects\.target/can\.weigth: unknown key\. Did you mean 'weight'",
    ),
    "a word of one for all": (
        {"objects.target.weight": 2},
        r"^scene: objects\.target\.weight: .*given for a single variant.*$",
    ),
    "a word of one for no variant": (
        {"objects.apple.split": "eval"},
        r"objects\.apple\.split: .*given for a single variant",
    ),
    "a misspelt variant": ({"objects.target.variants.cn.weight": 2}, r"unknown variant 'cn'\. Did you mean 'can'"),
    "a variant that is there": (
        {"objects.apple.on": "tabel"},
        r"unknown support 'tabel'.*Valid: bowl, can, floor, mug, p",
    ),
    "an anchor": (
        {"objects.apple.relations": [NEAR | {"near": "targt"}]},
        r"unknown object 'targt'\. Did you mean 'target'\? Valid: bowl, can, mug, post, table, target\.",
    ),
    "no mapping": ({"objects.target": {"variants": ["can"], "on": "table"}}, "should be a mapping of names"),
    "a name": ({"objects.target.variants.a b": {"asset": "can"}}, r"objects\.target\.variants\.a b: .*letters"),
    "a word": ({"objects.target.variants.can.gapp": 1}, r"objects\.target/can\.gapp: unknown key.*'gap'"),
    "two of a name": ({"objects.other": {"asset": ["can", "can"], "on": "table"}}, "two of the name 'can'"),
    "both": ({"objects.target.asset": ["can"]}, r"objects\.target\.asset: .*without 'variants'. .*'target/"),
    "a support": ({"objects.apple.on": "target/lid"}, r"objects\.apple\.on: 'target/lid' is not a member of 'target'"),
    "a variant": (
        {"objects.apple.relations": [NEAR]},
        r"objects\.apple\.relations\.0\.near: .*Name its object 'target'",
    ),
    "itself": ({"objects.target.relations": [NEAR | {"near": "target"}]}, "a different object"),
    "no weights": (
        {"objects.target.variants.can.weight": 0, "objects.target.variants.mug.weight": 0},
        r"objects\.target\.variants: .*a 'weight' above 0 in the split 'train'",
    ),
    "no weights in a split": (
        {"objects.target.variants.can.split": "eval", "objects.target.variants.mug.split": "eval"},
        r"objects\.target\.variants: .*should include a variant that the split 'train' may draw",
    ),
    "variants of a variant": (
        {"objects.target.variants.can.variants": {"tin": {"asset": "tin"}}},
        r"objects\.target\.variants\.can\.variants: .*given for the object 'target'",
    ),
    "two kinds": (
        {"objects.target.variants.mug.kind": "fixture"},
        r"objects\.target\.variants\.mug\.kind: .*should be the same for all variants",
    ),
    "two draws": (
        {"objects.target.variants.mug.randomize": {"mass": {"scale": [0.5, 2]}}},
        r"objects\.target\.variants\.mug\.randomize: .*for all variants.*next to 'variants'.*State\.model_field",
    ),
    "two kinds by the names of variants": (
        {"objects.target/mug.kind": "fixture"},
        r"objects\.target\.variants\.mug\.kind: .*should be the same for all variants",
    ),
    "in a heap": (
        {"heaps.pile": {"of": ["target"], "fill": "can"}},
        r"heaps\.pile\.of: 'target' has variants, so it cannot be in a heap",
    ),
    "one in a group": (
        {"groups.some": {"of": ["target/can"], "count": 1}},
        r"some\.of: 'target/can' is a single variant\. Name its object 'target'",
    ),
    "a share of nothing": (
        {"objects.other": {"holdout": 0.5, "on": "table"}},
        r"other\.holdout: 0\.5 should be given only with",
    ),
    "a negative weight": (
        {"objects.target.variants.can.weight": -1},
        r": objects\.target/can\.weight: .*at least 0",
    ),
    "no split": (
        {"objects.target.variants.can.split": "test"},
        r": objects\.target/can\.split: .*should be 'train' or 'eval'",
    ),
    "all in one split": ({"objects.target.holdout": 1}, r"objects\.target\.holdout: 1 should be above 0"),
    "one that another object trains with": (
        {
            "objects.target.holdout": 0.5,
            "objects.other": {"asset": ["can", "mug", "bowl"], "on": "table"},
            "objects.other/can.split": "train",
            "objects.other/mug.split": "train",
        },
        r"objects\.target: '.*(can|mug).*' is held out here, and a variant of 'other' in training",
    ),
    "one to hold out": ({"objects.other": {"asset": ["can"], "on": "table", "holdout": 0.5}}, "at least two variants"),
    "no place": (
        {"objects.other": {"asset": ["can", "mug"]}},
        r"objects\.other: 'other/can' keeps its pose.*all variants a",
    ),
    "a group": ({"groups.target": {"of": ["can"], "count": 1}}, r"groups\.target: .*another name"),
    "a name with a slash": (
        {"objects.target/x": {"asset": "can", "on": "table"}},
        r"unknown variant 'target/x'.*target/mug",
    ),
    "no asset": (
        {"objects.target.variants.x": {"body": "can"}},
        r"target\.variants: 'x' has no asset\. Give this variant an 'asset'",
    ),
    "no scales": ({"objects.other": {"asset": "can", "scale": [], "on": "table"}}, r"other\.scale: .*list of numbers"),
    "scales of nothing": (
        {"objects.other": {"scale": [1, 2], "on": "table"}},
        r"other\.scale: \[1, 2\] should be given only with an 'asset'",
    ),
    "two of a name by scale": (
        {"objects.target.variants": {"can": {"asset": "can", "scale": [0.8, 1]}, "can-80": {"asset": "can"}}},
        r"target\.variants: 'can-80' should be the name of one variant only",
    ),
    "a word of one that is no mapping": ({"objects.target/can": 3}, r"objects\.target/can: 3 should be a mapping"),
    "no assets": ({"objects.other": {"asset": [], "on": "table"}}, r"other\.asset: \[\] should have at least one"),
    "a scale beyond all floats": (
        {"objects.other": {"asset": "can", "scale": [1, 10**400], "on": "table"}},
        r"other\.scale: .* should be from 0\.01 to 100",
    ),
    "a scale": ({"objects.other": {"asset": "can", "scale": ["big"], "on": "table"}}, "a list of numbers"),
    "a part that a variant lacks": (
        {"objects.target.parts": {"lid": {"can": "top"}}},
        r"objects\.target\.parts\.lid: .*should have a joint for 'mug', null if it has none, or .*'default'",
    ),
    "a part of no variant": (
        {"objects.target.parts": {"lid": {"default": "top", "cn": "top"}}},
        r"objects\.target\.parts\.lid\.cn: 'top' .*its key names no variant\. Did you mean 'can'",
    ),
    "a variant of an object without variants": (
        {"objects.apple.parts": {"lid": {"default": "top", "can": "top"}}},
        r"objects\.apple\.parts\.lid\.can: .*names no variant",
    ),
    "a part that is a number": ({"objects.target.parts": {"lid": 3}}, r"parts\.lid: 3 should be a mapping of names"),
    "a joint that is a number": (
        {"objects.target.parts": {"lid": {"default": 3}}},
        r"parts\.lid\.default: 3 should be a name",
    ),
    "the name of a part": ({"objects.target.parts": {"a b": "top"}}, r"parts\.a b: .*should be a name of letters"),
}


def test_a_part_has_a_joint_for_each_variant():
    """The variant's name goes before patterns, and patterns before `default`; a variant may have its own."""
    parts = {"lid": {"default": "top", "m*": "flap", "mug": "cover", "can": None}, "door": "door_*"}
    config = with_target({"asset": ["can", "mug", "bowl", "milk"], "on": "table", "parts": parts})
    joints = [config.objects[f"target/{name}"].joint_of("lid", name) for name in ("can", "mug", "bowl", "milk")]
    assert joints == [None, "cover", "top", "flap"]
    assert config.objects["target/mug"].joint_of("door", "mug") == "door_*"
    own = SceneConfig.load(config, {"objects.target/can": {"parts": {"lid": "cap"}}})
    assert own.objects["target/can"].joint_of("lid", "can") == "cap"
    without = config.without(["target/mug"])
    assert [part.joint_of("lid", name[7:]) for name, part in without.objects.items() if name[:7] == "target/"] == [
        None,
        "top",
        "flap",
    ]


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_refused_with_its_place(name: str):
    """One error each, which says what would be right."""
    overrides, message = WRONG[name]
    with pytest.raises(ScenirisError, match=message):
        SceneConfig.load(with_target(), overrides)
