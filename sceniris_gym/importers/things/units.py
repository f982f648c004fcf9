"""Finds an object's unit of length and up axis: from the user's options, the file, a prompt, or a guess.

The manifest of the asset records which of these was the source.
"""

import sys
from collections.abc import Callable

import numpy as np

from sceniris_gym.errors import ArgumentError, MeshError
from sceniris_gym.importers.things.thing import Thing

LEAST_SIZE, MOST_SIZE = 0.001, 50.0
"""Limits of the longest edge of an object's bounds [m]. Outside them, the unit is most likely wrong."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Metres per unit."""
_HELD, _USUAL = (0.02, 0.5), (0.01, 3.0)  # sizes of objects that a hand holds, and of most objects in scenes [m]
_MOST_GUESSED, _HEAVIEST = 2.0, 100.0
"""Greatest longest edge [m] and mass [kg] with a guessed unit. Most files in cm or mm exceed them in metres."""
UPRIGHT = {
    "x": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Name of an axis -> rotation matrix (3, 3) that points this axis of the file up. If possible, the x axis stays."""

Ask = Callable[[str], str]
"""A function that prompts the user with a question and returns the answer."""


def ask_on_terminal() -> Ask | None:
    """Return a function that prompts the user on the terminal, or None if the program does not run on a terminal."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return None

    def ask(question: str) -> str:
        print(question, end=" ", file=sys.stderr, flush=True)
        return sys.stdin.readline().strip()

    return ask


def parse_scale(text: str) -> float:
    """Return the metres per unit of length from a text: a number, or the name of a unit in `UNITS`.

    Raises:
        ArgumentError: The text is not a positive number and not the name of a unit.
    """
    try:
        factor = UNITS[text] if text in UNITS else float(text)
    except ValueError:
        factor = 0.0
    if not (np.isfinite(factor) and factor > 0.0):
        raise ArgumentError(f"scale: {text!r} should be the metres per unit of the file, or one of {', '.join(UNITS)}.")
    return factor


def find_scale(thing: Thing, scale: str | None, ask: Ask | None, where: str, density: float = 0.0) -> tuple[float, str]:
    """Return the metres per unit of length of an object, and the source of this number in words.

    If the user gives a `scale` (a number or the name of a unit), it is used. Otherwise, the file's unit is used, or
    metres if the file has no unit. `ask` prompts the user for another scale if the longest edge of the object is then
    below 1 mm or above 50 m. If the file has no unit, `ask` also prompts for an edge above 2 m, or a mass above 100 kg.
    `density` [kg/m^3] determines this mass. Error messages begin with `where`.

    Raises:
        MeshError: The longest edge is below 1 mm or above 50 m, and `ask` is None, or the user's answer does not change
            this. Or the file has no unit, the object is too long or too heavy in metres, and `ask` is None.
        ArgumentError: The scale or the user's answer is not a positive number and not the name of a unit.
    """
    size = float(thing.extents().max())
    if scale is not None:
        factor, how = parse_scale(scale), "as given"
    elif thing.meters is not None:
        factor, how = thing.meters, "from the file"
    else:
        factor, how = 1.0, "guessed: the file has no unit"
    guessed, mass = how.startswith("guessed"), density * _volume(thing) * factor**3
    if not LEAST_SIZE <= size * factor <= MOST_SIZE:
        problem = f"{where}: its length should be from 1 mm to 50 m, got {size * factor:.4g} m"
        choices = _choices(size)
    elif guessed and (size > _MOST_GUESSED or mass > _HEAVIEST):
        problem = f"{where}: the file has no unit, and in metres, its object is {size:.3g} m long, with {mass:,.0f} kg"
        choices = f"{_choices(size, _HELD)}. --scale m keeps this size"
    else:
        small = guessed and size < _USUAL[0]
        return factor, how + (f", use --scale if {size:.3g} m is not its length" if small else "")
    if ask is None or size == 0.0:
        raise MeshError(f"{problem}. {choices}.", "size")
    factor = parse_scale(ask(f"{problem}. {choices}. Scale?"))
    if not LEAST_SIZE <= size * factor <= MOST_SIZE:
        raise MeshError(f"{where}: this makes it {size * factor:.4g} m long, not 1 mm to 50 m. {choices}.", "size")
    return factor, "as answered"


def find_up(thing: Thing, up: str | None, stands: Callable[[str], bool]) -> tuple[str, str]:
    """Return the axis of the file that points up, and the source of this choice in words.

    If `up` is given, it is used. Otherwise, the file's up axis is used. If the file has no up axis, the axis is y if
    the object stands with y up but not with z up, and otherwise z.

    Args:
        thing: The object.
        up: The user's choice, "x", "y" or "z", or None.
        stands: Takes an axis. Returns whether the object stands stably when this axis points up.
    """
    if up is not None:
        return up, "as given"
    if thing.up is not None:
        return thing.up, "from the file"
    for axis, why in (("z", "it stands with z up"), ("y", "it stands with y up, but not with z up")):
        if stands(axis):
            return axis, f"guessed: {why}"
    return "z", "guessed: it does not stand with z or y up"


def _volume(thing: Thing) -> float:
    """Return the volume inside the surfaces of an object, in cubed units of the file. Holes make it inexact."""
    surfaces = [surface for link in thing.links for surface in link.touched]
    corners = (surface.vertices[surface.faces] for surface in surfaces)
    return abs(sum(float(np.linalg.det(triangles).sum()) for triangles in corners)) / 6.0


def _choices(size: float, *first: tuple[float, float]) -> str:
    """Return the end of an error message: values of `--scale` that would give the object a plausible size.

    Args:
        size: Longest edge of the object, in the file's unit of length.
        first: A range of sizes [m] that is preferred.
    """
    if size == 0.0:
        return "All its vertices coincide: export the file again"
    for low, high in (*first, _USUAL, (LEAST_SIZE, MOST_SIZE)):
        fit = [unit for unit, factor in UNITS.items() if low <= size * factor <= high]
        if fit:
            return f"Give its scale: {', '.join(f'--scale {u} makes it {size * UNITS[u]:.3g} m' for u in fit)}"
    return (
        f"The object measures {size:.3g} units of the file, so no usual unit fits. Give the metres per unit, such as "
        f"--scale {0.1 / size:.6g} if it is 0.1 m long"
    )
