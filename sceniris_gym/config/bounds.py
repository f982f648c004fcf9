"""Limits on the sizes of scenes and batches, and on numbers in scene files and models. Device code depends on them.

Positions are limited because single precision becomes coarse far from the origin. All other limits are far above any
sensible value.
"""

from typing import NamedTuple

MOST_FAR = 100.0
"""Largest distance [m] of placed objects from the world's origin, along each axis. Single precision resolves 8 um
there."""
MOST_WIDE = 1000.0
"""Largest distance [m], along each axis, between the world's origin and any part of a geom that comes near the origin.
Single precision resolves 61 um there, which limits the accuracy of distances in layouts. `oddities.py` warns if this
matters. For a large ground, a plane is better, because it has no corners."""
STANDING_GAP = 5.0e-3
"""Largest gap [m] above the support of an object that is put down. With a larger gap, it is dropped and may fall."""
LEAST_GAP = 2.0e-5
"""Smallest gap [m] between an object and its support. With a smaller gap, rounding could make them touch."""


class Bound(NamedTuple):
    """The lowest and the highest value of a kind of number, and its unit for messages."""

    low: float
    high: float
    unit: str

    def holds(self, value: float) -> bool:
        """Return whether a value is within the bound. For NaN, return False."""
        return self.low <= value <= self.high

    @property
    def advice(self) -> str:
        """The advice for error messages, such as "should be from 0 to 10 m"."""
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
"""The bound of each kind of number. In scene files, all numbers have a bound except fractions, counts and the angles of
relations. In models, the bounds are for numbers that MuJoCo does not check."""


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
"""Maximum number of free objects in a tower, where each object stands on the one below."""

MAX_POINTS = 4096
"""Maximum number of points of a region `points`. Every draw searches all of them."""

MAX_PIECES = 65536
"""Maximum number of pieces of a region after all relations of the object cut it. Every draw cuts and measures each
piece."""

MOST_WORLDS = 1 << 24
"""Maximum number of worlds in a batch: far more than fit on a GPU, even for scenes of a few objects."""
COUNT = range(1, MOST_WORLDS + 1)
"""A number of worlds or layouts. `check_numbers` rejects an option outside the range that annotates it."""
