"""The generator's verdict against FCL: what it accepts keeps its distance, what it rejects does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import FLOOR, Rows, box_mjcf, collisions, compile_on_cpu, make, posed, read, valid, write_mjcf
from tests.oracle.solids import Solids
from tests.versions import since_4

ROUND = {
    "ball": '<geom type="sphere" size=".04"/>',
    "pill": '<geom type="capsule" size=".02 .05"/>',
    "drum": '<geom type="cylinder" size=".04 .03"/>',
    "egg": '<geom type="ellipsoid" size=".05 .03 .02"/>',
    "brick": '<geom type="box" size=".05 .03 .02"/>',
}


def _compile_pairs(pairs: list[tuple[dict, dict, float]], geometry: str, clearance: float, tilt: bool) -> CompiledScene:
    """A world of pairs, 1.5 m apart: the first of each at its station, the second anywhere within a reach [m] of it.

    `tilt` turns every free body by a rotation of its own, about which the yaw is then drawn.
    """
    objects = {}
    for i, (first, second, reach) in enumerate(pairs):
        x, y = 1.5 * (i % 3 - 1), 1.5 * (i // 3 - 1)
        box = [[x - reach, y - reach, -reach], [x + reach, y + reach, reach]]
        objects[f"first_{i}"] = {**first, "region": {"box": [[x, y, 0.0], [x, y, 0.0]]}, "clearance": 0.0}
        objects[f"second_{i}"] = {**second, "region": {"box": box}, "clearance": clearance}
    scene = build_model(SceneConfig.load({"objects": objects, "geometry": geometry, "attempts": 30, "restarts": 0}))
    if tilt:
        assert scene.spec is not None
        rng = np.random.default_rng(3)
        for name, part in objects.items():
            if part.get("kind", "free") == "free":
                scene.spec.body(name).quat = np.roll(Rotation.random(rng=rng).as_quat(), 1)
        mjm = scene.spec.compile()
        scene = replace(scene, mjm=mjm, home_qpos=mjm.qpos0.copy())
    return compile_scene(scene, "cpu")


def _judged(compiled: CompiledScene, npair: int, nworld: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """FCL's distances [m] of all accepted and of all rejected candidates, of the second of each pair to the first."""
    generator = LayoutGenerator._recording(compiled, nworld, seed=seed, rejected=50 * nworld)
    generator.generate()
    solids = Solids(compiled.mjm, compiled.config.geometry)
    sides = [[solids.geoms(f"{side}_{i}") for side in ("first", "second")] for i in range(npair)]
    accepted = [
        solids.distance(data, *side) for data in posed(compiled, valid(read(generator.layouts))) for side in sides
    ]
    view = generator.layouts.view
    count = int(view.rejected_count.numpy()[0])
    assert 0 < count <= 50 * nworld
    poses = (view.rejected_qpos, view.rejected_mocap_pos, view.rejected_mocap_quat)
    rows = Rows(*[a.numpy()[:count] for a in poses], *[np.zeros(count)] * 2)
    named = [compiled.placed[k] for k in view.rejected_object.numpy()[:count]]
    rejected = [
        solids.distance(data, *sides[int(name.split("_")[1])])
        for name, data in zip(named, posed(compiled, rows), strict=True)
    ]
    assert len(accepted) > 20
    return np.array(accepted), np.array(rejected)


@pytest.mark.parametrize("clearance", [0.001, 0.03])
@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_assets_are_kept_apart_exactly_as_fcl_says(geometry: str, clearance: float):
    """Tilted and turned kitchenware and fruit around each other: no miss, and no false alarm beyond 10 um."""
    pairs = [("mug", "apple", 0.1), ("bowl", "banana", 0.15), ("can", "orange", 0.1), ("banana", "mug", 0.15)]
    compiled = _compile_pairs([({"asset": a}, {"asset": b}, r) for a, b, r in pairs], geometry, clearance, tilt=True)
    accepted, rejected = _judged(compiled, len(pairs), nworld=25, seed=4)
    assert accepted.min() >= clearance
    assert accepted.min() < clearance + 0.02
    assert rejected.max() <= clearance + 1e-5


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_an_articulated_object_is_tested_in_its_drawn_joint_state(geometry: str):
    """A can around a cabinet with drawers at any opening: FCL sees the drawers where they were drawn."""
    drawers = {"asset": "cabinet", "kind": "fixture", "joints": {"*": {"fraction": [0, 1]}}}
    compiled = _compile_pairs([(drawers, {"asset": "can"}, 0.5)], geometry, 0.001, tilt=False)
    accepted, rejected = _judged(compiled, 1, nworld=120, seed=5)
    assert accepted.min() >= 0.001
    assert rejected.max() <= 0.001 + 1e-5


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_what_stands_before_a_drawer_is_judged_by_its_opening_and_not_by_its_default(tmp_path: Path, geometry: str):
    """The same place is free while the drawer is shut and taken while it is open, world by world."""
    crate = box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.4)
    scene = {
        "floor": FLOOR,
        "geometry": geometry,
        "attempts": 1,
        "restarts": 0,
        "objects": {
            "cabinet": {
                "asset": "cabinet",
                "kind": "fixture",
                "on": "floor",
                "region": {"box": [[-1e-3, -1e-3], [1e-3, 1e-3]]},
                "orientation": "fixed",
                "joints": {"upper": {"choice": [0.0, 0.25]}},
            },
            "crate": {"asset": crate, "on": "floor", "region": {"box": [[-0.1, -0.3], [0.1, -0.28]]}},
        },
    }
    compiled = compile_on_cpu(scene)
    rows = make(compiled, 200)
    upper = LayoutGenerator._recording(compiled, 200, rejected=200)
    upper.generate()
    rejected = upper.layouts.view.rejected_qpos.numpy()[: int(upper.layouts.view.rejected_count.numpy()[0])]
    adr = compiled.mjm.joint("cabinet/upper").qposadr[0]
    assert np.allclose(valid(rows).qpos[:, adr], 0.0)
    assert np.allclose(rejected[:, adr], 0.25)
    assert min(len(rejected), len(valid(rows).qpos)) > 60


def test_an_arm_is_an_obstacle_in_its_drawn_state():
    """Cans around the robot's elbow and hand keep clear of every link of it, and are not turned away without reason."""
    robot = {"asset": "panda", "joints": {"*": {"noise": 0.2}}}
    objects = {"can": {"asset": "can", "region": {"box": [[0.2, -0.15, 0.4], [0.65, 0.15, 0.75]]}, "clearance": 0.002}}
    compiled = compile_on_cpu({"robot": robot, "objects": objects, "attempts": 30, "restarts": 0})
    generator = LayoutGenerator._recording(compiled, 150, seed=6, rejected=1000)
    generator.generate()
    view, solids = generator.layouts.view, Solids(compiled.mjm, "physics")
    arm, can = solids.geoms("panda"), solids.geoms("can")
    accepted = [solids.distance(data, arm, can) for data in posed(compiled, valid(read(generator.layouts)))]
    mine = np.flatnonzero(view.rejected_object.numpy()[: int(view.rejected_count.numpy()[0])] == 1)
    rows = Rows(view.rejected_qpos.numpy()[mine], *[np.zeros((len(mine), 1))] * 4)
    rejected = [solids.distance(data, arm, can) for data in posed(compiled, rows)]
    assert len(accepted) > 100
    assert len(rejected) > 20
    assert min(accepted) >= 0.002
    assert max(rejected) <= 0.002 + 1e-5


@pytest.mark.parametrize("other", ["ball", "pill", "drum", "egg", "brick"])
def test_true_primitives_are_kept_apart_to_a_tenth_of_a_millimetre(tmp_path: Path, other: str):
    """Round primitives in all orientations; both FCL and MuJoCo C are good to 0.1 mm there."""
    assets = {name: {"asset": write_mjcf(tmp_path, name, geom)} for name, geom in ROUND.items()}
    pairs = [(assets[name], assets[other], 0.12) for name in ROUND]
    compiled = _compile_pairs(pairs, "physics", 0.002, tilt=True)
    accepted, rejected = _judged(compiled, len(pairs), nworld=30, seed=7)
    assert accepted.min() >= 0.002 - 1e-4
    assert rejected.max() <= 0.002 + 1e-4


def _two_boxes(tmp_path: Path, first: str, second: str, rest: str = "", kinds: tuple[str, str] = ("free", "free")):
    """Two equal boxes of an own model at one place, with attributes of their geoms; true if both may stand there."""
    joint = {"free": "<freejoint/>", "fixture": "", "static": ""}
    text = f"""<mujoco><worldbody>
      <body name="b">{joint[kinds[0]]}<geom type="box" size=".05 .05 .05" {first}/></body>
      <body name="a">{joint[kinds[1]]}<geom type="box" size=".05 .05 .05" {second}/></body>
      </worldbody>{rest}</mujoco>"""
    (tmp_path / "own.xml").write_text(text)
    wide = {"box": [[0, 0, 0], [0.5, 0, 0]]}
    parts: dict[str, dict] = {
        n: {"kind": k} if k == "static" else {"kind": k, "region": wide} for n, k in zip("ba", kinds, strict=True)
    }
    parts["a"]["orientation"] = "fixed"
    if kinds[0] != "static":
        parts["b"] |= {"region": {"box": [[0, 0, 0], [0, 0, 0]]}, "orientation": "fixed"}
    compiled = compile_on_cpu({"model": tmp_path / "own.xml", "objects": parts})
    rows = valid(make(compiled, 100))
    x = rows.qpos[:, -7] if kinds[1] == "free" else rows.mocap_pos[:, -1, 0]
    return bool((x < 0.1).any())


@pytest.mark.parametrize(
    ("first", "second", "meet"),
    [
        ("", "", True),
        ('contype="2" conaffinity="2"', "", False),
        ('contype="2" conaffinity="4"', 'contype="4" conaffinity="8"', True),
        ('contype="4" conaffinity="8"', 'contype="2" conaffinity="4"', True),
        ('contype="2" conaffinity="0"', 'contype="2" conaffinity="0"', False),
        ('contype="0" conaffinity="2"', 'contype="2" conaffinity="0"', True),
    ],
)
def test_contact_bits_decide_who_collides(tmp_path: Path, first: str, second: str, meet: bool):
    """MuJoCo's rule: the contype of either meets the conaffinity of the other."""
    assert _two_boxes(tmp_path, first, second) != meet


@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
def test_excluded_pairs_may_overlap(tmp_path: Path, order: tuple[str, str]):
    """<exclude> is honoured whichever of the two it names first."""
    rest = f'<contact><exclude body1="{order[0]}" body2="{order[1]}"/></contact>'
    assert _two_boxes(tmp_path, "", "", rest)


@pytest.mark.parametrize(
    "kinds", [("fixture", "fixture"), ("static", "fixture"), ("fixture", "free"), ("static", "free")]
)
def test_fixtures_keep_apart_though_mujoco_would_not_report_them(tmp_path: Path, kinds: tuple[str, str]):
    """Fixture against fixture, fixture against static, and both against what is free."""
    assert not _two_boxes(tmp_path, "", "", kinds=kinds)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_marker_is_no_obstacle_and_meets_none(geometry: str):
    """A goal is drawn anywhere, through tables and over objects, and later objects do not mind it."""
    one = {"box": [[0, 0, 0.2], [0, 0, 0.2]]}
    objects = {
        "wall": {"asset": "table", "kind": "static"},
        "goal": {"asset": "apple", "kind": "marker", "region": {"box": [[-0.1, -0.1, 0.3], [0.1, 0.1, 0.5]]}},
        "ghost": {"asset": "mug", "kind": "marker", "region": one},
        "apple": {"asset": "apple", "region": one},
    }
    hits, fine = collisions({"geometry": geometry, "objects": objects}, "apple")
    assert (hits, fine) == (0, 200)
    hits, fine = collisions({"geometry": geometry, "objects": objects}, "goal")
    assert (hits, fine) == (0, 200)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_the_larger_of_two_clearances_holds(tmp_path: Path, geometry: str):
    """3 cm to a box that itself asks for 1 cm, and to one that asks for 3 cm itself."""
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.1)
    for first, second in ((0.01, 0.03), (0.03, 0.0)):
        objects = {
            "a": {
                "asset": crate,
                "region": {"box": [[0, 0, 0], [0, 0, 0]]},
                "orientation": "fixed",
                "clearance": first,
            },
            "b": {
                "asset": crate,
                "region": {"box": [[0.1, 0, 0], [0.2, 0, 0]]},
                "orientation": "fixed",
                "clearance": second,
            },
        }
        compiled = compile_on_cpu({"geometry": geometry, "objects": objects})
        x = valid(make(compiled, 500)).qpos[:, 7]
        assert x.min() >= 0.13 - 1e-6
        assert x.min() < 0.131


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_support_is_exempt_from_clearance_but_not_from_touch(tmp_path: Path, geometry: str):
    """On a bench with a post: the top is half a millimetre below; the post, of the same body, may be as near."""
    body = """<geom type="box" size=".2 .2 .02" pos="0 0 .1"/><geom type="box" size=".009 .009 .1" pos="0 0 .22"/>"""
    table = write_mjcf(tmp_path, "bench", body)
    can = box_mjcf(tmp_path, "brick", 0.06, 0.06, 0.1)
    objects = {
        "bench": {"asset": table, "kind": "static"},
        "brick": {"asset": can, "on": "bench", "orientation": "fixed", "clearance": 0.05},
    }
    compiled = compile_on_cpu({"geometry": geometry, "objects": objects})
    at = np.abs(valid(make(compiled, 2000)).qpos[:, :2]).max(axis=1)
    assert 0.039 <= at.min() < 0.041
    lower = {**objects, "brick": {**objects["brick"], "gap": 0.0}}
    hits, _ = collisions(
        {"geometry": geometry, "floor": FLOOR, "objects": {**lower, "brick": {**lower["brick"], "gap": 1e-4}}}, "brick"
    )
    assert 0 < hits < 100


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_the_floor_is_met_by_no_part_of_a_robot_or_an_open_drawer(tmp_path: Path, geometry: str):
    """A flap that hangs below the lowest joint state would reach through the floor: the object is raised instead."""
    body = """<geom type="box" size=".05 .05 .05" pos="0 0 .05"/><body name="flap" pos=".06 0 .05">
      <joint name="flap" type="slide" axis="0 0 1" range="-.3 0"/><geom type="box" size=".005 .05 .05"/></body>"""
    words = {"asset": write_mjcf(tmp_path, "box", body), "on": "floor", "joints": {"flap": {"fraction": [0, 1]}}}
    words |= {"stands": False}  # on a corner of the flap
    compiled = compile_on_cpu({"floor": FLOOR, "geometry": geometry, "objects": {"box": words}})
    rows = make(compiled, 100)
    assert (rows.attempts == 1).all()
    solids = Solids(compiled.mjm, geometry)
    lowest = np.array([solids.lowest(data, solids.geoms("box")) for data in posed(compiled, rows)])
    np.testing.assert_allclose(lowest, 0.0005, atol=2e-6)


def test_a_model_s_own_walls_and_loose_bodies_are_obstacles(tmp_path: Path):
    """World geoms and bodies that the scene file does not name stand where the model's keyframe has them."""
    (tmp_path / "own.xml").write_text("""<mujoco><worldbody>
      <geom name="wall" type="box" size=".5 .05 .5" pos="0 .5 0"/>
      <body name="stone" pos="0 0 5"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
      <body name="toy"><freejoint/><geom type="box" size=".02 .02 .02"/></body></worldbody>
      <keyframe><key name="home" qpos="-.3 0 0 1 0 0 0 0 0 0 1 0 0 0"/></keyframe></mujoco>""")
    region = {"box": [[-0.5, -0.5, 0], [0.5, 0.5, 0]]}
    compiled = compile_on_cpu(
        {"model": tmp_path / "own.xml", "objects": {"toy": {"region": region, "orientation": "fixed"}}}
    )
    rows = valid(make(compiled, 3000))
    x, y = rows.qpos[:, 7:9].T
    assert y.max() < 0.43
    assert y.max() > 0.42
    at_stone = np.maximum(np.abs(x + 0.3), np.abs(y))
    assert 0.12 < at_stone.min() < 0.13
    np.testing.assert_allclose(rows.qpos[:, 0], -0.3, atol=1e-7)


@since_4("a fixture's own parts collide with it")
def test_a_door_hinged_inside_its_frame_is_no_collision_of_its_own(tmp_path: Path):
    """A child that overlaps its parent at the hinge, as MuJoCo allows; but a sibling in its way is respected."""
    body = """<geom type="box" size=".1 .1 .1" pos="0 0 .1"/>
      <body name="door" pos=".1 -.1 .1"><joint name="door" axis="0 0 1" range="0 170"/>
        <geom type="box" size=".1 .005 .1" pos="-.1 0 0"/></body>
      <body name="post" pos="-.3 -.4 .1"><joint name="post" type="slide" axis="1 0 0" range="0 .3"/>
        <geom type="box" size=".02 .32 .02"/></body>"""
    asset = write_mjcf(tmp_path, "cupboard", body)
    joints = {"door": {"range": [0.0, 170.0 * np.pi / 180 - 1e-6]}, "post": {"value": 0.2}}
    cupboard = {"asset": asset, "kind": "fixture", "on": "floor", "joints": joints}
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"cupboard": cupboard}, "attempts": 50})
    generator = LayoutGenerator(compiled, 300)
    generator.generate()
    rows = valid(read(generator.layouts))
    assert len(rows.qpos) > 290
    solids = Solids(compiled.mjm, "physics")
    door, post = solids.geoms("cupboard/door"), solids.geoms("cupboard/post")
    apart = np.array([solids.distance(data, door, post) for data in posed(compiled, rows)])
    assert apart.min() > 0.0
    assert generator.rejection_counts()["cupboard"]["collision"] > 50
