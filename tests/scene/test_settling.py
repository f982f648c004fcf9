"""Settled heaps, judged by MuJoCo C in a model of their own: inside, not too deep in anything, and at rest."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.groups import HeapConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.scene.heaps import read_rows
from sceniris_gym.scene.settling import settle
from tests.scene.heaping import BIN, THINGS, folder, model

HEAP = HeapConfig.model_validate({"fill": "bin", "of": THINGS})


def test_heaps_lie_in_the_bin_and_stay_there():
    """The bin and the blocks written anew as MJCF: for half a second nothing moves by 3 mm, or is 1 mm deep.

    With the cones of friction that scenes have: what leans on a wall creeps with pyramids.
    """
    rows = read_rows(folder() / "pile.npz", HEAP, "here")
    blocks = "".join(f'<body name="{n}"><freejoint/><geom type="box" size=".03 .02 .015"/></body>' for n in THINGS)
    option = '<option timestep=".005" integrator="implicitfast" cone="elliptic" impratio="10"/>'
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody><body>{BIN}</body>{blocks}</worldbody></mujoco>")
    for pos, quat in zip(rows.pos, rows.quat, strict=True):
        data = mujoco.MjData(mjm)
        data.qpos[:] = np.hstack([pos, quat]).reshape(-1)
        mujoco.mj_forward(mjm, data)
        assert data.contact.dist.min() > -1e-3
        mujoco.mj_step(mjm, data, nstep=100)
        now = data.qpos.reshape(-1, 7)[:, :3]
        assert np.linalg.norm(now - pos, axis=1).max() < 3e-3
        assert np.abs(now[:, :2]).max() < 0.08
        assert now[:, 2].min() > 0.01


def test_rows_depend_on_the_seed_and_their_number_alone():
    """More rows begin with the same ones, and another seed has others."""
    rows = read_rows(folder() / "pile.npz", HEAP, "here")
    again = settle(model(folder()), "pile", 2, seed=3)
    assert np.array_equal(again.pos.astype(np.float32), rows.pos[:2])
    assert not np.allclose(settle(model(folder()), "pile", 1, seed=4).pos, again.pos[:1], atol=1e-3)
    assert len(np.unique(rows.pos.round(4), axis=0)) == len(rows.pos)


def test_a_free_bin_stays_where_it_is():
    """The heap is the same as in one that cannot move."""
    free = settle(model(folder(), **{"objects.bin.kind": "free"}), "pile", 1, seed=3)
    rows = read_rows(folder() / "pile.npz", HEAP, "here")
    assert free.pos[0] == pytest.approx(rows.pos[0], abs=5e-3)


def test_a_bin_that_is_too_small_is_an_error():
    """It says how many things it does not hold, and what helps."""
    scene = model(folder(), **{f"objects.{name}.asset": "cereal_box" for name in THINGS})
    with pytest.raises(SceneKeyError, match=r"heaps\.pile: 'bin' does not hold all 3 objects.* a larger container"):
        settle(scene, "pile", 1, seed=0)


def test_the_floor_is_no_container():
    """It has no walls."""
    scene = model(folder(), **{"heaps.pile.fill": "floor"})
    with pytest.raises(NotSupportedError, match=r"is part of the world. Name a separate body with walls"):
        settle(scene, "pile", 1, seed=0)
