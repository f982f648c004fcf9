"""Cores lie inside of their pieces, and are not much smaller than they could be."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from sceniris_gym.geometry.inner_boxes import inner_box
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces

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


def _piece(name: str) -> Piece:
    meshes = f'<mesh name="gem" vertex="{GEM}" scale=".1 .1 .1"/><mesh name="wedge" vertex="{WEDGE}"/>'
    xml = f'<mujoco><asset>{meshes}</asset><worldbody><body pos="1 2 3">{SHAPES[name]}</body></worldbody></mujoco>'
    return extract_pieces(mujoco.MjModel.from_xml_string(xml), "physics")[0]


def _holds(piece: Piece, points: np.ndarray) -> np.ndarray:
    """Return which points, in the piece's frame, lie in it; for hulls, by the planes of their faces."""
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
