"""The whole program as flat arrays: nothing is missing, bodies move as in MuJoCo, and pieces are found again."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import shapely
import warp as wp
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.colliders import collider_arrays
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.device_statics import Statics
from sceniris_gym.program.pack.objects import pack_objects
from sceniris_gym.program.pack.pairs import PairRules
from sceniris_gym.program.pack.program import ARM_LISTS, layout_bounds, pack_pairs, pack_starts, pack_statics
from sceniris_gym.program.pack.relations import joints_of, pack_regions, pack_relations, surfaces_of_regions
from sceniris_gym.program.plan import Plan, build_plan
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.layout.starting import HANDLE, HELD, HOME, LIFT, LIFTED, SCENE
from tests.placement.supports import TILES, tiles_mjcf
from tests.program.scenes import BOX, GADGET, Packed, pack, scene_of

# What turns, slides, hangs on a ball joint and stands beside it all, in frames that are turned and moved.
MOBILE = """
<body name="arm" pos=".1 0 .2" quat=".8 .1 .5 .2"><joint name="turn" axis="1 2 0" pos="0 .1 0" range="-2 2" ref=".3"/>
  <joint name="push" type="slide" axis="0 1 1" range="-.2 .4" ref="-.1"/><geom size=".03"/>
  <body name="hand" pos="0 .2 0"><joint name="roll" axis="0 0 1" pos=".05 0 0" range="-1 3"/><geom size=".03"/></body>
</body>
<body name="bob" pos="0 0 .5"><joint name="knot" type="ball"/><geom size=".03" pos="0 0 -.1"/></body>
<body name="fixed" pos="0 .4 0" euler="0 0 40"><geom size=".03"/></body>"""


@pytest.fixture
def mobile(folder: Path) -> Packed:
    """A mobile that stands as a fixture, and one that is loose and not placed."""
    key = '<keyframe><key name="home" qpos=".5 .1 -.4 .6 0 .8 0"/></keyframe>'
    asset = write_mjcf(folder, "mobile", MOBILE, key)
    loose = f'<freejoint/><geom type="box" size=".1 .1 .1"/>{MOBILE}'
    key = '<keyframe><key name="home" qpos="0 0 0 1 0 0 0 .7 .2 .3 -.6 .8 0 0"/></keyframe>'
    other = write_mjcf(folder, "loose", loose, key)
    objects = {
        "mobile": {"asset": asset, "kind": "fixture", "on": "floor", "joints": {"push": {"fraction": [0, 1]}}},
        "loose": {"asset": other},
    }
    return pack(scene_of(objects))


def _kinematics(packed: Packed, qpos: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Poses of all bodies from the packed arrays alone: a body's pose, then its joints one after the other."""
    a, n = packed.arrays, len(packed["body_parent"])
    pos, turn = np.zeros((n, 3)), [Rotation.identity()] * n
    for body in range(1, n):
        parent = int(a["body_parent"][body])
        pos[body] = pos[parent] + turn[parent].apply(a["body_pos"][body])
        turn[body] = turn[parent] * Rotation.from_quat(a["body_quat"][body], scalar_first=True)
        for joint in range(a["body_jntadr"][body], a["body_jntadr"][body] + a["body_jntnum"][body]):
            moved = qpos[a["jnt_qposadr"][joint]] - a["jnt_qpos0"][joint]
            if a["jnt_slide"][joint]:
                pos[body] += turn[body].apply(a["jnt_axis"][joint]) * moved
                continue
            anchor = pos[body] + turn[body].apply(a["jnt_pos"][joint])
            turn[body] = turn[body] * Rotation.from_rotvec(a["jnt_axis"][joint] * moved)
            pos[body] = anchor - turn[body].apply(a["jnt_pos"][joint])
    return pos, Rotation.concatenate(turn)


def test_bodies_move_as_mujoco_moves_them(mobile: Packed):
    """With random hinges and slides; free and ball joints, which are never drawn, stand where they start."""
    mjm, data, draws = mobile.scene.mjm, mujoco.MjData(mobile.scene.mjm), np.random.default_rng(0)
    kinds = [int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)]
    scalar = np.flatnonzero(np.isin(mjm.jnt_type, kinds))
    assert len(scalar) == 6
    assert mjm.njnt == 9
    for _ in range(20):
        data.qpos[:] = mobile.scene.home_qpos
        data.qpos[mjm.jnt_qposadr[scalar]] = draws.uniform(*mjm.jnt_range[scalar].T)
        mujoco.mj_kinematics(mjm, data)
        pos, turn = _kinematics(mobile, data.qpos)
        np.testing.assert_allclose(pos, data.xpos, atol=1e-9)
        np.testing.assert_allclose(turn.as_matrix().reshape(-1, 9), data.xmat, atol=1e-9)


def test_what_is_loose_and_not_placed_stands_where_the_model_starts(folder: Path):
    """Its freejoint is gone, and its body is where an own model's keyframe has it, turned and all."""
    body = '<body name="stone" pos="0 0 .2"><freejoint/><geom size=".1"/></body>'
    key = '<keyframe><key name="home" qpos="1 -2 .5 .6 0 .8 0"/></keyframe>'
    (folder / "own.xml").write_text(f"<mujoco><worldbody>{body}</worldbody>{key}</mujoco>")
    packed = pack(scene_of({"stone": {}}, model=str(folder / "own.xml")))
    stone = packed.scene.bodies["stone"]
    pos, turn = _kinematics(packed, np.zeros(packed.scene.mjm.nq))
    assert packed["body_jntnum"][stone] == 0
    np.testing.assert_allclose(pos[stone], [1.0, -2.0, 0.5])
    np.testing.assert_allclose(turn[stone].as_quat(scalar_first=True), [0.6, 0.0, 0.8, 0.0], atol=1e-12)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_every_field_of_the_program_is_packed_and_by_one_packer(folder: Path, geometry: str):
    """Colliders and the bank apart, which others fill; nothing more but the lists of an arm, which are `Reach`'s."""
    objects = {
        "gadget": {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor"},
        "box": {"asset": str(folder / "box.xml"), "on": "floor", "relations": [{"left_of": "gadget"}]},
    }
    packed = pack(scene_of(objects, geometry=geometry))
    # pyrefly: ignore[missing-attribute]
    declared = {name for name, var in Program.vars.items() if wp.types.is_array(var.type)}
    assert set(packed.arrays) | set(collider_arrays(packed.colliders)) == declared.union(ARM_LISTS)
    assert set(ARM_LISTS) <= set(Reach.vars) - declared  # pyrefly: ignore[missing-attribute]
    assert not set(packed.arrays) & set(collider_arrays(packed.colliders))
    rules = PairRules(packed.scene, packed.colliders)
    parts = [
        pack_objects(packed.plan, rules, joints_of(packed.plan)),
        pack_pairs(packed.plan, rules, 1),
        pack_relations(packed.plan, joints_of(packed.plan)),
        pack_regions(packed.plan.objects),
    ]
    names = [name for part in parts for name in part]
    assert len(names) == len(set(names))


def test_an_empty_scene_is_packed_too():
    """Without objects and without a floor: every array keeps its number of columns."""
    packed, full = pack(scene_of({}, floor=None)), pack(scene_of({"apple": {"asset": "apple", "on": "floor"}}))
    for name, values in packed.arrays.items():
        assert values.shape[1:] == full[name].shape[1:], name


def test_pieces_are_those_of_the_plan_and_footprints_come_after_them(folder: Path):
    """Hulls are found again at their addresses; the footprint of what is made of several pieces is one hull more."""
    objects = {
        "gadget": {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor", "ratio_on_support": 1.0},
        "mug": {"asset": "mug", "on": "floor", "ratio_on_support": 1.0},
        "apple": {"asset": "apple", "on": "floor"},
    }
    packed = pack(scene_of(objects))
    pieces = packed.plan.pieces
    assert packed["piece_type"].tolist()[: len(pieces)] == [p.type for p in pieces]
    assert packed["piece_body"].tolist()[: len(pieces)] == [p.body for p in pieces]
    vertices = [
        packed["vert"][adr : adr + num]
        for adr, num in zip(packed["piece_vertadr"], packed["piece_vertnum"], strict=True)
    ]
    for piece, found in zip(pieces, vertices, strict=False):
        np.testing.assert_array_equal(found, piece.vertices)
        assert (len(found) > 3) == (piece.type == PieceType.HULL)
    assert packed["piece_type"][len(pieces) :].tolist() == [PieceType.HULL] * 2
    for name, i in (("gadget", len(pieces)), ("mug", len(pieces) + 1)):
        assert packed.listed(name, "shadow", "shadow_list") == [i]
        hull = ConvexHull(vertices[i] + packed["piece_pos"][i])
        own = [p.mesh.vertices for p in pieces if p.body == packed.scene.bodies[name] and p.mesh is not None]
        outside = np.concatenate(own) @ hull.equations[:, :3].T + hull.equations[:, 3]
        assert outside.max() < 1e-6
    assert packed.listed("apple", "shadow", "shadow_list") == packed.listed("apple", "piece", "piece_list")


def test_groups_are_their_members_slots_and_counts(folder: Path):
    """A slot is a place in the scene file, whatever the order of placement."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    objects = {"a": {**box, "on": "d"}, "b": box, "c": box, "d": {**box, "kind": "fixture"}}
    groups = {"first": {"of": ["c", "a"], "count": [0, 2]}, "second": {"of": ["b"], "count": 1}}
    packed = pack(scene_of(objects, groups=groups))
    members = [
        [list(objects)[slot] for slot in packed["group_slot"][adr : adr + num]] for adr, num in packed["group"][:, :2]
    ]
    assert members == [["c", "a"], ["b"]]
    assert packed["group"][:, 2:].tolist() == [[0, 2], [1, 1]]


def test_drawn_joints_keep_to_what_is_drawn_and_others_to_their_home(tmp_path: Path):
    """A slide is drawn, a hinge stays, a free box may be anywhere within reach and has a unit quaternion."""
    gadget, box = tmp_path / "gadget.xml", tmp_path / "box.xml"
    gadget.write_text(GADGET)
    box.write_text(BOX)
    scene = scene_of(
        {
            "gadget": {
                "asset": str(gadget),
                "kind": "fixture",
                "on": "floor",
                "joints": {"slide": {"range": [-0.1, 0.2]}},
            },
            "box": {"asset": str(box), "on": "floor"},
        }
    )
    bounds = layout_bounds(build_plan(scene))
    joints = scene.joints("gadget")
    slide, hinge = (int(scene.mjm.jnt_qposadr[joints[name]]) for name in ("slide", "hinge"))
    free = int(scene.mjm.jnt_qposadr[scene.mjm.joint("box/free").id])
    np.testing.assert_allclose(bounds["bound_qpos"][[slide, hinge]], [0.2, 0.5], atol=3e-3)
    assert (bounds["bound_qpos"][free : free + 3] > 1000).all()
    np.testing.assert_allclose(bounds["bound_qpos"][free + 3 : free + 7], 1.0, atol=3e-3)
    assert bounds["quat_qposadr"].tolist() == [free + 3]
    assert bounds["bound_mocap"].shape == (1,)


def test_kinds_are_packed_one_a_row():
    """Weights add up to 1, and bounds hold all joints of all starts."""
    packed = pack(build_model(SceneConfig.load(SCENE)))
    plan = packed.plan
    assert packed["start_weight"].tolist() == [3, 1, 1, 1, 2, 1, 1]
    bounds = np.zeros(plan.scene.mjm.nq)
    starts = pack_starts(plan, bounds, "cpu")
    assert starts is not None
    np.testing.assert_allclose(starts.lift.numpy()[LIFTED], LIFT)
    low, high = np.moveaxis(starts.arm_range.numpy(), 2, 0)
    assert (low[HOME] > high[HOME]).all()
    assert (low[HELD, :7] < high[HELD, :7]).all()
    drawn = starts.draw_range.numpy()
    assert (drawn[:, :, 0] <= drawn[:, :, 1]).sum(axis=1).tolist() == [int(i == HANDLE) for i in range(7)]
    mjm = plan.scene.mjm
    for name in [*(f"panda/joint{i}" for i in range(1, 8)), "panda/finger_joint1", "cabinet/upper"]:
        joint = mjm.joint(name)
        assert bounds[joint.qposadr[0]] >= np.abs(joint.range).max() - 1e-9


def test_a_scene_without_the_word_has_none():
    """Its layouts begin in the start pose."""
    config = SceneConfig.load({key: value for key, value in SCENE.items() if key != "start"})
    plan = build_plan(build_model(config))
    assert pack_starts(plan, np.zeros(plan.scene.mjm.nq), "cpu") is None


def stances_of(objects: dict) -> tuple[Plan, Statics]:
    """Return the plan of a scene, and how its objects stand."""
    plan = build_plan(scene_of(objects))
    statics = pack_statics(plan, "cpu")
    assert statics is not None
    return plan, statics


def lists(statics: Statics, name: str, of: str) -> list[list[int]]:
    """Return the lists of a field."""
    adr, num = (getattr(statics, f"{of}{end}").numpy() for end in ("adr", "num"))
    flat = getattr(statics, name).numpy()
    return [flat[a : a + n].tolist() for a, n in zip(adr, num, strict=True)]


def test_levels_carry_what_stands_beside_the_chain(tmp_path: Path):
    """A tree of five crates: the levels of each, and the others on them that were placed before."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05)}
    on = {"a": "floor", "b": "a", "c": "b", "d": "b", "e": "a"}
    _, statics = stances_of({name: {**crate, "on": support} for name, support in on.items()})
    assert lists(statics, "level_obj", "obj_level") == [[], [1, 0], [2, 1, 0], [3, 1, 0], [4, 0]]
    loads = lists(statics, "load", "level_load")
    assert loads == [[], [], [], [], [], [], [2], [], [], [1, 2, 3]]


def test_a_carrier_sinks_under_each_variant_as_under_that_alone(tmp_path: Path):
    """A plank under one of three boxes, each on it as if the others were in no world."""
    plank = {"asset": box_mjcf(tmp_path, "plank", 0.06, 0.06, 0.05), "on": "floor"}
    boxes = [box_mjcf(tmp_path, f"box_{z}", 0.05, 0.05, 0.04 * z) for z in (1, 2, 4)]
    _, several = stances_of({"plank": plank, "thing": {"asset": boxes, "on": "plank"}})
    alone = [stances_of({"plank": plank, "thing": {"asset": box, "on": "plank"}})[1] for box in boxes]
    (_, *found), each = (
        lists(several, "level_sink", "obj_level"),
        [lists(one, "level_sink", "obj_level") for one in alone],
    )
    assert found == [sinks for _, sinks in each]


def test_a_scene_in_which_nothing_can_fall_has_none(tmp_path: Path):
    """Neither a kernel nor arrays."""
    objects = {"crate": {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05), "on": "floor"}}
    assert pack_statics(build_plan(scene_of(objects)), "cpu") is None


def test_convex_parts_make_up_the_surfaces(tmp_path: Path):
    """Those of an L with a hole are triangles, those of a box one rectangle; all run counter-clockwise.

    The floor, which nothing can leave, has no sides.
    """
    objects = {
        "slab": {"asset": tiles_mjcf(tmp_path, TILES), "kind": "fixture", "on": "floor"},
        "crate": {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05), "on": "slab"},
        "top": {"asset": box_mjcf(tmp_path, "top", 0.05, 0.05, 0.05), "on": "crate"},
    }
    plan, statics = stances_of(objects)
    sides = statics.side.numpy()
    adr, num = statics.part_sideadr.numpy(), statics.part_sidenum.numpy()
    rings = [shapely.LinearRing(sides[a : a + n, :2]) for a, n in zip(adr[1:], num[1:], strict=True)]
    assert all(ring.is_ccw for ring in rings)
    assert num[0] == 0
    surfaces = surfaces_of_regions(plan.objects)
    first, count = statics.surface_partadr.numpy(), statics.surface_partnum.numpy()
    for surface, a, n in zip(surfaces[1:], first[1:], count[1:], strict=True):
        whole = shapely.union_all([shapely.Polygon(ring) for ring in rings[a - 1 : a - 1 + n]])
        assert whole.symmetric_difference(surface.outline).area < 1e-6
    assert set(count[1:]) == {1, np.max(count)}
