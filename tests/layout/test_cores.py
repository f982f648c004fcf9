"""Cores that say "touching" are right, by FCL and by MuJoCo's distances, and say so of most that touch."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.layout.cores import boxes_within
from sceniris_gym.layout.transforms import Pose

wp.set_module_options({"enable_backward": False})

N = 6000


@wp.kernel
def _within(
    ca: wp.array(dtype=wp.vec3),
    ha: wp.array(dtype=wp.vec3),
    cb: wp.array(dtype=wp.vec3),
    hb: wp.array(dtype=wp.vec3),
    pos: wp.array(dtype=wp.vec3),
    rot: wp.array(dtype=wp.mat33),
    margin: float,
    out: wp.array(dtype=bool),
):
    i = wp.tid()
    rel = Pose()
    rel.pos = pos[i]
    rel.rot = rot[i]
    out[i] = boxes_within(ca[i], ha[i], cb[i], hb[i], rel, margin)


def _turns(rng: np.random.Generator, count: int, slant: float | None) -> np.ndarray:
    """Rotations about z, leaning by up to `slant` [rad]; any rotations for None."""
    if slant is None:
        return Rotation.random(count, rng=rng).as_matrix()
    yaw = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, (count, 1)) * [0.0, 0.0, 1.0])
    lean = rng.normal(size=(count, 3))
    lean *= slant * rng.random((count, 1)) / np.linalg.norm(lean, axis=1, keepdims=True)
    return (Rotation.from_rotvec(lean) * yaw).as_matrix()


@pytest.mark.parametrize("slant", [None, 0.0, 1e-6, 1e-4, 1e-3, 3e-3, 1e-2])
@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_boxes_are_plainly_near_only_where_fcl_finds_them_so(margin: float, slant: float | None):
    """Also where edges are in parallel, or nearly: there the axis across them says nothing, or nearly."""
    rng = np.random.default_rng(0)
    centers = rng.uniform(-0.1, 0.1, (2, N, 3))
    halves = 10.0 ** rng.uniform(-3.0, -0.7, (2, N, 3))
    rot = _turns(rng, N, slant).astype(np.float32)
    pos = rng.uniform(-0.3, 0.3, (N, 3)).astype(np.float32)
    arrays = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (centers[0], halves[0], centers[1], halves[1], pos)]
    out = wp.zeros(N, dtype=bool, device="cpu")
    inputs = [*arrays, wp.array(rot, dtype=wp.mat33, device="cpu"), margin]
    wp.launch(_within, dim=N, inputs=inputs, outputs=[out], device="cpu")
    near = np.zeros(N, bool)
    for i in range(N):
        first, second = (fcl.Box(*(2.0 * h[i])) for h in halves)
        turn = rot[i].astype(float)
        at = (fcl.Transform(np.eye(3), centers[0, i]), fcl.Transform(turn, turn @ centers[1, i] + pos[i]))
        pair = [fcl.CollisionObject(shape, t) for shape, t in zip((first, second), at, strict=True)]
        near[i] = fcl.collide(*pair, fcl.CollisionRequest(), fcl.CollisionResult()) > 0
        if not near[i] and margin > 0.0:
            near[i] = fcl.distance(*pair, fcl.DistanceRequest(), fcl.DistanceResult()) <= margin
    found = out.numpy()
    assert not (found & ~near).any()
    assert found[near].mean() > (0.5 if margin > 0.0 else 0.75)
