"""`COLUMNS`: the columns of a layout, from which all that stores, copies or serves layouts takes its own.

A column that another place lists by hand is a column that the next feature forgets.
"""

from __future__ import annotations

COLUMNS = {
    "key": ("seed", "episode", "knob"),
    "draw": ("draw_seed", "draw_episode", "draw_stream"),
    "pose": ("qpos", "mocap_pos", "mocap_quat", "present", "start"),
    "grasp": ("grasp", "grasp_qpos", "pregrasp_qpos"),
    "count": ("status", "attempts", "first_pass_valid"),
}
"""Columns of `LayoutsView` by what they say: which layout it is, by which key its physics and looks are drawn, what is
written into a world, what was found of the arms, and how it was made."""

NEXT = ("next_seed", "next_episode", "next_knob")
"""Columns of `LayoutsView` that say which layout a world gets next."""


def columns(*parts: str) -> tuple[str, ...]:
    """Return the names of the columns of these parts, or of all."""
    return tuple(name for part in parts or COLUMNS for name in COLUMNS[part])


BANKED = ("seed", "episode", *columns("pose", "grasp"))
"""Columns of the bank. Its layouts are made with the knobs of the scene file, and drawn by their own key."""
