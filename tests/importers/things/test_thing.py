"""Things: their points through chains of links, in other units, and turned."""

from __future__ import annotations

import numpy as np

from sceniris_gym.importers.things.thing import Inertia, Joint, Link, Surface, Thing

HALF = np.sqrt(0.5)
CORNER = Surface(np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]), np.array([[0, 1, 2]]))
CHAIN = Thing(
    "chain",
    (
        Link("base", surfaces=(CORNER,), inertia=Inertia(1.0, np.array([1.0, 0.0, 0.0]), np.diag([1.0, 2.0, 3.0]))),
        Link("arm", "base", np.array([0, 0, 10.0]), np.array([HALF, 0, 0, HALF]), surfaces=(CORNER,)),
        Link(
            "tip",
            "arm",
            np.array([5.0, 0, 0]),
            joint=Joint("slide", "slide", np.eye(3)[0], (0.0, 2.0)),
            surfaces=(CORNER,),
        ),
    ),
)


def test_points_of_all_links_are_in_the_frame_of_the_root():
    """A quarter turn about z takes x to y; the tip is 5 along the arm's x."""
    points = CHAIN.points()
    np.testing.assert_allclose(points[3], [0.0, 1.0, 10.0], atol=1e-12)
    np.testing.assert_allclose(points[6], [0.0, 6.0, 10.0], atol=1e-12)
    np.testing.assert_allclose(CHAIN.extents(), np.ptp(points, axis=0))


def test_another_unit_changes_all_lengths():
    """Points, origins, limits of slides and centres of mass; masses stay."""
    small = CHAIN.scaled(0.001)
    np.testing.assert_allclose(small.points(), 0.001 * CHAIN.points())
    assert small.links[2].joint is not None
    assert small.links[2].joint.range == (0.0, 0.002)
    assert small.links[0].inertia is not None
    assert small.links[0].inertia.mass == 1.0
    np.testing.assert_allclose(small.links[0].inertia.center, [0.001, 0, 0])


def test_a_turned_thing_has_turned_points_and_moments():
    """Children of the root turn with it."""
    turn, shift = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.0, 0.0, 7.0])
    moved = CHAIN.moved(turn, shift)
    np.testing.assert_allclose(moved.points(), CHAIN.points() @ turn.T + shift, atol=1e-12)
    assert moved.links[0].inertia is not None
    np.testing.assert_allclose(moved.links[0].inertia.matrix, np.diag([2.0, 1.0, 3.0]), atol=1e-12)
    np.testing.assert_allclose(moved.links[0].inertia.center, [0, 1, 7], atol=1e-12)
