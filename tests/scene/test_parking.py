"""The ground on which absent objects are parked: it is under every place, and no plane is above it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.scene.parking import (
    PARKING_COLUMNS,
    PARKING_FROM,
    PARKING_SPACING,
    add_parking_ground,
    has_parking_ground,
)


def _places(nslot: int) -> np.ndarray:
    """Return the parking places [m] of the objects of so many slots, row by row, shape (nslot, 2)."""
    slots = np.arange(nslot)
    return PARKING_FROM + PARKING_SPACING * np.stack([slots % PARKING_COLUMNS, slots // PARKING_COLUMNS], axis=1)


def _height(mjm: mujoco.MjModel, xy: np.ndarray) -> float:
    """Return the height of the ground that a ray from one metre above meets; -inf where it meets none."""
    data = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, data)
    far = mujoco.mj_ray(mjm, data, np.array([*xy, 1.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, np.zeros(1, np.int32))
    return 1.0 - far if far >= 0.0 else -np.inf


def _with_planes(*planes: str) -> mujoco.MjModel:
    geoms = "".join(f'<geom type="plane" size="1 1 .1" {words}/>' for words in planes)
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")


@pytest.mark.parametrize("nslot", [1, 8, 9, 64, 65, 80, 200])
def test_the_ground_is_under_every_place_and_around_it(nslot: int):
    """At z = 0, also half a place beside the outermost ones, however many objects there are."""
    spec = mujoco.MjSpec()
    add_parking_ground(spec, nslot)
    mjm = spec.compile()
    half = 0.5 * PARKING_SPACING
    for place in _places(nslot):
        for step in ([0.0, 0.0], [half, half], [-half, half], [half, -half], [-half, -half]):
            assert _height(mjm, place + step) == pytest.approx(0.0, abs=1e-9)
    assert _height(mjm, np.zeros(2)) == -np.inf


def test_what_is_put_down_on_the_ground_stays_there():
    """A cube on the first place and one on the last, in half a second of MuJoCo C."""
    spec = mujoco.MjSpec()
    add_parking_ground(spec, 70)
    for i, (x, y) in enumerate(_places(70)[[0, -1]]):
        body = spec.worldbody.add_body(name=f"cube{i}", pos=[x, y, 0.05])
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, 0.05])
        body.add_freejoint()
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    start = data.qpos.copy()
    while data.time < 0.5:
        mujoco.mj_step(mjm, data)
    assert np.abs(data.qpos - start).max() < 1e-3


def test_a_plane_at_the_height_of_the_ground_is_ground_enough():
    """Wherever its middle is, and also among others that lie lower."""
    assert has_parking_ground(_with_planes(""), 1, "here")
    assert has_parking_ground(_with_planes('pos="-7 3 0"', 'pos="0 0 -1"'), 100, "here")


@pytest.mark.parametrize(
    "planes",
    [(), ('pos="0 0 -1"',), ('contype="0" conaffinity="0"',), ('pos="0 0 1" contype="0" conaffinity="0"',)],
    ids=["none", "far below", "not touched", "above and not touched"],
)
def test_what_is_no_ground_is_not_taken_for_it(planes: tuple[str, ...]):
    """A plane that is far below, or that nothing touches, carries no absent object."""
    assert not has_parking_ground(_with_planes(*planes), 1, "here")


@pytest.mark.parametrize(
    "plane",
    ['pos="0 0 .5"', 'zaxis="-.1 0 1"', 'pos="50 0 0" zaxis="-.1 0 1"', 'zaxis="0 -1 0"'],
    ids=["higher", "rising", "rising from among them", "upright"],
)
def test_a_plane_above_the_ground_is_refused(plane: str):
    """One that lies higher, rises over some or all of the places, or stands upright before them: they are under it."""
    with pytest.raises(SceneKeyError, match="here: groups: the plane 'top' lies above the ground"):
        has_parking_ground(_with_planes("", f'name="top" {plane}'), 1, "here")


def test_a_plane_that_falls_away_from_the_origin_is_no_ground():
    """It is nowhere above the places, and so neither carries nor buries what waits there."""
    assert not has_parking_ground(_with_planes('zaxis=".1 .1 1"'), 1, "here")
