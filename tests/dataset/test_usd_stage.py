"""USD: where everything is in a frame, by usd-core, is where MuJoCo C has it for that row."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym import compile_scene
from sceniris_gym.dataset.manifest import DatasetPlan
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.dataset.writer import DatasetWriter
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import compile_on_cpu

pxr = pytest.importorskip("pxr", reason="usd-core is not installed (extra 'import')")
from pxr import Usd, UsdGeom  # noqa: E402

from sceniris_gym.dataset.usd_stage import body_paths  # noqa: E402

SHAPES = """
<mujoco>
  <asset>
    <hfield name="hills" nrow="2" ncol="3" size="0.4 0.2 0.1 0.05" elevation="0 1 0 0 0.5 0"/>
    <material name="red" rgba="1 0 0 0.5"/>
  </asset>
  <worldbody>
    <geom name="ground" type="plane" size="1 2 0.1"/>
    <geom name="hills" type="hfield" contype="0" conaffinity="0" hfield="hills" pos="5 0 0"/>
    <body name="a thing" pos="0 0 1">
      <freejoint/>
      <geom name="ball" type="sphere" size="0.02" material="red"/>
      <geom name="egg" type="ellipsoid" size="0.01 0.02 0.03" pos="0.03 0 0"/>
      <geom name="pill" type="capsule" size="0.01 0.03" euler="0 90 0"/>
      <geom name="rod" type="cylinder" size="0.01 0.03" group="3"/>
      <geom name="a box" type="box" size="0.01 0.02 0.03" euler="30 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def opened(compiled: CompiledScene, folder: Path, n: int = 6) -> tuple[Usd.Stage, np.ndarray]:
    """Write layouts, and open their stage."""
    DatasetWriter(compiled, DatasetPlan.of(compiled, n, 3, "train", ("usd",)), folder, Shard()).write(chunk=64)
    return Usd.Stage.Open(str(folder / "layouts-00000.usdc")), np.load(folder / "layouts-00000.npy")


def put(compiled: CompiledScene, row: np.ndarray) -> mujoco.MjData:
    """A row in MuJoCo C."""
    data = mujoco.MjData(compiled.mjm)
    data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = row["qpos"], row["mocap_pos"], row["mocap_quat"]
    mujoco.mj_kinematics(compiled.mjm, data)
    return data


def corners(stage: Usd.Stage, path: str, time: float) -> np.ndarray:
    """Bounds of a geometry prim in the world, shape (2, 3)."""
    box = UsdGeom.BBoxCache(time, ["default", "guide"]).ComputeWorldBound(stage.GetPrimAtPath(path))
    found = box.ComputeAlignedRange()
    return np.array([found.GetMin(), found.GetMax()])


@pytest.mark.parametrize("scene", ["mid", "tabletop_lift"])
def test_frames_are_rows(scene: str, tmp_path: Path):
    """Every body, on joints or not; the number of frames; and what is said of each of them."""
    compiled = compile_on_cpu(scene)
    stage, rows = opened(compiled, tmp_path)
    paths = body_paths(compiled)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, len(rows) - 1)
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Z", 1.0)
    assert str(stage.GetDefaultPrim().GetPath()) == "/World"
    for name, body in compiled.scene.bodies.items():
        assert paths[body] == f"/World/{name}"
    joint = compiled.mjm.joint("cabinet/upper" if scene == "mid" else "panda/joint1").id
    owner = stage.GetPrimAtPath(paths[compiled.mjm.jnt_bodyid[joint]])
    for i, row in enumerate(rows):
        data, cache = put(compiled, row), UsdGeom.XformCache(i)
        for body in range(1, compiled.mjm.nbody):
            world = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(paths[body]))).T
            np.testing.assert_allclose(world[:3, 3], data.xpos[body], atol=1e-6)
            np.testing.assert_allclose(world[:3, :3], data.xmat[body].reshape(3, 3), atol=1e-6)
        about = stage.GetPrimAtPath("/World")
        assert about.GetAttribute("layout:seed").Get(i) == row["seed"]
        local = compiled.mjm.joint(joint).name.partition("/")[2]
        assert owner.GetAttribute(f"joint:{local}").Get(i) == row["qpos"][compiled.mjm.jnt_qposadr[joint]]


def test_meshes_are_those_of_the_model(tmp_path: Path):
    """Points of all meshes of `mid` in the world; colliders are guides; what is seen has its colour."""
    compiled = compile_on_cpu("mid")
    stage, rows = opened(compiled, tmp_path)
    mjm, data, cache = compiled.mjm, put(compiled, rows[2]), UsdGeom.XformCache(2)
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    geoms = [g for g in range(mjm.ngeom) if mjm.geom_dataid[g] >= 0 or mjm.geom_type[g] == 0]
    assert len(meshes) == len(geoms)
    for prim, geom in zip(sorted(meshes, key=_place(cache)), sorted(geoms, key=lambda g: _key(data, g)), strict=True):
        guide = UsdGeom.Imageable(prim).ComputePurpose() == "guide"
        assert guide == (mjm.geom_group[geom] > 2)
        if mjm.geom_dataid[geom] < 0:
            continue
        world = np.array(cache.GetLocalToWorldTransform(prim)).T
        points = np.array(prim.GetAttribute("points").Get()) @ world[:3, :3].T + world[:3, 3]
        mesh = mjm.geom_dataid[geom]
        own = mjm.mesh_vert[mjm.mesh_vertadr[mesh] :][: mjm.mesh_vertnum[mesh]]
        wanted = own @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        np.testing.assert_allclose(points.min(axis=0), wanted.min(axis=0), atol=1e-5)
        np.testing.assert_allclose(points.max(axis=0), wanted.max(axis=0), atol=1e-5)


def _key(data: mujoco.MjData, geom: int) -> tuple:
    return (*np.round(data.geom_xpos[geom], 4), data.model.geom_group[geom])


def _place(cache: UsdGeom.XformCache):
    def key(prim: Usd.Prim) -> tuple:
        at = np.array(cache.GetLocalToWorldTransform(prim).ExtractTranslation())
        return (*np.round(at, 4), 3 if UsdGeom.Imageable(prim).ComputePurpose() == "guide" else 0)

    return key


def test_absent_members_are_invisible(tmp_path: Path):
    """In the frames in which they are absent, and in no other."""
    compiled = compile_on_cpu("mid", {"groups": {"fruit": {"of": ["apple", "banana"], "count": [0, 2]}}})
    stage, rows = opened(compiled, tmp_path, 30)
    assert not rows["present"].all()
    for slot, name in enumerate(compiled.slots):
        prim = UsdGeom.Imageable(stage.GetPrimAtPath(f"/World/{name}"))
        seen = [prim.ComputeVisibility(i) != "invisible" for i in range(len(rows))]
        np.testing.assert_array_equal(seen, rows["present"][:, slot])


def test_the_bounds_of_a_frame_are_those_of_the_scene(tmp_path: Path):
    """Without the far ground of absent objects, which a scene without a floor has, and without these objects."""
    fruit = {name: {"asset": name, "on": "table"} for name in ("apple", "lemon")}
    words = {"objects": {"table": {"asset": "table", "kind": "static"}, **fruit}}
    compiled = compile_on_cpu({**words, "groups": {"fruit": {"of": ["apple", "lemon"], "count": [0, 1]}}})
    assert compiled.mjm.geom("parking_ground").pos[0] > 20.0
    stage, rows = opened(compiled, tmp_path)
    for i in range(len(rows)):
        assert np.abs(corners(stage, "/World", i)).max() < 2.0


def test_every_kind_of_geom_is_written(tmp_path: Path):
    """With the sizes that MuJoCo gives it; names with blanks become identifiers."""
    (tmp_path / "shapes.xml").write_text(SHAPES)
    words = {"model": str(tmp_path / "shapes.xml"), "floor": {"size": [1.0, 1.0]}}
    compiled = compile_scene(words | {"objects": {"thing": {"body": "a thing", "on": "floor", "stands": False}}}, "cpu")
    stage, rows = opened(compiled, tmp_path / "out")
    data = put(compiled, rows[1])
    for name, kind in (("ball", "Sphere"), ("egg", "Sphere"), ("pill", "Capsule"), ("a_box", "Cube")):
        assert stage.GetPrimAtPath(f"/World/thing/{name}").GetTypeName() == kind
    ball = UsdGeom.Sphere(stage.GetPrimAtPath("/World/thing/ball"))
    assert np.allclose(ball.GetDisplayColorAttr().Get()[0], (1.0, 0.0, 0.0))
    assert ball.GetDisplayOpacityAttr().Get()[0] == 0.5
    at = data.xpos[compiled.scene.bodies["thing"]]
    np.testing.assert_allclose(corners(stage, "/World/thing/ball", 1), [at - 0.02, at + 0.02], atol=0.01)
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/World/thing/rod")).ComputePurpose() == "guide"
    box = np.array(UsdGeom.XformCache(1).GetLocalToWorldTransform(stage.GetPrimAtPath("/World/thing/a_box"))).T
    turn = data.geom("a box").xmat.reshape(3, 3)
    np.testing.assert_allclose(box[:3, :3], turn @ np.diag([0.01, 0.02, 0.03]), atol=1e-6)
    np.testing.assert_allclose(corners(stage, "/World/ground", 1), [[-1, -2, 0], [1, 2, 0]], atol=1e-6)
    np.testing.assert_allclose(corners(stage, "/World/hills", 1), [[4.6, -0.2, 0], [5.4, 0.2, 0.1]], atol=1e-6)
