"""Every shipped asset: its file, its surfaces, its size, and that it stays where it is put."""

from __future__ import annotations

import importlib
from importlib.resources import files

import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from tests.assets.geometry import COLLISION, VISUAL, bounds, depth_outside, geoms, load, mesh, visual, winding

SMALL = ["apple", "orange", "banana", "mug", "bowl", "can"]
FINE = [f"{name}_16k" for name in SMALL]
OTHERS = ["table", "cabinet", "panda", "ur5e", "heron"]
# Least and greatest extent along x, y, z [mm].
SIZES = {
    "apple": ((70, 78), (70, 78), (70, 90)),
    "orange": ((65, 85), (65, 85), (60, 85)),
    "banana": ((170, 200), (45, 80), (28, 45)),
    "mug": ((95, 130), (75, 95), (85, 105)),
    "bowl": ((130, 170), (130, 170), (50, 80)),
    "can": ((60, 70), (60, 70), (110, 125)),
}


@pytest.mark.parametrize("name", SMALL + FINE + OTHERS)
def test_an_asset_opens_alone_and_is_one_root_body(name):
    """One file, one root body named like the asset, meshes for the eye, meshes or boxes for contacts."""
    model, _ = load(name)
    assert [model.body(i).name for i in range(1, model.nbody) if model.body_parentid[i] == 0] == [name.split("/")[0]]
    assert model.nkey == (1 if model.njnt else 0)
    for geom in range(model.ngeom):
        touches = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        assert model.geom_group[geom] == (COLLISION if touches else VISUAL)
        kinds = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_BOX) if touches else (mujoco.mjtGeom.mjGEOM_MESH,)
        assert int(model.geom_type[geom]) in [int(kind) for kind in kinds]


@pytest.mark.parametrize("name", SMALL + FINE + OTHERS)
def test_every_surface_is_closed_and_faces_outward(name):
    """As MuJoCo holds them: no gaps, one winding, a positive volume, one component."""
    model, data = load(name)
    for geom in geoms(model, VISUAL) + geoms(model, COLLISION):
        shape = mesh(model, data, geom)
        assert shape.is_watertight, model.geom(geom).name
        assert shape.is_winding_consistent, model.geom(geom).name
        assert shape.volume > 0, model.geom(geom).name
        assert shape.body_count == 1, model.geom(geom).name


@pytest.mark.parametrize("name", SMALL)
def test_small_objects_have_the_size_they_claim_and_stand_on_their_origin(name):
    """Extents lie in the stated ranges, and the origin is the bottom centre of the bounds."""
    model, data = load(name)
    for group in (VISUAL, COLLISION):
        low, high = bounds(model, data, geoms(model, group))
        for extent, (least, greatest) in zip(1000 * (high - low), SIZES[name], strict=True):
            assert least <= extent <= greatest
        np.testing.assert_allclose(low[2], 0.0, atol=1e-6)
        np.testing.assert_allclose((low + high)[:2] / 2, 0.0, atol=0.0012)


@pytest.mark.parametrize("name", SMALL)
def test_meshes_have_the_promised_numbers_of_faces(name):
    """About 1,000 to 2,000 faces, and 16,000 to 20,000 for the fine one, which is the same body otherwise."""
    coarse, fine = load(name)[0], load(f"{name}_16k")[0]
    assert 1000 <= coarse.mesh_facenum[coarse.geom_dataid[geoms(coarse, VISUAL)[0]]] <= 2000
    assert 16000 <= fine.mesh_facenum[fine.geom_dataid[geoms(fine, VISUAL)[0]]] <= 20000
    np.testing.assert_array_equal(coarse.body_mass, fine.body_mass)
    np.testing.assert_array_equal(coarse.body_inertia, fine.body_inertia)
    assert len(geoms(coarse, COLLISION)) == len(geoms(fine, COLLISION))


@pytest.mark.parametrize("name", [*SMALL, "panda", "ur5e", "heron"])
def test_collision_meshes_are_convex_and_have_few_corners(name):
    """Every vertex of a collision mesh is a corner of its hull; there are at most 80 of them, 64 for parts."""
    model, data = load(name)
    chosen = [g for g in geoms(model, COLLISION) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH]
    for geom in chosen:
        shape = mesh(model, data, geom)
        assert len(ConvexHull(shape.vertices).vertices) == len(shape.vertices) <= (80 if len(chosen) < 3 else 64)
        np.testing.assert_allclose(ConvexHull(shape.vertices).volume, shape.volume, rtol=1e-3)


@pytest.mark.parametrize("name", ["apple", "orange", "banana", "can"])
def test_collision_pieces_of_full_objects_fit_closely(name):
    """Their bounds are those of the visual surface within 1.9 mm, their volume is at most 12% less."""
    model, data = load(name)
    seen, felt = (bounds(model, data, geoms(model, group)) for group in (VISUAL, COLLISION))
    np.testing.assert_allclose(felt, seen, atol=0.0019)
    pieces = sum(mesh(model, data, g).volume for g in geoms(model, COLLISION))
    assert 0.88 < pieces / visual(name).volume < 1.0


@pytest.mark.parametrize(("name", "radius", "low", "high"), [("mug", 35.0, 8.0, 94.0), ("bowl", 41.0, 10.0, 61.0)])
def test_vessels_are_hollow(name, radius, low, high):
    """A cylinder [mm] within the vessel is free of its surface and of every piece; the wall beside it is solid."""
    model, data = load(name)
    # The vessel's axis: the mug's is off the origin, which is centred under the mug with its handle.
    first = geoms(model, COLLISION)[0]
    axis = mesh(model, data, first).vertices[:, :2].mean(axis=0)
    generator = np.random.default_rng(1)
    angle, share = generator.uniform(0, 2 * np.pi, 200), np.sqrt(generator.uniform(0, 1, 200))
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    height = generator.uniform(low, high, (200, 1))
    hollow = np.hstack([axis + around * share[:, None] * radius / 1000, height / 1000])
    pieces = geoms(model, COLLISION)
    assert depth_outside(model, data, pieces, hollow).min() > 0.0
    np.testing.assert_allclose(winding(visual(name), hollow), 0.0, atol=1e-6)
    middle = {"mug": 39.0, "bowl": 63.0}[name]
    wall = np.hstack([axis + around * middle / 1000, np.full((200, 1), {"mug": 50.0, "bowl": 42.0}[name] / 1000)])
    assert depth_outside(model, data, pieces, wall).max() < 0.0
    np.testing.assert_allclose(winding(visual(name), wall), 1.0, atol=1e-6)


@pytest.mark.parametrize("ground", ["plane", "table"])
@pytest.mark.parametrize("name", SMALL)
def test_small_objects_stay_where_they_are_put(name, ground):
    """Put 0.5 mm above a plane or a box at several yaws, they move less than 1 mm and tilt less than 0.5 degrees."""
    spec = mujoco.MjSpec()
    height = 0.0
    if ground == "plane":
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1])
    else:
        height = 0.4
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.4, 0.4, 0.02], pos=[0, 0, height - 0.02])
    asset = mujoco.MjSpec.from_file(str(files("sceniris_gym.assets") / f"{name}.xml"))
    spec.attach(asset, prefix="o/", frame=spec.worldbody.add_frame(pos=[0, 0, height + 0.0005]))
    spec.body(f"o/{name}").add_freejoint()
    model = spec.compile()
    data = mujoco.MjData(model)
    for yaw in (0.0, 1.1, 2.6):
        mujoco.mj_resetData(model, data)
        data.qpos[3:7] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        before = data.qpos.copy()
        mujoco.mj_step(model, data, nstep=1000)
        assert np.linalg.norm(data.qpos[:3] - before[:3]) < 0.001
        turned = 2 * np.arccos(min(1.0, abs(data.qpos[3:7] @ before[3:7])))
        assert np.degrees(turned) < 0.5


def test_the_table_is_a_flat_top_on_four_legs():
    """Its top is level at 0.4 m, for contacts and for the eye alike, and there is room below."""
    model, data = load("table")
    low, high = bounds(model, data, geoms(model, COLLISION))
    # Edges are rounded by 1.5 mm, so contacts end where the top's flat ends.
    np.testing.assert_allclose(low, [-0.3985, -0.4985, 0.0], atol=1e-9)
    np.testing.assert_allclose(high, [0.3985, 0.4985, 0.4], atol=1e-9)
    seen = bounds(model, data, geoms(model, VISUAL))
    np.testing.assert_allclose(seen, [[-0.4, -0.5, 0.0], [0.4, 0.5, 0.4]], atol=1e-6)
    below = np.array([[0.0, 0.0, 0.2], [0.2, 0.3, 0.1], [-0.3, 0.0, 0.05]])
    assert depth_outside(model, data, geoms(model, COLLISION), below).min() > 0.03
    np.testing.assert_allclose(winding(visual("table"), below), 0.0, atol=1e-6)


@pytest.mark.slow
def test_the_scripts_make_what_ships(tmp_path, monkeypatch):
    """Run anew, they write the same files, and meshes of the same extent."""
    pytest.importorskip("manifold3d")
    make_all = importlib.import_module("sceniris_gym.assets.make_all")
    paths = importlib.import_module("sceniris_gym.assets.paths")

    shipped = paths.FOLDER
    monkeypatch.setattr(paths, "FOLDER", tmp_path)
    (tmp_path / "meshes").mkdir()
    make_all.main()
    for pattern in ("*.xml", "meshes/*"):
        names = {path.name for path in tmp_path.glob(pattern)}
        assert names == {path.name for path in shipped.glob(pattern)}
    for path in sorted((tmp_path / "meshes").glob("*.obj")):
        if "_16k" not in path.name:
            np.testing.assert_allclose(
                extent(path), extent(shipped / "meshes" / path.name), atol=1e-4, err_msg=path.name
            )


def extent(path) -> np.ndarray:
    """Lowest and highest corner of an OBJ file's vertices."""
    vertices = np.array(
        [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], dtype=float
    )
    return np.array([vertices.min(axis=0), vertices.max(axis=0)])
