"""Things in kitchens and on tables: closed surfaces, few pieces that lie within them, hinges that hold."""

from __future__ import annotations

from importlib.resources import files

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from tests.assets.geometry import COLLISION, VISUAL, bounds, depth_outside, geoms, load, mesh, winding

# Extent along x, y, z [mm].
SMALL = {
    "plate": (219, 219, 20),
    "glass": (73, 73, 110),
    "pan": (341, 191, 59),
    "spatula": (300, 60, 11),
    "bottle": (68, 68, 252),
    "tin": (84, 84, 46),
    "cereal_box": (190, 65, 270),
    "pear": (64, 64, 108),
    "lemon": (85, 52, 51),
    "book": (150, 210, 30),
    "brick": (64, 32, 24),
    "block": (45, 45, 45),
    "peg": (40, 40, 60),
    "chest": (240, 164, 112),
}
LARGE = {
    "chair": (420, 464, 860),
    "dining_table": (1200, 800, 740),
    "shelf": (800, 300, 1120),
    "cupboard": (500, 447, 800),
    "counter": (2000, 600, 900),
}
ALL = SMALL | LARGE
# How far a surface may lie outside the pieces [mm]: round walls are made of twelve flats.
BARE = {"pan": 3.2, "chair": 2.7}


@pytest.mark.parametrize("name", ALL)
def test_a_thing_opens_alone_as_one_root_body_of_the_size_it_claims(name):
    """One root body named like the asset; it stands on z = 0, centred on its bounds (its frame's, with a door)."""
    model, data = load(name)
    assert [model.body(i).name for i in range(1, model.nbody) if model.body_parentid[i] == 0] == [name]
    assert model.nkey == (1 if model.njnt else 0)
    low, high = bounds(model, data, geoms(model, VISUAL))
    np.testing.assert_allclose(1000 * (high - low), ALL[name], atol=0.6)
    low, high = bounds(model, data, geoms(model, VISUAL, name))
    np.testing.assert_allclose([*(low + high)[:2], low[2]], 0.0, atol=1e-5)


@pytest.mark.parametrize("name", ALL)
def test_surfaces_are_closed_and_contacts_are_few_convex_pieces(name):
    """Every surface is watertight and faces outward; small things have at most 14 pieces of at most 40 corners."""
    model, data = load(name)
    for geom in geoms(model, VISUAL) + geoms(model, COLLISION):
        shape = mesh(model, data, geom)
        assert shape.is_watertight, model.geom(geom).name
        assert shape.is_winding_consistent, model.geom(geom).name
        assert shape.volume > 0, model.geom(geom).name
    pieces = [mesh(model, data, g) for g in geoms(model, COLLISION)]
    for piece in pieces:
        assert len(piece.vertices) <= 40
        np.testing.assert_allclose(ConvexHull(piece.vertices).volume, piece.volume, rtol=1e-3)
    assert name in LARGE or len(pieces) <= 14


@pytest.mark.parametrize("name", ALL)
def test_pieces_lie_within_what_the_eye_sees(name):
    """No piece reaches more than 0.03 mm out of the visual surfaces of its body, so what looks apart is apart."""
    model, data = load(name)
    for body in range(1, model.nbody):
        seen = [mesh(model, data, g) for g in geoms(model, VISUAL, model.body(body).name)]
        for geom in geoms(model, COLLISION, model.body(body).name):
            shape = mesh(model, data, geom)
            points = np.concatenate([shape.vertices, shape.triangles_center])
            out = points[~np.any([winding(s, points) > 0.5 for s in seen], axis=0)]
            assert all(distance(seen, point) < 3e-5 for point in out), model.geom(geom).name


@pytest.mark.parametrize("name", ALL)
def test_pieces_cover_what_the_eye_sees(name):
    """No point of a visual surface is further than 2 mm outside the pieces of its body, or what is allowed to it."""
    model, data = load(name)
    for geom in geoms(model, VISUAL):
        shape = mesh(model, data, geom)
        points = np.concatenate([shape.vertices, shape.triangles_center])
        pieces = geoms(model, COLLISION, model.body(model.geom_bodyid[geom]).name)
        assert 1000 * depth_outside(model, data, pieces, points).max() < BARE.get(name, 2.0)


def distance(surfaces: list[trimesh.Trimesh], point: np.ndarray) -> float:
    """Distance [m] of a point from the nearest of some surfaces."""
    nearest = [trimesh.triangles.closest_point(s.triangles, np.tile(point, (len(s.faces), 1))) for s in surfaces]
    return float(np.linalg.norm(np.concatenate(nearest) - point, axis=1).min())


@pytest.mark.parametrize("name", [*SMALL, "chair", "shelf", "cupboard"])
def test_a_thing_stays_where_it_is_put(name):
    """Put 0.5 mm above a box, it moves less than 1 mm and tilts less than 0.5 degrees in 1 s."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 0.02], pos=[0, 0, -0.02])
    asset = mujoco.MjSpec.from_file(str(files("sceniris_gym.assets") / f"{name}.xml"))
    for key in asset.keys:
        asset.delete(key)
    spec.attach(asset, prefix="o/", frame=spec.worldbody.add_frame(pos=[0, 0, 0.0005]))
    spec.body(f"o/{name}").add_freejoint(name="free")
    model = spec.compile()
    data = mujoco.MjData(model)
    for yaw in (0.0, 1.1):
        mujoco.mj_resetData(model, data)
        pose = data.joint("free").qpos
        pose[3:7] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        before = pose.copy()
        mujoco.mj_step(model, data, nstep=500)
        assert np.linalg.norm(pose[:3] - before[:3]) < 0.001
        assert np.degrees(2 * np.arccos(min(1.0, abs(pose[3:7] @ before[3:7])))) < 0.5


@pytest.mark.parametrize(("name", "joint", "degrees"), [("cupboard", "door", 110), ("chest", "lid", 105)])
def test_a_hinge_turns_its_body_and_holds_it(name, joint, degrees):
    """From shut at 0 to its limit; left half open it creeps by 0.05 rad a second at most; its body is named like it."""
    model, data = load(name)
    hinge = model.joint(joint)
    assert hinge.type[0] == mujoco.mjtJoint.mjJNT_HINGE
    np.testing.assert_allclose(np.degrees(hinge.range), [0, degrees])
    assert model.body(hinge.bodyid[0]).name == joint
    for angle in (0.0, 0.8):
        data.joint(joint).qpos = angle
        mujoco.mj_step(model, data, nstep=500)
        np.testing.assert_allclose(data.joint(joint).qpos, angle, atol=0.05)


def test_a_door_opens_to_the_front_and_a_lid_upwards():
    """Half open, the door's knob is far in front of the cupboard; the lid's clasp is high above the chest."""
    model, data = load("cupboard")
    data.joint("door").qpos = np.pi / 2
    mujoco.mj_kinematics(model, data)
    assert data.site("handle").xpos[1] < -0.6
    model, data = load("chest")
    data.joint("lid").qpos = np.pi / 2
    mujoco.mj_kinematics(model, data)
    assert data.site("lid").xpos[2] > 0.2


@pytest.mark.parametrize(("name", "joint"), [("cupboard", "door"), ("chest", "lid")])
def test_hinged_bodies_keep_clear_of_what_they_hang_on(name, joint):
    """At every angle tried, no corner of what is seen of one body is inside of the other."""
    model, data = load(name)
    for angle in np.linspace(0, model.joint(joint).range[1], 8):
        data.joint(joint).qpos = angle
        mujoco.mj_kinematics(model, data)
        frame, leaf = ([mesh(model, data, g) for g in geoms(model, VISUAL, body)] for body in (name, joint))
        for one, other in ((frame, leaf), (leaf, frame)):
            points = np.concatenate([s.vertices for s in one])
            assert max(winding(s, points).max() for s in other) < 0.5


def test_boards_and_the_sink_are_level_where_they_are_said_to_be():
    """Heights of the surfaces that carry: boards of the shelf and the cupboard, worktop, sink, seat, tables."""
    tops = {
        ("shelf", "board_0"): 0.08,
        ("shelf", "board_1"): 0.43,
        ("shelf", "board_2"): 0.78,
        ("shelf", "top"): 1.12,
        ("cupboard", "bottom"): 0.076,
        ("cupboard", "board"): 0.44,
        ("counter", "top_left"): 0.90,
        ("counter", "sink_floor"): 0.75,
        ("chair", "seat"): 0.45,
        ("dining_table", "top"): 0.74,
    }
    for (name, piece), height in tops.items():
        model, data = load(name)
        np.testing.assert_allclose(bounds(model, data, [model.geom(piece).id])[1, 2], height, atol=1e-6)


def test_the_sink_is_an_open_recess():
    """0.4 x 0.35 x 0.15 m under the worktop are free of surfaces and of pieces."""
    model, data = load("counter")
    generator = np.random.default_rng(0)
    low, high = np.array([0.45 - 0.199, 0.01 - 0.174, 0.752]), np.array([0.45 + 0.199, 0.01 + 0.174, 0.95])
    free = generator.uniform(low, high, (300, 3))
    assert depth_outside(model, data, geoms(model, COLLISION), free).min() > 0.0
    for geom in geoms(model, VISUAL):
        np.testing.assert_allclose(winding(mesh(model, data, geom), free), 0.0, atol=1e-6)
