"""Stances as flat arrays: levels, what they carry besides, feet and the parts of surfaces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely

from sceniris_gym.program.device_statics import Statics
from sceniris_gym.program.pack.relations import surfaces_of_regions
from sceniris_gym.program.pack.standing import pack_statics
from sceniris_gym.program.plan import Plan, build_plan
from tests.layout.scenes import box_mjcf
from tests.placement.supports import TILES, tiles_mjcf
from tests.program.scenes import scene_of


def packed(objects: dict) -> tuple[Plan, Statics]:
    """Return the plan of a scene, and how its objects stand."""
    plan = build_plan(scene_of(objects))
    statics = pack_statics(plan, "cpu")
    assert statics is not None
    return plan, statics


def lists(statics: Statics, name: str, of: str) -> list[list[int]]:
    """Return the lists of a field."""
    adr, num = (getattr(statics, f"{of}{end}").numpy() for end in ("adr", "num"))
    flat = getattr(statics, name).numpy()
    return [flat[a : a + n].tolist() for a, n in zip(adr, num, strict=True)]


def test_levels_carry_what_stands_beside_the_chain(tmp_path: Path):
    """A tree of five crates: the levels of each, and the others on them that were placed before."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05)}
    on = {"a": "floor", "b": "a", "c": "b", "d": "b", "e": "a"}
    _, statics = packed({name: {**crate, "on": support} for name, support in on.items()})
    assert lists(statics, "level_obj", "obj_level") == [[], [1, 0], [2, 1, 0], [3, 1, 0], [4, 0]]
    loads = lists(statics, "load", "level_load")
    assert loads == [[], [], [], [], [], [], [2], [], [], [1, 2, 3]]


def test_a_carrier_sinks_under_each_variant_as_under_that_alone(tmp_path: Path):
    """A plank under one of three boxes, each on it as if the others were in no world."""
    plank = {"asset": box_mjcf(tmp_path, "plank", 0.06, 0.06, 0.05), "on": "floor"}
    boxes = [box_mjcf(tmp_path, f"box_{z}", 0.05, 0.05, 0.04 * z) for z in (1, 2, 4)]
    _, several = packed({"plank": plank, "thing": {"asset": boxes, "on": "plank"}})
    alone = [packed({"plank": plank, "thing": {"asset": box, "on": "plank"}})[1] for box in boxes]
    (_, *found), each = (
        lists(several, "level_sink", "obj_level"),
        [lists(one, "level_sink", "obj_level") for one in alone],
    )
    assert found == [sinks for _, sinks in each]


def test_a_scene_in_which_nothing_can_fall_has_none(tmp_path: Path):
    """Neither a kernel nor arrays."""
    objects = {"crate": {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05), "on": "floor"}}
    assert pack_statics(build_plan(scene_of(objects)), "cpu") is None


def test_convex_parts_make_up_the_surfaces(tmp_path: Path):
    """Those of an L with a hole are triangles, those of a box one rectangle; all run counter-clockwise.

    The floor, which nothing can leave, has no sides.
    """
    objects = {
        "slab": {"asset": tiles_mjcf(tmp_path, TILES), "kind": "fixture", "on": "floor"},
        "crate": {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05), "on": "slab"},
        "top": {"asset": box_mjcf(tmp_path, "top", 0.05, 0.05, 0.05), "on": "crate"},
    }
    plan, statics = packed(objects)
    sides = statics.side.numpy()
    adr, num = statics.part_sideadr.numpy(), statics.part_sidenum.numpy()
    rings = [shapely.LinearRing(sides[a : a + n, :2]) for a, n in zip(adr[1:], num[1:], strict=True)]
    assert all(ring.is_ccw for ring in rings)
    assert num[0] == 0
    surfaces = surfaces_of_regions(plan.objects)
    first, count = statics.surface_partadr.numpy(), statics.surface_partnum.numpy()
    for surface, a, n in zip(surfaces[1:], first[1:], count[1:], strict=True):
        whole = shapely.union_all([shapely.Polygon(ring) for ring in rings[a - 1 : a - 1 + n]])
        assert whole.symmetric_difference(surface.outline).area < 1e-6
    assert set(count[1:]) == {1, np.max(count)}
