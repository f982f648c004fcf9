"""Bounds of scenes, which are compiled into device code, of a batch, and of the numbers in scene files and models.

Positions end where single precision gets coarse. The other bounds are far above every sensible value that was seen.
"""

from __future__ import annotations

from dataclasses import dataclass

MOST_FAR = 100.0
"""Largest distance [m] from the world's origin, along each axis, at which objects are placed: single precision resolves
8 um there."""
MOST_WIDE = 1000.0
"""Largest distance [m] from the world's origin, along each axis, that a geom which comes near the origin may reach:
single precision resolves 61 um there, and distances in layouts are exact to that. `oddities.py` warns where it matters.
A plane makes better ground, because it has no corners."""
STANDING_GAP = 5.0e-3
"""Largest gap [m] over a support at which an object is put down; from higher up it is dropped, and need not stand."""
LEAST_GAP = 2.0e-5
"""Least height over a support [m]: any lower, rounding makes the object touch it."""


@dataclass(frozen=True)
class Bound:
    """The least and the greatest value of a kind of number, and its unit for messages."""

    low: float
    high: float
    unit: str

    def holds(self, value: float) -> bool:
        """Return whether a value is within the bound; NaN never is."""
        return self.low <= value <= self.high

    @property
    def advice(self) -> str:
        """The advice of errors, which begins with "should"."""
        return f"should be from {self.low:g} to {self.high:g} {self.unit}".rstrip()


BOUNDS = {
    "position": Bound(-MOST_FAR, MOST_FAR, "m"),
    "extent": Bound(0.0, 2.0 * MOST_FAR, "m"),
    "distance": Bound(0.0, 2.0 * MOST_FAR, "m"),
    "clearance": Bound(0.0, 10.0, "m"),
    "gap": Bound(LEAST_GAP, 10.0, "m"),
    "turn": Bound(-3600.0, 3600.0, "degrees"),
    "joint": Bound(-MOST_FAR, MOST_FAR, "m or rad"),
    "noise": Bound(0.0, MOST_FAR, "m or rad"),
    "field of view": Bound(1.0, 179.0, "degrees"),
    "scale": Bound(0.01, 100.0, ""),
    "weight": Bound(0.0, 1.0e6, ""),
    "direction": Bound(-1.0e6, 1.0e6, ""),
    "model length": Bound(-1.0e5, 1.0e5, "m"),
    "friction": Bound(0.0, 1.0e6, ""),
    "mass": Bound(0.0, 1.0e15, "kg"),
    "timestep": Bound(1.0e-7, 1.0, "s"),
    "acceleration": Bound(-1.0e4, 1.0e4, "m/s^2"),
    "tolerance": Bound(0.0, 1.0e3, ""),
    "iterations": Bound(0.0, 1.0e5, ""),
    "impedance ratio": Bound(1.0e-6, 1.0e6, ""),
}
"""The kinds of all numbers of a scene file except shares, counts and the angle of a relation, and of those numbers of a
model that MuJoCo itself does not check."""


MOST_ATTEMPTS = 10_000
"""Greatest number of candidates of one object between two restarts."""
MAX_RELATIONS = 4
"""Greatest number of relations of one object."""
MAX_ANCHORS = 8
"""Greatest number of anchors of one `between`."""
MAX_CORNERS = 24
"""Greatest number of corners of a piece of a region: a triangle cut by four relations of four half-planes each has up
to 19, one cut by three of them and a hull of eight anchors up to 23."""
MAX_FOOT = 24
"""Greatest number of corners of an object's foot, and of a convex part of a support below it."""
MAX_LEVELS = 12
"""Greatest number of free objects that stand on each other."""

MAX_POINTS = 4096
"""Greatest number of points of a region `points`: every draw searches all of them."""

MAX_PIECES = 65536
"""Greatest number of pieces that the relations of one object may cut its region into, over all combinations: every draw
cuts and measures each."""

MOST_WORLDS = 1 << 24
"""Upper limit of worlds in a batch: far more than fit on any GPU with a scene of a few objects."""
