"""Colliders: every obstacle is below one tree of its body, and the boxes above it hold all of it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from sceniris_gym.geometry.colliders import PIECE_LEAF, Collider, collect_colliders, collider_arrays
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces

# Two tetrahedra in one mesh, beside each other.
PAIR = "0 0 0 .1 0 0 0 .1 0 0 0 .1 .3 0 0 .4 0 0 .3 .1 0 .3 0 .1"
PAIR_FACES = "0 2 1 0 1 3 0 3 2 1 2 3 4 6 5 4 5 7 4 7 6 5 6 7"
MODEL = f"""
<mujoco>
  <asset><mesh name="pair" vertex="{PAIR}" face="{PAIR_FACES}"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <geom type="box" size=".3 .2 .1" pos="1 0 .1" euler="0 0 30"/>
    <geom type="plane" size="1 1 .1" zaxis="1 0 0"/>
    <body name="tower" pos="0 1 0">
      <geom type="sphere" size=".1" pos="0 0 .1"/>
      <geom type="capsule" size=".05 .2" pos="0 0 .4" euler="40 0 10"/>
      <geom type="cylinder" size=".1 .05" pos="0 .1 .8" euler="20 50 0"/>
      <geom type="ellipsoid" size=".1 .05 .2" pos="0 0 1.2" euler="0 30 0"/>
    </body>
    <body name="empty"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    <body name="two"><geom type="mesh" mesh="pair" euler="10 20 30" pos=".1 .2 .3"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def mjm() -> mujoco.MjModel:
    """Return two planes and a box of the world, a tower of round things, and a mesh of two parts."""
    return mujoco.MjModel.from_xml_string(MODEL)


def _collected(mjm: mujoco.MjModel, geometry: str) -> tuple[list[Piece], list[Collider], dict[str, np.ndarray]]:
    pieces = extract_pieces(mjm, geometry)
    pieces = sorted(pieces, key=lambda p: (p.body, p.type != PieceType.PLANE, p.geom))
    colliders = collect_colliders(pieces, geometry == "visual", "cpu")
    return pieces, colliders, collider_arrays(colliders)


def _leaves(arrays: dict[str, np.ndarray], node: int, above: tuple[int, ...] = ()) -> dict[int, tuple[int, ...]]:
    """The leaves below a node, each with all nodes on the way to it."""
    child = int(arrays["node_child"][node])
    if child < 0:
        return {~child: (*above, node)}
    return _leaves(arrays, child, (*above, node)) | _leaves(arrays, child + 1, (*above, node))


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_body_has_one_collider_for_all_that_is_solid_and_one_for_each_plane(mjm: mujoco.MjModel, geometry: str):
    """A body without geoms has none."""
    pieces, colliders, arrays = _collected(mjm, geometry)
    solid = arrays["collider_plane"] < 0
    assert sorted(arrays["collider_body"][solid]) == [0, mjm.body("tower").id, mjm.body("two").id]
    assert [pieces[i].type for i in arrays["collider_plane"][~solid]] == [PieceType.PLANE] * 2
    assert arrays["collider_body"][~solid].tolist() == [0, 0]
    assert ((arrays["collider_mesh"] != 0) == (solid if geometry == "visual" else np.zeros_like(solid))).all()
    assert sum(c.mesh is not None for c in colliders) == (solid.sum() if geometry == "visual" else 0)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_every_node_belongs_to_one_collider_and_every_leaf_to_one_node(mjm: mujoco.MjModel, geometry: str):
    """The leaves of `physics` are pieces, those of `visual` faces and round pieces; trees are halved."""
    pieces, _, arrays = _collected(mjm, geometry)
    found, nodes = [], []
    for root, plane in zip(arrays["collider_root"], arrays["collider_plane"], strict=True):
        below = _leaves(arrays, int(root))
        found += [] if plane >= 0 else [*below]
        nodes += {node for way in below.values() for node in way}
        assert max(map(len, below.values())) == np.ceil(np.log2(len(below))) + 1
    solid = [i for i, p in enumerate(pieces) if p.type != PieceType.PLANE]
    rounded = [PIECE_LEAF + i for i in solid if pieces[i].type not in (PieceType.BOX, PieceType.HULL)]
    assert len(rounded) == 4
    assert sorted(found) == (solid if geometry == "physics" else [*range(len(arrays["face_a"])), *rounded])
    assert sorted(nodes) == list(range(len(arrays["node_child"])))


def test_the_boxes_over_a_piece_hold_all_of_its_surface(mjm: mujoco.MjModel):
    """Points of closed meshes that are made here, as MuJoCo places its geoms in their bodies."""
    pieces, _, arrays = _collected(mjm, "physics")
    for root in arrays["collider_root"][arrays["collider_plane"] < 0]:
        for leaf, way in _leaves(arrays, int(root)).items():
            points = _surface(mjm, pieces[leaf].geom)
            for node in way:
                assert (np.abs(points - arrays["node_center"][node]) <= arrays["node_half"][node]).all()
            assert (np.abs(points - arrays["node_center"][way[-1]]).max(0) >= 0.95 * arrays["node_half"][way[-1]]).all()


def test_the_boxes_over_a_face_hold_its_corners(mjm: mujoco.MjModel):
    """In float32 as well, in which the device keeps both."""
    _, _, arrays = _collected(mjm, "visual")
    corners = np.stack([arrays["face_a"], arrays["face_b"], arrays["face_c"]], axis=1).astype(np.float32)
    center, half = (arrays[name].astype(np.float32) for name in ("node_center", "node_half"))
    for root in arrays["collider_root"][arrays["collider_plane"] < 0]:
        for leaf, way in _leaves(arrays, int(root)).items():
            for node in way if leaf < PIECE_LEAF else ():
                assert (np.abs(corners[leaf] - center[node]) <= half[node]).all()


def test_the_boxes_over_a_round_piece_that_is_seen_hold_all_of_its_surface(mjm: mujoco.MjModel):
    """Finer meshes of them than those that stand for their roofs."""
    pieces, _, arrays = _collected(mjm, "visual")
    for root in arrays["collider_root"][arrays["collider_plane"] < 0]:
        for leaf, way in _leaves(arrays, int(root)).items():
            for node in way if leaf >= PIECE_LEAF else ():
                points = _surface(mjm, pieces[leaf - PIECE_LEAF].geom)
                assert (np.abs(points - arrays["node_center"][node]) <= arrays["node_half"][node]).all()


def test_faces_are_those_that_mujoco_draws(mjm: mujoco.MjModel):
    """Of the mesh of two parts, in the frame of its body."""
    _, _, arrays = _collected(mjm, "visual")
    body = mjm.body("two").id
    root = int(arrays["collider_root"][(arrays["collider_body"] == body) & (arrays["collider_plane"] < 0)][0])
    mine = sorted(_leaves(arrays, root))
    corners = np.stack([arrays["face_a"], arrays["face_b"], arrays["face_c"]], axis=1)[mine]
    geom = int(mjm.body_geomadr[body])
    turn = Rotation.from_quat(mjm.geom_quat[geom], scalar_first=True)
    drawn = (turn.apply(mjm.mesh_vert.astype(float)) + mjm.geom_pos[geom])[mjm.mesh_face]
    np.testing.assert_allclose(_in_order(corners), _in_order(drawn), atol=1e-9)


def test_one_point_stands_for_each_closed_part(mjm: mujoco.MjModel):
    """Parts are counted here by shared corners: a mesh of two has two points, one on each of them."""
    pieces, _, arrays = _collected(mjm, "visual")
    for body, adr, num in zip(*(arrays[f"collider_{n}"] for n in ("body", "pointadr", "pointnum")), strict=True):
        points = arrays["point"][adr : adr + num]
        meshes = [p.mesh for p in pieces if p.body == body and p.mesh is not None]
        parts = [part for mesh in meshes for part in _parts(mesh)]
        if num == 0:  # a plane
            continue
        assert num == len(parts)
        for part in parts:
            assert (np.linalg.norm(points[:, None] - part, axis=2).min(1) < 1e-9).sum() == 1
    two = arrays["collider_body"] == mjm.body("two").id
    assert arrays["collider_pointnum"][two].tolist() == [2]


def test_without_pieces_there_are_no_colliders_and_arrays_keep_their_shapes():
    """An empty scene is a scene."""
    arrays = collider_arrays(collect_colliders([], False, "cpu"))
    assert all(len(values) == 0 for values in arrays.values())
    for name in ("node_center", "node_half", "face_a", "face_b", "face_c", "point"):
        assert arrays[name].shape == (0, 3)


def _surface(mjm: mujoco.MjModel, geom: int) -> np.ndarray:
    """Points on a geom in its body's frame, shape (n, 3)."""
    (x, y, z), kind = mjm.geom_size[geom], mujoco.mjtGeom(int(mjm.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        points = mjm.mesh_vert.astype(float)
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        points = trimesh.creation.box([2 * x, 2 * y, 2 * z]).vertices
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        points = trimesh.creation.cylinder(x, 2 * y, sections=200).vertices
    else:
        ball = trimesh.creation.icosphere(subdivisions=4).vertices
        points = ball * ([x, y, z] if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else x)
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            points = points + np.sign(points[:, 2:]) * [0.0, 0.0, y]
    turn = Rotation.from_quat(mjm.geom_quat[geom], scalar_first=True)
    return turn.apply(np.asarray(points)) + mjm.geom_pos[geom]


def _parts(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    """Vertices of the connected parts of a mesh."""
    a, b = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]]]).T
    n = len(mesh.vertices)
    count, part = connected_components(coo_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)
    return [np.asarray(mesh.vertices)[part == i] for i in range(count)]


def _in_order(triangles: np.ndarray) -> np.ndarray:
    """The same triangles (n, 3, 3) in an order that depends on their corners alone, the least corner first."""
    rows = []
    for corners in triangles:
        first = min(range(3), key=lambda i, c=corners: tuple(c[i].round(6)))
        rows.append(np.roll(corners, -first, axis=0))
    return np.array(sorted(rows, key=lambda c: tuple(c.round(6).ravel())))
