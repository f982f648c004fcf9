"""The hash of a scene: what is part of it, what is not, and that no version of MuJoCo is."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import mujoco
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene import identity
from sceniris_gym.scene.build import build_model
from tests.scene.assets import ARM, BALL, CHEST, OWN, TETRAHEDRON, build
from tests.scene.memory import NEAR, cubes_on, spec_of

CABINET = {"a": {"asset": "chest", "kind": "fixture", "on": "floor"}}
LOOKS = {
    "a camera": ('<light pos="0 0 3"/>', '<light pos="0 0 3"/><camera name="eye" pos="0 0 3"/>'),
    "a light": ('<light pos="0 0 3"/>', ""),
    "the solver": ('<option timestep="0.001"/>', '<option timestep="0.002" iterations="7" solver="CG"/>'),
    "layout of the text": ('size=".1 .1 .1" pos="0 0 .1"', 'pos="0 0  .1"\n size=".1 .1 .1"'),
    "a comment": ("<sensor>", "<!-- where it is --><sensor>"),
    "a sensor": ("<sensor>", '<sensor><framequat name="how" objtype="body" objname="chest"/>'),
}
SHAPES = {
    "a size": ('size=".1 .1 .1"', 'size=".1 .1 .2"'),
    "a limit": ('range="0 .25"', 'range="0 .2"'),
    "contact bits": ('<geom name="knob"', '<geom contype="2" name="knob"'),
    "an exclude": ('<exclude body1="chest" body2="tray"/>', ""),
    "gravity": ('<option timestep="0.001"/>', '<option timestep="0.001" gravity="0 0 -5"/>'),
    "a flag": ('<option timestep="0.001"/>', '<option><flag filterparent="disable"/></option>'),
    "the start pose": ('qpos="1 .2 .5"', 'qpos="1 .1 .5"'),
    "what is seen": ('<geom name="box"', '<geom rgba="0 0 0 0" name="box"'),
}


def chest_hash(folder: Path, before: str = "", after: str = "") -> str:
    """Return the hash of a scene with a changed chest."""
    assert before in CHEST
    (folder / "chest.xml").write_text(CHEST.replace(before, after, 1) if before else CHEST)
    return build(folder, {"a": dict(CABINET["a"])}).hash


@pytest.mark.parametrize(("before", "after"), LOOKS.values(), ids=LOOKS.keys())
def test_what_shapes_no_layout_is_not_part_of_the_hash(folder: Path, before: str, after: str):
    """Cameras, lights, sensors, and how time goes on."""
    assert chest_hash(folder, before, after) == chest_hash(folder)


@pytest.mark.parametrize(("before", "after"), SHAPES.values(), ids=SHAPES.keys())
def test_what_shapes_layouts_is_part_of_the_hash(folder: Path, before: str, after: str):
    """Sizes, limits, what collides, and the start pose."""
    assert chest_hash(folder, before, after) != chest_hash(folder)


@pytest.mark.parametrize("name", LOOKS)
def test_looks_are_part_of_the_hash_where_something_is_drawn(folder: Path, name: str):
    """As one id then stands for pictures as well: cameras and lights, but no sensors, comments and solvers."""

    def hashed(chest: str) -> str:
        (folder / "chest.xml").write_text(chest)
        return build(folder, {"a": {**CABINET["a"], "randomize": {"friction": {"scale": [0.5, 1.0]}}}}).hash

    assert (hashed(CHEST.replace(*LOOKS[name], 1)) != hashed(CHEST)) == (name in ("a camera", "a light"))


def test_files_count_by_what_is_in_them(folder: Path):
    """Included files count as if they were written in place; names and folders of files do not matter."""
    whole = chest_hash(folder)
    asset = '<asset><mesh name="knob" file="knob.obj"/></asset>'
    (folder / "assets.xml").write_text(f"<mujoco>{asset}</mujoco>")
    assert chest_hash(folder, asset, '<include file="assets.xml"/>') == whole
    scaled = asset.replace("/>", ' scale=".5 .5 .5"/>', 1)
    (folder / "assets.xml").write_text(f"<mujoco>{scaled}</mujoco>")
    assert chest_hash(folder, asset, '<include file="assets.xml"/>') != whole
    chest_hash(folder)
    (folder / "chest.xml").rename(folder / "trunk.xml")
    assert build(folder, {"a": {**CABINET["a"], "asset": "trunk"}}).hash == whole


URDF = """
<robot name="thing">{compiler}<link name="root">
  <inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry>{seen}</geometry></visual><collision><geometry><box size=".1 .1 .1"/></geometry></collision>
</link></robot>
"""
KEPT = '<mujoco><compiler discardvisual="false"/></mujoco>'


@pytest.mark.parametrize("compiler", ["", KEPT], ids=["left out", "kept"])
def test_what_is_seen_of_a_urdf_counts_where_it_is_kept(folder: Path, compiler: str):
    """MuJoCo leaves its visuals out by default; kept, boxes and meshes are what `geometry: visual` keeps apart."""

    def hashed(seen: str) -> tuple[str, int]:
        file = folder / "thing.urdf"
        file.write_text(URDF.format(compiler=compiler, seen=seen))
        objects = {"a": {"asset": str(file), "kind": "fixture", "on": "floor"}}
        config = SceneConfig.load({"floor": {"size": [1, 2]}, "objects": objects, "geometry": "visual"})
        scene = build_model(config)
        return scene.hash, scene.mjm.ngeom

    small, large = hashed('<box size=".1 .1 .1"/>'), hashed('<box size=".4 .4 .1"/>')
    assert (small != large) == bool(compiler)
    assert small[1] == 2 + bool(compiler)  # with the floor
    mesh, knob = '<mesh filename="knob.obj"/>', folder / "knob.obj"
    knob.write_text(TETRAHEDRON)
    before = hashed(mesh)
    knob.write_text(TETRAHEDRON.replace("0 0 .1", "0 0 .2"))
    assert (hashed(mesh) != before) == bool(compiler)


def test_words_at_their_defaults_are_not_part_of_the_hash(folder: Path):
    """Written or not; another value is."""
    plain = build(folder, {"a": dict(CABINET["a"])}).hash
    assert build(folder, {"a": {**CABINET["a"], "clearance": 0.001}}, attempts=10, geometry="physics").hash == plain
    assert build(folder, {"a": {**CABINET["a"], "clearance": 0.002}}).hash != plain
    assert build(folder, {"a": dict(CABINET["a"])}, attempts=11).hash != plain


CHANGES: dict[str, Callable[[mujoco.MjSpec], object]] = {
    "a size": lambda spec: setattr(spec.geom("ledge"), "size", [0.3, 0.2, 0.03]),
    "a name": lambda spec: setattr(spec.geom("ledge"), "name", "shelf"),
    "a place": lambda spec: setattr(spec.body("cab/cabinet"), "pos", [-0.7, 0, 0]),
    "a geom": lambda spec: spec.worldbody.add_geom(size=[0.1, 0, 0], pos=[0, 0, 9]),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES.keys())
def test_a_model_in_memory_is_known_by_its_arrays(change: Callable[[mujoco.MjSpec], object]):
    """The same from a MjSpec and its MjModel, another one after a change; cameras and names of keys are no matter."""
    scene = {"objects": cubes_on("ground", region=NEAR), "home": "init_state"}

    def hashed(model: mujoco.MjSpec | mujoco.MjModel) -> str:
        return build_model(SceneConfig.load({"model": model, **scene})).hash

    spec = spec_of()
    before = hashed(spec)
    assert hashed(spec.compile()) == before
    spec.worldbody.add_camera(name="eye")
    spec.option.timestep = 0.001
    assert hashed(spec.compile()) == before
    change(spec)
    assert hashed(spec) != before


PHYSICS: dict[str, Callable[[mujoco.MjSpec], object]] = {
    "friction": lambda spec: setattr(spec.geom("ledge"), "friction", [0.3, 0.01, 0.001]),
    "frictionloss": lambda spec: setattr(spec.joint("turn"), "frictionloss", 0.2),
    "gains": lambda spec: spec.actuator("turn").set_to_position(kp=7),
    "limits of forces": lambda spec: setattr(spec.actuator("turn"), "forcerange", [-3, 3]),
    "a kind of actuator": lambda spec: setattr(spec.actuator("turn"), "dyntype", mujoco.mjtDyn.mjDYN_INTEGRATOR),
    "a camera": lambda spec: spec.worldbody.add_camera(name="eye"),
    "a light": lambda spec: spec.worldbody.add_light(name="lamp", pos=[0, 0, 3]),
}


@pytest.mark.parametrize("change", PHYSICS.values(), ids=PHYSICS.keys())
def test_physics_in_memory_is_part_of_the_hash_where_something_is_drawn(change: Callable[[mujoco.MjSpec], object]):
    """And of no other."""

    def hashed(spec: mujoco.MjSpec, **words: Any) -> str:
        scene = {"model": spec, "objects": cubes_on("ground", ratio_on_support=1), "home": "init_state"}
        return build_model(SceneConfig.load({**scene, **words})).hash

    before, after = spec_of(), spec_of()
    change(after)
    draws = {"gravity": {"add": [[0, 0, -0.1], [0, 0, 0.1]]}}
    assert hashed(after) == hashed(before)
    assert hashed(after, randomize=draws) != hashed(before, randomize=draws)


TABLE = {"desk": {"kind": "static"}}
FALLING: dict[str, tuple[dict[str, Any], bool]] = {
    "on something": ({"on": "desk"}, True),
    "on something, all of it": ({"on": "desk", "ratio_on_support": 1}, False),
    "on the floor": ({"on": "floor"}, False),
    "dropped": ({"on": "desk", "gap": 0.006}, False),
    "in any orientation": ({"on": "desk", "orientation": "any"}, False),
    "in space": ({"region": {"box": [[0, 0, 1], [1, 1, 2]]}}, False),
    "meant to fall": ({"on": "desk", "stands": False}, False),
}


@pytest.mark.parametrize(("words", "could_fall"), FALLING.values(), ids=FALLING.keys())
def test_a_scene_in_which_something_could_fall_has_another_hash_than_before(
    folder: Path, words: dict[str, Any], could_fall: bool, monkeypatch: pytest.MonkeyPatch
):
    """All others keep theirs."""
    now = build(folder, {"stone": words, **TABLE}, model=str(folder / "own.xml")).hash
    monkeypatch.setattr(identity, "_could_fall", lambda _: False)
    assert (now != build(folder, {"stone": words, **TABLE}, model=str(folder / "own.xml")).hash) == could_fall


def test_a_scene_with_something_on_a_free_object_has_another_hash(monkeypatch: pytest.MonkeyPatch):
    """Even if all of it is on that."""
    objects = {"a": {"asset": "can", "on": "floor"}, "b": {"asset": "can", "on": "a", "ratio_on_support": 1}}
    config = SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects})
    less = SceneConfig.load(config, {"objects.b.on": "floor"})
    now = [build_model(one).hash for one in (config, less)]
    monkeypatch.setattr(identity, "_could_fall", lambda _: False)
    assert [build_model(one).hash == found for one, found in zip((config, less), now, strict=True)] == [False, True]


@pytest.mark.parametrize(
    ("option", "counts"),
    [('timestep="0.004"', False), ('timestep="0.02"', True), ('o_solref="0.1 1"', True), ('iterations="7"', False)],
)
def test_options_that_say_how_things_stand_count_where_something_could_fall(folder: Path, option: str, counts: bool):
    """A timestep counts if MuJoCo makes contacts softer for it."""
    own = folder / "own.xml"

    def hashed(text: str, words: dict[str, Any]) -> str:
        own.write_text(text)
        return build(folder, {"stone": words, **TABLE}, model=str(own)).hash

    before = own.read_text()
    after = before.replace('<option timestep="0.003"/>', f"<option {option}/>", 1)
    assert after != before
    assert (hashed(before, {"on": "desk"}) != hashed(after, {"on": "desk"})) == counts
    assert hashed(before, {"on": "floor"}) == hashed(after, {"on": "floor"})


@pytest.mark.oldest
def test_the_hash_is_the_same_with_every_version_of_mujoco(folder: Path):
    """Of a scene from files: the number is kept here, and tests run with the oldest version and the newest."""
    own = build(folder, {"stone": {"on": "desk"}, "desk": {"kind": "static"}}, model=str(folder / "own.xml"))
    assert OWN in (folder / "own.xml").read_text()
    assert (build(folder, {"a": dict(CABINET["a"])}).hash, own.hash) == ("b2186a1706e23957", "69d5ef02a389cd99")


def joined(**words: Any) -> dict[str, Any]:
    """Return the words of an object that is joined to the object `a` at sites."""
    return {"on": "floor", "relations": [{"beside": {"of": "a", **words}}]}


BESIDE = {"asset": "ball", "kind": "fixture"}
RENAMED: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "asset of a robot": ({}, {"robot": {"asset": "arm", "base": [0, 1, 0]}}, "4e0de271be331c18"),
    "site": ({"b": BESIDE | joined(site="left", of_site="right")}, {}, "9e087973fb102fda"),
    "of_site": ({"b": BESIDE | joined(site="left", of_site="left")}, {}, "7dd95f83044f0a3f"),
    "angle": ({"b": BESIDE | joined(site="left", of_site="right", angle=90.0)}, {}, "1fae0e1f4a8ce416"),
    "angle of a robot": (
        {},
        {"robot": {"asset": "arm"} | joined(site="left", of_site="right", angle=0.0)},
        "b69336b416ed1eff",
    ),
    "angle of robots": (
        {},
        {"robots": {"left": {"asset": "arm.xml"} | joined(site="left", of_site="right", angle=0.0)}},
        "118b4146b203a661",
    ),
}


@pytest.mark.oldest
@pytest.mark.parametrize(("objects", "words", "expected"), RENAMED.values(), ids=RENAMED.keys())
def test_a_word_that_was_renamed_leaves_hashes_as_they_were(
    folder: Path, monkeypatch: pytest.MonkeyPatch, objects: dict[str, Any], words: dict[str, Any], expected: str
):
    """The hashes are from before: with `model` of a robot, and `my`, `its` and `turn` of a connection."""
    (folder / "arm.xml").write_text(ARM)
    (folder / "ball.xml").write_text(BALL)
    monkeypatch.chdir(folder)
    a = {} if words.get("robot", {}).get("base") else {"a": {**BESIDE, "on": "floor"}}
    assert build(folder, deepcopy(a | objects), **deepcopy(words)).hash == expected


def test_open_furniture_beside_furniture_has_another_hash_than_before(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """Its layouts differ from those of version 0.1.0: not those of closed furniture, nor of a free object beside it."""
    row = {"on": "floor", "relations": [{"beside": "a", "side": "right"}]}
    opened = {**CABINET["a"], "joints": {"*": {"fraction": [0, 1]}}}
    closed = {**CABINET["a"]}
    free = {"asset": "ball", "stands": False}
    (folder / "ball.xml").write_text(BALL)
    for a, b, differs in (
        (opened, closed, True),
        (closed, opened, True),
        (closed, closed, False),
        (opened, free, False),
    ):
        now = build(folder, {"a": deepcopy(a), "b": deepcopy(b | row)}).hash
        with monkeypatch.context() as patch:
            patch.setattr(identity, "_ROOT_LAW", "")
            assert (build(folder, {"a": deepcopy(a), "b": deepcopy(b | row)}).hash != now) == differs
