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

WAITING_FROM = 40.0
"""First corner [m] of the square lattice, far from every scene, on which absent members of groups wait."""
WAITING_SPACING = 2.0
"""Distance [m] of neighbours on that lattice."""
WAITING_COLUMNS = 8
"""Places in one row of that lattice."""
