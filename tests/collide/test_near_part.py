"""Near parts of a long wall against blocks around it: no gap is lost to rounding, and nothing in reach is cut off."""

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.convex import piece_shape
from sceniris_gym.collide.near_part import near_parts_separated
from sceniris_gym.device.transforms import Pose
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Program, fill_struct

wp.set_module_options({"enable_backward": False})


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
    rel = Pose()
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
    program = Program()
    arrays = {"piece_type": boxes, "piece_size": sizes, "piece_vertnum": 0 * boxes, "piece_vertadr": 0 * boxes}
    fill_struct(Program, program, arrays | {"vert": np.zeros((1, 3))}, "cpu")
    radius = wp.array(np.linalg.norm(sizes, axis=1), dtype=float, device="cpu")
    numbers = wp.array(1 + np.arange(count), dtype=int, device="cpu")
    out = wp.zeros(count, dtype=bool, device="cpu")
    pos, turns = wp.array(at, dtype=wp.vec3, device="cpu"), wp.array(rot, dtype=wp.mat33, device="cpu")
    inputs = [program, radius, numbers, pos, turns, 5e-6]
    wp.launch(_near_parts_separated, dim=count, inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()
