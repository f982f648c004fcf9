"""The triangle test against FCL: random, crossing, parallel and degenerate pairs."""

from itertools import product

import fcl
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.triangles import triangles_separated
from tests.oracle.triangles import triangle_distances

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _separated(a: wp.array2d[wp.vec3], b: wp.array2d[wp.vec3], margin: float, out: wp.array[bool]):
    i = wp.tid()
    out[i] = triangles_separated(a[i, 0], a[i, 1], a[i, 2], b[i, 0], b[i, 1], b[i, 2], margin)


def _verdicts(a: np.ndarray, b: np.ndarray, margin: float) -> np.ndarray:
    out = wp.zeros(len(a), dtype=bool, device="cpu")
    args = [wp.array(x, dtype=wp.vec3, device="cpu") for x in (a, b)]
    wp.launch(_separated, dim=len(a), inputs=[*args, margin, out], device="cpu")
    return out.numpy()


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """FCL's distance of two triangles, 0 if they cross."""
    objects = []
    for corners in (a, b):
        mesh = fcl.BVHModel()
        mesh.beginModel(3, 1)
        mesh.addSubModel(corners.astype(float), np.array([[0, 1, 2]]))
        mesh.endModel()
        objects.append(fcl.CollisionObject(mesh, fcl.Transform()))
    if fcl.collide(*objects, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return fcl.distance(*objects, fcl.DistanceRequest(), fcl.DistanceResult())


def _pairs(kind: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    a = rng.uniform(-0.01, 0.01, size=(count, 3, 3))
    b = rng.uniform(-0.01, 0.01, size=(count, 3, 3))
    if kind == "near":
        b += 0.01 * rng.normal(size=(count, 1, 3))
    if kind == "parallel":
        a[..., 2] = 0.0
        b[..., 2] = rng.uniform(-0.002, 0.002, size=(count, 1))
        b[..., :2] += 0.01 * rng.normal(size=(count, 1, 2))
    if kind == "sliver":
        a[:, 2] = a[:, 0] + 0.5 * (a[:, 1] - a[:, 0]) + 1e-6 * rng.normal(size=(count, 3))
    return a.astype(np.float32), b.astype(np.float32)


@pytest.mark.parametrize("margin", [5e-6, 1e-3])
@pytest.mark.parametrize("kind", ["crossing", "near", "parallel", "sliver"])
def test_triangles_are_separated_exactly_when_fcl_says_so(kind: str, margin: float):
    """No miss and no false alarm beyond 1 um."""
    a, b = _pairs(kind, 3000)
    verdict = _verdicts(a, b, margin)
    distance = np.array([_distance(x, y) for x, y in zip(a, b, strict=True)])
    assert verdict.any() and not verdict.all()
    assert not np.any(verdict & (distance < margin - 1e-6))
    assert not np.any(~verdict & (distance > margin + 1e-6))


def test_a_triangle_without_area_is_an_edge():
    """Three points on a line, above and through a face."""
    face = np.array([[[-1, -1, 0], [1, -1, 0], [0, 1, 0]]] * 2, np.float32)
    line = np.array([[[0, 0, 0.5], [0, 0, 0.7], [0, 0, 1]], [[0, 0, -0.5], [0, 0, 0], [0, 0, 1]]], np.float32)
    assert _verdicts(face, line, 0.4).tolist() == [True, False]
    assert _verdicts(line, face, 0.4).tolist() == [True, False]


def test_a_triangle_without_area_is_not_a_solid():
    """Far beside the face whose plane its points straddle, and a single point three times."""
    face = np.array([[[-1, -1, 0], [1, -1, 0], [0, 1, 0]]] * 3, np.float32)
    flat = np.array([[[5, 0, z] for z in (-1, 0, 1)], [[0, 3, z] for z in (-1, 1, -1)], [[2, 0, 0]] * 3], np.float32)
    assert _verdicts(face, flat, 1e-3).all()
    assert _verdicts(flat, face, 1e-3).all()
    assert _verdicts(flat, np.roll(flat, 1, axis=0), 1e-3).all()


def _slivers(rng: np.random.Generator, count: int, width: float) -> np.ndarray:
    """Triangles of 1 m x width, needles and caps, turned at random about a point of their longest edge."""
    corners = np.zeros((count, 3, 3))
    corners[:, :, 0] = [-0.5, 0.5, 0.5]
    corners[:, 2, 0] = np.where(rng.random(count) < 0.5, 0.5, rng.uniform(-0.5, 0.5, count))
    corners[:, 2, 1] = width
    order = rng.permuted(np.tile(np.arange(3), (count, 1)), axis=1)
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    corners[..., 0] += rng.uniform(-0.5, 0.5, (count, 1))
    return np.einsum("nij,nkj->nki", Rotation.random(count, rng=rng).as_matrix(), corners)


@pytest.mark.parametrize(("wide", "narrow"), [*product((0.3, 1e-2, 1e-3, 1e-4, 1e-5), (1e-2, 1e-4))])
def test_slivers_are_judged_as_in_double_precision(wide: float, narrow: float):
    """Of 1 m, down to a hundredth of a millimetre wide: no crossing is missed, and nothing apart is held to touch."""
    rng = np.random.default_rng(1)
    a, b = (_slivers(rng, 20_000, width) for width in (wide, narrow))
    b += rng.normal(size=(len(b), 1, 3)) * min(max(wide, narrow), 1e-2)
    a, b = a.astype(np.float32), b.astype(np.float32)
    distance = triangle_distances(a, b)
    assert (distance == 0.0).sum() > 1000
    for margin in (5e-6, 1e-3):
        verdict = _verdicts(a, b, margin)
        assert not np.any(verdict & (distance < margin - 1e-6))
        assert not np.any(~verdict & (distance > margin + 1e-6))


@pytest.mark.parametrize("kind", ["crossing", "near", "parallel", "sliver"])
def test_the_oracle_in_double_precision_agrees_with_fcl(kind: str):
    """The oracle and FCL agree on small triangles, for which FCL is right."""
    a, b = _pairs(kind, 1000)
    expected = [_distance(x, y) for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(triangle_distances(a, b), expected, atol=1e-9)
