"""Share of layouts with objects in each other, by FCL, whichever program made them."""

from __future__ import annotations

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable


def colliding(compiled: CompiledScene, table: LayoutTable) -> float:
    """Return the share of layouts in which two things cross, or one of them encloses the other.

    Clearances do not count: each program keeps its own.

    Args:
        compiled: The scene; its model and geometry are all that is used.
        table: The layouts.
    """
    auditor = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)
    found = auditor.judge(table).conflicts
    return len({conflict.row for conflict in found if conflict.distance <= 0.0}) / len(table)
