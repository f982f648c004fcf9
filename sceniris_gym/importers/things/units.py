"""Unit of length and up axis of a thing: given, stated by its file, asked for, or guessed, which the manifest says."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from sceniris_gym.errors import ArgumentError, MeshError
from sceniris_gym.importers.things.thing import Thing

LEAST_SIZE, MOST_SIZE = 0.001, 50.0
"""Limits of the longest edge of a thing's bounds [m]: anything outside them is most likely in another unit."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres for each unit."""
_USUAL = (0.01, 3.0)  # m: the sizes of most things that are placed in scenes
UPRIGHT = {
    "x": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotation matrices (3, 3) after which an axis of the file points up, by its name; x stays to the right if possible."""

Ask = Callable[[str], str]
"""Asks the user a question and returns the answer."""


def ask_on_terminal() -> Ask | None:
    """Return a function that asks the user on the terminal, or None if there is no terminal."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return None

    def ask(question: str) -> str:
        print(question, end=" ", file=sys.stderr, flush=True)
        return sys.stdin.readline().strip()

    return ask


def parse_scale(text: str) -> float:
    """Return metres for each unit of length, from a number or the name of a unit.

    Raises:
        ArgumentError: It is neither.
    """
    try:
        factor = UNITS[text] if text in UNITS else float(text)
    except ValueError:
        factor = 0.0
    if not (np.isfinite(factor) and factor > 0.0):
        raise ArgumentError(
            f"scale: {text!r} should be metres for each unit of the file, or one of {', '.join(UNITS)}."
        )
    return factor


def find_scale(thing: Thing, scale: str | None, ask: Ask | None, where: str) -> tuple[float, str]:
    """Return metres for each unit of length of a thing, and the source of that number.

    A given scale takes precedence over that of the file; without either, metres are assumed if they make sense.

    Raises:
        MeshError: The thing would be smaller than 1 mm or larger than 50 m, and nobody can be asked.
        ArgumentError: The scale, or the answer, is no scale.
    """
    size = float(thing.extents().max())
    if scale is not None:
        factor, how = parse_scale(scale), "as given"
    elif thing.meters is not None:
        factor, how = thing.meters, "as the file says"
    else:
        factor, how = 1.0, "guessed: the file does not say"
    if LEAST_SIZE <= size * factor <= MOST_SIZE:
        if how.startswith("guessed") and not _USUAL[0] <= size * factor <= _USUAL[1]:
            how += f"; --scale if {size * factor:.3g} m is not its length"
        return factor, how
    choices = _choices(size)
    problem = f"{where}: it would be {size * factor:.4g} m long, and should be from 1 mm to 50 m"
    if ask is None or size == 0.0:
        raise MeshError(f"{problem}. {choices}.", "size")
    factor = parse_scale(ask(f"{problem}. {choices}. Scale?"))
    if not LEAST_SIZE <= size * factor <= MOST_SIZE:
        raise MeshError(f"{where}: it would be {size * factor:.4g} m long. {choices}.", "size")
    return factor, "as answered"


def find_up(thing: Thing, up: str | None, stands: Callable[[str], bool]) -> tuple[str, str]:
    """Return the axis of the file that points up, and the source of that choice.

    Args:
        thing: The thing.
        up: The axis that the user gives, if any.
        stands: Returns whether the thing would stand with this axis up.
    """
    if up is not None:
        return up, "as given"
    if thing.up is not None:
        return thing.up, "as the file says"
    for axis, why in (("z", "it stands that way"), ("y", "it stands that way, and not with z up")):
        if stands(axis):
            return axis, f"guessed: {why}"
    return "z", "guessed: it stands neither way"


def _choices(size: float) -> str:
    """Name the units that would make a thing of this size [units] usual in size, or else possible."""
    if size == 0.0:
        return "All its vertices are in one place: export it again"
    for low, high in (_USUAL, (LEAST_SIZE, MOST_SIZE)):
        fit = [unit for unit, factor in UNITS.items() if low <= size * factor <= high]
        if fit:
            return f"Give its scale: {', '.join(f'--scale {u} makes it {size * UNITS[u]:.3g} m' for u in fit)}"
    return (
        f"It measures {size:.3g} units of the file, so no usual unit fits. Give its scale in metres for each of them, "
        f"as in --scale {0.1 / size:.6g} if it is 0.1 m long"
    )
