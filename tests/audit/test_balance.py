"""Statics of layouts by hand: levers, legs over an edge, and what rolls; MuJoCo C agrees with each of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable

GAP = 0.0005
CUBE = '<geom name="{name}" type="box" size=".025 .025 .025" pos="0 0 .025"/>'
STOOL = """<geom name="post" type="box" size=".03 .03 .05" pos="0 0 .05" density="200"/>
  <geom name="seat" type="box" size=".12 .12 .01" pos="0 0 .11" density="200"/>"""
BRICK = '<geom name="brick" type="box" size=".02 .02 .02" pos="0 0 .02" density="12000"/>'
LEGS = "".join(
    f'<geom name="leg{i}" type="box" size=".01 .01 .05" pos="{x} {y} .05"/>'
    for i, (x, y) in enumerate([(-0.06, -0.06), (0.06, -0.06), (-0.06, 0.06), (0.06, 0.06)])
)
TABLE = f'{LEGS}<geom name="top" type="box" size=".08 .08 .005" pos="0 0 .105"/>'
SLAB = '<geom name="slab" type="box" size=".2 .2 .05" pos="0 0 .05"/>'
BALL = '<geom name="ball" type="sphere" size=".03" pos="0 0 .03"/>'
TOP = '<geom name="top" type="ellipsoid" size=".02 .02 .06" pos="0 0 .06"/>'


def judged(
    things: Mapping[str, tuple[str, str, tuple[float, float, float]]],
    geometry: str = "physics",
    **words: Mapping[str, Any],
) -> tuple[list[str], list[str]]:
    """Return what falls by the audit, and what moves by MuJoCo C, of things with their geoms, supports and places."""
    bodies = "".join(f'<body name="{name}"><freejoint/>{geoms}</body>' for name, (geoms, _, _) in things.items())
    floor = '<geom name="floor" type="plane" size=".5 .5 .1"/>'
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{floor}{bodies}</worldbody></mujoco>")
    objects = {name: {"on": on, **words.get(name, {})} for name, (_, on, _) in things.items()}
    config = SceneConfig.load({"model": mjm, "floor": {"size": [1, 1]}, "geometry": geometry, "objects": objects})
    qpos = np.concatenate([[*place, 1, 0, 0, 0] for _, _, place in things.values()])[None]
    table = LayoutTable.from_states(qpos, np.zeros((1, 0, 3)), np.zeros((1, 0, 4)), np.ones((1, len(things)), bool))
    report = Auditor(mjm, config, {name: mjm.body(name).id for name in things}).judge(table, settled=1)
    return [m.name for m in report.misplaced if m.cause == "falls"], [name for name, n in report.moved.items() if n]


def cubes(*places: float) -> dict[str, tuple[str, str, tuple[float, float, float]]]:
    """Return cubes on top of each other, at these places along x [m]."""
    names = ("floor", *"abcdef")
    return {
        name: (CUBE.format(name=name), below, (x, 0.0, i * 0.05 + (i + 1) * GAP))
        for i, (below, name, x) in enumerate(zip(names, names[1:], places, strict=False))
    }


def test_a_tower_stands_as_long_as_every_level_does():
    """Each cube may be over the one below, and all of them together too far out."""
    assert judged(cubes(0.0, 0.005, 0.01)) == ([], [])
    falls, moved = judged(cubes(0.0, 0.02, 0.04, 0.06))  # each by less than half of its width
    assert falls == ["a", "b", "c"]
    assert {"b", "c", "d"} <= set(moved)


@pytest.mark.parametrize(("x", "falls"), [(0.0, []), (0.02, []), (0.09, ["stool"])])
def test_a_load_on_an_overhang_tips_what_carries_it(x: float, falls: list[str]):
    """The stool falls, not the brick, which has all of its foot on the seat."""
    things = {"stool": (STOOL, "floor", (0.0, 0.0, GAP)), "brick": (BRICK, "stool", (x, 0.0, 0.12 + 2 * GAP))}
    found, moved = judged(things)
    assert found == falls
    assert bool(moved) == bool(falls)


@pytest.mark.parametrize(("x", "falls"), [(0.12, []), (0.145, []), (0.17, ["table"])])
def test_legs_over_an_edge_carry_nothing(x: float, falls: list[str]):
    """Two of four legs are on a slab that ends at 0.2 m, partly on it, or beyond it."""
    things = {"slab": (SLAB, "floor", (0.0, 0.0, GAP)), "table": (TABLE, "slab", (x, 0.0, 0.1 + 2 * GAP))}
    assert judged(things) == (falls, falls)


@pytest.mark.parametrize(("lean", "falls"), [(0.0, []), (0.03, ["post"])])
def test_what_carries_may_end_above_what_is_seen(lean: float, falls: list[str]):
    """A post stands on a collider that ends 1.5 mm above its mesh, below its centre of mass or beside it."""
    seen = '<geom name="seen" type="box" size=".02 .02 .08" pos="0 0 .08" contype="0" conaffinity="0" mass="0"/>'
    foot = f'<geom name="foot" type="box" size=".01 .01 .039" pos="{lean} 0 .0405" mass="0.01"/>'
    head = '<geom name="head" type="box" size=".02 .02 .01" pos="0 0 .15" mass="1"/>'
    assert judged({"post": (seen + foot + head, "floor", (0.0, 0.0, GAP))}, "visual") == (falls, falls)


def test_drawn_masses_are_left_to_the_test_of_standing():
    """A brick that tips the stool by the masses of the model may not do so by those of its episode."""
    things = {"stool": (STOOL, "floor", (0.0, 0.0, GAP)), "brick": (BRICK, "stool", (0.09, 0.0, 0.12 + 2 * GAP))}
    assert judged(things, brick={"randomize": {"mass": {"scale": [0.1, 1.0]}}})[0] == []
    assert judged(things, brick={"randomize": {"friction": {"scale": [0.1, 1.0]}}})[0] == ["stool"]


def test_what_rolls_stands_and_what_stands_on_its_tip_too():
    """Neutral or not, the centre of mass is over the patch; MuJoCo C has the last word."""
    assert judged({"ball": (BALL, "floor", (0.0, 0.0, GAP))}) == ([], [])
    assert judged({"top": (TOP, "floor", (0.0, 0.0, GAP))})[0] == []


def test_what_need_not_stand_is_not_judged():
    """By `stands: false` and in any orientation; what it carries is judged for itself."""
    tower = cubes(0.0, 0.02, 0.04, 0.06)
    for words in ({"stands": False}, {"orientation": "any"}):
        assert judged(tower, b=words)[0] == ["c"]
