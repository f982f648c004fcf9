"""Cores lie inside of their pieces, and are not much smaller than they could be."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from sceniris_gym.geometry.cores import piece_core
from sceniris_gym.geometry.pieces import Piece, extract_pieces
from sceniris_gym.geometry.rotations import matrix

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
}
# Share of the volume that the best box has: pi/2 of a ball's cube and more, 2/9 of an octahedron, 1/2 of a prism.
BEST = {"ball": 0.36, "pill": 0.5, "drum": 0.63, "egg": 0.36, "box": 1.0, "gem": 2 / 9, "wedge": 0.5}


def _piece(name: str) -> Piece:
    meshes = f'<mesh name="gem" vertex="{GEM}" scale=".1 .1 .1"/><mesh name="wedge" vertex="{WEDGE}"/>'
    xml = f'<mujoco><asset>{meshes}</asset><worldbody><body pos="1 2 3">{SHAPES[name]}</body></worldbody></mujoco>'
    return extract_pieces(mujoco.MjModel.from_xml_string(xml), "physics")[0]


def _holds(piece: Piece, points: np.ndarray) -> np.ndarray:
    """Which points, in the piece's frame, lie in its surface as it is tessellated: by its faces' planes."""
    assert piece.mesh is not None
    mesh = trimesh.convex.convex_hull((piece.mesh.vertices - piece.pos) @ matrix(piece.quat))
    heights = points @ mesh.face_normals.T - (mesh.face_normals * mesh.triangles[:, 0]).sum(axis=1)
    return (heights <= 0.0).all(axis=1)


@pytest.mark.parametrize("name", SHAPES)
def test_the_corners_of_a_core_lie_inside_and_it_has_most_of_the_room(name: str):
    """By 20 um at least; and it has two thirds of the volume of the best box there is."""
    piece = _piece(name)
    center, half = piece_core(piece)
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8).T
    assert piece.mesh is not None
    assert half.min() > 0.0
    assert _holds(piece, center + signs * (half + 1.5e-5)).all()
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
        center, half = piece_core(piece)
        some += half.min() > 0.0
        assert half.min() == 0.0 or _holds(piece, center + signs * (half + 1.5e-5)).all()
    assert some > 100


def test_a_plane_and_a_sheet_have_none():
    """A box of less than 0.6 mm proves nothing worth the test."""
    xml = (
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/><geom type="box" size=".1 .1 .0002"/></worldbody></mujoco>'
    )
    for piece in extract_pieces(mujoco.MjModel.from_xml_string(xml), "physics"):
        assert piece_core(piece)[1].tolist() == [0.0, 0.0, 0.0]
