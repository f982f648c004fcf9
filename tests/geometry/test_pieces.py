"""Pieces against the model they were taken from: which geoms, where, and how large."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces, hull_vertices, obstacle_flexes
from sceniris_gym.scene.build import build_model

WORKSHOP = """
<mujoco>
  <asset><mesh name="gem" scale="2 1 1" vertex=".03 0 .03 -.03 0 .03 0 .03 .03 0 -.03 .03 0 0 .06 .02 .02 0 .02 -.02 0
    -.02 .02 0 -.02 -.02 0 0 0 .03"/></asset>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <geom name="painted" type="plane" size="1 1 .1" contype="0" conaffinity="0"/>
    <body name="bench" pos="1 2 3" euler="10 20 30">
      <geom name="ball" type="sphere" size=".03" pos=".1 .2 .3"/>
      <geom name="pill" type="capsule" size=".02 .05" euler="30 0 45" pos="0 0 .1"/>
      <geom name="drum" type="cylinder" size=".04 .03" euler="0 70 0" contype="2" conaffinity="0"/>
      <geom name="egg" type="ellipsoid" size=".05 .03 .02" euler="45 45 0" contype="0" conaffinity="4"/>
      <geom name="brick" type="box" size=".05 .03 .02" euler="0 0 60" pos="-.1 0 0"/>
      <geom name="gem" type="mesh" mesh="gem" euler="90 10 0" pos="0 -.2 0"/>
      <geom name="seen" type="box" size=".01 .01 .01" contype="0" conaffinity="0" group="2"/>
      <geom name="hidden" type="box" size=".01 .01 .01" group="3"/>
      <geom name="glass" type="box" size=".01 .01 .01" rgba="1 1 1 0"/>
    </body>
  </worldbody>
</mujoco>
"""
SOLID = ["ball", "pill", "drum", "egg", "brick", "gem"]


@pytest.fixture(scope="module")
def workshop() -> mujoco.MjModel:
    """Return a model with a geom of every kind."""
    return mujoco.MjModel.from_xml_string(WORKSHOP)


def _named(mjm: mujoco.MjModel, geometry: str) -> dict[str, Piece]:
    return {mjm.geom(p.geom).name: p for p in extract_pieces(mjm, geometry)}


def _points(mjm: mujoco.MjModel, name: str) -> np.ndarray:
    """Points all over a geom's surface in its body's frame, by the definitions of MuJoCo's geoms."""
    geom = mjm.geom(name)
    (x, y, z), unit = geom.size, np.random.default_rng(0).normal(size=(40000, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    kind = mujoco.mjtGeom(int(geom.type[0]))
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        points = x * unit
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        points = x * unit + np.sign(unit[:, 2:]) * [0, 0, y]
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angle = np.arctan2(unit[:, 1], unit[:, 0])
        points = np.stack([x * np.cos(angle), x * np.sin(angle), y * np.sign(unit[:, 2])], axis=1)
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        points = unit * [x, y, z]
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        points = np.sign(unit) * [x, y, z]
    else:
        mesh = mjm.mesh(int(geom.dataid[0]))
        points = mjm.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]].astype(float)
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, geom.quat)
    return points @ matrix.reshape(3, 3).T + geom.pos


def test_physics_takes_what_collides_and_visual_what_is_seen(workshop: mujoco.MjModel):
    """Contact bits decide for the one, groups and colours for the other; ground is ground for both."""
    assert list(_named(workshop, "physics")) == ["ground", *SOLID, "hidden", "glass"]
    assert list(_named(workshop, "visual")) == ["ground", *SOLID, "seen"]
    only = extract_pieces(workshop, "physics", bodies={0})
    assert [p.type for p in only] == [PieceType.PLANE]


def test_contact_classes_are_those_of_the_bits_and_one_where_only_the_eye_decides(workshop: mujoco.MjModel):
    """With `geometry: visual` everything meets everything."""
    physics, visual = (_named(workshop, g) for g in ("physics", "visual"))
    assert len({physics[name].contact_class for name in ("ball", "drum", "egg")}) == 3  # bits 1 1, 2 0 and 0 4
    assert len({p.contact_class for p in visual.values()}) == 1


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("name", SOLID)
def test_extents_are_those_of_the_geom_along_any_axis(workshop: mujoco.MjModel, name: str, geometry: str):
    """Against many points of its surface; bounds are the extents along the body's own axes."""
    piece, points = _named(workshop, geometry)[name], _points(workshop, name)
    axes = np.random.default_rng(1).normal(size=(50, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    low, high = piece.extents(axes)
    heights = points @ axes.T
    assert (low <= heights.min(axis=0) + 1e-8).all()
    assert (high >= heights.max(axis=0) - 1e-8).all()
    np.testing.assert_allclose(low, heights.min(axis=0), atol=2e-4)
    np.testing.assert_allclose(high, heights.max(axis=0), atol=2e-4)
    np.testing.assert_allclose(np.concatenate(piece.bounds), np.concatenate(piece.extents(np.eye(3))))


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("name", SOLID)
def test_the_radius_is_that_of_the_least_sphere_about_the_frame(workshop: mujoco.MjModel, name: str, geometry: str):
    """It holds every point of the surface, and one of them is on it."""
    piece, points = _named(workshop, geometry)[name], _points(workshop, name)
    distance = np.linalg.norm(points - piece.pos, axis=1).max()
    assert distance - 1e-8 <= piece.radius <= distance + 2e-4


def test_no_sphere_holds_a_plane(workshop: mujoco.MjModel):
    """Its radius is larger than any scene."""
    assert _named(workshop, "physics")["ground"].radius > 1e20


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("name", SOLID)
def test_the_mesh_of_a_piece_is_closed_and_has_the_geom_s_bounds(workshop: mujoco.MjModel, name: str, geometry: str):
    """In the body's frame, outward, and inside of the round geom that it stands for."""
    piece = _named(workshop, geometry)[name]
    assert piece.mesh is not None
    assert piece.mesh.is_watertight
    assert piece.mesh.volume > 0
    np.testing.assert_allclose(piece.mesh.bounds, np.stack(piece.bounds), atol=3e-4)
    low, high = piece.extents(piece.mesh.face_normals)
    heights = np.einsum("ij,ij->i", piece.mesh.face_normals, piece.mesh.triangles[:, 0])
    assert (heights <= high + 1e-9).all()
    assert (heights >= low - 1e-9).all()


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("kind", ["capsule", "cylinder", "sphere", "ellipsoid", "box"])
def test_primitives_of_a_millimetre_have_a_mesh_too(kind: str, geometry: str):
    """Closed and as large as the geom, although its faces are tiny."""
    text = f'<mujoco><worldbody><geom name="grain" type="{kind}" size=".0005 .0004 .0003"/></worldbody></mujoco>'
    (piece,) = extract_pieces(mujoco.MjModel.from_xml_string(text), geometry)
    assert piece.mesh is not None and piece.mesh.is_watertight
    np.testing.assert_allclose(piece.mesh.bounds, piece.bounds, atol=1e-5)


def test_a_hull_is_that_of_all_vertices_and_has_none_inside(workshop: mujoco.MjModel):
    """The gem's inner vertex is left out; the piece's frame is shifted only, so the geom's points are met."""
    piece = _named(workshop, "physics")["gem"]
    points = _points(workshop, "gem")
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, piece.quat)
    mine = piece.vertices @ matrix.reshape(3, 3).T + piece.pos
    hull = ConvexHull(points)
    corners = points[hull.vertices]
    assert len(mine) == len(corners) == 9
    np.testing.assert_allclose(mine[np.lexsort(mine.round(6).T)], corners[np.lexsort(corners.round(6).T)], atol=1e-7)
    assert np.isclose(ConvexHull(mine).volume, hull.volume)


def test_a_hull_with_fewer_vertices_is_that_of_mujoco():
    """`maxhullvert` makes MuJoCo collide a smaller hull, and so do pieces."""
    rng = np.random.default_rng(2)
    ball = rng.normal(size=(200, 3))
    ball *= 0.1 / np.linalg.norm(ball, axis=1, keepdims=True)
    text = " ".join(f"{v:.6f}" for v in ball.ravel())
    mjm = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="m" maxhullvert="20" vertex="{text}"/></asset><worldbody><body>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    vertices = hull_vertices(mjm, 0, "m")
    assert len(vertices) == 20
    assert {tuple(v) for v in vertices} <= {tuple(v) for v in mjm.mesh_vert.astype(float)}


@pytest.mark.parametrize("asset", ["apple", "banana", "mug", "bowl", "can", "orange", "cabinet", "table", "panda"])
def test_the_visual_meshes_of_assets_are_solids(asset: str):
    """Closed although textures split their vertices, outward, and with the surface that MuJoCo draws."""
    objects = {} if asset == "panda" else {asset: {"asset": asset, "kind": "static"}}
    robot = {"robot": {"asset": "panda"}} if asset == "panda" else {}
    mjm = build_model(SceneConfig.load({"objects": objects, **robot, "geometry": "visual"})).mjm
    pieces = extract_pieces(mjm, "visual")
    assert pieces
    for p in pieces:
        assert p.mesh is not None
        assert p.mesh.is_watertight
        assert p.mesh.is_winding_consistent
        assert p.mesh.volume > 0
        mesh = mjm.mesh(int(mjm.geom_dataid[p.geom]))
        drawn = trimesh.Trimesh(
            mjm.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]].astype(float),
            mjm.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]],
            process=False,
        )
        assert len(p.mesh.faces) == len(drawn.faces)
        assert np.isclose(p.mesh.area, drawn.area)
        low, high = p.bounds
        np.testing.assert_allclose(p.mesh.bounds, [low, high], atol=1e-6)


CONTACT = '<contact selfcollide="none" contype="{0}" conaffinity="{0}"/>'
FLEX = """<mujoco><worldbody><body name="pole"><geom size=".01"/></body><body name="mast"><geom size=".01"/>
  <flexcomp name="flag" type="grid" count="3 3 {deep}" spacing=".05 .05 .05" dim="{dim}" radius=".005" mass=".1"
    rgba="1 0 0 {alpha}" {dof}>{contact}</flexcomp></body></worldbody></mujoco>"""
SOFT = {
    "cloth": {"deep": 1, "dim": 2, "dof": ""},
    "trilinear": {"deep": 3, "dim": 3, "dof": 'dof="trilinear"'},
    "rigid": {"deep": 1, "dim": 2, "dof": 'rigid="true"'},
}


@pytest.mark.parametrize("flex", SOFT.values(), ids=SOFT)
def test_flexes_that_collide_or_are_seen_are_found(flex: dict):
    """Colliding ones in either geometry, visible ones in the visual one; none is a piece."""
    soft = mujoco.MjModel.from_xml_string(FLEX.format(contact=CONTACT.format(1), alpha=0, **flex))
    for geometry in ("physics", "visual"):
        ((number, bodies),) = obstacle_flexes(soft, geometry)
        assert number == 0
        assert bodies <= {*range(2, soft.nbody)}
        assert len(extract_pieces(soft, "physics")) == 2
    limp = mujoco.MjModel.from_xml_string(FLEX.format(contact=CONTACT.format(0), alpha=1, **flex))
    assert not obstacle_flexes(limp, "physics")
    assert len(obstacle_flexes(limp, "visual")) == 1
    unseen = mujoco.MjModel.from_xml_string(FLEX.format(contact=CONTACT.format(0), alpha=0, **flex))
    assert not obstacle_flexes(unseen, "visual")
