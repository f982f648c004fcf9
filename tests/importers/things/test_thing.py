"""Things: their points through chains of links, in other units, and turned."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from sceniris_gym.importers.things.grasps import GraspSite
from sceniris_gym.importers.things.thing import Inertia, Joint, Link, Surface, Thing, write_asset
from tests.importers.things.shapes import box, surface

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


HEAVY = Inertia(2.0, np.array([0.01, 0.0, 0.0]), 0.01 * np.eye(3))


def test_a_thing_of_two_links_is_what_mujoco_reads(tmp_path: Path):
    """Poses, joint limits, inertias, a picture around the box, its parts and a grasp."""
    plain = surface(box())
    textured = replace(plain, texture=Image.new("RGB", (2, 2), (9, 8, 7)), uv=np.zeros((len(plain.vertices), 2)))
    lid = Link(
        "lid",
        "base",
        np.array([0.0, 0.0, 0.2]),
        joint=Joint("hinge", "hinge", np.eye(3)[1], (0.0, 1.0)),
        surfaces=(plain,),
        solids=(plain,),
        inertia=HEAVY,
    )
    thing = Thing("pot", (Link("base", surfaces=(textured,), solids=(plain,), inertia=HEAVY), lid))
    grasp = GraspSite(np.array([0.0, 0.0, 0.1]), np.array([0.0, 1.0, 0.0, 0.0]), 0.04)
    files = write_asset(thing, [grasp], tmp_path / "pot.xml")
    assert all(file.is_file() for file in files)
    assert all(file.name.startswith("pot") for file in files)
    mjm = mujoco.MjModel.from_xml_path(str(tmp_path / "pot.xml"))
    assert mjm.body("pot").id == 1
    np.testing.assert_allclose(mjm.body("lid").pos, [0, 0, 0.2])
    np.testing.assert_allclose(mjm.joint("hinge").range, [0, 1])
    np.testing.assert_allclose(mjm.body_mass[1:], 2.0)
    np.testing.assert_allclose(mjm.body("pot").ipos, [0.01, 0, 0], atol=1e-9)
    assert mjm.ntex == 1
    assert sorted(mjm.geom_group.tolist()) == [2, 2, 3, 3]
    assert mjm.site("grasp_0").pos.tolist() == [0.0, 0.0, 0.1]


def test_links_of_any_name_are_bodies_of_an_asset(tmp_path: Path):
    """One that is called as the asset's file or as MuJoCo's own body, which the root of a URDF is often called."""
    plain = surface(box())
    parents = {"world": None, "mini": "world", "mini_": "mini", "door": "mini_"}
    links = [Link(name, parent, surfaces=(plain,), inertia=HEAVY) for name, parent in parents.items()]
    links.append(Link("world", "door", surfaces=(plain,), inertia=HEAVY))
    write_asset(Thing("mini", tuple(links)), [], tmp_path / "mini.xml")
    mjm = mujoco.MjModel.from_xml_path(str(tmp_path / "mini.xml"))
    assert [mjm.body(i).name for i in range(mjm.nbody)] == ["world", "mini", "mini_", "mini__", "door", "world_"]
    assert mjm.body_parentid.tolist() == [0, 0, 1, 2, 3, 4]
