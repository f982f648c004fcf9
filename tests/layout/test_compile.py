"""`compile_scene`: what a CompiledScene holds, and what cannot be supported, each with its own error and reason."""

from __future__ import annotations

import re
import warnings
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import (
    ArgumentError,
    FallbackWarning,
    InfeasibleSceneError,
    MeshError,
    NotSupportedError,
    SceneKeyError,
    ScenirisError,
    UnknownNameError,
)
from sceniris_gym.layout.compile import compile_scene, device_name
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.device import Program
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import ANYWHERE, FLOOR, bank_rows, box_mjcf, compile_on_cpu, make, valid, write_mjcf

TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("device", [torch.device("cpu"), wp.get_device("cpu"), "cpu"], ids=["torch", "warp", "name"])
def test_a_device_is_given_in_any_way(crate: dict[str, Any], device: Any):
    """As torch or Warp has it, or by its name."""
    assert compile_scene({"floor": FLOOR, "objects": {"crate": crate}, "bank": 1}, device).device == "cpu"


@pytest.mark.parametrize("device", [5, [], "abacus"])
def test_what_is_no_device_is_refused(crate: dict[str, Any], device: Any):
    """With those that there are."""
    with pytest.raises(UnknownNameError, match=r"compile_scene: unknown device .* Valid: .*cpu"):
        compile_scene({"floor": FLOOR, "objects": {"crate": crate}}, device)


def test_a_computer_without_a_gpu_is_named_as_the_reason(monkeypatch: pytest.MonkeyPatch):
    """If a GPU is asked for."""
    monkeypatch.setattr("warp.is_cuda_available", lambda: False)
    with pytest.raises(UnknownNameError, match=r"unknown device 'cuda:99'\. Valid: .*cpu \(no GPU was found\)"):
        device_name("cuda:99")


@pytest.fixture
def crate(tmp_path: Path) -> dict[str, Any]:
    """Return a crate of 5 cm that stands on the floor."""
    return {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05), "on": "floor"}


def _mesh(folder: Path, text: str) -> str:
    (folder / "part.obj").write_text(text)
    return write_mjcf(
        folder,
        "thing",
        '<geom name="shell" type="mesh" mesh="part"/>',
        '<asset><mesh name="part" file="part.obj"/></asset>',
    )


def _refused(scene: dict, error: type[ScenirisError], *words: str) -> ScenirisError:
    """Build a scene that must fail with an error whose message has all the words."""
    with pytest.raises(error) as caught:
        compile_on_cpu(scene)
    assert type(caught.value) is error
    assert all(word in str(caught.value) for word in words), str(caught.value)
    return caught.value


def test_every_way_to_name_a_scene_gives_the_same_world(tmp_path: Path):
    """A shipped name, its path, its mapping, its config and its model: one hash, one bank, one order."""
    path = tmp_path / "mine.yaml"
    path.write_text("base: mid\n")
    config = SceneConfig.load("mid")
    worlds = [compile_scene(scene, "cpu") for scene in ("mid", path, {"base": "mid"}, config, build_model(config))]
    first = worlds[0]
    for compiled in worlds:
        assert compiled.hash == first.hash
        assert (compiled.bank.qpos.numpy() == first.bank.qpos.numpy()).all()
        assert compiled.object_names == compiled.placed == ("cabinet", "apple", "banana")
        assert compiled.device == "cpu"
        assert (bank_rows(compiled, "train"), bank_rows(compiled, "eval")) == (slice(0, 64), slice(64, 128))


def test_overrides_change_parts_of_a_scene():
    """As `SceneConfig.load` does. A SceneModel is refused, because it is built already."""
    changes = {"bank": 3, "objects.apple.clearance": 0.01}
    compiled = compile_scene("mid", "cpu", overrides=changes, cache=False)
    assert compiled.config.bank == 3
    assert compiled.hash == build_model("mid", changes).hash
    with pytest.raises(ArgumentError, match="overrides should be None for a SceneModel"):
        compile_scene(build_model("mid"), "cpu", overrides=changes)


def test_a_world_is_frozen():
    """Nothing of it can be set again."""
    compiled = compile_on_cpu("mid", bank=3)
    assert (bank_rows(compiled, "train"), bank_rows(compiled, "eval")) == (slice(0, 3), slice(3, 6))
    with pytest.raises(FrozenInstanceError):
        compiled.device = "cuda:0"  # pyrefly: ignore[read-only]


@pytest.mark.parametrize("scene", ["mid", {"objects": {}}], ids=["mid", "nothing"])
@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_every_field_of_the_device_program_is_set(scene: str | dict, geometry: str):
    """Arrays that nobody filled would be null pointers in a kernel; float arrays hold numbers only."""
    compiled = compile_on_cpu(scene, {"geometry": geometry})
    for name, field in Program.vars.items():  # pyrefly: ignore[missing-attribute]
        if wp.types.is_array(field.type):
            values = getattr(compiled.program, name)
            assert values is not None, name
            assert values.dtype == field.type.dtype, name
            assert values.ndim == field.type.ndim, name
            assert np.isfinite(values.numpy().astype(float)).all(), name


def test_many_fallbacks_are_told_with_what_cures_them(crate: dict):
    """A crowded tray: the share, the object, the cause and the words; each of these words brings silence."""
    one = {**crate, "orientation": "fixed", "region": {"box": [[-0.05, -0.05], [0.05, 0.05]]}}
    scene = {"floor": FLOOR, "objects": {"a": one, "b": one}, "attempts": 1, "restarts": 0}
    with pytest.warns(FallbackWarning) as told:
        compiled = compile_on_cpu(scene)
    warning = told[0].message
    assert isinstance(warning, FallbackWarning)
    rows = make(compiled, 2000)
    assert warning.share == pytest.approx((rows.status == LayoutStatus.FALLBACK).mean(), abs=0.1)
    assert (warning.name, warning.cause) == ("b", "collision")
    for words in ("'restarts' above 0", "'attempts: auto'", "a larger region for 'b'", "a 'bank' above 64"):
        assert words in str(warning)
    assert told[0].filename == compile_on_cpu.__code__.co_filename  # where compile_scene was called
    for words in ({"restarts": 30}, {"attempts": "auto"}, {"objects.b.region": {"box": [[0.1, 0.1], [0.2, 0.2]]}}):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            compile_on_cpu(scene, words)


def test_a_tight_relation_is_among_the_cures(tmp_path: Path):
    """Two crates whose centres are hardly farther apart than they are wide; a wider ring brings silence."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.2, 0.2, 0.2), "on": "floor", "orientation": "fixed"}
    near = {**crate, "relations": [{"near": "a", "distance": {"max": 0.22}}]}
    scene = {"floor": {"size": [4, 4]}, "objects": {"a": crate, "b": near}, "attempts": 2, "restarts": 1}
    with pytest.warns(FallbackWarning, match=r"a larger region for 'b', or a wider 'near a, at most 0\.22 m'"):
        compile_on_cpu(scene)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compile_on_cpu(scene, {"objects.b.relations": [{"near": "a", "distance": {"max": 1.5}}]})


def test_a_bank_that_is_not_full_is_told_instead_of_a_larger_one(tmp_path: Path):
    """Three crates that fill their floor: of a thousand layouts few are found, and asking for more gives no more."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.2, 0.2, 0.2), "on": "floor", "ratio_on_support": 1.0}
    scene = {"floor": {"size": [0.5, 0.5]}, "objects": {"a": crate, "b": crate, "c": crate}, "attempts": 3}
    with pytest.warns(FallbackWarning) as told:
        compiled = compile_on_cpu({**scene, "restarts": 1, "bank": 1000})
    warning = told[0].message
    assert isinstance(warning, FallbackWarning)
    rows = [bank_rows(compiled, split) for split in ("train", "eval")]
    found = min(r.stop - r.start for r in rows)
    assert warning.held == (found, 1000)
    assert f"the bank holds {found} of 1000" in str(warning)
    assert "'bank' above" not in str(warning)
    assert "'restarts' above 1" in str(warning)


def test_restarts_for_what_no_attempt_cures_are_blamed_on_it(tmp_path: Path, crate: dict):
    """A lid that leans half of the time: `auto` is no cure for an empty region, and is not proposed."""
    body = """<geom type="box" size=".2 .2 .01"/>
      <body name="lid" pos="0 0 .3"><joint name="lid" axis="1 0 0" range="-90 90"/>
        <geom type="box" size=".1 .1 .005"/></body>"""
    lid = {"lid": {"choice": [0.0, 1.0]}}
    rack = {"asset": write_mjcf(tmp_path, "rack", body), "kind": "fixture", "on": "floor", "joints": lid}
    thing = {**crate, "on": "rack/lid", "stands": False}
    scene = {"floor": FLOOR, "objects": {"rack": rack, "crate": thing}, "restarts": 0}
    with pytest.warns(FallbackWarning, match=r"'crate' \(empty\)") as told:
        compile_on_cpu(scene)
    assert "auto" not in str(told[0].message)


def test_an_unknown_device_is_refused_with_those_there_are():
    """Before the scene is looked at."""
    with pytest.raises(UnknownNameError, match=r"unknown device 'cuda:99'.*cpu"):
        compile_scene("mid", "cuda:99")


def test_relations_that_cut_a_region_too_finely_are_refused(crate: dict):
    """Four thin rings around one anchor make more pieces than a number of 32 bits holds."""
    ring = {"near": "a", "distance": {"equal": 3.0, "tolerance": 1e-4}}
    objects = {"a": {**crate, "on": "floor"}, "b": {**crate, "on": "floor", "relations": [ring] * 4}}
    _refused({"floor": FLOOR, "objects": objects}, SceneKeyError, "objects.b.relations", "pieces")


def test_object_names_are_in_the_order_of_the_file_and_placed_in_that_of_placement():
    """Children that are written before their parents are placed after them."""
    objects = {
        "apple": {"asset": "apple", "on": "table"},
        "table": {"asset": "table", "kind": "fixture", "on": "floor"},
        "goal": {"kind": "marker", "region": {"box": ANYWHERE}},
        "wall": {"asset": "cabinet", "kind": "static", "joints": {"upper": {"value": 0.1}}},
    }
    robot = {"asset": "panda", "base": [3, 0, 0], "joints": {"*": {"noise": 0.01}}}
    compiled = compile_on_cpu({"floor": {"size": [4, 4]}, "objects": objects, "robot": robot})
    assert compiled.object_names == ("apple", "table", "goal", "wall")
    assert compiled.placed == ("robot", "wall", "table", "apple", "goal")


@pytest.mark.parametrize("robot", [None, {"asset": "panda"}, {"asset": "panda", "joints": {"*": {"noise": 0.1}}}])
@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_scene_without_objects_is_a_scene(robot: dict | None, geometry: str):
    """Nothing, a robot at rest, and a robot with drawn joints: valid at the first attempt."""
    scene = {"floor": FLOOR, "objects": {}, "geometry": geometry, **({"robot": robot} if robot else {})}
    compiled = compile_on_cpu(scene)
    rows = make(compiled, 30)
    assert (rows.status == LayoutStatus.VALID).all()
    if robot is None or "joints" not in robot:
        assert (rows.qpos == compiled.home_qpos).all()
        assert (rows.attempts == 0).all()


@pytest.mark.parametrize("word", ["on", "in", "inside"])
@pytest.mark.parametrize("parent", ["pear", "banana"])
def test_a_parent_without_a_level_surface_is_refused(parent: str, word: str, crate: dict):
    """Fruit carries nothing: the message names the parent and where it was named."""
    objects = {parent: {"asset": parent, "on": "floor"}, "crate": {"asset": crate["asset"], word: parent}}
    _refused({"floor": FLOOR, "objects": objects}, SceneKeyError, f"objects.crate.{word}", f"'{parent}'")


def test_a_support_that_is_eroded_to_nothing_is_refused_and_never_a_pose_at_the_origin(tmp_path: Path, crate: dict):
    """A table of 80 x 100 cm under a box of 85 x 95 cm at ratio 1; and regions beside, and without area."""
    wide = {"asset": box_mjcf(tmp_path, "wide", 1.05, 0.85, 0.1), "on": "table", "ratio_on_support": 1.0}
    table = {"asset": "table", "kind": "static"}
    _refused({"objects": {"table": table, "wide": wide}}, SceneKeyError, "objects.wide.on", "ratio_on_support")
    regions: list[dict] = [
        {"box": [[0.6, 0.6], [0.9, 0.9]]},
        {"box": [[0.1, 0.1], [0.1, 0.3]]},
        {"polygon": [[5, 5], [6, 5], [5, 6]]},
        {"fraction": [[0.5, 0.0], [0.5, 1.0]]},
    ]
    for region in regions:
        scene = {"floor": FLOOR, "objects": {"crate": {**crate, "region": region}}}
        _refused(scene, SceneKeyError, "objects.crate.on", "cropping to the region", "[-0.5, 0.5]")
    both = {**crate, "region": {"box": [[0.49, 0.49], [0.5, 0.5]]}, "ratio_on_support": 1.0}
    says = "erosion by 0.025 m and cropping to the region"
    _refused({"floor": FLOOR, "objects": {"crate": both}}, SceneKeyError, says)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_an_infeasible_scene_names_the_object_and_the_cause(crate: dict, geometry: str):
    """A crate that must stand where the cabinet is."""
    objects = {
        "apple": {"asset": "apple", "on": "floor"},
        "cabinet": {"asset": "cabinet", "kind": "static"},
        "crate": {**crate, "region": {"box": [[-0.01, -0.15], [0.01, -0.14]]}},
    }
    scene = {"floor": FLOOR, "geometry": geometry, "objects": objects}
    error = _refused(scene, InfeasibleSceneError, "'crate'", "collision", "crate: collision")
    assert isinstance(error, InfeasibleSceneError)
    assert (error.name, error.cause) == ("crate", "collision")
    assert error.counts["crate"]["collision"] > error.counts["apple"]["collision"] > 0
    assert error.counts["crate"]["overhead"] == error.counts["crate"]["footprint"] == 0


def test_the_object_that_cannot_be_placed_is_blamed_and_not_the_one_that_is_hard(tmp_path: Path, crate: dict):
    """The first crate finds its narrow place seldom and fails most passes; the second one never can."""
    post = {"asset": box_mjcf(tmp_path, "post", 0.5, 0.5, 0.5), "kind": "static"}
    objects = {
        "post": post,
        "hard": {**crate, "region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}},
        "never": {**crate, "region": {"box": [[-0.2, -0.2], [0.2, 0.2]]}},
    }
    error = _refused({"floor": FLOOR, "objects": objects, "attempts": 5}, InfeasibleSceneError, "'never'")
    assert isinstance(error, InfeasibleSceneError)
    assert error.counts["hard"]["collision"] > error.counts["never"]["collision"]


def test_an_object_that_was_hardly_ever_tried_is_not_blamed():
    """The mug and its variant are tried in the few worlds in which the bottle fits, and fail there, too."""
    tight = {"on": "floor", "clearance": 0.01}
    thing = {"on": "floor", "variants": {"mug": {"asset": "mug"}, "can": {"asset": "can"}}}
    assets = {"can": "can", "bar": "brick", "bottle": "bottle"}
    objects = {name: {"asset": asset, **tight} for name, asset in assets.items()} | {"thing": thing}
    says = ("'bottle' could not be placed", "Most often in its way: geom 'bottle/body' of body 'bottle' and geom")
    error = _refused({"floor": {"size": [0.08, 0.08]}, "objects": objects}, InfeasibleSceneError, *says)
    assert isinstance(error, InfeasibleSceneError)
    tried = {name: error.counts[name]["collision"] for name in ("bottle", "thing/mug", "thing/can")}
    assert tried["bottle"] > 100 * max(tried["thing/mug"], tried["thing/can"]) > 0
    assert error.name in error.in_the_way


def test_a_footprint_that_never_fits_is_the_cause_that_is_named(tmp_path: Path):
    """A long bar whose width passes the erosion of a round table, but whose length does not fit on it."""
    disc = write_mjcf(tmp_path, "disc", '<geom type="cylinder" size=".1 .02" pos="0 0 .02"/>')
    bar = {"asset": box_mjcf(tmp_path, "bar", 0.5, 0.02, 0.02), "on": "disc", "ratio_on_support": 1.0}
    objects = {"disc": {"asset": disc, "kind": "static"}, "bar": bar}
    _refused({"objects": objects}, InfeasibleSceneError, "'bar'", "footprint")


@pytest.mark.parametrize(("word", "where"), [("inside", "bowl"), ("on", "cabinet/upper_drawer")])
def test_a_word_that_the_roof_rules_out_is_told_with_one_that_it_does_not(word: str, where: str):
    """Nothing is above the floor of a bowl, and nothing is open in a drawer that is shut."""
    owner = where.split("/")[0]
    objects = {owner: {"asset": owner, "kind": "static"}, "block": {"asset": "block", word: where}}
    _refused({"objects": objects}, InfeasibleSceneError, "mostly because of overhead", "Use 'in' to accept both")


EASY = {"asset": "apple", "on": "floor"}
NEVER = {"asset": "block", "on": "cabinet/upper_drawer"}
"""A place below a roof, as the drawer is shut."""


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ({"x": {"variants": {"easy": EASY, "never": NEVER}}}, None),
        ({"x": {"variants": {"easy": EASY, "never": {**NEVER, "weight": 1e-5}}}}, None),
        ({"x": {"variants": {"easy": EASY, "never": {**NEVER, "split": "eval"}}}}, None),
        ({"never": NEVER, "easy": EASY}, [0, 1]),
    ],
    ids=["variant", "hardly ever drawn", "drawn in eval", "member"],
)
def test_what_may_be_drawn_and_is_never_possible_is_refused(words: dict, count: list[int] | None):
    """By its key and the cause, however seldom it is drawn: its worlds would get another thing from the bank."""
    cabinet = {"cabinet": {"asset": "cabinet", "kind": "static"}}
    groups = {} if count is None else {"g": {"of": [*words], "count": count}}
    scene = {"floor": FLOOR, "objects": {**cabinet, **words}, "groups": groups}
    error = _refused(scene, InfeasibleSceneError, ": no valid layout was found: ", "mostly because of overhead")
    assert isinstance(error, InfeasibleSceneError)
    name = "x/never" if count is None else "never"
    assert (error.where, error.name, error.cause) == (f"scene: objects.{name}", name, "overhead")


def test_a_variant_that_leaves_no_room_is_named_beside_what_it_leaves_none_for(tmp_path: Path, crate: dict):
    """It is placed itself, and the crate after it never is."""
    middle = {"on": "floor", "region": {"box": [[-0.1, -0.1], [0.1, 0.1]]}}
    variants = {"small": {"asset": crate["asset"]}, "wide": {"asset": box_mjcf(tmp_path, "wide", 0.5, 0.5, 0.1)}}
    objects = {"thing": {**middle, "variants": variants}, "crate": {**crate, **middle}}
    says = (": objects.thing/wide: no valid layout", "'crate' could not be placed", "collision", "of body 'thing/wide'")
    _refused({"floor": FLOOR, "objects": objects}, InfeasibleSceneError, *says)


def test_what_is_hardly_ever_drawn_has_rows_in_both_banks(crate: dict):
    """A variant, and a member of a group: alone, and beside each of the others."""
    rare = {"asset": crate["asset"], "weight": 1e-5}
    objects = {"x": {"variants": {"usual": {"asset": crate["asset"]}, "rare": rare}, "on": "floor"}}
    group = {"of": ["a", "b", "c", "d"], "count": [0, 2], "weights": {"a": 1e-5}}
    scene = {"floor": FLOOR, "objects": objects | dict.fromkeys("abcd", crate), "groups": {"g": group}}
    compiled = compile_on_cpu(scene, bank=16)
    columns = [compiled.slots.index(name) for name in ("x/rare", "a", "b", "c", "d")]
    for split in ("train", "eval"):
        present = compiled.bank.present.numpy()[bank_rows(compiled, split)][:, columns]
        assert (present.sum(axis=0) > 0).all()
        assert np.diff(np.flatnonzero(present[:, 0] == 0)).min() > 1  # spread, as worlds take the next one that fits
        beside = present[present[:, 1] > 0][:, 2:]
        assert (beside.sum(axis=0) > 0).all()
        assert set(beside.sum(axis=1).tolist()) == {0, 1}


def test_a_kind_of_start_that_is_hard_is_kept_and_has_rows_in_both_banks(tmp_path: Path):
    """It works in 3% of its layouts: that none of the few that are drawn is valid proves nothing."""
    post, thing = box_mjcf(tmp_path, "post", 0.37, 0.4, 0.3), box_mjcf(tmp_path, "thing", 0.01, 0.01, 0.01)
    objects = {
        "post": {"asset": post, "kind": "static"},
        "goal": {"kind": "marker", "on": "floor"},
        "thing": {"asset": thing, "on": "floor", "region": {"box": [[0.192, -0.2], [0.2, 0.2]]}},
    }
    scene = {"floor": {"size": [0.4, 0.4]}, "attempts": 1, "restarts": 0, "objects": objects}
    compiled = compile_on_cpu({**scene, "start": [{"weight": 12}, {"place": {"thing": "goal"}}]})
    kinds = compiled.bank.start.numpy()
    assert all(set(kinds[bank_rows(compiled, split)].tolist()) == {0, 1} for split in ("train", "eval"))


def test_an_open_mesh_is_refused_where_it_is_seen_and_is_a_hull_where_it_collides(tmp_path: Path):
    """A tetrahedron without one of its faces."""
    asset = _mesh(tmp_path, TETRAHEDRON.removesuffix("f 2 3 4\n"))
    scene = {"floor": FLOOR, "objects": {"thing": {"asset": asset, "on": "floor"}}}
    says = ("objects.thing.asset: mesh of geom 'thing/shell'", "open", "geometry: physics")
    _refused({**scene, "geometry": "visual"}, MeshError, *says)
    assert (make(compile_on_cpu(scene), 10).status == LayoutStatus.VALID).all()


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("text", ["", "v 0 0 0\nv .1 0 0\nv 0 .1 0\nf 1 2 3\n"], ids=["empty", "one face"])
def test_a_mesh_without_a_solid_is_refused(tmp_path: Path, geometry: str, text: str):
    """A file without faces, and a single triangle."""
    scene = {
        "floor": FLOOR,
        "geometry": geometry,
        "objects": {"thing": {"asset": _mesh(tmp_path, text), "on": "floor"}},
    }
    _refused(scene, MeshError, "objects.thing.asset: ", "mesh")


def test_a_mesh_that_is_inside_out_is_turned(tmp_path: Path):
    """All faces inwards: the solid is the same, and what is inside of it collides."""
    faces = TETRAHEDRON.replace("f 1 3 2", "f 1 2 3").replace("f 1 2 4", "f 1 4 2")
    faces = faces.replace("f 1 4 3", "f 1 3 4").replace("f 2 3 4", "f 2 4 3")
    (tmp_path / "part.obj").write_text(faces)
    body = '<geom name="shell" type="mesh" mesh="part" mass="1"/>'
    rest = '<asset><mesh name="part" file="part.obj" scale="10 10 10" inertia="shell"/></asset>'
    objects = {
        "thing": {"asset": write_mjcf(tmp_path, "thing", body, rest), "kind": "static"},
        "pea": {
            "asset": box_mjcf(tmp_path, "pea", 0.01, 0.01, 0.01),
            "region": {"box": [[0.02, 0.02, 0.02], [2.0, 0.2, 0.2]]},
        },
    }
    x = valid(make(compile_on_cpu({"geometry": "visual", "objects": objects}), 300)).qpos[:, :3]
    assert x.sum(axis=1).min() > 0.98


@pytest.mark.parametrize(
    ("parent", "nearest"), [("cabinett", "cabinet"), ("cabinet/uper_drawer", "cabinet/upper_drawer"), ("flor", "floor")]
)
def test_an_unknown_parent_is_refused_with_the_nearest_name(crate: dict, parent: str, nearest: str):
    """Objects, parts of objects and the floor."""
    objects = {"cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor"}, "crate": {**crate, "on": parent}}
    _refused({"floor": FLOOR, "objects": objects}, UnknownNameError, "objects.crate.on", f"Did you mean '{nearest}'?")


def test_cycles_are_named(crate: dict):
    """Objects on each other, and one on itself."""
    table = {"asset": "table", "kind": "fixture"}
    objects = {"a": {**table, "on": "b"}, "b": {**table, "on": "c"}, "c": {**table, "on": "a"}}
    _refused({"floor": FLOOR, "objects": objects}, SceneKeyError, "a -> b -> c -> a")
    _refused({"floor": FLOOR, "objects": {"a": {**table, "on": "a"}}}, SceneKeyError, "a -> a")


@pytest.mark.parametrize("turn", ["any", "stable"])
def test_what_is_to_carry_is_to_be_kept_upright(turn: str, tmp_path: Path, crate: dict):
    """A board that lies any way, or that would not stand on its edge, has no level top; no joint would help."""
    board = {"asset": box_mjcf(tmp_path, "board", 0.03, 0.5, 0.5), "on": "floor", "orientation": turn}
    advice = f"Keep 'board' upright: give it a yaw or 'fixed' instead of 'orientation: {turn}'."
    scene = {"floor": FLOOR, "objects": {"board": board, "crate": {**crate, "on": "board"}}}
    _refused(scene, InfeasibleSceneError, "The object's support 'board' leans by more than 0.1 degree", advice)


def test_a_support_that_leans_carries_nothing(tmp_path: Path, crate: dict):
    """At a fixed angle it is refused, tilted by a joint it is empty; turning about the vertical is fine."""
    body = """<geom type="box" size=".2 .2 .01"/>
      <body name="flat" pos="0 0 .3" euler="0 0 30"><joint name="swing" axis="0 0 1" range="-90 90"/>
        <geom type="box" size=".1 .1 .005"/></body>
      <body name="wall" pos=".5 0 .3" euler="90 0 0"><geom type="box" size=".1 .1 .005"/></body>
      <body name="lid" pos="-.5 0 .3"><joint name="lid" axis="1 0 0" range="-90 90"/>
        <geom type="box" size=".1 .1 .005"/></body>"""
    rack = {"asset": write_mjcf(tmp_path, "rack", body), "kind": "fixture", "on": "floor"}

    def scene(part: str, joints: dict) -> dict:
        return {
            "floor": FLOOR,
            "objects": {"rack": {**rack, "joints": joints}, "crate": {**crate, "on": f"rack/{part}", "stands": False}},
        }

    _refused(scene("wall", {}), NotSupportedError, "objects.crate.on", "'rack/wall' leans by 90 degrees")
    leans = "The object's support 'rack/lid' leans by more than 0.1 degree in most of the drawn states"
    _refused(scene("lid", {"lid": {"range": [0.2, 0.5]}}), InfeasibleSceneError, "'crate'", "empty", leans)
    shut = make(compile_on_cpu(scene("lid", {"lid": {"choice": [0.0, 1.0]}})), 50)
    lid = compile_on_cpu(scene("lid", {"lid": {"choice": [0.0, 1.0]}})).mjm.joint("rack/lid").qposadr[0]
    assert np.all(shut.qpos[:, lid] == 0.0)
    for part, joints in (("lid", {}), ("lid", {"lid": {"value": 0.0}}), ("flat", {"swing": {"fraction": [0, 1]}})):
        rows = make(compile_on_cpu(scene(part, joints)), 50)
        np.testing.assert_allclose(rows.qpos[:, -5], 0.01 + 0.0005 + 0.3 + 0.005 + 0.0005, atol=1e-5)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_planes_stand_still(tmp_path: Path, crate: dict, geometry: str):
    """A plane in something that is placed is refused; in something that stays it carries things, and covers none."""
    body = '<geom type="plane" size="1 1 .1"/><geom type="box" size=".2 .2 .05" pos="0 0 .05"/>'
    ground = {"asset": write_mjcf(tmp_path, "ground", body)}
    fixed = {**ground, "kind": "fixture", "region": {"box": ANYWHERE}}
    _refused({"geometry": geometry, "objects": {"ground": fixed}}, NotSupportedError, "objects.ground", "plane")
    objects = {
        "ground": {**ground, "kind": "static"},
        "crate": {**crate, "on": "ground"},
        "fallen": {**crate, "on": None, "region": {"box": [[0.5, 0.5, -0.2], [0.8, 0.8, 0.2]]}},
    }
    compiled = compile_on_cpu({"geometry": geometry, "objects": objects})
    rows = valid(make(compiled, 300))
    on_plane = rows.qpos[:, 2] < 0.05
    np.testing.assert_allclose(rows.qpos[:, 2], np.where(on_plane, 0.0005, 0.1005), atol=1e-6)
    assert 0.9 < on_plane.mean() < 1.0  # the box has 4% of the area
    assert 0.001 <= rows.qpos[:, 9].min() < 0.01


def test_a_robot_that_stands_on_a_plane_of_its_own_keeps_others_off_it(tmp_path: Path, crate: dict):
    """The plane is the obstacle, whichever of the two was placed first."""
    body = """<geom type="plane" size="1 1 .1"/><body name="arm" pos="0 0 .5">
      <joint name="turn" axis="0 0 1" range="-90 90"/><geom type="box" size=".02 .02 .02"/></body>"""
    robot = {"asset": write_mjcf(tmp_path, "bot", body, '<keyframe><key name="home" qpos="0"/></keyframe>')}
    robot["joints"] = {"turn": {"fraction": [0, 1]}}  # pyrefly: ignore[bad-assignment]
    stone = {"asset": crate["asset"], "region": {"box": [[0.3, 0.3, -0.3], [0.5, 0.5, 0.3]]}}
    compiled = compile_on_cpu({"robot": robot, "objects": {"stone": stone}})
    rows = valid(make(compiled, 300))
    assert len(rows.qpos) > 290
    assert 0.001 <= rows.qpos[:, 3].min() < 0.01


def test_a_height_field_is_refused(tmp_path: Path, crate: dict):
    """A height field has neither a hull nor a closed mesh, so it cannot be an obstacle."""
    body = '<geom name="dunes" type="hfield" hfield="dunes"/>'
    rest = '<asset><hfield name="dunes" nrow="2" ncol="2" size="1 1 .1 .1" elevation="0 1 0 1"/></asset>'
    objects = {"dunes": {"asset": write_mjcf(tmp_path, "dunes", body, rest), "kind": "static"}, "crate": crate}
    _refused({"floor": FLOOR, "objects": objects}, NotSupportedError, "dunes", "hfield")


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_robot_with_drawn_joints_is_feasible_as_it_is_shipped(geometry: str):
    """Links that touch or overlap as they are built do not count against the arm."""
    robot = {"asset": "panda", "joints": {"*": {"noise": 0.05}}}
    rows = make(compile_on_cpu({"floor": FLOOR, "robot": robot, "geometry": geometry}), 100)
    assert (rows.status == LayoutStatus.VALID).all()
    assert rows.attempts.mean() < 1.1


@pytest.mark.parametrize("words", [{"attempts": 10_000, "restarts": 10_000}, {"attempts": 10_000, "bank": 10_000}])
def test_a_scene_that_cannot_be_made_is_given_up_after_a_number_of_candidates(tmp_path: Path, words: dict[str, int]):
    """Each word as large as it may be: a hundred million candidates of each world, and none can pass."""
    plate = box_mjcf(tmp_path, "plate", 0.3, 0.3, 0.05)
    objects = {name: {"asset": plate, "on": "floor"} for name in ("one", "other")}
    with pytest.raises(InfeasibleSceneError) as found:
        compile_on_cpu({"floor": {"size": [0.05, 0.05]}, "objects": objects, **words})
    assert 0 < found.value.counts["other"]["collision"] < 1_000_000


def test_a_full_support_is_refused_with_the_area_that_would_do(tmp_path: Path):
    """By the three objects that were rejected most; a floor of the area that is named has room for all."""
    crate = box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05)
    objects = {f"crate_{i}": {"asset": crate, "on": "floor"} for i in range(60)}
    with pytest.raises(InfeasibleSceneError) as found:
        compile_on_cpu({"floor": {"size": [0.4, 0.4]}, "objects": objects})
    said = str(found.value)
    assert len(re.findall(r"crate_\d+: collision \d+", said)) == 3
    assert re.search(
        r"; and \d+ other objects less often\. The 0\.16 m2 of 'floor' were full after \d+ of its 60", said
    )
    (area,) = re.findall(r"a support of about ([\d.]+) m2", said)
    compile_on_cpu({"floor": {"size": [float(area) ** 0.5] * 2}, "objects": objects})


def test_the_budget_of_the_probe_changes_no_layout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It decides how the bank is filled; fresh layouts have all restarts that the scene says."""
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05)
    objects = {f"crate_{i}": {"asset": crate, "on": "floor"} for i in range(5)}
    scene = {"floor": {"size": [0.4, 0.4]}, "objects": objects, "attempts": 5, "restarts": 20, "bank": 16}
    rich = make(compile_on_cpu(scene), 200)
    monkeypatch.setattr("sceniris_gym.layout.compile._BUDGET", 150)
    poor = compile_on_cpu(scene)
    assert int(poor.program.restarts) == 20
    made = make(poor, 200)
    fresh = rich.status == LayoutStatus.VALID
    assert fresh.any()
    assert (made.status == rich.status).all()
    assert made[fresh].bits() == rich[fresh].bits()
