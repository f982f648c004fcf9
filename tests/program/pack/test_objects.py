"""Objects as flat arrays: what is drawn for each, where its pose is, how it is tested; and views of arms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.program.device import Cover, Measure, ObjectKind, OrientationType
from sceniris_gym.program.pack.objects import footprint_hulls
from sceniris_gym.scene.build import build_model
from tests.layout.grasped import arm_mjcf
from tests.layout.scenes import box_mjcf
from tests.program.scenes import pack, scene_of


@pytest.fixture
def objects(folder: Path) -> dict[str, Any]:
    """One object of each kind, some of them with joints that are drawn."""
    box, gadget = str(folder / "box.xml"), str(folder / "gadget.xml")
    return {
        "free": {"asset": box, "on": "floor"},
        "still": {"asset": gadget, "kind": "static", "joints": {"slide": {"choice": [0.1, -0.05, 0.2]}}},
        "goal": {"kind": "marker", "on": "floor"},
        "gadget": {"asset": gadget, "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0, 1]}}},
        "second": {"asset": box, "on": "floor"},
    }


def test_poses_are_written_where_mujoco_keeps_them(objects: dict[str, Any]):
    """A free object's to the address of its freejoint, that of a fixture or a marker to its mocap body."""
    packed = pack(scene_of(objects))
    mjm = packed.scene.mjm
    for name in ("free", "second"):
        i = packed.number(name)
        assert packed["obj_adr"][i] == mjm.joint(f"{name}/free").qposadr[0]
        assert packed["obj_kind"][i] == ObjectKind.FREE
    for name, kind in (("gadget", ObjectKind.FIXTURE), ("goal", ObjectKind.MARKER)):
        i = packed.number(name)
        assert packed["obj_adr"][i] == mjm.body(name).mocapid[0]
        assert packed["obj_kind"][i] == kind
    assert packed["obj_kind"][packed.number("still")] == ObjectKind.STATIC
    assert [[*objects][slot] for slot in packed["obj_slot"]] == [o.name for o in packed.plan.objects]
    assert [mjm.body(body).name for body in packed["obj_body"]] == [o.name for o in packed.plan.objects]


def test_drawn_joints_are_intervals_or_one_of_some_values(objects: dict[str, Any]):
    """Found by their address in qpos; a joint without a word in the scene is not among them."""
    packed = pack(scene_of(objects))
    mjm = packed.scene.mjm
    assert packed.listed("still", "draw", "draw_qposadr") == [mjm.joint("still/slide").qposadr[0]]
    assert packed.listed("free", "draw", "draw_qposadr") == []
    first = int(packed["obj_drawadr"][packed.number("still")])
    adr, num = packed["draw_choiceadr"][first], packed["draw_choicenum"][first]
    assert packed["choice"][adr : adr + num].tolist() == [0.1, -0.05, 0.2]
    for joint, limits in zip(("slide", "hinge"), packed.listed("gadget", "draw", "draw_range"), strict=True):
        assert limits == pytest.approx(mjm.joint(f"gadget/{joint}").range)
    assert packed["draw_choicenum"].tolist().count(0) == 2


def test_a_stable_pose_is_drawn_as_often_as_it_is_probable(tmp_path: Path):
    """The steps of an object's cumulated shares are the probabilities of its poses, and the last one is 1."""
    brick = {"asset": box_mjcf(tmp_path, "brick", 0.1, 0.06, 0.04), "on": "floor"}
    packed = pack(scene_of({"a": {**brick, "orientation": "stable"}, "b": brick}))
    for name, count in (("a", 6), ("b", 1)):
        poses = packed.object(name).stable_poses
        shares = packed.listed(name, "stable", "stable_cdf")
        assert len(shares) == count
        assert np.diff([0.0, *shares]) == pytest.approx([v.probability for v in poses])
        assert shares[-1] == pytest.approx(1.0)
        np.testing.assert_array_equal(packed.listed(name, "stable", "stable_quat"), [v.quat for v in poses])
        np.testing.assert_array_equal(packed.listed(name, "stable", "stable_pivot"), [v.pivot for v in poses])


@pytest.mark.parametrize(
    ("orientation", "kind", "yaw"),
    [
        ("fixed", OrientationType.YAW, (0, 0)),
        ({"yaw": [-30, 90]}, OrientationType.YAW, (-30, 90)),
        ({"stable": {"yaw": [10, 20]}}, OrientationType.YAW, (10, 20)),
        ("any", OrientationType.ANY, (-180, 180)),
        ({"face_to": "goal", "yaw": [5, 6]}, OrientationType.FACE_TO, (5, 6)),
    ],
    ids=str,
)
def test_how_an_orientation_is_drawn(tmp_path: Path, orientation: Any, kind: OrientationType, yaw: tuple):
    """Angles in radians, and whom it faces as a slot; what has no orientation in its words turns all around."""
    brick = {"asset": box_mjcf(tmp_path, "brick", 0.1, 0.06, 0.04), "on": "floor"}
    goal = {"kind": "marker", "on": "floor"}
    packed = pack(scene_of({"b": brick, "a": {**brick, "orientation": orientation}, "goal": goal}))
    i, other = packed.number("a"), packed.number("b")
    assert packed["obj_orientation"][i] == kind
    assert packed["obj_yaw"][i] == pytest.approx(np.radians(yaw))
    assert packed["obj_yaw"][other] == pytest.approx([-np.pi, np.pi])
    if kind == OrientationType.FACE_TO:
        assert packed.plan.slots[packed["obj_target"][i]] == "goal"


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize(("word", "roof"), [("on", Cover.OPEN), ("in", Cover.EITHER), ("inside", Cover.COVERED)])
def test_a_roof_may_be_any_part_of_the_parent(word: str, roof: Cover, geometry: str):
    """All of the cabinet for what is in a drawer of it, but the drawer's bottom; with `in` nobody looks up."""
    objects = {
        "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor"},
        "block": {"asset": "block", word: "cabinet/upper_drawer"},
    }
    packed = pack(scene_of(objects, geometry=geometry))
    assert packed["obj_cover"][packed.number("block")] == roof
    assert packed["obj_cover"][packed.number("cabinet")] == Cover.EITHER
    assert packed.listed("cabinet", "overhead", "overhead_list") == []
    found = packed.listed("block", "overhead", "overhead_list")
    bodies = [part.body for part in (packed.colliders if geometry == "visual" else packed.plan.pieces)]
    own = packed.scene.subtree("cabinet")
    expected = [i for i, body in enumerate(bodies) if body in own]
    if geometry == "physics":
        floor = min(s.height for surfaces in packed.plan.objects[packed.number("block")].surfaces for s in surfaces)
        drawer = packed.scene.mjm.body("cabinet/upper_drawer").id
        own_meshes = {i: packed.plan.pieces[i].mesh for i in expected if bodies[i] == drawer}
        under = [i for i, mesh in own_meshes.items() if mesh is not None and mesh.bounds[1, 2] <= floor + 1e-6]
        assert len(under) == 1  # its bottom
        expected = [i for i in expected if i not in under]
    assert found == (expected if roof != Cover.EITHER else [])
    assert len(own) == 3


MEASURED = {
    "rigid": ({}, "slab", Measure.NOTHING),
    "rigid, and seen by its bounds": ({"seen": "bounds"}, "slab", Measure.NOTHING),
    "any": ({"orientation": "any"}, "slab", Measure.WHOLE),
    "stable": ({"orientation": "stable"}, "slab", Measure.NOTHING),
    "joints": ({"joints": True}, "gadget", Measure.LOWEST),
    "joints, kept from an edge": ({"joints": True, "ratio_on_support": 0.5}, "gadget", Measure.WHOLE),
    "joints, seen by its origin": ({"joints": True, "seen": "origin"}, "gadget", Measure.LOWEST),
    "joints, seen by its bounds": ({"joints": True, "seen": "bounds"}, "gadget", Measure.WHOLE),
    "nothing to measure": ({"orientation": "any"}, None, Measure.NOTHING),
}


@pytest.mark.parametrize("case", MEASURED)
def test_only_what_may_change_and_is_looked_at_is_measured(case: str, folder: Path):
    """The lowest point is measured if joints are drawn, and the bounds too if something looks at them."""
    words, asset, measure = MEASURED[case]
    words = dict(words)
    seen, joints = words.pop("seen", None), words.pop("joints", False)
    box_mjcf(folder, "slab", 0.1, 0.06, 0.04)
    words |= {"joints": {"*": {"fraction": [0, 1]}}} if joints else {}
    path = None if asset is None else str(folder / f"{asset}.xml")
    kind = "marker" if asset is None else "fixture"
    objects: dict[str, Any] = {"thing": {"asset": path, "kind": kind, "on": "floor", **words}}
    if seen:
        relation = {"near": "thing", "distance": {"max": 1.0}, "measure": seen}
        objects["other"] = {"asset": str(folder / "slab.xml"), "on": "floor", "relations": [relation]}
    packed = pack(scene_of(objects))
    assert packed["obj_measured"][packed.number("thing")] == measure


def test_a_footprint_is_a_piece_of_its_own_only_where_all_of_it_must_be_carried(folder: Path):
    """Of what has several pieces, with a ratio of 1, and no joints that are drawn; else each piece has a shadow."""
    gadget = {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor"}
    objects = {
        "whole": {**gadget, "ratio_on_support": 1.0},
        "part": {**gadget, "ratio_on_support": 0.9},
        "moving": {**gadget, "ratio_on_support": 1.0, "joints": {"*": {"fraction": [0, 1]}}},
        "single": {"asset": str(folder / "box.xml"), "on": "floor", "ratio_on_support": 1.0},
    }
    packed = pack(scene_of(objects))
    assert [hull.type for hull in footprint_hulls(packed.plan.objects)] == [PieceType.HULL]
    assert packed.listed("whole", "shadow", "shadow_list") == [len(packed.plan.pieces)]
    for name in ("part", "moving", "single"):
        assert packed.listed(name, "shadow", "shadow_list") == packed.listed(name, "piece", "piece_list")
    assert packed["obj_footprint"].tolist() == [name != "part" for name in (o.name for o in packed.plan.objects)]


@pytest.mark.parametrize("robot", ["panda", "ur5e", "heron", "picker"])
def test_the_hand_moves_with_the_tcp_as_the_device_is_told(robot: str, folder: Path, cube: str):
    """In random joint states MuJoCo finds the hand's first body where it is from the TCP, whatever the fingers do."""
    asset = arm_mjcf(folder) if robot == "picker" else robot  # a picker's hand does not point straight down at home
    objects = {"cube": {"asset": cube, "on": "floor", "reachable": "ik"}}
    stands = {"asset": asset, "base": [0.3, 0.1, 0.2], "yaw": 40.0}
    model = build_model(SceneConfig.load({"floor": {"size": [2, 2]}, "robot": stands, "objects": objects}))
    found = upload_scene(model, "cpu").reaching
    assert found is not None
    view, arm = found.arms[0].view, found.arms[0].arm
    mjm, data, hand = model.mjm, mujoco.MjData(model.mjm), int(view.hand_body.numpy()[0])
    pos, turn = np.array(view.hand_pos), Rotation.from_quat(np.array(view.hand_quat), scalar_first=True)
    own = [j for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in model.subtree("robot")]
    draws = np.random.default_rng(0)
    for _ in range(20):
        data.qpos[mjm.jnt_qposadr[own]] = draws.uniform(*mjm.jnt_range[own].T)
        mujoco.mj_kinematics(mjm, data)
        tcp = Rotation.from_matrix(data.site_xmat[arm.tcp_site].reshape(3, 3))
        np.testing.assert_allclose(data.site_xpos[arm.tcp_site] + tcp.apply(pos), data.xpos[hand], atol=1e-6)
        np.testing.assert_allclose((tcp * turn).as_matrix(), data.xmat[hand].reshape(3, 3), atol=1e-6)


def test_the_device_finds_the_grasps_of_every_stable_pose(folder: Path, cube: str):
    """Of two things to reach and two that need not be, one of them in many poses; what need not be has none."""
    slab = box_mjcf(folder, "slab", 0.2, 0.15, 0.05)
    objects = {
        "first": {"asset": slab, "on": "floor", "orientation": "stable"},
        "slab": {"asset": slab, "on": "floor", "orientation": "stable", "reachable": "ik"},
        "other": {"asset": cube, "on": "floor"},
        "cube": {"asset": cube, "on": "slab", "reachable": "clear"},
    }
    scene = {"floor": {"size": [2, 2]}, "robot": {"asset": "panda"}, "objects": objects}
    compiled = upload_scene(build_model(SceneConfig.load(scene)), "cpu")
    plan, found = compiled.plan, compiled.reaching
    assert found is not None
    assert found.names == ("slab", "cube")
    view, stable, sizes = found.arms[0].view, 0, []
    for number, o in enumerate(plan.objects):
        column = int(view.obj_reach.numpy()[number])
        assert column == (found.names.index(o.name) if o.name in found.names else -1)
        for v in range(len(o.stable_poses)):
            adr, num = int(view.stable_graspadr.numpy()[stable]), int(view.stable_graspnum.numpy()[stable])
            stable += 1
            sizes.append(num)
            if column < 0:
                assert num == 0
                continue
            target = found.targets[column]
            first, count = target.grasp_set.spans[v]
            expected = target.grasp_set.grasps[first : first + count]
            assert target.number == number
            assert num == count
            for name in ("body", "pos", "quat", "opening"):
                values = getattr(view, f"grasp_{name}").numpy()[adr : adr + num]
                np.testing.assert_allclose(values.ravel(), np.ravel([getattr(g, name) for g in expected]), atol=1e-6)
    assert stable == len(view.stable_graspadr) == 6 + 6 + 1 + 1
    assert len(view.grasp_body) == sum(sizes) > 32
    assert 0 in sizes[6:12]  # lying it is 15 cm wide, and the gripper opens 8 cm


CHEST = """<mujoco><worldbody><body name="chest"><geom name="base" type="box" size=".2 .2 .02" pos="0 0 .02"/>
  <body name="drawer" pos="0 0 .1"><joint name="drawer" type="slide" axis="0 1 0" range="0 .3"/>
    <geom name="drawer" type="box" size=".1 .1 .02"/></body>
  <body name="door" pos=".2 0 .3"><joint name="door" axis="0 0 1" range="0 110"/>
    <geom name="door" type="box" size=".01 .1 .2" pos="0 .1 0"/></body>
  <body name="flap" pos="0 .3 .1"><joint name="flap" axis="1 0 0" range="-110 0"/>
    <geom name="flap" type="box" size=".1 .1 .01" pos="0 .1 0"/></body>
  <body name="ramp" pos="0 -.3 .1"><joint name="ramp" type="slide" axis="0 -.6 -.8" range="0 .2"/>
    <geom name="ramp" type="box" size=".05 .05 .01"/></body></body></worldbody></mujoco>"""


def test_level_drawers_and_doors_are_never_lowest(tmp_path: Path):
    """The lowest corner of 200 drawn states of MuJoCo C is on a piece that may be lowest, and on each of them once."""
    (tmp_path / "chest.xml").write_text(CHEST)
    asset, joints = str(tmp_path / "chest.xml"), {"*": {"fraction": [0, 1]}}
    packed = pack(scene_of({"chest": {"asset": asset, "kind": "fixture", "on": "floor", "joints": joints}}))
    mjm, data = packed.scene.mjm, mujoco.MjData(packed.scene.mjm)
    first = packed.listed("chest", "piece", "piece_list")[: packed["obj_lownum"][packed.number("chest")]]
    names = {mjm.geom(packed.plan.pieces[i].geom).name.removeprefix("chest/") for i in first}
    corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T
    rng, found = np.random.default_rng(0), set()
    own = [g for g in range(mjm.ngeom) if mjm.geom(g).name.startswith("chest/")]
    for _ in range(200):
        data.qpos[:] = rng.uniform(*mjm.jnt_range.T)
        mujoco.mj_kinematics(mjm, data)
        up = data.geom_xmat[own].reshape(-1, 3, 3)[:, 2]
        least = data.geom_xpos[own, 2] + np.einsum("gi,gi,ci->gc", up, mjm.geom_size[own], corners).min(axis=1)
        found.add(mjm.geom(own[int(np.argmin(least))]).name.removeprefix("chest/"))
    assert found == names == {"base", "flap", "ramp"}
