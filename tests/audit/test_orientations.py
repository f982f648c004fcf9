"""The audit of orientations, on turns that are known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.audit.judging import MJM, at, kept
from tests.commands.scenes import layout


@pytest.mark.parametrize(
    ("orientation", "yaw", "off"),
    [
        ("fixed", 0.1, 0.1),
        ({"yaw": [150, 210]}, np.radians(-140), np.radians(10)),
        ({"yaw": [150, 210]}, np.radians(-160), np.radians(-10)),
        ({"face_to": "can"}, np.radians(90), 0.0),
        ({"face_to": "can"}, np.radians(-90), np.pi),
        ({"face_to": "can", "yaw": [10, 20]}, np.radians(75), np.radians(25)),
    ],
)
def test_headings_are_measured(orientation: Any, yaw: float, off: float):
    """Whatever full turns are between; the front is -y, and the can is to the right of the crate."""
    found = kept(layout(MJM, can=at(0.5, 0), crate=at(0, 0, yaw)), crate={"orientation": orientation})
    word = "yaw rad" if isinstance(orientation, str) or "face_to" not in orientation else "face_to rad"
    assert found["crate", word].worst == pytest.approx(off, abs=1e-5)
    assert found["crate", word].broken == (off > 1e-3)


def test_nothing_faces_what_is_at_its_own_pivot():
    """So any heading is right there; 0.1 mm apart it is not."""
    for apart, broken in ((0.0, 0), (2e-6, 0), (1e-4, 1)):
        rows = layout(MJM, can=at(apart, 0), crate=at(0, 0, -1.5))
        assert kept(rows, crate={"orientation": {"face_to": "can"}})["crate", "face_to rad"].broken == broken


def test_what_leans_is_not_upright_and_what_stands_on_an_edge_is_not_stable():
    """A crate that leans by 10 degrees, and one that lies on another face."""
    rows = layout(MJM, 2)
    adr = MJM.jnt_qposadr[MJM.joint("crate/free").id] + 3
    for row, angle in enumerate((np.radians(10), np.pi / 2)):
        rows.qpos[row, adr : adr + 4] = [np.cos(angle / 2), np.sin(angle / 2), 0, 0]
    assert kept(rows)["crate", "upright rad"].broken == 2
    stable = kept(rows, crate={"orientation": "stable"})["crate", "stable m"]
    assert (stable.broken, stable.row) == (1, 0)
    assert stable.worst == pytest.approx(0.04 * (np.cos(np.radians(10)) - np.sin(np.radians(10))), abs=1e-6)
