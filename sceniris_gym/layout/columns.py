"""Columns of layouts by their parts, from which all that stores, copies or serves layouts takes its own.

The fields of `LayoutTable` are the list. A column that another place lists by hand is a column that the next feature
forgets.
"""

from __future__ import annotations

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import COLUMNS

NEXT = ("next_seed", "next_episode", "next_param")
"""Columns of `LayoutsView` that say which layout a world gets next."""


def columns(*parts: str) -> tuple[str, ...]:
    """Return the names of the columns of these parts, or of all that `Layouts` has."""
    return tuple(name for name, c in COLUMNS.items() if (c.part in parts if parts else c.part != "table"))


BANKED = ("seed", "episode", *columns("pose", "grasp"))
"""Columns of the bank. Its layouts are made with the params of the scene file, and drawn by their own key."""


def row_types(compiled: CompiledScene, **widths: int) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Return type and shape of a row of each column of a table.

    Args:
        compiled: The scene.
        **widths: Widths that differ from the scene's, or that it does not have, such as `nvalue`.
    """
    mjm, reaching = compiled.mjm, compiled.reaching
    of_scene = {"nq": mjm.nq, "nmocap": mjm.nmocap, "nslot": len(compiled.slots)}
    if reaching is not None:
        of_scene |= {"nreach": len(reaching.targets), "njoint": reaching.njoint}
    return {name: (column.dtype, column.row(of_scene | widths)) for name, column in COLUMNS.items()}
