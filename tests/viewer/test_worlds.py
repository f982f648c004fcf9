"""Worlds side by side: poses that are sent are those of the layouts, each at its place in the grid."""

from __future__ import annotations

import io
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp
from PIL import Image

from sceniris_gym.commands.replay import drawn
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.scene.build import build_model
from sceniris_gym.viewer.deck import LayoutDeck, Where
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.worlds import Window, Worlds, body_mesh, drawn_model, grid_origins, view_direction
from tests.importers.libero.problems import write
from tests.layout.scenes import box_mjcf
from tests.viewer.pages import drawn_body, page
from tests.viewer.worlds_on_show import compiled_scene, world_of

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")


def groups_of(worlds: Worlds) -> list[Any]:
    """Return the meshes that mjviser draws, each for several bodies in all worlds."""
    return worlds._scene._mesh_groups


def test_what_is_sent_is_the_layout():
    """For every body of nine worlds, moved by the world's origin; a hidden one is out of sight."""
    compiled = compiled_scene("kitchen")
    table = LayoutDeck(compiled, 9).make(Where(seed=5))
    mug = compiled.scene.bodies["mug"]
    with page() as server:
        worlds = Worlds(server, compiled.scene, 9)
        shown = [ShownWorld(compiled, table[i : i + 1]) for i in range(9)]
        for i, world in enumerate(shown):
            worlds.put(i, world.data, hidden=[mug] if i == 4 else [])
        worlds.send()
        checked = set()
        for group in groups_of(worlds):
            if not group.handle.visible:
                continue
            sent = np.asarray(group.handle.batched_positions).reshape(9, len(group.body_ids), 3)
            turned = np.asarray(group.handle.batched_wxyzs).reshape(9, len(group.body_ids), 4)
            for k, body in enumerate(group.body_ids):
                checked.add(int(body))
                for i, world in enumerate(shown):
                    if body == mug and i == 4:
                        assert sent[i, k, 2] < -1.0e4
                    else:
                        assert sent[i, k] == pytest.approx(world.data.xpos[body] + worlds.origins[i], abs=1e-4)
                        assert abs(turned[i, k] @ world.data.xquat[body]) == pytest.approx(1.0, abs=1e-6)
        assert {compiled.scene.bodies[name] for name in ("mug", "counter", "plate")} <= checked
        assert 0 in checked  # the floor of every world


def test_the_users_model_stays_as_it_is():
    """A copy is drawn, in which nothing is fixed to the world, and planes have an end."""
    mjm = compiled_scene("tabletop_lift").mjm
    before = {name: np.array(getattr(mjm, name)) for name in ("body_weldid", "geom_group", "geom_rgba", "geom_size")}
    width = mjm.vis.scale.framewidth
    with page() as server:
        Worlds(server, compiled_scene("tabletop_lift").scene, 1).aim()
        eye = np.array(server.initial_camera.position)
        assert np.linalg.norm(eye) < 10.0
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(mjm, name), values)
    assert mjm.vis.scale.framewidth == width
    assert not np.any(drawn_model(mjm).body_weldid == 0)


def test_the_view_is_of_the_objects_and_not_of_the_room(tmp_path: Path):
    """The walls of an arena are 6 m apart: the page opens as near as without them, and two rooms do not overlap."""
    eyes = []
    for arena in (False, True):
        scene = build_model(SceneConfig.load(read_bddl(write(tmp_path), arena=arena).scene))
        with page() as server:
            Worlds(server, scene, 1).aim()
            eyes.append(np.linalg.norm(server.initial_camera.position - scene.mjm.body("kitchen_table").pos))
            apart = np.ptp(Worlds(server, scene, 2).origins, axis=0).max()
    assert eyes[1] < 1.1 * eyes[0]
    assert apart > 6.0


def test_many_worlds_are_coarser_from_afar():
    """A few worlds are all drawn in full; the camera is far enough from many."""
    compiled = compiled_scene("mid")
    with page() as server:
        few = Worlds(server, compiled.scene, 4)
        assert all(group.handle.lod == "off" for group in groups_of(few))
        worlds = Worlds(server, compiled.scene, 64)
        worlds.aim()
        eye = np.asarray(server.initial_camera.position)
        moving = [group for group in groups_of(worlds) if group.body_ids[0] > 0]
        assert len(moving) >= 4
        for group in moving:
            ((distance, share),) = np.array(group.handle.lod, float)
            assert share < 0.5
            assert distance < np.linalg.norm(eye - worlds.origins, axis=1).min()


def test_boards_and_boxes_are_drawn_in_full_from_afar():
    """They are a few triangles each, and with fewer a door becomes a wedge."""
    scene = build_model(SceneConfig.load("kitchen"))
    with page() as server:
        groups = groups_of(Worlds(server, scene, 16))
        lods = {scene.mjm.body(int(group.body_ids[0])).name: group.handle.lod for group in groups}
    for name in ("counter", "counter/sink", "shelf", "cupboard", "cupboard/door", "chest", "book"):
        assert lods[name] == "off", name
    for name in ("pan", "lemon", "bottle"):
        assert lods[name] != "off", name


@pytest.mark.parametrize("num", [1, 2, 5, 64])
def test_worlds_stand_apart_around_the_middle(num: int):
    """On a grid as square as it can be, each in a place of its own."""
    origins = grid_origins(num, np.array([2.0, 1.0]))
    assert origins.shape == (num, 3)
    assert len(np.unique(origins, axis=0)) == num
    apart = np.abs(origins[:, None] - origins[None])[..., :2] / [2.0, 1.0]
    assert np.all((apart.max(axis=-1) > 0.99) | np.eye(num, dtype=bool))
    full = int(np.sqrt(num)) ** 2 == num
    assert not full or origins.mean(axis=0) == pytest.approx([0.0, 0.0, 0.0])


def test_the_page_looks_as_the_scenes_camera_does():
    """Along the axis of 'overview', or from the front where there is none."""
    mjm = compiled_scene("mid").mjm
    data = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, data)
    assert view_direction(mjm) == pytest.approx(data.camera("overview").xmat.reshape(3, 3)[:, 2])
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert view_direction(empty)[1] < 0.0 < view_direction(empty)[2]


def test_bodies_have_the_mesh_that_is_seen():
    """Of the apple, about its size; of geoms that are not seen, none."""
    mjm = compiled_scene("mid").mjm
    geoms = np.flatnonzero(mjm.geom_bodyid == mjm.body("apple").id)
    mesh = body_mesh(mjm, geoms)
    assert mesh is not None
    assert 0.04 < np.ptp(mesh[0], axis=0).max() < 0.12
    assert body_mesh(mjm, geoms[mjm.geom_group[geoms] == 3]) is None


def test_the_page_of_an_environment_keeps_to_real_time():
    """It shows poses of the first 64 worlds at most; absent objects are not seen; five steps of 40 ms take 0.2 s."""
    world = world_of("mid")
    scene = world.compiled.scene
    xpos, xmat = world.data.xpos[None].repeat(70, axis=0), world.data.xmat.reshape(-1, 3, 3)[None].repeat(70, axis=0)
    present = np.ones((70, 3), int)
    present[1, world.compiled.slots.index("apple")] = 0
    states = {"xpos": (xpos, wp.vec3), "xmat": (xmat, wp.mat33)}
    data = {name: wp.array(values, dtype=dtype, device="cpu") for name, (values, dtype) in states.items()}
    batch: Any = SimpleNamespace(data=SimpleNamespace(**data))
    view = SimpleNamespace(present=wp.array(present, dtype=int, device="cpu"))
    layouts: Any = SimpleNamespace(view=view)
    with page() as server:
        window = Window(scene, 70, server)
        assert window.num == 64
        window.show(batch, layouts, 0.0)
        apple, banana = (drawn_body(server, name).batched_positions for name in ("apple", "banana"))
        bodies = [scene.bodies[name] for name in ("apple", "banana")]
        assert apple[0] - banana[0] == pytest.approx(np.subtract(*world.data.xpos[bodies]), abs=1e-5)
        assert apple[1, 2] < -1.0e4
        began = time.monotonic()
        for _ in range(5):
            window.show(batch, layouts, 0.04)
        assert time.monotonic() - began > 0.15


def test_each_world_has_its_drawn_colours(tmp_path: Path):
    """Those of the layout; these geoms move with their bodies, and those of other objects are as ever."""
    cube = {"asset": box_mjcf(tmp_path, "cube", 0.1, 0.1, 0.1), "on": "floor"}
    scene = SceneConfig.load(
        {
            "floor": {"size": [1.0, 1.0]},
            "objects": {
                "cube": {**cube, "randomize": {"rgba": {"abs": [[0, 0, 0, 1], [1, 1, 1, 1]]}}},
                "plain": cube,
            },
            "bank": 2,
        }
    )
    compiled = compile_scene(scene, "cpu")
    table = LayoutDeck(compiled, 3).make(Where(seed=5))
    models = [drawn(compiled, table[i : i + 1])[0] for i in range(3)]
    with page() as server:
        worlds = Worlds(server, compiled.scene, 3)
        worlds.paint(compiled, table)
        for i in range(3):
            worlds.put(i, ShownWorld(compiled, table[i : i + 1]).data)
        worlds.send()
        bodies = compiled.mjm.geom_bodyid[list(worlds._painted)].tolist()
        assert set(bodies) == {compiled.scene.bodies["cube"]}
        for geom, handle in worlds._painted.items():
            colours = np.stack([model.geom_rgba[geom, :3] for model in models])
            assert len(np.unique(colours, axis=0)) == 3
            np.testing.assert_allclose(handle.batched_colors / 255.0, colours, atol=0.01)
            if handle.visible:
                places = [ShownWorld(compiled, table[i : i + 1]).data.body("cube").xpos for i in range(3)]
                np.testing.assert_allclose(handle.batched_positions, places + worlds.origins, atol=1e-4)
        assert any(handle.visible for handle in worlds._painted.values())


_QUAD = "".join(f"v {x} {y} {z}\n" for x, y, z in ((0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))
_QUAD += "vt 0 0\nvt 1 0\nvt 0 1\nf 1/1 3/3 2/2\nf 1/1 2/2 4/3\nf 1/1 4/3 3/2\nf 2/1 3/2 4/3\n"


@pytest.mark.parametrize("num", [2, 9])
def test_meshes_with_textures_are_tinted_in_each_world(num: int, tmp_path: Path):
    """A few worlds keep the texture, and many have its mean. Without draws, all have the texture."""
    texels = np.full((2, 2, 3), 200, np.uint8)
    texels[0] = 100
    Image.fromarray(texels).save(tmp_path / "tiles.png")
    (tmp_path / "quad.obj").write_text(_QUAD)
    (tmp_path / "toy.xml").write_text(
        "<mujoco><asset><texture name='tiles' type='2d' file='tiles.png'/><material name='tiles' texture='tiles'/>"
        "<mesh name='quad' file='quad.obj'/></asset><worldbody><body name='toy'><freejoint/>"
        "<geom type='mesh' mesh='quad' material='tiles'/></body></worldbody></mujoco>"
    )
    toy = {"asset": str(tmp_path / "toy.xml"), "on": "floor"}
    tint = {"randomize": {"rgba": {"abs": [[0.2, 0.2, 0.2, 1], [1, 1, 1, 1]]}}}
    words = {"floor": {"size": [1.0, 1.0]}, "objects": {"toy": {**toy, **tint}, "plain": toy}, "bank": 2}
    compiled = compile_scene(SceneConfig.load(words), "cpu")
    table = LayoutDeck(compiled, num).make(Where(seed=5))
    models = [drawn(compiled, table[i : i + 1])[0] for i in range(num)]
    tints = np.stack([m.geom_rgba[m.geom_bodyid == compiled.scene.bodies["toy"]][0, :3] for m in models])
    assert len(np.unique(tints, axis=0)) == num
    with page() as server:
        worlds = Worlds(server, compiled.scene, num)
        worlds.paint(compiled, table)
        handles = {name: [] for name in ("toy", "plain")}
        for group in groups_of(worlds):
            if group.body_ids[0] > 0:
                handles[compiled.mjm.body(int(group.body_ids[0])).name].append(group.handle)
        (plain,) = handles["plain"]
        assert _looks(plain)[0] == {100, 200}
        if num == 9:
            (toy_of_all,) = handles["toy"]
            np.testing.assert_allclose(toy_of_all.batched_colors, 150.0 * tints, atol=1.0)
            return
        for i, handle in enumerate(handles["toy"]):
            assert handle.batched_scales.tolist() == np.eye(num)[i].tolist()
            values, factor = _looks(handle)
            assert values == {100, 200}
            np.testing.assert_allclose(factor, tints[i] ** 2.2, atol=0.01)


def _looks(handle: Any) -> tuple[set[int], np.ndarray]:
    """Return the values in the texture of a mesh on the page, and its linear colour factor, shape (3,)."""
    (mesh,) = trimesh.load_scene(io.BytesIO(handle.glb_data), file_type="glb").geometry.values()
    material = mesh.visual.material
    return set(np.unique(material.baseColorTexture).tolist()), material.baseColorFactor[:3] / 255.0


def test_geoms_have_the_colours_of_mujoco():
    """The colour of a geom comes before its material, and a texture that mjviser cannot draw becomes its mean."""
    mjm = mujoco.MjModel.from_xml_string(
        "<mujoco><asset>"
        "<texture name='tiles' type='2d' builtin='checker' width='4' height='4' rgb1='1 0 0' rgb2='0 0 1'/>"
        "<material name='tiles' texture='tiles'/><material name='green' rgba='0 1 0 1'/>"
        "</asset><worldbody>"
        "<geom name='tiled' type='box' size='.1 .1 .1' material='tiles'/>"
        "<geom name='plain' type='box' size='.1 .1 .1' material='green'/>"
        "<geom name='own' type='box' size='.1 .1 .1' material='green' rgba='1 0 0 1'/>"
        "</worldbody></mujoco>"
    )
    from mjviser.conversions import create_primitive_mesh

    drawn = drawn_model(mjm)
    colours = {"tiled": [0.5, 0.0, 0.5, 1.0], "plain": [0.0, 1.0, 0.0, 1.0], "own": [1.0, 0.0, 0.0, 1.0]}
    for name, colour in colours.items():
        visual: Any = create_primitive_mesh(drawn, mjm.geom(name).id).visual
        assert visual.vertex_colors[0] / 255.0 == pytest.approx(colour, abs=0.01), name
