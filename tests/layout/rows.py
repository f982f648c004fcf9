"""Rows of furniture on a floor, and a judge that reads only MuJoCo C's poses and the boxes of the units' own files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.relations import Kept
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import judge_language
from tests.layout.scenes import Rows, posed, read, valid

GAP = 0.004  # m
OPEN = {"*": {"fraction": [0.0, 1.0]}}
Units = dict[str, list[str]]
"""Assets of built units, by kind."""


class Joint(NamedTuple):
    """The place of a unit of a row relative to the unit before it, in each layout.

    Attributes:
        gap: Distance of the two along the side [m].
        back, front: How far its end is beyond the end of the unit before it, to the left and right of the side [m].
        yaw: Its heading relative to the unit before it [rad].
    """

    gap: np.ndarray
    back: np.ndarray
    front: np.ndarray
    yaw: np.ndarray


def row_of(assets: Sequence[str | list[str]], **words: Any) -> dict[str, Any]:
    """Return a scene of open units, each to the right of the one before it with its back in line, unless `words`.

    A unit with several assets has variants.
    """
    first = {"on": "floor", "region": {"box": [[-1.2, 0.5], [-1.0, 0.52]]}, "orientation": {"yaw": [-3, 3]}}
    objects: dict[str, Any] = {"unit_0": {"kind": "fixture", "asset": assets[0], **first}}
    for i, asset in enumerate(assets[1:]):
        beside = {"beside": f"unit_{i}", "side": "right", "gap": GAP, "align": "back"}
        next_ = {"on": "floor", "relations": [beside], "orientation": {"with": f"unit_{i}"}}
        objects[f"unit_{i + 1}"] = {"kind": "fixture", "asset": asset, **next_, **words}
    for asset, unit in zip(assets, objects.values(), strict=True):
        if any(mujoco.MjModel.from_xml_path(one).njnt for one in ([asset] if isinstance(asset, str) else asset)):
            unit.setdefault("joints", OPEN)
    return {"floor": {"size": [8, 8]}, "objects": objects}


def root_corners(asset: str) -> np.ndarray:
    """Return the corners [m] of the boxes of a unit's file that no joint moves, in the frame of its root, (n, 3)."""
    model = mujoco.MjModel.from_xml_path(asset)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    still = [i for i in range(model.ngeom) if model.body_weldid[model.geom_bodyid[i]] == 0]
    assert (model.geom_type[still] == mujoco.mjtGeom.mjGEOM_BOX).all()
    signs = np.stack(np.meshgrid(*[(-1, 1)] * 3), -1).reshape(-1, 3)
    return np.concatenate(
        [data.geom_xpos[i] + signs * model.geom_size[i] @ data.geom_xmat[i].reshape(3, 3).T for i in still]
    )


def joints_of(
    compiled: CompiledScene, num: int = 0, sides: np.ndarray | None = None, rows: Rows | LayoutTable | None = None
) -> tuple[list[Joint], int]:
    """Return how each unit after the first stands in `num` layouts or in some rows, and how many of these are fresh.

    Of a unit's variants, the one that stands on the floor counts. `sides` are the directions to each unit in the frame
    of the unit before it, by default its right, shape (n - 1, 2).
    """
    if rows is None:
        generator = LayoutGenerator(compiled, num)
        generator.generate()
        rows = valid(read(generator.layouts))
    config, names = compiled.config, sorted(compiled.config.named_objects)
    members = [config.variants.get(name, (name,)) for name in names]
    corners = {one: root_corners(str(config.objects[one].asset)) for some in members for one in some}
    sides = np.tile([1.0, 0.0], (len(names) - 1, 1)) if sides is None else sides
    found: list[list[list[float]]] = [[] for _ in sides]
    for data in posed(compiled, rows):
        roots = [min(map(data.body, some), key=lambda root: np.linalg.norm(root.xpos)) for some in members]
        mats = [root.xmat.reshape(3, 3) for root in roots]
        points = [root.xpos + corners[root.name] @ mat.T for root, mat in zip(roots, mats, strict=True)]
        for i, (x, y) in enumerate(sides):
            its, own = (p @ mats[i][:, :2] @ np.array([[x, -y], [y, x]]) for p in points[i : i + 2])
            high, low, turn = own.max(0) - its.max(0), own.min(0) - its.min(0), mats[i].T @ mats[i + 1]
            found[i].append([own[:, 0].min() - its[:, 0].max(), high[1], low[1], np.arctan2(turn[1, 0], turn[0, 0])])
    return [Joint(*np.array(each).T) for each in found], len(rows.qpos)


def stands(compiled: CompiledScene, num: int) -> list[Kept]:
    """Return the audit's verdicts on relations and orientations of some layouts."""
    return judge_language(Auditor(compiled.mjm, compiled.config, compiled.scene.bodies), make_table(compiled, num, 0))
