"""Limits that are compiled into device code."""

MOST_ATTEMPTS = 10_000
"""Most candidates of one object between two restarts."""
MAX_RELATIONS = 4
"""Most relations of one object."""
MAX_ANCHORS = 8
"""Most anchors of one `between`."""
MAX_CORNERS = 24
"""Most corners of a piece of a region: a triangle cut by four relations of four half-planes each has up to 19, one cut
by three of them and a hull of eight anchors up to 23."""

MAX_POINTS = 4096
"""Most points of a region `points`: a point is looked for among all of them in every draw."""

MAX_PIECES = 65536
"""Most pieces that the relations of one object may cut its region into, over all combinations: each is cut and measured
in every draw."""
