"""Bounding-volume descent: boxes that are told apart are apart, and whole trees touch exactly where FCL says so."""

import fcl
import mujoco
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.boxes import NARROW_STACK, SHARED_STACK, boxes_separated, collides, collides_without_stack
from sceniris_gym.device.transforms import Pose
from sceniris_gym.geometry.colliders import collect_colliders, collider_arrays
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.program.device import Cause, Program, fill_struct
from sceniris_gym.program.pack.program import pack_pieces

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
    rel = Pose()  # pyrefly: ignore[missing-argument]
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


@wp.kernel
def _collide(
    program: Program,
    own_pos: wp.array2d[wp.vec3],
    own_quat: wp.array2d[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
    # Out:
    shared: wp.array[int],
    alone: wp.array[bool],
):
    """Test one pair of colliders, body 2 as `own_*` pose it, with the stacks of a block and with one of its own."""
    i, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=wp.vec3i)
    shared[i] = collides(program, 0, 1, 0, -1, nodes, leaves, lane, own_pos[i], own_quat[i], body_pos, body_quat)
    alone[i] = collides_without_stack(program, 0, 1, lane, own_pos[i], own_quat[i], body_pos, body_quat)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_trees_of_boxes_touch_exactly_where_any_two_of_their_boxes_do(geometry: str):
    """Two bodies of 20 boxes each, in any pose, by FCL's distance of every pair: to 0.02 mm."""
    rng, margin = np.random.default_rng(7), 0.01
    sizes, places = rng.uniform(0.01, 0.05, (2, 20, 3)), rng.uniform(-0.3, 0.3, (2, 20, 3))
    turns = [Rotation.random(20, rng=rng) for _ in range(2)]
    spec = mujoco.MjSpec()
    for k in range(2):
        body = spec.worldbody.add_body(name=f"body{k}")
        for size, pos, quat in zip(sizes[k], places[k], turns[k].as_quat(scalar_first=True), strict=True):
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=pos, quat=quat)
    pieces = extract_pieces(spec.compile(), geometry)
    # pyrefly: ignore[missing-argument]
    colliders, program = collect_colliders(pieces, geometry == "visual", "cpu"), Program()
    program.visual = geometry == "visual"
    roots = [c.root for c in colliders]
    arrays = collider_arrays(colliders) | pack_pieces(pieces, geometry == "visual")
    arrays |= {"pair_a": np.array([0]), "pair_b": np.array([1]), "pair_bodies": np.array([[1, 2, 2, -1]])}
    arrays |= {"pair_margin": np.array([margin]), "broad_pair": np.array([[0, *roots]])}
    fill_struct(Program, program, arrays | {"pair_touch": np.zeros(1)}, "cpu")
    count = 300
    pos, rot = rng.uniform(-0.5, 0.5, (count, 3)).astype(np.float32), Rotation.random(count, rng=rng)
    own_pos, own_quat = np.zeros((count, 3, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 3, 1))
    own_pos[:, 2], own_quat[:, 2] = pos, rot.as_quat(scalar_first=True)
    inputs = [program, wp.array(own_pos, dtype=wp.vec3, device="cpu"), wp.array(own_quat, dtype=wp.vec4, device="cpu")]
    inputs += [wp.array(own_pos[0] * 0.0, dtype=wp.vec3, device="cpu")]
    inputs += [wp.array(np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), dtype=wp.vec4, device="cpu")]
    shared, alone = (wp.zeros(count, dtype=kind, device="cpu") for kind in (int, bool))
    wp.launch_tiled(_collide, dim=[count], inputs=inputs, outputs=[shared, alone], block_dim=1, device="cpu")
    least = np.empty(count)
    boxes = [[fcl.Box(*(2.0 * size)) for size in sizes[k]] for k in range(2)]
    here = _posed(boxes[0], turns[0], places[0])
    for i in range(count):
        there = _posed(boxes[1], rot[i] * turns[1], rot[i].apply(places[1]) + pos[i])
        least[i] = min(_distance(a, b) for a in here for b in there)
    found = alone.numpy()
    assert (shared.numpy() == np.where(found, Cause.COLLISION, Cause.NONE)).all()
    assert not found[least > margin + 2e-5].any() and found[least < margin - 2e-5].all()
    assert 0.2 < found.mean() < 0.8


def _posed(shapes: list, turns: Rotation, places: np.ndarray) -> list[fcl.CollisionObject]:
    """Shapes at these poses, for FCL."""
    poses = zip(shapes, turns.as_matrix(), places, strict=True)
    return [fcl.CollisionObject(shape, fcl.Transform(turn, place)) for shape, turn, place in poses]


def _distance(a: fcl.CollisionObject, b: fcl.CollisionObject) -> float:
    """FCL's distance [m] of two posed shapes, 0 where they overlap."""
    if fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return fcl.distance(a, b, fcl.DistanceRequest(), fcl.DistanceResult())
