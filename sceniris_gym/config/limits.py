"""Limits: of scenes, which are compiled into device code, and of a batch."""

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
