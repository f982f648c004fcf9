"""Colliders: every obstacle is below one tree of its body, depths are no less than true, and inner boxes lie inside."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from sceniris_gym.geometry.colliders import (
    PIECE_LEAF,
    Collider,
    build_tree,
    collect_colliders,
    collider_arrays,
    inner_box,
    most_depth,
)
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
CELLS = 24
GEM = "1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1"
WEDGE = "0 0 0 .3 0 0 .3 .2 0 0 .2 0 0 0 .1 0 .2 .1"
SHAPES = {
    "ball": '<geom type="sphere" size=".05"/>',
    "pill": '<geom type="capsule" size=".03 .1"/>',
    "drum": '<geom type="cylinder" size=".05 .02"/>',
    "egg": '<geom type="ellipsoid" size=".05 .03 .02"/>',
    "box": '<geom type="box" size=".2 .1 .01" euler="30 40 50"/>',
    "gem": '<geom type="mesh" mesh="gem" euler="10 20 30"/>',
    "wedge": '<geom type="mesh" mesh="wedge"/>',
    "ball with sizes of no use": '<geom type="sphere" size=".05 -1 -1"/>',
    "needle": '<geom type="capsule" size=".0008 .05"/>',
    "thread": '<geom type="capsule" size=".0004 .05"/>',
    "wire": '<geom type="cylinder" size=".0005 .05"/>',
}
# Share of the volume that the best box has: pi/2 of a ball's cube and more, 2/9 of an octahedron, 1/2 of a prism.
BEST = {"ball": 0.36, "pill": 0.5, "drum": 0.63, "egg": 0.36, "box": 1.0, "gem": 2 / 9, "wedge": 0.5}
BEST |= {"ball with sizes of no use": 0.36, "needle": 0.0, "thread": 0.0, "wire": 0.0}


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


def _leaves_box_tree(n: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(n)
    middle = rng.normal(size=(n, 3)) * [1.0, 0.1, 3.0]
    half = rng.uniform(0.0, 0.2, size=(n, 3))
    if kind == "equal":
        middle, half = np.ones((n, 3)), np.full((n, 3), 0.5)
    if kind == "flat":
        middle[:, 1:] = 0.0
        half[:, 1:] = 0.0
    return middle - half, middle + half


def _below(child: np.ndarray, node: int) -> list[int]:
    """The leaves below a node."""
    left = int(child[node])
    return [~left] if left < 0 else _below(child, left) + _below(child, left + 1)


@pytest.mark.parametrize("kind", ["random", "equal", "flat"])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_every_leaf_is_there_once_and_every_node_is_the_box_of_its_leaves(n: int, kind: str):
    """From a single leaf to a mesh, with boxes that are all alike, and without extent."""
    lower, upper = _leaves_box_tree(n, kind)
    center, half, child = build_tree(lower, upper)
    assert len(child) == len(center) == len(half) == 2 * n - 1
    assert sorted(_below(child, 0)) == list(range(n))
    for node in range(len(child)):
        below = _below(child, node)
        np.testing.assert_allclose(center[node] - half[node], lower[below].min(axis=0), atol=1e-12)
        np.testing.assert_allclose(center[node] + half[node], upper[below].max(axis=0), atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_children_are_given_once_and_behind_their_parents(n: int):
    """The root is the first node, and no node but the root has no parent."""
    _, _, child = build_tree(*_leaves_box_tree(n, "random"))
    inner = np.flatnonzero(child >= 0)
    assert (child[inner] > inner).all()
    children = np.concatenate([child[inner], child[inner] + 1])
    assert sorted(children) == list(range(1, len(child)))


@pytest.mark.parametrize("n", [1, 2, 3, 7, 64, 1153])
def test_a_tree_is_no_deeper_than_halving_makes_it(n: int):
    """Its depth bounds the stack of the collision test."""
    _, _, child = build_tree(*_leaves_box_tree(n, "random"))

    def deep(node: int) -> int:
        left = int(child[node])
        return 0 if left < 0 else 1 + max(deep(left), deep(left + 1))

    assert deep(0) == int(np.ceil(np.log2(n)))


def _turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0.2, 0.3]))
    return mesh


def _two() -> trimesh.Trimesh:
    small, large = trimesh.creation.box((0.1, 0.1, 0.1)), trimesh.creation.box((0.3, 0.4, 0.5))
    vertices = np.concatenate([large.vertices, small.vertices + [1.0, 0.0, 0.0]])
    return trimesh.Trimesh(vertices, np.concatenate([large.faces, small.faces + len(large.vertices)]))


MESHES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "box": lambda: trimesh.creation.box((0.4, 0.3, 0.2)),
    "turned box": lambda: _turned(trimesh.creation.box((0.4, 0.3, 0.2))),
    "sheet": lambda: trimesh.creation.box((0.5, 0.5, 0.001)),
    "turned sheet": lambda: _turned(trimesh.creation.box((0.5, 0.5, 0.001))),
    "needle": lambda: _turned(trimesh.creation.cylinder(0.002, 0.6)),
    "ball": lambda: trimesh.creation.icosphere(3, 0.05),
    "pipe": lambda: trimesh.creation.annulus(0.08, 0.1, 0.3),
    "ring": lambda: trimesh.creation.torus(0.3, 0.1),
    "two": _two,
    "grain": lambda: trimesh.creation.box((1e-5, 1e-5, 1e-5)),
}


_PAIRS = 5_000  # of a point and a triangle at once, whose numbers stay in a processor's cache


def _depth(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Distance [m] of points from the surface, by trimesh; negative outside, by the sum of all solid angles.

    A. van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomedical Engineering 30(2), 1983.
    """
    return np.concatenate(
        [_few_depths(mesh, few) for few in np.array_split(points, 1 + len(points) * len(mesh.faces) // _PAIRS)]
    )


def _few_depths(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    triangles, each = np.tile(mesh.triangles, (len(points), 1, 1)), np.repeat(points, len(mesh.faces), axis=0)
    distance = np.linalg.norm(trimesh.triangles.closest_point(triangles, each) - each, axis=1)
    distance = distance.reshape(len(points), -1).min(axis=1)
    a, b, c = (mesh.triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    volume = (a * np.cross(b, c)).sum(axis=2)
    cosine = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    inside = np.arctan2(volume, cosine).sum(axis=1) > np.pi
    return np.where(inside, distance, -distance)


def _greatest_depth(mesh: trimesh.Trimesh) -> float:
    """The depth [m] of the deepest of many points, and of many more around the deepest ones found before."""
    rng = np.random.default_rng(0)
    inward = np.linspace(0.0, mesh.extents.min(), 6)[1:, None, None] * -mesh.face_normals[:20]
    points = np.concatenate(
        [rng.uniform(mesh.bounds[0], mesh.bounds[1], (1000, 3)), (mesh.triangles_center[:20] + inward).reshape(-1, 3)]
    )
    spread, deepest = 0.1 * mesh.scale, 0.0
    for _ in range(16):
        depth = _depth(mesh, points)
        deepest = max(deepest, float(depth.max()))
        best = points[np.argsort(depth)[-5:]]
        spread *= 0.6
        points = np.concatenate([best, (best[:, None] + rng.normal(0.0, spread, (5, 40, 3))).reshape(-1, 3)])
    return deepest


@pytest.mark.parametrize("name", MESHES)
def test_no_point_inside_is_deeper_than_the_bound(name: str):
    """By trimesh's distances of points all over the solid; and the bound is too large by half a cell's diagonal."""
    mesh = MESHES[name]()
    assert mesh.is_watertight
    points = wp.array(mesh.vertices, dtype=wp.vec3, device="cpu")
    indices = wp.array(mesh.faces.ravel(), dtype=int, device="cpu")
    solid = wp.Mesh(points, indices, support_winding_number=True)
    bound = most_depth(solid, mesh.bounds[0], mesh.bounds[1], "cpu")
    truth = _greatest_depth(mesh)
    cell = max(float(mesh.extents.max()) / CELLS, 1e-6)
    assert truth > 0.0
    assert bound >= truth
    assert bound <= truth + 0.5 * np.sqrt(3.0) * cell + 1e-6


def _piece(name: str) -> Piece:
    meshes = f'<mesh name="gem" vertex="{GEM}" scale=".1 .1 .1"/><mesh name="wedge" vertex="{WEDGE}"/>'
    xml = f'<mujoco><asset>{meshes}</asset><worldbody><body pos="1 2 3">{SHAPES[name]}</body></worldbody></mujoco>'
    return extract_pieces(mujoco.MjModel.from_xml_string(xml), "physics")[0]


def _holds(piece: Piece, points: np.ndarray) -> np.ndarray:
    """Return which points, in the piece's frame, lie in it: of hulls by the planes of their faces."""
    (x, y, z), kind = np.abs(piece.size), piece.type
    if kind in (PieceType.SPHERE, PieceType.CAPSULE):
        along = np.clip(points[:, 2], -y, y) if kind == PieceType.CAPSULE else 0.0
        beside = np.linalg.norm(points - np.array([0.0, 0.0, 1.0]) * np.reshape(along, (-1, 1)), axis=1)
        return np.asarray(beside <= x)
    if kind == PieceType.CYLINDER:
        return np.asarray((np.hypot(points[:, 0], points[:, 1]) <= x) & (np.abs(points[:, 2]) <= y))
    if kind == PieceType.ELLIPSOID:
        return np.asarray(np.linalg.norm(points / [x, y, z], axis=1) <= 1.0)
    if kind == PieceType.BOX:
        return np.asarray((np.abs(points) <= [x, y, z]).all(axis=1))
    mesh = trimesh.convex.convex_hull(piece.vertices)
    heights = points @ mesh.face_normals.T - (mesh.face_normals * mesh.triangles[:, 0]).sum(axis=1)
    return np.asarray((heights <= 0.0).all(axis=1))


@pytest.mark.parametrize("name", SHAPES)
def test_the_corners_of_a_core_lie_inside_and_it_has_most_of_the_room(name: str):
    """By 20 um at least; and it has two thirds of the volume of the best box there is."""
    piece = _piece(name)
    center, half = inner_box(piece)
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8).T
    assert piece.mesh is not None
    assert half.min() > 0.0 or name == "thread"  # which is too thin for one
    assert _holds(piece, center + signs * (half + 1.5e-5 * (half > 0.0))).all()
    assert 8.0 * half.prod() >= 0.66 * BEST[name] * piece.mesh.convex_hull.volume


def test_cores_of_random_hulls_lie_inside():
    """Of any shape, long and flat ones too."""
    rng = np.random.default_rng(0)
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8).T
    some = 0
    for _ in range(200):
        points = rng.normal(size=(rng.integers(4, 60), 3)) * 10.0 ** rng.uniform(-3.0, 0.0, 3)
        points = Rotation.random(rng=rng).apply(points)
        text = " ".join(map(str, points.ravel()))
        xml = f'<mujoco><asset><mesh name="m" vertex="{text}"/></asset><worldbody><geom type="mesh" mesh="m"/>'
        try:
            piece = extract_pieces(mujoco.MjModel.from_xml_string(xml + "</worldbody></mujoco>"), "physics")[0]
        except ValueError:  # too flat for MuJoCo
            continue
        center, half = inner_box(piece)
        some += half.min() > 0.0
        assert half.min() == 0.0 or _holds(piece, center + signs * (half + 1.5e-5)).all()
    assert some > 100


def test_a_hull_of_many_faces_takes_no_more_memory_than_they_do():
    """20,480 faces and 10,242 vertices: as a table of both it would be 1.7 GB."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.1)
    piece = replace(_piece("gem"), vertices=np.asarray(ball.vertices), mesh=ball, pos=np.zeros(3), quat=np.eye(4)[0])
    tracemalloc.start()
    _, half = inner_box(piece)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert half.min() > 0.05
    assert peak < 1e8


def test_a_plane_and_a_sheet_have_none():
    """A box of less than 0.6 mm proves nothing worth the test."""
    xml = (
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><geom type="box" size=".1 .1 .0002"/></worldbody></mujoco>'
    )
    for piece in extract_pieces(mujoco.MjModel.from_xml_string(xml), "physics"):
        assert inner_box(piece)[1].tolist() == [0.0, 0.0, 0.0]
