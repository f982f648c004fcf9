"""The cabinet: two hollow drawers that slide freely, and stay where they are left."""

from __future__ import annotations

import fcl
import mujoco
import numpy as np
import pytest

from tests.assets.geometry import COLLISION, VISUAL, bounds, depth_outside, geoms, load, mesh, winding

DRAWERS = ["upper", "lower"]


def test_the_frame_has_its_size_and_enough_faces():
    """0.42 x 0.32 x 0.50 m, origin under the middle, at least 1,000 faces for the frame and for each drawer."""
    model, data = load("cabinet")
    # Edges are rounded by 1.5 mm: the boxes for contacts are as much narrower, but as tall.
    for group, edge in ((VISUAL, 0.0), (COLLISION, 0.0015)):
        x, y = 0.21 - edge, 0.16 - edge
        np.testing.assert_allclose(
            bounds(model, data, geoms(model, group, "cabinet")), [[-x, -y, 0], [x, y, 0.5]], atol=1e-6
        )
    for body in ("cabinet", "upper_drawer", "lower_drawer"):
        assert model.mesh_facenum[model.geom_dataid[geoms(model, VISUAL, body)[0]]] >= 1000


@pytest.mark.parametrize("joint", DRAWERS)
def test_a_drawer_slides_to_the_front_by_a_quarter_of_a_metre(joint):
    """The joint is prismatic, 0 to 0.25 m, and a positive value moves the drawer to -y; the start pose is closed."""
    model, data = load("cabinet")
    assert model.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_SLIDE
    np.testing.assert_array_equal(model.joint(joint).range, [0.0, 0.25])
    assert model.body(model.joint(joint).bodyid[0]).name == f"{joint}_drawer"
    assert model.key("home").qpos.tolist() == [0.0, 0.0]
    before = data.body(f"{joint}_drawer").xpos.copy()
    data.joint(joint).qpos = 0.25
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body(f"{joint}_drawer").xpos - before, [0, -0.25, 0], atol=1e-12)


def distance(first, second) -> float:
    """Distance [m] between two surfaces."""
    objects = []
    for shape in (first, second):
        surface = fcl.BVHModel()
        surface.beginModel(len(shape.vertices), len(shape.faces))
        surface.addSubModel(shape.vertices, shape.faces)
        surface.endModel()
        objects.append(fcl.CollisionObject(surface))
    return fcl.distance(*objects)


@pytest.mark.parametrize("group", [VISUAL, COLLISION])
def test_drawers_keep_clear_of_the_frame_and_of_each_other(group):
    """At least 2 mm in every joint state tried, for the eye and for contacts."""
    model, data = load("cabinet")
    for upper, lower in ((0, 0), (0.25, 0), (0, 0.25), (0.25, 0.25), (0.12, 0.2), (0.2, 0.05)):
        data.qpos[:] = upper, lower
        mujoco.mj_forward(model, data)
        parts = {
            b: [mesh(model, data, g) for g in geoms(model, group, b)]
            for b in ("cabinet", "upper_drawer", "lower_drawer")
        }
        for one, other in (("cabinet", "upper_drawer"), ("cabinet", "lower_drawer"), ("upper_drawer", "lower_drawer")):
            assert min(distance(a, b) for a in parts[one] for b in parts[other]) >= 0.002


@pytest.mark.parametrize("joint", DRAWERS)
def test_a_drawer_is_hollow_and_tall_enough_for_a_banana(joint):
    """Pulled out or not, 0.34 x 0.25 x 0.10 m over its floor are free; floor and walls are solid."""
    model, data = load("cabinet")
    for travel in (0.0, 0.25):
        data.joint(joint).qpos = travel
        mujoco.mj_forward(model, data)
        front, floor = -0.16 - travel, data.body(f"{joint}_drawer").xpos[2] + 0.013
        generator = np.random.default_rng(0)
        free = generator.uniform([-0.17, front + 0.022, floor + 0.0005], [0.17, front + 0.272, floor + 0.10], (200, 3))
        pieces = geoms(model, COLLISION)
        assert depth_outside(model, data, pieces, free).min() > 0.0
        solid = np.array([[0, 0.1, -0.005], [0.187, 0.1, 0.05], [0, 0.009, 0.1]]) + [0, front, floor]
        assert depth_outside(model, data, pieces, solid).max() < 0.0
        for geom in geoms(model, VISUAL):
            np.testing.assert_allclose(winding(mesh(model, data, geom), free), 0.0, atol=1e-6)
        drawer = mesh(model, data, geoms(model, VISUAL, f"{joint}_drawer")[0])
        np.testing.assert_allclose(winding(drawer, solid), 1.0, atol=1e-6)


@pytest.mark.parametrize("joint", DRAWERS)
def test_the_floor_of_a_drawer_is_where_the_eye_sees_it(joint):
    """The visual floor and the collision floor are the same plane."""
    model, data = load("cabinet")
    drawer = mesh(model, data, geoms(model, VISUAL, f"{joint}_drawer")[0])
    flat = (drawer.face_normals[:, 2] > 0.999) & (drawer.area_faces > 1e-3)
    top = bounds(model, data, [model.geom(f"{joint}_floor").id])[1, 2]
    np.testing.assert_allclose(drawer.triangles_center[flat][:, 2].min(), top, atol=1e-6)


def test_drawers_stay_where_they_are_left_and_follow_a_pull():
    """No drawer moves by 1 mm in 1 s; a pull of 5 N opens one within 1 s."""
    model, data = load("cabinet")
    data.qpos[:] = 0.2, 0.06
    mujoco.mj_step(model, data, nstep=500)
    np.testing.assert_allclose(data.qpos, [0.2, 0.06], atol=0.001)
    data.joint("lower").qfrc_applied = 5.0
    mujoco.mj_step(model, data, nstep=500)
    assert data.joint("lower").qpos[0] > 0.2
