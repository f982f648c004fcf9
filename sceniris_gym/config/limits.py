"""Sizes that are built into device code."""

MAX_RELATIONS = 4
"""Relations of one object."""
MAX_ANCHORS = 8
"""Anchors of one `between`."""
MAX_CORNERS = 24
"""Corners of a piece of a region: a triangle cut by four relations of four half-planes has up to 19, by three and a
hull of eight anchors up to 23."""

MAX_PIECES = 65536
"""Pieces that the relations of one object may cut its region into, all combinations together: each of them is cut and
measured in every draw."""
