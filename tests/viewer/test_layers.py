"""The layers: names, clearances, relations, what collides, and slices of the reach map, where they should be."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.tier import Tier
from sceniris_gym.viewer.layers import (
    LAYERS,
    ReachSlice,
    nearest_to,
    sketch_clearances,
    sketch_names,
    sketch_pieces,
    sketch_relations,
)
from sceniris_gym.viewer.sketch import GREEN, RED
from tests.versions import since_4
from tests.viewer.worlds_on_show import compiled_scene, world_of


def test_names_stand_above_their_objects():
    """All objects, or one."""
    world = world_of("mid")
    words = dict(sketch_names(world).labels)
    assert set(words) == {"cabinet", "apple", "banana"}
    apple = world.data.xpos[world.compiled.scene.bodies["apple"]]
    assert np.linalg.norm(words["apple"][:2] - apple[:2]) < 0.05
    assert words["apple"][2] > apple[2]
    assert [name for name, _ in sketch_names(world, "apple").labels] == ["apple"]


def test_every_layer_has_a_hint():
    """Every layer has a sentence that tells what it shows."""
    assert all(hint.endswith(".") for _, hint in LAYERS.values())


def test_clearances_are_kept_in_layouts():
    """In the layouts of a scene with 5 cm between things no line is red, and each says how long it is."""
    for seed in range(5):
        sketch = sketch_clearances(world_of("tabletop_lift", seed))
        assert sketch.lines
        assert {colour for _, colour in sketch.lines} == {GREEN}
        for (ends, _), (text, _) in zip(sketch.lines, sketch.labels, strict=True):
            assert text.endswith(f"{1e3 * np.linalg.norm(ends[1] - ends[0]):.0f} mm, at least 50")


@pytest.mark.parametrize(
    "scene", ["mid", pytest.param("kitchen", marks=since_4("mj_geomDistance says 0 of some shapes that are apart"))]
)
def test_what_things_carry_is_not_too_near(scene: str):
    """A banana in a drawer touches it, and a lemon its chest: neither is red, from neither side."""
    for seed in range(2):
        sketch = sketch_clearances(world_of(scene, seed))
        assert [text for (text, _), (_, colour) in zip(sketch.labels, sketch.lines, strict=True) if colour == RED] == []


def test_the_larger_clearance_is_asked_for():
    """Of the two, from both sides."""
    floor, pear = {"size": [0.4, 0.4]}, {"asset": "pear", "on": "floor", "clearance": 0.03}
    world = world_of({"floor": floor, "objects": {"apple": {"asset": "apple", "on": "floor"}, "pear": pear}})
    for name in ("apple", "pear"):
        assert sketch_clearances(world, name).labels[0][0].endswith("at least 30")


def test_what_is_too_near_is_red():
    """A tin that is moved into the can; its support is never in its way."""
    world = world_of("tabletop_lift")
    data = world.data
    tin, can = (world.compiled.scene.bodies[name] for name in ("tin", "can"))
    world.table.qpos[0, world.compiled.mjm.joint("tin/free").qposadr[0] :][:2] = data.xpos[can][:2]
    moved = type(world)(world.compiled, world.table)
    assert np.linalg.norm(moved.data.xpos[tin][:2] - moved.data.xpos[can][:2]) < 1e-6
    nearest = nearest_to(moved, "tin")
    assert nearest is not None
    assert nearest.other == "can"
    assert nearest.distance < 0.0
    assert (RED in {colour for _, colour in sketch_clearances(moved, "tin").lines}) is True


def test_a_pair_is_drawn_once():
    """Two things that are nearest to each other have one line."""
    objects = {n: {"asset": n, "on": "floor", "relations": []} for n in ("apple", "pear")}
    world = world_of({"floor": {"size": [0.3, 0.3]}, "objects": objects})
    sketch = sketch_clearances(world)
    assert len(sketch.lines) == 1
    assert sketch.labels[0][0].startswith("apple to pear: ")


def test_what_is_nearest_is_named_as_in_a_scene_file():
    """The floor and not the world, and what never moves in a user's own model by its name, if it has one."""
    for name in ("tin", "can"):
        nearest = nearest_to(world_of("kitchen"), name)
        assert nearest is not None
        assert nearest.other == "floor"
    model = """<mujoco><worldbody>
      <geom name="{}" type="box" size="0.5 0.02 0.5" pos="0 0.2 0.61"/>
      <body name="desk"><geom type="box" size="0.5 0.5 0.1"/></body>
      <body name="cube"><freejoint/><geom type="box" size="0.02 0.02 0.02" pos="0 0 2"/></body>
    </worldbody></mujoco>"""
    for name, word in (("wall", "wall"), ("", "static geometry")):
        spec = mujoco.MjSpec.from_string(model.format(name))
        cube = {"body": "cube", "on": "desk", "region": {"box": [[-0.1, 0.0], [0.1, 0.1]]}}
        world = world_of({"model": spec.compile(), "objects": {"cube": cube}})
        nearest = nearest_to(world, "cube")
        assert nearest is not None
        assert nearest.other == word


@pytest.mark.parametrize("name", ["apple"])
def test_nothing_near_is_nothing_to_draw(name: str):
    """An object alone on a floor."""
    world = world_of({"floor": {"size": [1.0, 1.0]}, "objects": {name: {"asset": name, "on": "floor"}}})
    assert nearest_to(world, name) is None
    assert sketch_clearances(world).lines == []


def test_arrows_lead_from_anchors_to_objects():
    """One for `front_of` and `right_of`, three for `between` three; they end above the object that is placed."""
    world = world_of("hard_plus", 2)
    sketch = sketch_relations(world)
    assert len(sketch.arrows) == 1 + 1 + 3
    ends = np.array([arrow for arrow, _ in sketch.arrows])
    pairs = [("cabinet", "apple"), ("cabinet", "mug"), ("cabinet", "orange"), ("mug", "orange"), ("apple", "orange")]
    for (tail, tip), (anchor, name) in zip(ends, pairs, strict=True):
        at, to = (world.standing(n)[0][:2] for n in (anchor, name))
        assert np.allclose(tip[:2], to)
        assert world.box(name)[1][2] < tip[2] < world.box(name)[1][2] + 0.05
        along, whole = tail[:2] - at, to - at
        assert abs(along[0] * whole[1] - along[1] * whole[0]) < 1e-6, "on the way from pivot to pivot"
        assert 0.0 <= along @ whole < whole @ whole
    assert len(sketch.surfaces) == 3


def test_an_anchor_hides_nothing_of_its_arrows():
    """A ray back from the tip meets the cabinet itself no sooner than the arrow's tail, however high the cabinet is."""
    for seed in range(4):
        world = world_of("hard_plus", seed)
        cabinet, geom = world.compiled.scene.bodies["cabinet"], np.zeros(1, np.int32)
        for ends, _ in sketch_relations(world, "apple").arrows:
            back = ends[0] - ends[1]
            groups = np.ones(6, np.uint8)
            far = mujoco.mj_ray(world.compiled.mjm, world.data, ends[1], back, groups, 1, -1, geom)
            body = world.compiled.mjm.geom_bodyid[geom[0]]
            assert far < 0.0 or far >= 1.0 - 1e-6 or body != cabinet


def test_one_object_alone_can_be_looked_at():
    """The others' relations are left out."""
    assert len(sketch_relations(world_of("hard_plus", 2), "mug").arrows) == 1
    assert sketch_relations(world_of("mid")).arrows == []


def test_surfaces_are_where_bodies_collide():
    """One for each body that collides, and one for the floor; that of the apple is around the apple."""
    world = world_of("mid")
    mjm = world.compiled.mjm
    collides = {int(b) for b in mjm.geom_bodyid[(mjm.geom_contype | mjm.geom_conaffinity) != 0]}
    sketch = sketch_pieces(world)
    assert len(sketch.surfaces) == len(collides)
    middles = [vertices.mean(axis=0) for vertices, _, _, _ in sketch.surfaces]
    apple = world.data.xpos[world.compiled.scene.bodies["apple"]]
    assert min(np.linalg.norm(middle - apple) for middle in middles) < 0.05
    for vertices, faces, _, opacity in sketch.surfaces:
        assert faces.max() < len(vertices)
        assert 0.0 < opacity <= 1.0


def test_a_slice_is_opaque_where_the_arm_reaches():
    """Not in its base, not beyond its span, and at points that the map knows; the height is that of the world."""
    world = world_of("tabletop_lift")
    (piece,) = ReachSlice.of(world.compiled.scene)
    height = 0.6
    base = world.data.xpos[piece.body]
    picture = piece.picture(world.data, height)
    assert picture.shape[2] == 4
    assert picture[0, 0, 3] == 0
    num = len(picture)
    ticks = (np.arange(num) + 0.5) / num * 2.0 * piece.span - piece.span
    x, y = ticks[3 * num // 4], ticks[num // 2]
    poses = np.tile(np.eye(4), (1, 1, 1))
    poses[0, :3, 3] = [x + piece.map.arm.axis_xy[0], y + piece.map.arm.axis_xy[1], height - base[2]]
    poses[0, :3, 2] = [0.0, 0.0, -1.0]
    poses[0, :3, 0], poses[0, :3, 1] = [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]
    assert piece.map.verdict(poses, "cpu")[0] >= Tier.MAP.least_verdict
    assert picture[num - 1 - num // 2, 3 * num // 4, 3] > 0
    at, turn = piece.pose(world.data, height)
    assert at[2] == height
    assert at[:2] == pytest.approx(base[:2], abs=0.2)
    assert turn == pytest.approx(world.data.xquat[piece.body])


def test_scenes_without_a_map_have_no_slice():
    """No robot at all."""
    assert ReachSlice.of(compiled_scene("mid").scene) == []
