"""Solids of a MuJoCo model: MuJoCo C says how low they reach and what bounds them, SciPy where they are."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.geometry import convex_hull, home_of, poses_of, solid_of, solids_of
from tests.audit.shapes import angle, model_of
from tests.commands.scenes import layout, small_model

FORMS = {
    "box": 'type="box" size="0.03 0.05 0.02"',
    "sphere": 'type="sphere" size="0.04"',
    "capsule": 'type="capsule" size="0.02 0.05"',
    "cylinder": 'type="cylinder" size="0.03 0.06"',
    "ellipsoid": 'type="ellipsoid" size="0.02 0.03 0.07"',
    "mesh": 'type="mesh" mesh="wedge"',
}
WEDGE = '<asset><mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.07 0  0.02 0.02 0.09  0.06 0.01 0.03"/></asset>'
RNG = np.random.default_rng(2)


def over_a_plane(geom: str) -> mujoco.MjModel:
    """Return a model of a plane and a free body of one geom, between which a contact is reported at any distance."""
    return mujoco.MjModel.from_xml_string(
        f'<mujoco>{WEDGE}<worldbody><geom type="plane" size="0 0 1" margin="20"/>'
        f"<body><freejoint/><geom {geom}/></body></worldbody></mujoco>"
    )


@pytest.mark.parametrize("form", FORMS)
def test_a_solid_reaches_down_as_far_as_mujoco_finds_it_above_a_plane(form: str):
    """Of every form, turned at random."""
    mjm = over_a_plane(FORMS[form])
    data, solid = mujoco.MjData(mjm), solid_of(mjm, 1, hull=True)
    for quat in RNG.normal(size=(30, 4)):
        data.qpos[:3], data.qpos[3:] = [0.3, -0.2, 5.0], quat / np.linalg.norm(quat)
        mujoco.mj_fwdPosition(mjm, data)
        up = data.geom_xmat[1].reshape(3, 3)[2]  # the world's vertical in the geom's frame
        found = data.geom_xpos[1, 2] + solid.lowest(up[None])[0]
        assert found == pytest.approx(data.contact.dist[: data.ncon].min(), abs=1e-7)


@pytest.mark.parametrize("form", FORMS)
def test_a_solid_is_bounded_by_the_box_of_mujocos_compiler(form: str):
    """Centre and half extents in the geom's frame."""
    mjm = over_a_plane(FORMS[form])
    solid = solid_of(mjm, 1, hull=True)
    np.testing.assert_allclose(np.concatenate([solid.center, solid.half]), mjm.geom_aabb[1], atol=1e-7)


def test_a_convex_hull_is_closed_and_turned_outwards():
    """Points inside are dropped, and the signed volume of the triangles is that of the hull."""
    for _ in range(20):
        points = RNG.normal(size=(40, 3)) * [1.0, 0.3, 0.1]
        vertices, faces = convex_hull(points)
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        hull = ConvexHull(points)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(hull.volume)
        assert {tuple(v) for v in vertices} == {tuple(points[i]) for i in hull.vertices}


def test_a_mesh_is_its_hull_where_it_collides_and_itself_where_it_is_seen():
    """The volumes are those of an L of five cubes, and of its hull."""
    mjm = model_of(angle())
    for hull, volume in ((False, 5.0), (True, 7.0)):
        solid = solid_of(mjm, 0, hull=hull)
        mesh = trimesh.Trimesh(solid.vertices, solid.faces)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(volume, rel=1e-5)


def test_what_collides_and_what_is_seen_are_chosen_by_their_words():
    """Geoms that are drawn only, that collide only, that are painted away, and planes of all kinds."""
    geoms = {
        "both": 'type="sphere" size="0.1"',
        "drawn": 'type="sphere" size="0.1" contype="0" conaffinity="0"',
        "hidden group": 'type="sphere" size="0.1" group="3"',
        "transparent": 'type="sphere" size="0.1" rgba="1 1 1 0"',
        "one bit": 'type="sphere" size="0.1" contype="0" conaffinity="4"',
        "unseen ground": 'type="plane" size="1 1 1" rgba="0 0 0 0" group="4"',
        "backdrop": 'type="plane" size="1 1 1" contype="0" conaffinity="0"',
    }
    listed = "".join(f'<geom name="{name}" {words}/>' for name, words in geoms.items())
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{listed}</worldbody></mujoco>")
    chosen = {which: {mjm.geom(s.geom).name for s in solids_of(mjm, which)} for which in ("physics", "visual")}
    assert chosen["physics"] == {"both", "hidden group", "transparent", "one bit", "unseen ground"}
    assert chosen["visual"] == {"both", "drawn", "one bit", "unseen ground"}


def test_a_height_field_is_the_box_around_it():
    """From its base up to its highest point."""
    mjm = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><hfield name="hills" nrow="2" ncol="2" size="1 2 3 4"/></asset>'
        '<worldbody><geom name="hills" type="hfield" hfield="hills"/></worldbody></mujoco>'
    )
    (solid,) = solids_of(mjm, "physics")
    assert solid.vertices.min(axis=0).tolist() == [-1, -2, -4]
    assert solid.vertices.max(axis=0).tolist() == [1, 2, 3]


def test_poses_are_those_of_the_rows():
    """A free body's geom at an offset, a mocap body's child; each row by itself, all bodies and geoms."""
    mjm = small_model()
    rows = layout(mjm, 3)
    adr = mjm.jnt_qposadr[mjm.joint("can/free").id]
    turns = Rotation.from_quat(RNG.normal(size=(3, 4)))
    places = RNG.normal(size=(3, 3))
    rows.qpos[:, adr : adr + 3], rows.qpos[:, adr + 3 : adr + 7] = places, turns.as_quat()[:, [3, 0, 1, 2]]
    rows.mocap_pos[:, 0] = places + [0.0, 0.0, 1.0]
    slide = mjm.jnt_qposadr[mjm.joint("shelf/tray").id]
    rows.qpos[:, slide] = [0.0, 0.03, 0.1]
    poses = poses_of(mjm, rows)
    can, tray = mjm.body("can").id, mjm.body("shelf/tray").id
    np.testing.assert_allclose(poses.xpos[:, can], places)
    np.testing.assert_allclose(poses.xmat[:, can], turns.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(poses.geom_xpos[:, mjm.geom("can").id], places + turns.apply([0.0, 0.0, 0.05]))
    out = np.array([[0.0, -0.1 - drawn, 0.05] for drawn in (0.0, 0.03, 0.1)])
    np.testing.assert_allclose(poses.xpos[:, tray], rows.mocap_pos[:, 0] + out, atol=1e-12)


def test_home_is_the_keyframe_of_that_name_or_the_start_state():
    """With the poses of that state."""
    body = '<worldbody><body name="b" pos="0 0 1"><freejoint/><geom size="0.1"/></body></worldbody>'
    key = '<keyframe><key name="other" qpos="9 9 9 1 0 0 0"/><key name="home" qpos="1 2 3 0 0 0 1"/></keyframe>'
    for keyframe, place in ((key, [1.0, 2.0, 3.0]), ("", [0.0, 0.0, 1.0])):
        mjm = mujoco.MjModel.from_xml_string(f"<mujoco>{body}{keyframe}</mujoco>")
        data = home_of(mjm)
        np.testing.assert_allclose(data.subtree_com[1], place)
        np.testing.assert_allclose(data.xpos[1], place)
        np.testing.assert_allclose(data.geom_xpos[0], place)


def test_a_half_space_has_no_bounds():
    """Its box is everything, so that no test by boxes can leave it out."""
    solid = solid_of(over_a_plane(FORMS["box"]), 0, hull=True)
    assert np.isinf(solid.half).all()
    assert not solid.center.any()
