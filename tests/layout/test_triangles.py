"""The triangle test against FCL: random, crossing, parallel and degenerate pairs."""

import fcl
import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.triangles import triangles_separated

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _separated(a: wp.array2d(dtype=wp.vec3), b: wp.array2d(dtype=wp.vec3), margin: float, out: wp.array(dtype=bool)):
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
