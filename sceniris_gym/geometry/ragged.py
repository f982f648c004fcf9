"""Packs lists of different lengths into one flat list, with the start and length of each list, as MuJoCo does."""

from collections.abc import Iterable, Sequence

import numpy as np


def ranges(lists: Iterable) -> tuple[list, np.ndarray, np.ndarray]:
    """Join lists into one list. Return this list, and for each original list its start and its length."""
    lists = list(lists)
    num = np.array([len(x) for x in lists], int)
    adr = np.concatenate([[0], np.cumsum(num)[:-1]]) if len(num) else np.zeros(0, int)
    return [x for part in lists for x in part], adr, num


def addressed(name: str, lists: Iterable) -> tuple[list, dict[str, np.ndarray]]:
    """Join lists into one list. Return this list, and arrays of the starts `{name}adr` and lengths `{name}num`."""
    flat, adr, num = ranges(lists)
    return flat, {f"{name}adr": adr, f"{name}num": num}


def columns(prefix: str, rows: Sequence, **widths: int) -> dict[str, np.ndarray]:
    """Return an array for each attribute of the rows, under the key `{prefix}_{name}`, with its values in all rows.

    `widths` maps the `name` of each attribute to the number of values that it has in a row.
    """
    shapes = {name: (-1,) if width == 1 else (-1, width) for name, width in widths.items()}
    return {f"{prefix}_{name}": np.reshape([getattr(r, name) for r in rows], shape) for name, shape in shapes.items()}
