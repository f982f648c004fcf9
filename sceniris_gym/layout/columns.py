"""Names and types of the columns of layouts, for all code that stores, copies or serves layouts.

The fields of `LayoutTable` are the only list of columns. A second list, written by hand, would miss new columns.
"""

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.scene.layout_table import COLUMNS

NEXT = ("next_seed", "next_episode", "next_param")
"""Columns of `LayoutsView` with the seed, episode and params of each world's next layout."""


def columns(*parts: str) -> tuple[str, ...]:
    """Return the names of the columns that belong to the given parts. `Column.part` explains the parts.

    Without arguments, return the columns of all parts except "table". These are the columns of `Layouts`.
    """
    return tuple(name for name, c in COLUMNS.items() if (c.part in parts if parts else c.part != "table"))


BANKED = ("seed", "episode", *columns("pose", "grasp"))
"""Columns of the bank. Its layouts have the params of the scene file, and their key is also the key of their draws."""


def row_types(compiled: CompiledScene, **widths: int) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Return, for each column of a table, the type and shape of one row.

    Args:
        compiled: The scene.
        **widths: Numbers of entries in a row, by name, such as `nvalue`. They take precedence over the
            numbers that the scene determines.
    """
    mjm, reaching = compiled.mjm, compiled.reaching
    of_scene = {"nq": mjm.nq, "nmocap": mjm.nmocap, "nslot": len(compiled.slots)}
    if reaching is not None:
        npath = 3 * MAX_JOINTS if reaching.on_path else 0
        of_scene |= {"nreach": len(reaching.targets), "njoint": reaching.njoint, "npath": npath}
    return {name: (column.dtype, column.row(of_scene | widths)) for name, column in COLUMNS.items()}
