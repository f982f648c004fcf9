"""The layer of pieces: colliding geometry, each body in a colour of its own."""

from __future__ import annotations

import numpy as np
import trimesh

from sceniris_gym.geometry.pieces import PieceType, extract_pieces
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import GREY, PALETTE, Sketch

_MOST = 2.0  # m; half the edge of a drawn plane that has no size


def sketch_pieces(world: ShownWorld, opacity: float = 1.0) -> Sketch:
    """Draw the pieces of all bodies as physics collides them, meshes as convex hulls, and planes in grey."""
    sketch, data = Sketch(), world.data
    hidden = set(world.hidden_bodies())
    pieces = [p for p in extract_pieces(world.compiled.mjm, "physics") if p.body not in hidden]
    for piece in pieces:
        if piece.type == PieceType.PLANE:
            x, y = np.where(piece.size[:2] > 0.0, piece.size[:2], _MOST)
            corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
            turn, at = data.geom_xmat[piece.geom].reshape(3, 3), data.geom_xpos[piece.geom]
            sketch.surfaces.append((corners @ turn.T + at, np.array([[0, 1, 2], [0, 2, 3]]), GREY, 0.4 * opacity))
    for number, body in enumerate(sorted({p.body for p in pieces})):
        if meshes := [p.mesh for p in pieces if p.body == body and p.mesh is not None and p.type != PieceType.PLANE]:
            vertices, faces = trimesh.util.append_faces([m.vertices for m in meshes], [m.faces for m in meshes])
            turn, at = data.xmat[body].reshape(3, 3), data.xpos[body]
            sketch.surfaces.append((vertices @ turn.T + at, faces, PALETTE[number % len(PALETTE)], opacity))
    return sketch
