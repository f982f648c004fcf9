"""The scene as the audit sees it: carriers by their names, and hulls; and objects seen from above, against SciPy."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import shapely
import shapely.affinity
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.geometry import poses_of
from sceniris_gym.audit.scene import Carrier, JudgedScene, Outline
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import MJM, auditor, judge_language
from tests.commands.scenes import layout
from tests.scene.memory import cubes_on, spec_of


def test_names_mean_the_floor_objects_parts_geoms_and_bodies():
    """In this order."""
    model = spec_of().compile()
    objects = {**cubes_on("ground", 1), "cabinet": {"body": "cab/cabinet", "kind": "static"}}
    bodies = {"cube_0": model.body("cube_0/cube").id, "cabinet": model.body("cab/cabinet").id}
    config = SceneConfig.load({"model": model, "objects": objects})
    with_floor = SceneConfig.load({"model": model, "objects": objects, "floor": {"size": [1, 1]}})

    def carrier(parent: str, config: SceneConfig = config) -> Carrier:
        return JudgedScene(model, config, bodies).carrier(parent)

    assert carrier("floor", with_floor) == Carrier(0, is_ground=True)
    assert carrier("cube_0") == Carrier(bodies["cube_0"], owner="cube_0")
    assert carrier("cabinet/drawer") == Carrier(model.body("cab/drawer").id, owner="cabinet")
    assert carrier("ground") == Carrier(model.body("terrain").id, model.geom("ground").id)
    assert carrier("ledge") == Carrier(0, model.geom("ledge").id)
    assert carrier("cab/case") == Carrier(bodies["cabinet"], model.geom("cab/case").id, "cabinet")
    assert carrier("terrain") == Carrier(model.body("terrain").id)
    for name in ("nowhere", "floor"):  # without a floor in the scene file, 'floor' is a name like any other
        with pytest.raises(KeyError):
            carrier(name)


def test_a_footprint_has_the_corners_of_all_parts():
    """Of a cube and a post through its top: all of the cube's, and the upper ones of the post. A mark is a point."""
    mjm = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="thing" pos="3 1 2" euler="0 0 40"><freejoint/>
        <geom type="box" size=".5 .5 .5" pos=".5 .5 .5"/>
        <geom type="box" size=".125 .125 .75" pos=".375 .375 1.25"/></body>
        <body name="mark" mocap="true"/></worldbody></mujoco>"""
    )
    objects = {"thing": {"asset": "thing", "on": "floor"}, "mark": {"kind": "marker", "on": "floor"}}
    scene = JudgedScene(mjm, SceneConfig.load({"floor": {"size": [2, 2]}, "objects": objects}), {"thing": 1, "mark": 2})
    hulls = scene.hulls(scene.solids)
    cube = {(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)}
    expected = sorted(cube | {(x, y, 2) for x in (0.25, 0.5) for y in (0.25, 0.5)})
    assert sorted(map(tuple, np.round(hulls["thing"], 9) + 0.0)) == [pytest.approx(p) for p in expected]
    assert hulls["mark"].tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize("joint", ["", "<freejoint/>"])
def test_a_body_that_its_model_has_turned_has_its_sides_turned(joint: str):
    """A desk turned by 90 degrees, which looks to the right; a mark is seen from its own axes."""
    desk = f'<body name="desk" euler="0 0 90">{joint}<geom type="box" size=".2 .1 .1"/></body>'
    mjm = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{desk}<body name="mark" mocap="true" pos="0.5 0 0"/></worldbody></mujoco>'
    )
    rows = at_home(mjm)
    for side, off in (("front", -1.0), ("back", 179.0), ("left", 89.0), ("right", 89.0)):
        mark = {"kind": "marker", "on": "floor", "relations": [{f"{side}_of": "desk", "angle": 1}]}
        desk = {"asset": "desk", "kind": "free" if joint else "static"}
        config = SceneConfig.load({"floor": {"size": [2, 2]}, "objects": {"desk": desk, "mark": mark}})
        found = judge_language(Auditor(mjm, config, {"desk": 1, "mark": 2}), rows)
        assert {k.word: np.degrees(k.worst) for k in found}[f"0 {side}_of"] == pytest.approx(off, abs=1e-3)


def test_a_robot_is_seen_where_its_base_is():
    """Its arm reaches 1.05 m to the right of its base; a distance from it is one from the base or from its bounds."""
    arm = '<geom type="box" size=".05 .05 .1"/><geom type="box" size=".02 .5 .02" pos="0 -.55 .2"/>'
    mjm = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="arm" pos=".1 0 0">{arm}</body>'
        '<body name="mark" mocap="true" pos=".5 0 0"/></worldbody></mujoco>'
    )
    rows = at_home(mjm)
    for measure, distance in (("origin", 0.4), ("bounds", 0.35)):
        relation = {"front_of": "robot", "angle": 1, "distance": {"max": 0.3}, "measure": measure}
        mark = {"kind": "marker", "on": "floor", "relations": [relation]}
        scene = {"floor": {"size": [2, 2]}, "robot": {"asset": "panda"}, "objects": {"mark": mark}}
        found = judge_language(Auditor(mjm, SceneConfig.load(scene), {"robot": 1, "mark": 2}), rows)
        worst = {(k.word, k.unit): k.worst for k in found}
        assert worst["0 front_of", "m"] == pytest.approx(distance - 0.3, abs=1e-9)
        assert worst["0 front_of", "rad"] < 0


def at_home(mjm: mujoco.MjModel) -> LayoutTable:
    """Return one row: a model of two bodies as it is written, the second a mocap body."""
    states = mjm.qpos0[None], mjm.body_pos[None, 2:], mjm.body_quat[None, 2:]
    return LayoutTable.from_states(*states, present=np.ones((1, 2), bool))


def test_bounds_are_those_of_the_points_of_an_object():
    """A gem, a can and a crate, turned any way: heading, bounds and pivot from points that SciPy turns."""
    anyhow = {name: {"orientation": "any"} for name in ("gem", "can", "crate")}
    rows = layout(MJM, 50)
    turns = Rotation.from_quat(np.random.default_rng(1).normal(size=(50, 4)))
    angles = np.linspace(0, 2 * np.pi, 4000)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(4000)], 1) * 0.03
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.04
    points = {
        "gem": gem_points(),
        "can": np.concatenate([ring, ring + [0, 0, 0.1]]),
        "crate": corners + [0, 0, 0.04],
    }
    judge = auditor("physics", **anyhow)
    for name, own in points.items():
        adr = MJM.jnt_qposadr[MJM.joint(f"{name}/free").id]
        rows.qpos[:, adr + 3 : adr + 7] = turns.as_quat()[:, [3, 0, 1, 2]]
        seen = judge.outlines.outline(name, poses_of(MJM, rows))
        for i, turn in enumerate(turns):
            x = turn.as_matrix()[:, 0]
            assert np.cos(seen.heading[i] - np.arctan2(x[1], x[0])) == pytest.approx(1.0)
            posed = turn.apply(own) + rows.qpos[i, adr : adr + 3]
            flat = Rotation.from_euler("z", -seen.heading[i]).apply(posed - seen.pivot[i])
            np.testing.assert_allclose(flat[:, :2].min(0), seen.low[i], atol=1e-6)
            np.testing.assert_allclose(flat[:, :2].max(0), seen.high[i], atol=1e-6)
            assert flat[:, 2].min() == pytest.approx(0.0, abs=1e-6)
            np.testing.assert_allclose(seen.low[i] + seen.high[i], 0.0, atol=1e-12)  # the pivot is in the middle


def test_an_open_drawer_widens_the_bounds_and_leaves_the_pivot():
    """The shelf's tray, 8 cm out and turned with it: the pivot is where it is with the tray shut."""
    yaw = 0.7
    shut = layout(MJM, shelf=(0.1, 0.2, 0.3, yaw))
    out = layout(MJM, shelf=(0.1, 0.2, 0.3, yaw))
    out.qpos[0, MJM.jnt_qposadr[MJM.joint("shelf/tray").id]] = 0.08
    before, after = (auditor().outlines.outline("shelf", poses_of(MJM, rows)) for rows in (shut, out))
    np.testing.assert_allclose(after.pivot, before.pivot)
    np.testing.assert_allclose(after.low - before.low, [[0.0, -0.08]], atol=1e-12)
    np.testing.assert_allclose(after.high, before.high)
    assert before.heading[0] == after.heading[0] == pytest.approx(yaw)


def test_corners_and_spans_are_those_of_a_turned_rectangle():
    """By shapely: the rectangle of the bounds, turned about the pivot and moved there."""
    rng = np.random.default_rng(0)
    pivot, heading = rng.normal(size=(20, 3)), rng.uniform(-4, 4, 20)
    low, high = -rng.uniform(0, 1, (20, 2)), rng.uniform(0, 1, (20, 2))
    outline = Outline(pivot, heading, low, high)
    along = rng.uniform(-4, 4, 20)
    spans = outline.span(np.stack([np.cos(along), np.sin(along)], 1))
    for i in range(20):
        rectangle = shapely.affinity.rotate(shapely.box(*low[i], *high[i]), heading[i], origin=(0, 0), use_radians=True)
        rectangle = shapely.affinity.translate(rectangle, *pivot[i, :2])
        assert shapely.Polygon(outline.corners()[i]).symmetric_difference(rectangle).area < 1e-9
        turned = shapely.affinity.rotate(rectangle, -along[i], origin=(0, 0), use_radians=True)
        assert (spans[0][i], spans[1][i]) == pytest.approx((turned.bounds[0], turned.bounds[2]))


def gem_points() -> np.ndarray:
    """Return the vertices of the gem in its body's frame [m], shape (n, 3)."""
    geom = MJM.geom("gem").id
    first, count = MJM.mesh_vertadr[MJM.geom_dataid[geom]], MJM.mesh_vertnum[MJM.geom_dataid[geom]]
    turn = Rotation.from_quat(MJM.geom_quat[geom][[1, 2, 3, 0]])
    return turn.apply(MJM.mesh_vert[first : first + count]) + MJM.geom_pos[geom]
