"""Boxes that are told apart are apart: against the distance of two posed boxes by FCL."""

import fcl
import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.boxes import boxes_separated
from sceniris_gym.device.transforms import Pose

wp.set_module_options({"enable_backward": False})

N = 4000


@wp.kernel
def _separated(
    ca: wp.array[wp.vec3],
    ha: wp.array[wp.vec3],
    cb: wp.array[wp.vec3],
    hb: wp.array[wp.vec3],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    margin: wp.array[float],
    out: wp.array[bool],
):
    i = wp.tid()
    rel = Pose()
    rel.pos = pos[i]
    rel.rot = rot[i]
    out[i] = boxes_separated(ca[i], ha[i], cb[i], hb[i], rel, margin[i])


def test_no_boxes_within_the_margin_are_told_apart():
    """Random boxes, some of them flat or a point: never a false "apart", and few that are far apart go unseen."""
    rng = np.random.default_rng(4)
    centers = rng.uniform(-0.2, 0.2, (2, N, 3))
    halves = rng.uniform(0.0, 0.2, (2, N, 3)) * (rng.random((2, N, 3)) < 0.9)
    rot = Rotation.random(N, rng=rng).as_matrix()
    rot[: N // 4] = np.eye(3)  # edges in parallel have no normal
    pos, margin = rng.uniform(-0.25, 0.25, (N, 3)), rng.choice([0.0, 0.001, 0.05], N)
    arrays = [centers[0], halves[0], centers[1], halves[1], pos]
    inputs = [wp.array(a, dtype=wp.vec3, device="cpu") for a in arrays]
    inputs += [wp.array(rot, dtype=wp.mat33, device="cpu"), wp.array(margin, dtype=float, device="cpu")]
    out = wp.zeros(N, dtype=bool, device="cpu")
    wp.launch(_separated, dim=N, inputs=inputs, outputs=[out], device="cpu")
    distance = np.empty(N)
    for i in range(N):
        first, second = (fcl.Box(*np.maximum(2.0 * h[i], 1e-9)) for h in halves)
        at = (fcl.Transform(np.eye(3), centers[0, i]), fcl.Transform(rot[i], rot[i] @ centers[1, i] + pos[i]))
        pair = [fcl.CollisionObject(shape, t) for shape, t in zip((first, second), at, strict=True)]
        overlap = fcl.collide(*pair, fcl.CollisionRequest(), fcl.CollisionResult())
        result = fcl.DistanceResult()
        distance[i] = 0.0 if overlap else fcl.distance(*pair, fcl.DistanceRequest(), result)
    found = out.numpy()
    assert not found[distance < margin - 1e-5].any()
    assert found[distance > margin + 0.1].mean() > 0.99
    assert 0.2 < found.mean() < 0.8
