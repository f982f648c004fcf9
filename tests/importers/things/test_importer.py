"""Importing: from a file to an asset that a scene places, with a manifest that says what was done; and how it rests."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from sceniris_gym import SceneConfig, build_model
from sceniris_gym.errors import (
    ArgumentError,
    MeshError,
    NotSupportedError,
    SceneFileError,
    ScenirisError,
)
from sceniris_gym.importers.things.fit import tolerance_of
from sceniris_gym.importers.things.importer import STILL, SUFFIXES, Options, import_thing, moved, resting_poses, stands
from sceniris_gym.progress import listening
from sceniris_gym.scene.model_files import THINGS
from tests.importers.things.shapes import box, cup, write


def test_a_mesh_is_placed_in_a_scene_by_one_line(tmp_path: Path):
    """The asset stands on z = 0 around the origin, and the scene finds it beside itself."""
    manifest = import_thing(
        write(box(), tmp_path / "box.stl"), tmp_path / "assets" / "crate.xml", Options(density=1000.0)
    )
    assert manifest["mass_kg"] == pytest.approx(0.24)
    assert manifest["tags"] == ["graspable", "rigid", "stands"]
    line = "  crate: {asset: assets/crate.xml, on: floor}"
    (tmp_path / "scene.yaml").write_text(f"floor: {{size: [1, 1]}}\nobjects:\n{line}\n")
    mjm = build_model(SceneConfig.load(tmp_path / "scene.yaml")).mjm
    assert mjm.body("crate").mass[0] == pytest.approx(0.24)
    alone = mujoco.MjModel.from_xml_path(str(tmp_path / "assets" / "crate.xml"))
    data = mujoco.MjData(alone)
    mujoco.mj_kinematics(alone, data)
    seen = data.geom_xpos[0] + alone.mesh_vert[: alone.mesh_vertnum[0]] @ data.geom_xmat[0].reshape(3, 3).T
    np.testing.assert_allclose(seen.min(axis=0), [-0.02, -0.03, 0.0], atol=1e-6)


def test_each_step_that_may_be_long_is_told_before_it_starts(tmp_path: Path):
    """So that a bar stands there; parts that are to be too few or too many are refused before any work."""
    heard: list[tuple] = []
    with listening(lambda *words: heard.append(words)):
        import_thing(write(box(), tmp_path / "box.obj"), tmp_path / "box.xml")
    assert list(dict.fromkeys(what for what, _, _ in heard)) == ["pieces cut", "resting poses", "grasps"]
    assert {what for what, done, _ in heard if done == 0} == {"pieces cut", "resting poses", "grasps"}
    with pytest.raises(ArgumentError, match="max_parts: 161 should be from 1 to 160"):
        import_thing(tmp_path / "box.obj", tmp_path / "box.xml", Options(max_parts=161))


def test_the_manifest_has_the_hashes_of_all_files(tmp_path: Path):
    """Of the source too; a second import writes the same bytes, and nothing else is left."""
    source, out = write(box(), tmp_path / "box.obj"), tmp_path / "out" / "box.xml"
    import_thing(source, out)
    manifest = json.loads((out.parent / "box" / "manifest.json").read_text())
    assert manifest["sha256"] == hashlib.sha256(source.read_bytes()).hexdigest()
    for name, digest in manifest["files"].items():
        file = out if name == out.name else out.parent / "box" / name
        assert hashlib.sha256(file.read_bytes()).hexdigest() == digest
    assert import_thing(source, out) == manifest
    assert sorted(path.name for path in out.parent.iterdir()) == ["box", "box.xml"]


def test_y_up_becomes_z_up(tmp_path: Path):
    """A GLB says so; 10 cm along y become the height."""
    manifest = import_thing(write(box((0.04, 0.1, 0.06)), tmp_path / "box.glb"), tmp_path / "box.xml")
    assert manifest["size_m"] == pytest.approx([0.04, 0.06, 0.1])
    assert (manifest["up"], manifest["up_from"]) == ("y", "from the file")


@pytest.fixture(scope="module")
def cup_asset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The asset of a cup, which takes ten seconds to cut."""
    pytest.importorskip("coacd", reason="coacd is not installed (extra 'import')")
    folder = tmp_path_factory.mktemp("cup")
    import_thing(write(cup(), folder / "cup.stl"), folder / "cup.xml")
    return folder / "cup.xml"


def test_a_cup_keeps_its_hole(cup_asset: Path):
    """No point well inside of its hollow is in any part, and the error keeps what is promised."""
    manifest = json.loads((cup_asset.parent / "cup" / "manifest.json").read_text())
    assert manifest["error_mm"] <= manifest["tolerance_mm"] == pytest.approx(1000.0 * tolerance_of(cup()))
    mjm = mujoco.MjModel.from_xml_path(str(cup_asset))
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    angles = np.radians(np.arange(0, 360, 60))
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    hollow = np.concatenate([r * ring + [0, 0, z] for r in (0.0, 0.015, 0.028) for z in (0.02, 0.05, 0.085)])
    parts = np.flatnonzero(mjm.geom_contype)
    assert len(parts) == manifest["parts"] > 1
    for geom in parts:
        first, num = mjm.mesh_vertadr[mjm.geom_dataid[geom]], mjm.mesh_vertnum[mjm.geom_dataid[geom]]
        vertices = data.geom_xpos[geom] + mjm.mesh_vert[first : first + num] @ data.geom_xmat[geom].reshape(3, 3).T
        planes = ConvexHull(vertices).equations
        assert (hollow @ planes[:, :3].T + planes[:, 3]).max(axis=1).min() > 0.0


def test_a_cup_holds_a_pin(cup_asset: Path):
    """A pin dropped into it is still inside after two seconds in MuJoCo C, and stands out of nothing."""
    spec = mujoco.MjSpec.from_file(str(cup_asset))
    spec.worldbody.bodies[0].add_freejoint()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    pin = spec.worldbody.add_body(name="pin", pos=[0.0, 0.0, 0.08])
    pin.add_freejoint()
    pin.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.004, 0.02, 0.0], mass=0.01)
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    while data.time < 2.0:
        mujoco.mj_step(mjm, data)
    at = data.body("pin").xpos - data.body("cup").xpos
    assert np.hypot(*at[:2]) < 0.034
    assert 0.006 < at[2] < 0.05


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("a.obj", "v 0 0 0\n", MeshError),
        ("a.txt", "", NotSupportedError),
        ("a.urdf", "<robot", SceneFileError),
        ("a.glb", "", SceneFileError),
        ("a.stl", "solid a\nendsolid a\n", ScenirisError),
    ],
)
def test_bad_files_leave_nothing_behind(tmp_path: Path, name: str, text: str, kind: type[Exception]):
    """And an asset that was there before stays."""
    (tmp_path / name).write_text(text)
    out = tmp_path / "out" / "thing.xml"
    out.parent.mkdir()
    out.write_text("before")
    with pytest.raises(kind):
        import_thing(tmp_path / name, out)
    assert [path.name for path in out.parent.iterdir()] == ["thing.xml"]
    assert out.read_text() == "before"


def test_wrong_sizes_and_options_are_refused(tmp_path: Path):
    """A kilometre, a density below that of any gas, a tolerance of nothing."""
    far = write(box((1000.0, 1.0, 1.0)), tmp_path / "far.stl")
    with pytest.raises(MeshError):
        import_thing(far, tmp_path / "far.xml")
    for word, options in (("density", Options(density=0.0)), ("tolerance", Options(tolerance=-1.0))):
        with pytest.raises(ArgumentError, match=word):
            import_thing(far, tmp_path / "far.xml", options)
    for options in (Options(scale="yard"), Options(scale="-1"), Options(scale="nan")):
        with pytest.raises(ArgumentError, match="scale: "):
            import_thing(far, tmp_path / "far.xml", options)


def test_every_kind_of_bad_thing_is_one_error_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As `import_thing` raises it, for a file of each kind; nothing is written."""
    monkeypatch.setattr("sceniris_gym.importers.things.repair.MOST_FACES", 1000)
    opened, flat = box(), box()
    opened.update_faces(opened.face_normals[:, 2] < 0.5)
    flat.vertices[:, 2] = 0.0
    sliver = trimesh.Trimesh(
        [[0, 0, 0], [3e-3, 0, 0], [0, 3e-3, 0], [0, 0, 3e-5]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    )
    meshes = {
        "empty.obj": (None, "empty", "no faces"),
        "flat.stl": (flat, "flat", "has no volume"),
        "open.stl": (opened, "open", "--shell"),
        "scan.ply": (trimesh.creation.icosphere(subdivisions=4), "large", "at most 1,000 faces"),
        "sliver.stl": (sliver, "sliver", "at least 1e-14 kg m\\^2 .* Leave it out, or give it a thickness"),
        "dust.stl": (box((0.0005, 0.0005, 0.0005)), "size", "from 1 mm to 50 m"),
        "hill.stl": (box((60.0, 1.0, 1.0)), "size", "--scale cm makes it 0.6 m"),
    }
    for name, (mesh, reason, remedy) in meshes.items():
        path = tmp_path / name
        path.write_text("v 0 0 0\n") if mesh is None else write(mesh, path)
        with pytest.raises(MeshError, match=remedy) as refused:
            import_thing(path, tmp_path / "out" / "thing.xml")
        assert refused.value.reason == reason
    link = '<link name="a"><visual><geometry><mesh filename="gone.stl"/></geometry></visual></link>'
    (tmp_path / "a.urdf").write_text(f'<robot name="a">{link}</robot>')
    with pytest.raises(SceneFileError, match=r"gone\.stl\. Put the meshes at these paths"):
        import_thing(tmp_path / "a.urdf", tmp_path / "out" / "thing.xml")
    pytest.importorskip("pxr", reason="usd-core is not installed (extra 'import')")
    (tmp_path / "many.usda").write_text('#usda 1.0\ndef PointInstancer "many"\n{\n}\n')
    with pytest.raises(NotSupportedError, match="Export its prototype as a separate file"):
        import_thing(tmp_path / "many.usda", tmp_path / "out" / "thing.xml")
    assert not (tmp_path / "out" / "thing.xml").exists()


@pytest.mark.parametrize("name", ["gone.urdf", "gone"])
def test_a_thing_that_is_not_there_is_told_before_its_kind(tmp_path: Path, name: str):
    """With what could be given; the kinds are those of which a scene says that they are imported first."""
    with pytest.raises(SceneFileError, match=r"there is no such file. Give a folder, or a file \(\.obj, .*\.urdf\)"):
        import_thing(tmp_path / name, tmp_path / "thing.xml")
    assert (*THINGS, ".urdf") == SUFFIXES


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the asset of a box."""
    folder = tmp_path_factory.mktemp("block")
    import_thing(write(box(), folder / "block.obj"), folder / "out" / "block.xml")
    return folder / "out" / "block.xml"


def test_a_box_rests_on_its_six_sides(block: Path):
    """More often on the wide ones, and hardly moves."""
    rests = resting_poses(block)
    assert len(rests) == 6
    assert all(rest.moved < STILL for rest in rests)
    assert sum(rest.probability for rest in rests) == pytest.approx(1.0)
    assert all(stands(rests, sign * axis) for axis in np.eye(3) for sign in (-1, 1))
    assert not stands(rests, np.array([0.6, 0.8, 0.0]))


def test_a_box_on_its_edge_tips_over(block: Path):
    """It moves by more than a centimetre."""
    spec = mujoco.MjSpec.from_file(str(block))
    spec.worldbody.bodies[0].add_freejoint()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    corners = box().vertices - [*box().bounds.mean(axis=0)[:2], box().bounds[0, 2]]  # the asset stands at its origin
    assert moved(spec.compile(), corners, np.array([np.cos(0.3), np.sin(0.3), 0.0, 0.0])) > STILL


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_bottle_of_many_sides_stands_though_it_lies_more_often(tmp_path: Path, up: str):
    """Each of its sides is a pose as likely as its bottom, but only the bottom is flat."""
    radii = [0.0, 0.028, 0.03, 0.03, 0.026, 0.014, 0.012, 0.012, 0.014, 0.014, 0.0]
    heights = [0.0, 0.0, 0.004, 0.09, 0.11, 0.135, 0.145, 0.165, 0.167, 0.175, 0.175]
    bottle = trimesh.creation.revolve(np.column_stack([radii, heights]), sections=32)
    if up == "y":
        bottle.apply_transform(trimesh.transformations.rotation_matrix(-0.5 * np.pi, [1, 0, 0]))
    manifest = import_thing(write(bottle, tmp_path / "bottle.obj"), tmp_path / "bottle.xml", Options(scale="m"))
    assert manifest["up"] == up
    assert "stands" in manifest["tags"]
    assert manifest["size_m"][2] == pytest.approx(0.175, abs=1e-3)
    assert not manifest["notes"]


def test_a_ball_has_corners_and_rests_on_its_facets(tmp_path: Path):
    """As its convex part is a polyhedron: it is held where it is put down."""
    manifest = import_thing(write(trimesh.creation.icosphere(4, 0.05), tmp_path / "ball.stl"), tmp_path / "ball.xml")
    assert manifest["parts"] == 1
    assert manifest["rests"]
    assert all(rest["moved_mm"] < 1000.0 * STILL for rest in manifest["rests"])
