"""Things on top of each other, put there by hand: towers, a stool under a load, a table at an edge."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable

Things = Mapping[str, tuple[str, str, tuple[float, float, float]]]
"""Name -> geoms in MJCF, support and place [m]."""
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


def auditor(things: Things, geometry: str = "physics", **words: Mapping[str, Any]) -> Auditor:
    """Return the auditor of a scene of things; `words` are further ones of a scene file, by object."""
    bodies = "".join(f'<body name="{name}"><freejoint/>{geoms}</body>' for name, (geoms, _, _) in things.items())
    floor = '<geom name="floor" type="plane" size=".5 .5 .1"/>'
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{floor}{bodies}</worldbody></mujoco>")
    objects = {name: {"on": on, **words.get(name, {})} for name, (_, on, _) in things.items()}
    config = SceneConfig.load({"model": mjm, "floor": {"size": [1, 1]}, "geometry": geometry, "objects": objects})
    return Auditor(mjm, config, {name: mjm.body(name).id for name in things})


def table(*rows: Things) -> LayoutTable:
    """Return a layout of each of several places of the same things."""
    qpos = np.array([np.concatenate([[*place, 1, 0, 0, 0] for _, _, place in things.values()]) for things in rows])
    n = len(rows)
    return LayoutTable.from_states(qpos, np.zeros((n, 0, 3)), np.zeros((n, 0, 4)), np.ones((n, len(rows[0])), bool))


def cubes(*places: float) -> Things:
    """Return cubes on top of each other, at these places along x [m]."""
    names = ("floor", *"abcdef")
    return {
        name: (CUBE.format(name=name), below, (x, 0.0, i * 0.05 + (i + 1) * GAP))
        for i, (below, name, x) in enumerate(zip(names, names[1:], places, strict=False))
    }


def stool(x: float) -> Things:
    """Return a stool with a brick at x [m] on its seat."""
    return {"stool": (STOOL, "floor", (0.0, 0.0, GAP)), "brick": (BRICK, "stool", (x, 0.0, 0.12 + 2 * GAP))}


def table_at_an_edge(x: float) -> Things:
    """Return a table with four legs at x [m] on a slab that ends at 0.2 m."""
    return {"slab": (SLAB, "floor", (0.0, 0.0, GAP)), "table": (TABLE, "slab", (x, 0.0, 0.1 + 2 * GAP))}


def post(lean: float) -> Things:
    """Return a post on a collider that ends 1.5 mm above its mesh, `lean` [m] aside of its centre of mass."""
    seen = '<geom name="seen" type="box" size=".02 .02 .08" pos="0 0 .08" contype="0" conaffinity="0" mass="0"/>'
    foot = f'<geom name="foot" type="box" size=".01 .01 .039" pos="{lean} 0 .0405" mass="0.01"/>'
    head = '<geom name="head" type="box" size=".02 .02 .01" pos="0 0 .15" mass="1"/>'
    return {"post": (seen + foot + head, "floor", (0.0, 0.0, GAP))}
