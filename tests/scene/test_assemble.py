"""Assets in one specification: names, kinds of bodies, and assets or bodies that are refused."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import MeshError, ModelWarning, SceneFileError, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.scene.build import build_model
from tests.scene.assets import BALL, build, names


def test_a_root_body_has_the_object_s_name_and_all_else_its_prefix(folder: Path):
    """Bodies, joints, geoms, meshes and actuators of two objects of the same asset."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}, "b": {"asset": "chest", "kind": "static"}})
    assert names(scene.mjm, "body") == ["world", "a", "a/tray", "a/lid", "b", "b/tray", "b/lid"]
    assert names(scene.mjm, "joint") == ["a/slide", "a/hinge", "b/swing", "b/slide", "b/hinge"]
    assert names(scene.mjm, "geom")[:5] == ["floor", "a/box", "a/knob", "a/tray", "a/lid"]
    assert names(scene.mjm, "mesh") == ["a/knob", "b/knob"]
    assert names(scene.mjm, "actuator") == ["a/pull", "b/pull"]
    assert scene.bodies == {"a": 1, "b": 4}


def test_references_to_a_renamed_root_follow_it(folder: Path):
    """Excluded pairs and sensors of an asset still mean its root body."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}})
    assert scene.mjm.exclude_signature.tolist() == [(1 << 16) + 2]
    assert scene.mjm.sensor("a/where").objid == [scene.bodies["a"]]


def test_a_lamp_and_a_floor_of_an_asset_stay_behind(folder: Path):
    """Only the root body of an asset enters the scene; its options do not, and nothing warns."""
    scene = build(folder, {"a": {"asset": "chest", "kind": "fixture"}})
    assert scene.mjm.nlight == 1
    assert "a/ground" not in names(scene.mjm, "geom")
    assert scene.mjm.opt.timestep == 0.005


def test_sizes_of_buffers_of_an_asset_stay_behind(folder: Path, capfd: pytest.CaptureFixture):
    """The scene has its sizes, and MuJoCo writes no line about a conflict."""
    for name, sizes in (("a", 'memory="9M"'), ("b", 'nconmax="50" njmax="77"')):
        (folder / f"{name}.xml").write_text(BALL.replace("<worldbody>", f"<size {sizes}/><worldbody>", 1))
    build(folder, {name: {"asset": name, "on": "floor"} for name in "ab"})
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    "element",
    [
        '<actuator><position joint="slyde"/></actuator>',
        '<equality><joint joint1="slide" joint2="slyde"/></equality>',
        '<tendon><fixed><joint joint="slyde" coef="1"/></fixed></tendon>',
    ],
)
@pytest.mark.parametrize("key", ["robot", "objects.a"])
def test_an_element_that_names_a_missing_joint_is_warned_of(folder: Path, element: str, key: str):
    """In MuJoCo's words, as it refuses the file: when it attaches the file, it leaves out the element silently."""
    joint = '<body name="arm"><joint name="slide" type="slide" range="0 1"/><geom size="0.1"/></body>'
    (folder / "a.xml").write_text(f"<mujoco><worldbody>{joint}</worldbody>{element}</mujoco>")
    asset = {"asset": str(folder / "a.xml")}
    scene = {"robot": asset} if key == "robot" else {"objects": {"a": asset | {"kind": "static"}}}
    with pytest.warns(ModelWarning, match=rf"{key}\.asset: MuJoCo cannot compile the model: .*slyde"):
        build_model(SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": {}} | scene))


def test_each_kind_is_the_body_it_should_be(folder: Path):
    """Free: a freejoint; fixture: a mocap body; static: neither; marker: a mocap body that touches nothing."""
    scene = build(
        folder,
        {
            "ball": {"asset": "ball", "on": "floor"},
            "chest": {"asset": "chest", "kind": "fixture", "on": "floor"},
            "rock": {"asset": "ball", "kind": "static"},
            "ghost": {"asset": "ball", "kind": "marker"},
            "goal": {"kind": "marker", "region": {"box": [[0, 0, 0], [1, 1, 1]]}},
        },
    )
    mjm, mocap = scene.mjm, {name: scene.mjm.body(name).mocapid[0] for name in scene.bodies}
    assert mjm.joint("ball/free").type == mujoco.mjtJoint.mjJNT_FREE
    assert mjm.body("ball").jntnum == 1
    assert [mjm.body(name).jntnum[0] for name in ("chest", "rock", "ghost", "goal")] == [0, 0, 0, 0]
    assert [mocap[name] >= 0 for name in ("ball", "chest", "rock", "ghost", "goal")] == [False, True, False, True, True]
    assert mjm.geom("ghost/g").contype == mjm.geom("ghost/g").conaffinity == 0
    assert mjm.geom("rock/g").contype == 1
    assert mjm.body("goal").geomnum == 1
    assert mjm.geom("goal/mark").contype == mjm.geom("goal/mark").conaffinity == 0
    for geometry in ("physics", "visual"):
        assert not extract_pieces(mjm, geometry, {mjm.body("goal").id}), "a mark is nothing to place around"
    assert mjm.body("goal").mass == 0


def test_explicit_pairs_make_no_marker_touch_anything(folder: Path):
    """Of a body of the own model and of an asset; other pairs stay."""
    two = '<geom name="low" size=".1" pos="0 0 -.3"/><body name="in"><geom name="up" size=".1"/></body>'
    pairs = '<contact><pair geom1="low" geom2="{0}"/><pair geom1="{0}" geom2="up"/>{1}</contact>'
    (folder / "lamp.xml").write_text(
        f'<mujoco><worldbody><body name="lamp">{two}</body></worldbody>'
        + '<contact><pair geom1="low" geom2="up"/></contact></mujoco>'
    )
    others = '<geom name="one" size=".1" pos="2 0 0"/><body name="b"><joint/><geom name="other" size=".1"/></body>'
    (folder / "own.xml").write_text(
        f'<mujoco><worldbody>{others}<body name="mine">{two}</body></worldbody>'
        + pairs.format("one", '<pair geom1="one" geom2="other"/>')
        + "</mujoco>"
    )
    objects = {"mine": {"kind": "marker", "on": "floor"}, "lamp": {"asset": "lamp", "kind": "marker", "on": "floor"}}
    mjm = build(folder, objects, model=str(folder / "own.xml")).mjm
    left = [{mjm.geom(int(g)).name for g in pair} for pair in zip(mjm.pair_geom1, mjm.pair_geom2, strict=True)]
    assert left == [{"one", "other"}]


BAD_ASSETS = {
    "no XML": ("<mujoco>", SceneFileError, r"objects\.a\.asset: .*bad\.xml: should be .*XML, found: no element.*"),
    "no body": ("<mujoco/>", SceneKeyError, "a body below its worldbody, found none"),
    "two free bodies": (
        BALL.replace("</worldbody>", "<body name='c'><freejoint/><geom size='.1'/></body></worldbody>"),
        SceneKeyError,
        r"one body.*'b', 'c'.*of which \['c'\] move freely.*'model'.*objects\.a: {body: c}",
    ),
    "a missing mesh": (
        BALL.replace("<worldbody>", "<asset><mesh name='m' file='m.obj'/></asset><worldbody>"),
        SceneFileError,
        "refers to .*m.obj",
    ),
    "no mass": (
        BALL.replace('size=".03"', 'size=".03" mass="0"'),
        SceneFileError,
        r"objects\.a\.asset: MuJoCo cannot compile",
    ),
    "a hinge at the root": (
        BALL.replace("<geom", "<joint name='h' type='hinge'/><geom"),
        SceneKeyError,
        r"objects\.a\.kind: a 'free' object .*'a/h'",
    ),
}


@pytest.mark.parametrize(("text", "error", "says"), BAD_ASSETS.values(), ids=BAD_ASSETS.keys())
def test_a_bad_asset_is_refused_by_its_object(folder: Path, text: str, error: type[ScenirisError], says: str):
    """Assets that MuJoCo cannot read or compile, or that are not one body."""
    (folder / "bad.xml").write_text(text)
    with pytest.raises(error, match=says):
        build(folder, {"a": {"asset": "bad", "on": "floor"}})


@pytest.mark.parametrize(
    ("objects", "error", "says"),
    [
        ({"dest": {"kind": "static"}}, UnknownNameError, r"objects\.dest: unknown body .*mean 'desk'"),
        ({"drawer": {"kind": "static"}}, SceneKeyError, "'drawer' should be a child of the world, not of 'desk'"),
        ({"stone": {"kind": "static"}}, SceneKeyError, "'stone' has a freejoint, so its kind should be 'free'"),
        ({"desk": {}}, SceneKeyError, "'desk' should have a freejoint"),
        ({"door": {"kind": "fixture"}}, SceneKeyError, "'door' should have no joints at its root"),
        ({"desk": {"asset": "ball"}}, SceneKeyError, "has a body of this name"),
        (
            {"door": {"kind": "static", "joints": {"swing": {"fraction": [0, 1]}}}},
            SceneKeyError,
            "'swing' has no limits",
        ),
    ],
)
def test_a_body_of_an_own_model_must_suit_its_kind(folder: Path, objects: dict, error: type[ScenirisError], says: str):
    """Anything that would silently change the user's model is refused."""
    with pytest.raises(error, match=says):
        build(folder, objects, model=str(folder / "own.xml"))


@pytest.mark.parametrize("knob", ["", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n"], ids=["empty", "flat"])
def test_a_mesh_without_a_volume_is_refused(folder: Path, knob: str):
    """Meshes of which MuJoCo can make no convex hull."""
    (folder / "parts" / "knob.obj").write_text(knob)
    with pytest.raises(MeshError, match=r"objects\.b\.asset: .*vertices"):
        build(folder, {"a": {"asset": "ball", "on": "floor"}, "b": {"asset": "chest", "kind": "fixture"}})


PARTS: dict[str, tuple[str, int, int]] = {
    "no name": ("<body><geom size='.1'/><body name='in'><geom size='.1'/></body></body>", 2, 2),
    "two bodies": ("<body name='b'><geom size='.1'/></body><body><geom size='.1'/></body>", 3, 2),
    "geoms alone": ("<geom name='ground' type='plane' size='1 1 1'/><geom size='.1'/><geom size='.2'/>", 1, 2),
}


@pytest.mark.parametrize("kind", ["free", "fixture", "static"])
@pytest.mark.parametrize(("text", "nbody", "ngeom"), PARTS.values(), ids=PARTS.keys())
def test_what_belongs_together_becomes_one_body(folder: Path, text: str, nbody: int, ngeom: int, kind: str):
    """A root without a name, several bodies, and geoms without one; a plane is no part."""
    (folder / "parts.xml").write_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    support = {} if kind == "static" else {"on": "floor"}
    scene = build(folder, {"a": {"asset": "parts", "kind": kind, **support}})
    assert len(scene.subtree("a")) == nbody
    assert np.isin(scene.mjm.geom_bodyid, scene.subtree("a")).sum() == ngeom
    assert scene.mjm.body("a").jntnum == (kind == "free")
    assert (scene.mjm.body("a").mocapid >= 0) == (kind == "fixture")


def test_slides_in_place_of_a_freejoint_are_refused_with_the_line_that_mends_them(folder: Path):
    """As in models that move a body by slides and hinges."""
    joints = "<joint name='x' type='slide' axis='1 0 0'/><joint name='t' type='hinge' axis='0 0 1'/>"
    (folder / "slid.xml").write_text(
        f"<mujoco><worldbody><body name='cube'>{joints}<geom size='.1'/></body></worldbody></mujoco>"
    )
    says = (
        r"'cube' .* has slide, hinge\. Write <freejoint name=\"cube\"/> in place of its 2 joints .* or make it 'static'"
    )
    with pytest.raises(SceneKeyError, match=says):
        build(folder, {"cube": {"on": "floor"}}, model=str(folder / "slid.xml"))
    text = (folder / "slid.xml").read_text().replace(joints, '<freejoint name="cube"/>')
    (folder / "slid.xml").write_text(text)
    assert build(folder, {"cube": {"on": "floor"}}, model=str(folder / "slid.xml")).mjm.njnt == 1


def test_a_robot_s_file_with_free_bodies_is_refused_with_the_scene_that_would_do(folder: Path):
    """The proposed words take the jointed body as the robot and the free ones as objects, and compile."""
    arm = "<body name='arm'><joint axis='0 0 1'/><geom size='.05 .05 .1' type='box' pos='0 0 .2'/></body>"
    free = "<body name='{0}' pos='{1} 1 .1'><freejoint/><geom size='.1'/></body>"
    path = folder / "cell.xml"
    path.write_text(f"<mujoco><worldbody>{free.format('cube', 0)}{arm}{free.format('ball', 1)}</worldbody></mujoco>")
    with pytest.raises(SceneKeyError, match=r"\['cube', 'ball'\] move freely") as told:
        build(folder, {}, robot={"asset": "cell"})
    words = YAML(typ="safe").load("{" + str(told.value).partition("by name: ")[2].removesuffix(".") + "}")
    assert words == {"robot": {"in_model": "arm"}, "objects": {"cube": {"on": "floor"}, "ball": {"on": "floor"}}}
    build_model(SceneConfig.load({"model": str(path), "floor": {"size": [2, 2]}} | words))


def test_unknown_keyframes_and_taken_names_of_a_robot_are_refused(folder: Path):
    """A keyframe must exist; no object can have the asset of the scene's robot."""
    with pytest.raises(UnknownNameError, match=r"unknown keyframe 'hom'\. Did you mean 'home'"):
        build(folder, {}, robot={"asset": "arm", "keyframe": "hom"})
    with pytest.raises(SceneKeyError, match=r"objects\.arm: the asset of the scene's robot"):
        build(folder, {"arm": {"asset": "ball"}}, robot={"asset": "arm"})
