"""The audit's narrow phase, against Minkowski differences and MuJoCo C."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.distance import Narrow, winding_number
from sceniris_gym.audit.geometry import Form, Solid, convex_hull
from tests.audit.shapes import angle, model_of
from tests.oracle.minkowski import signed_distance

RNG = np.random.default_rng(7)


def polyhedron(points: np.ndarray) -> Solid:
    """Return the hull of points as a solid."""
    return Solid(0, Form.POLYHEDRON, *convex_hull(points), 0.0, np.zeros(3))


def random_pose(reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a random position at a distance `reach` [m] and a random rotation."""
    direction = RNG.normal(size=3)
    return reach * direction / np.linalg.norm(direction), Rotation.from_quat(RNG.normal(size=4)).as_matrix()


def test_distance_of_hulls_equals_that_of_their_minkowski_difference():
    """Random hulls near contact: the distance is exact, and crossing ones have none."""
    for _ in range(150):
        first, second = (polyhedron(RNG.normal(size=(RNG.integers(8, 30), 3)) * 0.03) for _ in range(2))
        poses = (np.zeros(3), np.eye(3)), random_pose(RNG.uniform(0.03, 0.12))
        narrow = Narrow([first, second])
        expected = signed_distance(first.vertices, second.vertices @ poses[1][1].T + poses[1][0])
        measured = narrow.distance(0, 1, *poses)
        assert (measured <= 0) == (expected <= 0)
        if expected > 0:
            assert measured == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("length", [0.0, 0.05])
def test_rounded_solids_are_points_and_segments_with_a_radius(length: float):
    """A sphere or capsule is as far away as its core is, less its radius."""
    core = np.array([[0.0, 0, -length], [0, 0, length]])[: 2 if length else 1]
    rounded = Solid(0, Form.ROUNDED, core, np.zeros((0, 3), int), 0.02, np.zeros(3))
    for _ in range(40):
        hull = polyhedron(RNG.normal(size=(12, 3)) * 0.03)
        pos, mat = random_pose(0.15)
        narrow = Narrow([hull, rounded])
        widened = np.concatenate([core] * 4) + RNG.normal(size=(4 * len(core), 3)) * 1e-9
        expected = signed_distance(hull.vertices, widened @ mat.T + pos) - 0.02
        assert narrow.distance(0, 1, (np.zeros(3), np.eye(3)), (pos, mat)) == pytest.approx(expected, abs=1e-7)


def test_segments_cross_what_mujocos_rays_hit():
    """From random points in random directions, past and through an L that is not convex."""
    mesh = angle()
    mjm = model_of(mesh)
    data, nothing = mujoco.MjData(mjm), np.zeros(1, np.int32)
    mujoco.mj_kinematics(mjm, data)
    body = Solid(0, Form.POLYHEDRON, mesh.vertices.view(np.ndarray), mesh.faces.view(np.ndarray), 0.0, np.zeros(3))
    long = Solid(-1, Form.ROUNDED, np.array([[0, 0, 0], [0, 0, 20]]), np.zeros((0, 3), int), 0.0, np.zeros(3))
    narrow = Narrow([body, long])
    hits = 0
    for _ in range(400):
        origin, mat = RNG.uniform(-2, 5, 3) * [1, 1, 0.5], Rotation.from_quat(RNG.normal(size=4)).as_matrix()
        expected = mujoco.mj_ray(mjm, data, origin, mat[:, 2].copy(), None, 1, -1, nothing) >= 0
        assert (narrow.distance(0, 1, (np.zeros(3), np.eye(3)), (origin, mat)) <= 0.0) == expected
        hits += expected
    assert 20 < hits < 380


def test_winding_number_is_one_inside_and_zero_outside():
    """A concave closed surface: a box with a notch cut into it."""
    outline = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], float)
    low, high = (np.column_stack([outline, np.full(8, z)]) for z in (0.0, 1.0))
    sides = [
        triangle
        for i, j in zip(range(8), [*range(1, 8), 0], strict=True)
        for triangle in ([low[i], low[j], high[j]], [low[i], high[j], high[i]])
    ]
    cap = [[0, 1, 4], [1, 2, 3], [1, 3, 4], [0, 4, 5], [0, 5, 7], [5, 6, 7]]
    lids = [high[t] for t in cap] + [low[t[::-1]] for t in cap]
    triangles = np.array([*sides, *lids])
    assert winding_number(triangles, np.array([0.5, 2.0, 0.5])) == pytest.approx(1.0)
    assert winding_number(triangles, np.array([1.5, 2.0, 0.5])) == pytest.approx(0.0, abs=1e-9)
    assert winding_number(triangles, np.array([1.5, 0.5, 2.0])) == pytest.approx(0.0, abs=1e-9)
