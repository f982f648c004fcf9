"""Distances of geoms at home: by hand, and against hulls of Minkowski differences and MuJoCo's own depths."""

from __future__ import annotations

from itertools import combinations_with_replacement

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.program.pack.home_touch import HomeTouch, Touch
from tests.oracle.minkowski import signed_distance
from tests.versions import since_4

HULL = "0 0 .04 .05 0 0 -.03 .04 0 -.03 -.04 0 0 .02 -.05 .03 .03 .02"
SHAPES = {
    "box": 'type="box" size=".05 .03 .02"',
    "sphere": 'type="sphere" size=".04"',
    "capsule": 'type="capsule" size=".02 .05"',
    "cylinder": 'type="cylinder" size=".04 .03"',
    "ellipsoid": 'type="ellipsoid" size=".05 .03 .02"',
    "hull": 'type="mesh" mesh="hull"',
}
KINDS = list(combinations_with_replacement(SHAPES, 2))


def two(first: str, second: str) -> mujoco.MjModel:
    """Return a body of each of two geoms; the second is free."""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="hull" vertex="{HULL}"/></asset><worldbody><body name="a"><geom {first}/></body>
        <body name="b"><freejoint/><geom {second}/></body></worldbody></mujoco>"""
    )


def touch(mjm: mujoco.MjModel, qpos: np.ndarray, near: float) -> Touch | None:
    """Return what is found of the two geoms with the second body there."""
    data = mujoco.MjData(mjm)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(mjm, data)
    first, second = extract_pieces(mjm, "physics")
    return HomeTouch(mjm, data).between(first, second, near)


def poses(seed: int, count: int) -> np.ndarray:
    """Return poses near the origin, shape (count, 7)."""
    rng = np.random.default_rng(seed)
    return np.hstack([0.03 * rng.normal(size=(count, 3)), Rotation.random(count, rng=rng).as_quat()])


def vertices(mjm: mujoco.MjModel, qpos: np.ndarray) -> list[np.ndarray]:
    """Return the vertices of both geoms in the world."""
    data = mujoco.MjData(mjm)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(mjm, data)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return [
        (mjm.mesh_vert if mjm.geom_dataid[g] >= 0 else corners * mjm.geom_size[g]) @ data.geom_xmat[g].reshape(3, 3).T
        + data.geom_xpos[g]
        for g in (0, 1)
    ]


@pytest.mark.parametrize("kinds", [("box", "box"), ("box", "hull"), ("hull", "hull")], ids=" ".join)
def test_polyhedra_are_as_deep_as_their_minkowski_difference(kinds: tuple[str, str]):
    """In double precision; moved along the way by its depth they touch."""
    mjm = two(*(SHAPES[kind] for kind in kinds))
    count = 0
    for qpos in poses(1, 30):
        exact = signed_distance(*vertices(mjm, qpos))
        found = touch(mjm, qpos, 1e-5)
        assert (found is not None) == (exact < 1e-5)
        if found is not None:
            count += 1
            assert found.distance == pytest.approx(exact, abs=1e-7)
            out = qpos + np.r_[-found.distance * found.direction, np.zeros(4)]
            assert signed_distance(*vertices(mjm, out)) == pytest.approx(0.0, abs=1e-7)
    assert count > 10


@since_4("mj_geomDistance finds no distance of some boxes")
@pytest.mark.parametrize("kinds", KINDS, ids=" ".join)
def test_all_kinds_are_no_deeper_than_mujoco_finds_out_of_each_other(kinds: tuple[str, str]):
    """Moved along the way by its depth and 0.1 mm they are that far apart; turned around, they find the same."""
    mjm, other = (two(*(SHAPES[kind] for kind in order)) for order in (kinds, kinds[::-1]))
    data, count = mujoco.MjData(mjm), 0
    for qpos in poses(2, 20):
        found = touch(mjm, qpos, 1e-5)
        if found is None:
            continue
        count += 1
        data.qpos[:] = qpos + np.r_[(1e-4 - found.distance) * found.direction, np.zeros(4)]
        mujoco.mj_kinematics(mjm, data)
        assert mujoco.mj_geomDistance(mjm, data, 0, 1, 1.0, None) == pytest.approx(1e-4, abs=3e-6)
        turned = Rotation.from_quat(qpos[3:], scalar_first=True).inv()
        back = touch(other, np.r_[-turned.apply(qpos[:3]), turned.as_quat(scalar_first=True)], 1e-5)
        assert back is not None
        assert back.distance == pytest.approx(found.distance, abs=1e-6)
    assert count > 4


def test_a_way_is_found_also_where_geoms_just_touch():
    """A box on a box, with a distance of nothing or almost nothing between them."""
    mjm = two('type="box" size=".1 .1 .1"', SHAPES["box"])
    for gap in (0.0, 1e-16, -1e-16, 1e-9, -1e-9, 9e-6, -9e-6):
        found = touch(mjm, np.array([0.02, 0.03, 0.12 + gap, 1, 0, 0, 0]), 1e-5)
        assert found is not None
        assert found.distance == pytest.approx(gap, abs=1e-12)
        np.testing.assert_allclose(found.direction, [0, 0, 1], atol=1e-6)
    assert touch(mjm, np.array([0.0, 0.0, 0.1201, 1, 0, 0, 0]), 1e-5) is None


def test_the_way_over_a_plane_is_that_into_it():
    """The plane is the second, so it leaves a ball that is 1 cm deep downwards."""
    mjm = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 .3"/>
        <body pos="0 0 .32"><joint/><geom size=".03"/></body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    plane, ball = extract_pieces(mjm, "physics")
    found = HomeTouch(mjm, data).between(ball, plane, 1e-5)
    assert found is not None
    assert found.distance == pytest.approx(-0.01)
    np.testing.assert_allclose(found.direction, [0, 0, -1])
