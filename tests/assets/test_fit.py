"""Fit of contacts to visible surfaces: no piece sticks out of those of its body, and little is left bare."""

from __future__ import annotations

from importlib.resources import files

import manifold3d
import numpy as np
import pytest
import trimesh

from tests.assets.geometry import COLLISION, VISUAL, depth_outside, distance_to, geoms, load, mesh, solid

FILES = [file.name for file in files("sceniris_gym.assets").iterdir()]
ASSETS = sorted(name.removesuffix(".xml") for name in FILES if name.endswith(".xml"))
# How far a piece may reach out of the surfaces, and a surface out of the pieces [m].
ARMS = ("panda", "ur5e", "heron")
OUT, BARE = dict.fromkeys(ARMS, 1e-4), dict.fromkeys(ARMS, 0.010) | {"pan": 0.0032, "chair": 0.0027}


def dense(shape: trimesh.Trimesh) -> np.ndarray:
    """Points (n, 3) on a surface: corners, middles of edges, centres of faces, and 2,000 anywhere on its faces."""
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], (2000, 1))
    faces = np.random.default_rng(1).choice(len(shape.faces), 2000, p=shape.area_faces / shape.area)
    middles = shape.vertices[shape.edges_unique].mean(axis=1)
    return np.concatenate([shape.vertices, middles, shape.triangles_center, (weights @ shape.triangles[faces])[:, 0]])


@pytest.mark.parametrize("name", ASSETS)
def test_no_piece_sticks_out_of_what_the_eye_sees(name):
    """The rest of a piece outside the solids of its body is nowhere further than 0.03 mm from their surfaces."""
    model, data = load(name)
    limit = OUT.get(name, 3e-5)
    for body in range(1, model.nbody):
        seen = [mesh(model, data, g) for g in geoms(model, VISUAL, model.body(body).name)]
        solids = [solid(shape) for shape in seen]
        triangles = np.concatenate([shape.triangles for shape in seen]) if seen else np.empty((0, 3, 3))
        for geom in geoms(model, COLLISION, model.body(body).name):
            left = solid(mesh(model, data, geom).convex_hull)
            for other in solids:
                left = left - other
            points = remains(left)
            if len(points):
                assert distance_to(triangles, points, limit).max() <= limit - 1e-5, model.geom(geom).name


def remains(left: manifold3d.Manifold) -> np.ndarray:
    """Corners, middles of edges and centres of faces (n, 3) of what is left of a solid, but for slivers.

    A spike as high and as wide as the limit has a volume of 1e-14 m^3.
    """
    points = [np.empty((0, 3))]
    for lump in left.decompose():
        if lump.volume() > 1e-16:
            data = lump.to_mesh64()
            shape = trimesh.Trimesh(data.vert_properties[:, :3], data.tri_verts, process=False)
            points += [shape.vertices, shape.vertices[shape.edges_unique].mean(axis=1), shape.triangles_center]
    return np.concatenate(points)


@pytest.mark.parametrize("name", ASSETS)
def test_pieces_leave_little_of_a_surface_bare(name):
    """No point of a visual surface is further than 2 mm from the pieces of its body; the arm's fillets are bare."""
    model, data = load(name)
    limit = BARE.get(name, 0.002)
    for body in range(1, model.nbody):
        chosen = geoms(model, COLLISION, model.body(body).name)
        for geom in geoms(model, VISUAL, model.body(body).name):
            points = dense(mesh(model, data, geom))
            far = points[depth_outside(model, data, chosen, points) > limit / 2]
            if len(far):
                faces = np.concatenate([mesh(model, data, g).convex_hull.triangles for g in chosen])
                assert distance_to(faces, far, 2 * limit).max() < limit, model.geom(geom).name


@pytest.mark.parametrize(
    ("name", "body", "geom"),
    [
        ("table", "table", "top"),
        ("cabinet", "cabinet", "frame_top"),
        ("cabinet", "cabinet", "frame_shelf"),
        ("cabinet", "upper_drawer", "upper_floor"),
        ("mug", "mug", "bottom"),
        ("mug_16k", "mug_16k", "bottom"),
        ("bowl", "bowl", "bottom"),
        ("bowl_16k", "bowl_16k", "bottom"),
        ("can", "can", "hull"),
    ],
)
def test_a_surface_that_carries_is_where_the_eye_sees_it(name, body, geom):
    """The top of the piece is the height of a level face of the visual surface, within a micrometre."""
    model, data = load(name)
    shape = mesh(model, data, geoms(model, VISUAL, body)[0])
    level = (shape.face_normals[:, 2] > 0.999) & (shape.area_faces > 1e-6)
    top = mesh(model, data, model.geom(geom).id).vertices[:, 2].max()
    assert np.abs(shape.triangles_center[level][:, 2] - top).min() < 1e-6


@pytest.mark.parametrize("name", [name for name in ASSETS if name not in ARMS])
def test_pieces_stand_on_the_ground_as_the_eye_sees_it(name):
    """The lowest points of both are at z = 0, and those of the pieces span an area under the centre of mass."""
    model, data = load(name)
    feet = []
    for group in (VISUAL, COLLISION):
        corners = np.concatenate([mesh(model, data, g).vertices for g in geoms(model, group)])
        assert abs(corners[:, 2].min()) < 1e-6
        feet.append(corners[corners[:, 2] < 1e-5])
    centre = np.array([*data.body(1).xipos[:2], 0.0])
    corners = trimesh.PointCloud(np.vstack([feet[1], feet[1] + [0, 0, 1.0]])).convex_hull
    inside = (corners.face_normals * (centre + [0, 0, 0.5] - corners.triangles_center)).sum(axis=1)
    assert inside.max() < 0.0
