"""Poses of starts: between the fingers, as MuJoCo C measures it, in any of the grasps that count."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.layout.tables import make_table
from tests.layout.starting import HANDLE, HELD, LIFTED, STANDING, starting


def test_fingers_are_at_the_thing_on_both_sides():
    """Each is a fraction of a millimetre inside, so that it presses from the first step on."""
    compiled, table = starting(), make_table(starting(), 200, 7)
    data, mjm = mujoco.MjData(compiled.mjm), compiled.mjm
    fingers = [
        [g for g in range(mjm.ngeom) if f"{side}_finger" in mjm.body(mjm.geom_bodyid[g]).name]
        for side in ("left", "right")
    ]
    things = {STANDING: "block", LIFTED: "block", HELD: "block", HANDLE: "cabinet"}
    for row in np.flatnonzero(np.isin(table.start, list(things))):
        table.put(data, int(row))
        mujoco.mj_kinematics(mjm, data)
        own = compiled.scene.subtree(things[int(table.start[row])])
        geoms = [g for g in range(mjm.ngeom) if mjm.geom_bodyid[g] in own and mjm.geom_contype[g]]
        for side in fingers:
            near = min(
                mujoco.mj_geomDistance(mjm, data, f, g, 0.1, None) for f in side if mjm.geom_contype[f] for g in geoms
            )
            assert -6e-4 < near < -1e-4


def test_things_in_the_air_are_held_by_all_grasps():
    """The hand is anywhere, so no grasp is more likely than another."""
    compiled, table = starting(), make_table(starting(), 800, 11)
    assert compiled.reaching is not None
    column = compiled.reaching.names.index("block")
    held = table.grasp[table.start == HELD, column]
    assert set(held.tolist()) == set(range(len(compiled.reaching.targets[column].grasp_set.grasps)))
