"""The layer of pieces: colliding geometry, each body in a colour of its own."""

from __future__ import annotations

import numpy as np

from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import GREY, PALETTE, Colour, Sketch

_MOST = 2.0  # m; half the edge of a drawn plane that has no size


def sketch_pieces(world: ShownWorld, opacity: float = 1.0) -> Sketch:
    """Draw the pieces of all bodies as physics collides them, meshes as convex hulls, and planes in grey."""
    sketch = Sketch()
    hidden = set(world.hidden_bodies())
    pieces = [p for p in extract_pieces(world.compiled.mjm, "physics") if p.body not in hidden]
    for number, body in enumerate(sorted({p.body for p in pieces})):
        add_pieces(sketch, world, [p for p in pieces if p.body == body], PALETTE[number % len(PALETTE)], opacity)
    return sketch


def add_pieces(sketch: Sketch, world: ShownWorld, pieces: list[Piece], colour: Colour, opacity: float) -> None:
    """Add the pieces of one body where it is, solid ones as one surface."""
    vertices, faces, count = [], [], 0
    for piece in pieces:
        mat, pos = world.data.xmat[piece.body].reshape(3, 3), world.data.xpos[piece.body]
        if piece.type == PieceType.PLANE:
            x, y = np.where(piece.size[:2] > 0.0, piece.size[:2], _MOST)
            corners = np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]])
            turn, at = world.data.geom_xmat[piece.geom].reshape(3, 3), world.data.geom_xpos[piece.geom]
            sketch.surfaces.append((corners @ turn.T + at, np.array([[0, 1, 2], [0, 2, 3]]), GREY, 0.4 * opacity))
        elif piece.mesh is not None:
            vertices.append(np.asarray(piece.mesh.vertices) @ mat.T + pos)
            faces.append(np.asarray(piece.mesh.faces) + count)
            count += len(vertices[-1])
    if vertices:
        sketch.surfaces.append((np.concatenate(vertices), np.concatenate(faces), colour, opacity))
