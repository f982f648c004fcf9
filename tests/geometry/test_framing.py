"""The placed camera sees everything, and wastes nothing; the upright box around geoms, against trimesh."""

import mujoco
import numpy as np
import pytest
import trimesh

from sceniris_gym.scene.overview import box_corners, camera_axes, frame, upright_box


@pytest.mark.parametrize("aspect", [0.5, 1.0, 1.8])
def test_the_camera_sees_all_points_and_wastes_nothing(aspect: float):
    """All points are inside of the picture, and two opposite sides are nearly touched."""
    points = np.random.default_rng(1).normal(size=(200, 3)) * [1.0, 0.3, 0.2]
    eye, axes = frame(points, np.array([0.4, -1.0, 1.2]), 40.0, aspect)
    local = (points - eye) @ axes
    assert np.all(local[:, 2] < 0)
    seen = local[:, :2] / -local[:, 2:] / (np.tan(np.radians(20.0)) * np.array([aspect, 1.0]))
    assert np.abs(seen).max() < 1.0
    assert max(seen.max(0).min(), 0) > 0 > seen.min(0).max()
    filled = np.minimum(seen.max(0), -seen.min(0))
    assert filled.max() > 0.95
    assert axes.T @ axes == pytest.approx(np.eye(3))


def test_an_upright_camera_keeps_the_horizon_level():
    """Its right is level, its up points upwards, and its axes are at right angles."""
    axes = camera_axes(np.array([0.5, -1.0, 2.1]))
    assert axes[2, 0] == pytest.approx(0.0)
    assert axes[2, 1] > 0.0
    assert axes.T @ axes == pytest.approx(np.eye(3))


def test_a_box_has_eight_corners():
    """They are where its half edges say."""
    corners = box_corners(np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3]))
    assert len(np.unique(corners, axis=0)) == 8
    assert np.abs(corners - [1.0, 2.0, 3.0]) == pytest.approx(np.tile([0.1, 0.2, 0.3], (8, 1)))


def test_it_just_holds_boxes_in_any_pose():
    """For boxes, which fill theirs, its corners are the bounds of their vertices."""
    rng = np.random.default_rng(0)
    spec = mujoco.MjSpec()
    vertices = []
    for _ in range(5):
        quat, pos, size = rng.normal(size=4), rng.normal(size=3), rng.uniform(0.01, 0.3, 3)
        quat /= np.linalg.norm(quat)
        spec.worldbody.add_body(pos=pos, quat=quat).add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size)
        turn = trimesh.transformations.quaternion_matrix(quat)
        turn[:3, 3] = pos
        vertices.append(trimesh.creation.box(2.0 * size, turn).vertices)
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    for chosen in ([2], [0, 3], range(5)):
        of_them = np.concatenate([vertices[i] for i in chosen])
        low, high = upright_box(mjm, data, np.array(chosen))
        assert np.allclose(low, of_them.min(axis=0))
        assert np.allclose(high, of_them.max(axis=0))
