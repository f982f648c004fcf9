"""A body that is not convex, for trimesh and as a MuJoCo model."""

import mujoco
import numpy as np
import shapely
import trimesh


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    """Return the outward triangles (12, 3, 3) of a box between two corners."""
    return trimesh.creation.box(bounds=[low, high]).triangles.view(np.ndarray)


def angle() -> trimesh.Trimesh:
    """Return an L of five cubes of 1 m: two times three in a plane that share the one at the corner."""
    outline = shapely.Polygon([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])
    return trimesh.creation.extrude_polygon(outline, 1.0)


def model_of(mesh: trimesh.Trimesh) -> mujoco.MjModel:
    """Return a model of one geom, the mesh."""
    vertices, faces = (" ".join(map(str, values.ravel())) for values in (mesh.vertices, mesh.faces))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="mesh" vertex="{vertices}" face="{faces}"/></asset>'
        '<worldbody><geom type="mesh" mesh="mesh"/></worldbody></mujoco>'
    )
