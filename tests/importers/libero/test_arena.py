"""Arenas: cameras as LIBERO's, and parts that only pictures show, plain or from a file in LIBERO's form."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.importers.libero.arena import ARENAS
from sceniris_gym.importers.libero.kinds import WORKSPACES
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from tests.importers.libero.problems import STACK, write

pytestmark = pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
FILE = """
<mujoco model="table_arena">
  <asset>
    <texture name="texplane" type="2d" file="../textures/old.png"/>
    <texture name="tex-wall" type="2d" file="../textures/old.png"/>
    <material name="floorplane" texture="texplane"/>
    <material name="table_texture"/>
    <material name="table_legs"/>
  </asset>
  <worldbody>
    <geom name="floor" group="1" type="plane" size="3 3 .1" material="floorplane"/>
    <geom name="wall" group="1" type="box" size="3 1.5 0.01" pos="3 0 1.5"/>
    <body name="table" pos="0 0 0.4"><geom name="table_collision" group="0" type="box" size="0.4 0.4 0.4"/></body>
    <body name="desk"><geom group="0" type="box" size="1 1 1"/><geom name="desk_vis" group="1" size="0.1"/></body>
    <light name="light1" pos="1 1 4"/>
    <camera name="agentview" pos="0.5 0 1.35"/>
  </worldbody>
</mujoco>
"""


def grey(path: Path) -> None:
    """Write a small picture."""
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (2, 2), "grey").save(path)


def test_layouts_are_the_same_with_and_without_an_arena(tmp_path: Path):
    """Its geoms do not collide; the arm stands on a mount and starts in LIBERO's pose."""
    plain, shown = (read_bddl(write(tmp_path), robot="panda", arena=arena).scene for arena in (False, True))
    mjm = compile_scene(shown, "cpu").mjm
    drawn = [i for i in range(mjm.ngeom) if mjm.body(mjm.geom_bodyid[i]).name.startswith("arena_parts/")]
    assert len(drawn) == 1 + 4 + 5 + 3  # floor, walls, a table with legs, a mount
    assert not mjm.geom_contype[drawn].any() and not mjm.geom_conaffinity[drawn].any()
    ours, theirs = (make_table(compile_scene(scene, "cpu"), 16, 0) for scene in (plain, shown))
    np.testing.assert_array_equal(ours.qpos, theirs.qpos)
    np.testing.assert_array_equal(ours.mocap_pos, theirs.mocap_pos)
    start = theirs.qpos[0, [mjm.joint(f"panda/joint{i}").qposadr[0] for i in range(1, 8)]]
    np.testing.assert_allclose(start, [0, -0.161037, 0, -2.444597, 0, 2.226752, np.pi / 4], atol=1e-6)


def test_the_overview_looks_at_the_objects_and_not_at_the_room(tmp_path: Path):
    """With the arena's walls, which are 6 m apart, the camera is as near to the table as without them."""
    models = [compile_scene(read_bddl(write(tmp_path), arena=arena).scene, "cpu").mjm for arena in (False, True)]
    plain, shown = (np.linalg.norm(mjm.camera("overview").pos - mjm.body("kitchen_table").pos) for mjm in models)
    assert shown < 1.1 * plain


def test_cameras_look_as_those_of_libero(tmp_path: Path):
    """Poses as LIBERO's code has them: of `agentview` in the world, of the camera at the hand in the hand's frame."""
    mjm = compile_scene(read_bddl(write(tmp_path), robot="panda", arena=True).scene, "cpu").mjm
    eye, wrist = mjm.camera("agentview"), mjm.camera("robot0_eye_in_hand")
    np.testing.assert_allclose(eye.pos, [0.6586131746834771, 0.0, 1.6103500240372423], atol=1e-6)
    turn = np.zeros(4)
    mujoco.mju_mulQuat(turn, eye.quat, [0.6380177736, -0.3048497438, -0.3048498630, -0.6380177736])
    assert abs(turn[0]) == pytest.approx(1.0, abs=1e-6) and eye.fovy == 45.0
    assert mjm.body(wrist.bodyid[0]).name == "panda/hand" and wrist.fovy == 75.0
    np.testing.assert_allclose(wrist.pos, [0.05, 0.0, 0.0])
    np.testing.assert_allclose(np.abs(wrist.quat), [0.0, 0.5**0.5, 0.5**0.5, 0.0], atol=1e-6)
    other = read_bddl(write(tmp_path, STACK), robot="ur5e", arena=True).scene
    assert set(other.cameras) == {"agentview"} and other.cameras["agentview"].pos[2] == 0.65


def test_a_file_of_libero_gives_the_arena(tmp_path: Path):
    """Its visual geoms, lights and the problem's textures come, without cameras, collisions and the table."""
    for name in ("gray_ceramic_tile", "yellow_linen_wall_texture"):
        grey(tmp_path / f"textures/{name}.png")
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes/libero_kitchen_tabletop_base_style.xml").write_text(FILE)
    mjm = read_bddl(write(tmp_path), assets=tmp_path, arena=True).scene.model.copy().compile()
    names = {mjm.geom(i).name for i in range(mjm.ngeom)}
    assert {"arena/floor", "arena/wall", "arena/desk_vis"} <= names and "arena/table_collision" not in names
    geoms = [i for i in range(mjm.ngeom) if mjm.body(mjm.geom_bodyid[i]).name.startswith("arena")]
    assert len(geoms) == 3 + 5 and not mjm.geom_contype[geoms].any()
    assert sum(mjm.geom_matid[geoms] == mjm.material("arena/table_legs").id) == 4
    assert mjm.nlight == 1 and mjm.ncam == 0


def test_lights_do_not_bleach_the_table(tmp_path: Path):
    """LIBERO's lights, of 0.8 each, and the headlight of 0.7 give at most white before the texture."""
    for name in ("gray_ceramic_tile", "yellow_linen_wall_texture"):
        grey(tmp_path / f"textures/{name}.png")
    (tmp_path / "scenes").mkdir()
    light = '<light name="light{}" pos="1 1 4" diffuse=".8 .8 .8" dir="0 -.15 -1"/>'
    lights = "".join(light.format(i) for i in range(2, 4))
    file = FILE.replace('<light name="light1"', f'{lights}<light name="light1" diffuse=".8 .8 .8"')
    (tmp_path / "scenes/libero_kitchen_tabletop_base_style.xml").write_text(file)
    mjm = read_bddl(write(tmp_path), assets=tmp_path, arena=True).scene.model.copy().compile()
    assert mjm.nlight == 3
    np.testing.assert_allclose(mjm.light_diffuse, 0.5 / 3.0, atol=1e-6)


def test_every_work_surface_has_an_arena():
    """So that no class of a problem is without cameras."""
    assert set(ARENAS) == set(WORKSPACES)
