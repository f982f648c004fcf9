"""Cores that say "touching" are right, by FCL, and say so of most that touch."""

from __future__ import annotations

import fcl
import mujoco
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.inner_boxes import boxes_within, inner_boxes_within
from sceniris_gym.device.transforms import Pose
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.program.device import Program, fill_struct
from sceniris_gym.program.pack.program import pack_pieces

wp.set_module_options({"enable_backward": False})

N = 6000


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
    rel = Pose()
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
    rel = Pose()
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
    program, count, rng = Program(), 150, np.random.default_rng(1)
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
