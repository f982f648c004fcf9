"""Helpers of the audit's tests: an auditor of the small scene, and its findings on rows in few words."""

from __future__ import annotations

from typing import Any

import pytest

from sceniris_gym.audit.auditor import CHUNK, Auditor
from sceniris_gym.audit.geometry import poses_of
from sceniris_gym.audit.relations import Kept, count
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from tests.commands.scenes import GAP, OBJECTS, bodies, layout, small_config, small_model

MJM = small_model()
GEOMETRIES = pytest.mark.parametrize("geometry", ["physics", "visual"])


def auditor(geometry: str = "physics", **changes: dict[str, Any]) -> Auditor:
    """Return an auditor of the small scene."""
    return Auditor(MJM, small_config(geometry, changes), bodies(MJM))


def judge_language(judge: Auditor, rows: LayoutTable) -> list[Kept]:
    """Return what an auditor says of relations, orientations and groups alone, which is fast."""
    return count([judge.excess(some, poses_of(judge.scene.mjm, some)) for _, some in rows.chunks(CHUNK)])


def causes(rows: LayoutTable, **changes: dict[str, Any]) -> list[tuple[int, str, str]]:
    """Return what is misplaced in rows, as (row, object, cause)."""
    return [(m.row, m.name, m.cause) for m in auditor("physics", **changes).judge(rows).misplaced]


def kept(rows: LayoutTable, groups: dict | None = None, **changes: dict[str, Any]) -> dict[tuple[str, str], Kept]:
    """Return what the audit says of rows, by object and word, where words of objects are changed."""
    objects = {name: {**part, **changes.get(name, {})} for name, part in OBJECTS.items()}
    config = SceneConfig.load({"floor": {"size": [2.0, 2.0]}, "objects": objects, "groups": groups or {}})
    found = judge_language(Auditor(MJM, config, bodies(MJM)), rows)
    return {(k.name, f"{k.word} {k.unit}"): k for k in found}


def missed(relation: dict[str, Any], **poses: tuple[float, float, float, float]) -> dict[str, float]:
    """Return by how much the crate misses a relation, by unit, where objects stand at (x, y, z, yaw)."""
    found = kept(layout(MJM, 1, **poses), crate={"relations": [relation]})
    return {k.unit: k.worst for (name, _), k in found.items() if name == "crate" and k.word[0] == "0"}


def at(x: float, y: float, yaw: float = 0.0) -> tuple[float, float, float, float]:
    """A place on the floor."""
    return (x, y, GAP, yaw)
