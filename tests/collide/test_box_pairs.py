"""Gaps along separating axes, near parts of a long wall, and inner boxes that touch, by projections and FCL."""

import fcl
import mujoco
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.box_pairs import (
    absolute,
    boxes_within,
    gap_across_edges,
    gap_at_faces,
    inner_boxes_within,
    near_parts_separated,
)
from sceniris_gym.collide.convex import piece_shape
from sceniris_gym.device.transforms import Pose
from sceniris_gym.geometry.pieces import PieceType, extract_pieces
from sceniris_gym.program.device import Program, fill_struct
from sceniris_gym.program.pack.program import pack_pieces

wp.set_module_options({"enable_backward": False})

N = 500
CORNERS = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T

PAIRS = 6000


@wp.kernel
def _gaps(
    ha: wp.array[wp.vec3],
    hb: wp.array[wp.vec3],
    t: wp.array[wp.vec3],
    r: wp.array[wp.mat33],
    # Out:
    faces: wp.array2d[float],
    edges: wp.array2d[float],
):
    i = wp.tid()
    f = absolute(r[i])
    faces[i, 0] = gap_at_faces(ha[i], hb[i], t[i], f)
    faces[i, 1] = gap_at_faces(hb[i], ha[i], wp.transpose(r[i]) * t[i], wp.transpose(f))
    for j in range(3):
        for k in range(3):
            edges[i, 3 * j + k] = gap_across_edges(ha[i], hb[i], t[i], r[i], f, j, k)


def _gap(axis: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """The gap between two sets of corners along an axis, in units of its length; negative for an overlap."""
    on_a, on_b = a @ axis, b @ axis
    return max(on_b.min() - on_a.max(), on_a.min() - on_b.max())


def test_gaps_are_those_between_projected_corners():
    """Along the face normals of either box, and along each cross product of two edges, parallel ones included."""
    rng = np.random.default_rng(0)
    ha, hb = rng.uniform(0.0, 0.3, (2, N, 3)) * (rng.random((2, N, 3)) < 0.9)
    t = rng.uniform(-0.5, 0.5, (N, 3))
    r = Rotation.random(N, rng=rng).as_matrix()
    r[: N // 10] = np.eye(3)
    faces = wp.zeros((N, 2), dtype=float, device="cpu")
    edges = wp.zeros((N, 9), dtype=float, device="cpu")
    inputs = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (ha, hb, t)]
    inputs.append(wp.array(r, dtype=wp.mat33, device="cpu"))
    wp.launch(_gaps, dim=N, inputs=inputs, outputs=[faces, edges], device="cpu")
    expected_faces, expected_edges = np.empty((N, 2)), np.empty((N, 9))
    for i in range(N):
        a, b = CORNERS * ha[i], CORNERS * hb[i] @ r[i].T + t[i]
        expected_faces[i] = [max(_gap(axis, a, b) for axis in axes) for axes in (np.eye(3), r[i].T)]
        expected_edges[i] = [_gap(np.cross(edge, other), a, b) for edge in np.eye(3) for other in r[i].T]
    np.testing.assert_allclose(faces.numpy(), expected_faces, atol=1e-6)
    np.testing.assert_allclose(edges.numpy(), expected_edges, atol=1e-6)
    assert 0.2 < (expected_faces > 0.0).mean() < 0.8


@wp.kernel
def _near_parts_separated(
    program: Program,
    radius: wp.array[float],
    b: wp.array[int],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    margin: float,
    out: wp.array[bool],
):
    i = wp.tid()
    rel = Pose()  # pyrefly: ignore[missing-argument]
    rel.pos = pos[i]
    rel.rot = rot[i]
    wall = piece_shape(program, 0)
    block = piece_shape(program, b[i])
    out[i] = near_parts_separated(program.vert, wall, block, radius[0], radius[b[i]], rel, margin)


@pytest.mark.parametrize("half_length", [1.0, 2.5, 20.0])
@pytest.mark.parametrize("gap", [2e-5, 1e-4, 1e-3])
def test_blocks_beside_a_thin_wall_are_separated_from_it(gap: float, half_length: float):
    """A corner of each is `gap` over the wall: what they span with it can be so flat that rounding has it enclose."""
    rng, count = np.random.default_rng(0), 20000
    wall, half = np.array([half_length, 0.001, 0.3]), rng.uniform(0.01, 0.05, (count, 3))
    rot = Rotation.random(count, rng=np.random.default_rng(1)).as_matrix().astype(np.float32)
    lowest = -np.einsum("nj,nj->n", np.abs(rot[:, 2].astype(float)), half.astype(np.float32))
    at = rng.uniform(-0.95, 0.95, (count, 3)) * wall
    at[:, 2] = wall[2] + gap - lowest
    assert _apart_from_wall(wall, half, at, rot).all()


@pytest.mark.parametrize("depth", [2e-5, 1e-3])
def test_blocks_in_a_long_wall_are_not_separated_from_it(depth: float):
    """Their lowest corner is in it, also near its ends: what is cut off is out of reach."""
    rng, count = np.random.default_rng(2), 20000
    wall, half = np.array([20.0, 0.2, 0.3]), rng.uniform(0.01, 0.05, (count, 3))
    rot = Rotation.random(count, rng=np.random.default_rng(3)).as_matrix().astype(np.float32)
    signs = -np.sign(rot[:, 2])
    corner = np.einsum("nij,nj->ni", rot.astype(float), signs * half.astype(np.float32))
    tip = rng.uniform(-1.0, 1.0, (count, 3)) * (wall - 2e-3)
    tip[:, 2] = wall[2] - depth
    assert not _apart_from_wall(wall, half, tip - corner, rot).any()


def _apart_from_wall(wall: np.ndarray, half: np.ndarray, at: np.ndarray, rot: np.ndarray) -> np.ndarray:
    """For boxes of these half extents, posed around a box at the origin: True for each that is separated from it."""
    count, sizes = len(half), np.vstack([wall, half])
    boxes = np.full(len(sizes), PieceType.BOX)
    program = Program()  # pyrefly: ignore[missing-argument]
    arrays = {"piece_type": boxes, "piece_size": sizes, "piece_vertnum": 0 * boxes, "piece_vertadr": 0 * boxes}
    fill_struct(Program, program, arrays | {"vert": np.zeros((1, 3))}, "cpu")
    radius = wp.array(np.linalg.norm(sizes, axis=1), dtype=float, device="cpu")
    numbers = wp.array(1 + np.arange(count), dtype=int, device="cpu")
    out = wp.zeros(count, dtype=bool, device="cpu")
    pos, turns = wp.array(at, dtype=wp.vec3, device="cpu"), wp.array(rot, dtype=wp.mat33, device="cpu")
    inputs = [program, radius, numbers, pos, turns, 5e-6]
    wp.launch(_near_parts_separated, dim=count, inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


@wp.kernel
def _within(
    ca: wp.array[wp.vec3],
    ha: wp.array[wp.vec3],
    cb: wp.array[wp.vec3],
    hb: wp.array[wp.vec3],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    margin: float,
    out: wp.array[bool],
):
    i = wp.tid()
    rel = Pose()  # pyrefly: ignore[missing-argument]
    rel.pos = pos[i]
    rel.rot = rot[i]
    out[i] = boxes_within(ca[i], ha[i], cb[i], hb[i], rel, margin)


@wp.kernel
def _inner_boxes_within(
    program: Program,
    a: int,
    b: int,
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    margin: float,
    out: wp.array[bool],
):
    i = wp.tid()
    rel = Pose()  # pyrefly: ignore[missing-argument]
    rel.pos = pos[i]
    rel.rot = rot[i]
    out[i] = inner_boxes_within(program, a, b, rel, margin)


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
    centers = rng.uniform(-0.1, 0.1, (2, PAIRS, 3))
    halves = 10.0 ** rng.uniform(-3.0, -0.7, (2, PAIRS, 3))
    rot = _turns(rng, PAIRS, slant).astype(np.float32)
    pos = rng.uniform(-0.3, 0.3, (PAIRS, 3)).astype(np.float32)
    arrays = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (centers[0], halves[0], centers[1], halves[1], pos)]
    out = wp.zeros(PAIRS, dtype=bool, device="cpu")
    inputs = [*arrays, wp.array(rot, dtype=wp.mat33, device="cpu"), margin]
    wp.launch(_within, dim=PAIRS, inputs=inputs, outputs=[out], device="cpu")
    near = np.zeros(PAIRS, bool)
    for i in range(PAIRS):
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


GEOMS = """
<geom type="sphere" size=".06" pos=".1 0 .05"/>
<geom type="cylinder" size=".03 .1" pos="-.1 .05 0" euler="30 40 50"/>
<geom type="ellipsoid" size=".08 .04 .05" pos="0 .1 -.05" euler="70 10 20"/>
<geom type="box" size=".09 .03 .05" pos=".02 -.1 .03" euler="10 80 30"/>
<geom type="mesh" mesh="wedge" pos=".05 .02 -.08" euler="50 20 70"/>
"""
WEDGE = "0 0 0 .2 0 0 .2 .1 0 0 .1 0 0 0 .08 0 .1 .08"


@pytest.mark.parametrize("margin", [0.0, 0.03])
def test_cores_of_posed_pieces_are_where_the_pieces_are(margin: float):
    """Geoms that are turned and off the origins of two bodies: MuJoCo's distances of them are within the margin."""
    bodies = "".join(f'<body name="{name}"><freejoint/>{GEOMS}</body>' for name in "ab")
    xml = f'<asset><mesh name="wedge" vertex="{WEDGE}"/></asset><worldbody>{bodies}</worldbody>'
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    data, pieces = mujoco.MjData(mjm), extract_pieces(mjm, "physics")
    program, count, rng = Program(), 150, np.random.default_rng(1)  # pyrefly: ignore[missing-argument]
    fill_struct(Program, program, pack_pieces(pieces, visual=False), "cpu")
    rot = Rotation.random(count, rng=rng)
    pos = rng.uniform(-0.2, 0.2, (count, 3)).astype(np.float32)
    poses = [wp.array(pos, dtype=wp.vec3, device="cpu"), wp.array(rot.as_matrix(), dtype=wp.mat33, device="cpu")]
    half, proven, near = len(pieces) // 2, 0, 0
    for a in range(half):
        for b in range(half, 2 * half):
            out = wp.zeros(count, dtype=bool, device="cpu")
            wp.launch(
                _inner_boxes_within, dim=count, inputs=[program, a, b, *poses, margin], outputs=[out], device="cpu"
            )
            for i, found in enumerate(out.numpy()):
                data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *pos[i], *rot[i].as_quat(scalar_first=True)]
                mujoco.mj_kinematics(mjm, data)
                distance = mujoco.mj_geomDistance(mjm, data, pieces[a].geom, pieces[b].geom, 1.0, None)
                assert not found or distance <= margin + 1e-6
                proven, near = proven + found, near + (distance <= margin)
    assert proven > 0.5 * near > 200
