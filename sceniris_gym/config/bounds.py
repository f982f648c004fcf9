"""Bounds of scenes, batches, and the numbers in scene files and models. Device code is compiled with these bounds.

Positions end where single precision gets coarse. The other bounds are far above any sensible value.
"""

from dataclasses import dataclass

MOST_FAR = 100.0
"""Largest distance [m] of placed objects from the world's origin, along each axis. Single precision resolves 8 um
there."""
MOST_WIDE = 1000.0
"""Largest distance [m] from the world's origin, along each axis, of any part of a geom near the origin. Single
precision resolves 61 um there, which limits the accuracy of distances in layouts. `oddities.py` warns if this matters.
A plane makes better ground, because it has no corners."""
STANDING_GAP = 5.0e-3
"""Largest gap [m] for putting an object down. Objects with a larger gap are dropped, and need not stand."""
LEAST_GAP = 2.0e-5
"""Smallest height over a support [m]. Closer objects could touch it by rounding."""


@dataclass(frozen=True)
class Bound:
    """The lowest and the highest value of a kind of number, and its unit for messages."""

    low: float
    high: float
    unit: str

    def holds(self, value: float) -> bool:
        """Return whether a value is within the bound. NaN is not."""
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
"""The kinds of numbers. In scene files, these are all numbers except fractions, counts and the angle of a relation. In
models, these are the numbers that MuJoCo does not check."""


MOST_ATTEMPTS = 10_000
"""Maximum number of candidates of one object between two restarts."""
MAX_RELATIONS = 4
"""Maximum number of relations of one object."""
MAX_ANCHORS = 8
"""Maximum number of anchors of one `between`."""
MAX_CORNERS = 24
"""Maximum number of corners of a piece of a region. A triangle has up to 19 corners after cuts by four relations of
four half-planes each, and up to 23 after cuts by three such relations and a hull of eight anchors."""
MAX_FOOT = 24
"""Maximum number of corners of an object's foot, and of a convex part of its support."""
MAX_LEVELS = 12
"""Maximum number of free objects that stand on each other."""

MAX_POINTS = 4096
"""Maximum number of points of a region `points`. Every draw searches all of them."""

MAX_PIECES = 65536
"""Maximum number of pieces of a region after cuts by the object's relations, over all combinations. Every draw cuts and
measures each piece."""

MOST_WORLDS = 1 << 24
"""Maximum number of worlds in a batch: far more than fit on a GPU, even for scenes of a few objects."""
