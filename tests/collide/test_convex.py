"""The separation test against FCL: convex pieces of every kind, near each other, overlapping and enclosed."""

import fcl
import numpy as np
import pytest
import trimesh
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.convex import piece_shape, separated
from sceniris_gym.device.transforms import Pose
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Program, fill_struct

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _separated(
    program: Program,
    a: wp.array[int],
    b: wp.array[int],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    margin: wp.array[float],
    out: wp.array[bool],
):
    i = wp.tid()
    rel = Pose()  # pyrefly: ignore[missing-argument]
    rel.pos = pos[i]
    rel.rot = rot[i]
    out[i] = separated(
        program.vert, piece_shape(program, a[i]), piece_shape(program, b[i]), rel, wp.vec3(1.0), margin[i]
    )


def _hulls(rng: np.random.Generator) -> list[np.ndarray]:
    ball = rng.normal(size=(60, 3))
    ball *= 0.04 / np.linalg.norm(ball, axis=1, keepdims=True)
    plate = rng.uniform(-1, 1, size=(24, 3)) * [0.2, 0.15, 0.004]
    wedge = rng.uniform(-1, 1, size=(8, 3)) * [0.05, 0.02, 0.03]
    hulls = [trimesh.convex.convex_hull(v) for v in (ball, plate, wedge)]
    return [np.asarray(h.vertices, np.float32) - np.asarray(h.vertices, np.float32).mean(0) for h in hulls]


def _program(hulls: list[np.ndarray]) -> Program:
    types = [PieceType.HULL] * len(hulls) + [PieceType.BOX, PieceType.SPHERE, PieceType.CAPSULE, PieceType.CYLINDER]
    types.append(PieceType.ELLIPSOID)
    sizes = [[0, 0, 0]] * len(hulls) + [[0.2, 0.1, 0.01], [0.04, 0, 0], [0.03, 0.08, 0], [0.05, 0.03, 0]]
    sizes.append([0.06, 0.03, 0.02])
    counts = [len(h) for h in hulls] + [0] * 5
    program = Program()  # pyrefly: ignore[missing-argument]
    arrays = {
        "piece_type": np.array(types),
        "piece_size": np.array(sizes),
        "piece_vertnum": np.array(counts),
        "piece_vertadr": np.concatenate([[0], np.cumsum(counts)[:-1]]),
        "vert": np.concatenate(hulls),
    }
    fill_struct(Program, program, arrays, "cpu")
    return program


def _fcl(hulls: list[np.ndarray], piece: int) -> fcl.CollisionGeometry:
    if piece < len(hulls):
        hull = trimesh.convex.convex_hull(hulls[piece].astype(float))
        mesh = fcl.BVHModel()
        mesh.beginModel(len(hull.vertices), len(hull.faces))
        mesh.addSubModel(hull.vertices, hull.faces)
        mesh.endModel()
        return mesh
    box, ball = fcl.Box(0.4, 0.2, 0.02), fcl.Sphere(0.04)
    return [box, ball, fcl.Capsule(0.03, 0.16), fcl.Cylinder(0.05, 0.06), fcl.Ellipsoid(0.06, 0.03, 0.02)][
        piece - len(hulls)
    ]


def _judge(a: int, b: int, count: int, margin: float, seed: int, spread: float):
    """Verdicts of the device and distances of FCL for random poses of the pieces a and b."""
    rng = np.random.default_rng(seed)
    hulls = _hulls(np.random.default_rng(1))
    rot = Rotation.random(count, rng=rng).as_matrix().astype(np.float32)
    pos = rng.normal(size=(count, 3)).astype(np.float32)
    pos *= (rng.uniform(0.0, spread, size=count) / np.linalg.norm(pos, axis=1)).astype(np.float32)[:, None]
    out = wp.zeros(count, dtype=bool, device="cpu")
    args = [np.full(count, a), np.full(count, b)]
    wp.launch(
        _separated,
        dim=count,
        inputs=[_program(hulls), *(wp.array(x, dtype=int, device="cpu") for x in args)]
        + [wp.array(pos, dtype=wp.vec3, device="cpu"), wp.array(rot, dtype=wp.mat33, device="cpu")]
        + [wp.full(count, margin, dtype=float, device="cpu"), out],
        device="cpu",
    )
    ga, gb = _fcl(hulls, a), _fcl(hulls, b)
    distance = np.empty(count)
    for i in range(count):
        oa, ob = fcl.CollisionObject(ga, fcl.Transform()), fcl.CollisionObject(gb, fcl.Transform(rot[i], pos[i]))
        touching = fcl.collide(oa, ob, fcl.CollisionRequest(), fcl.CollisionResult())
        distance[i] = 0.0 if touching else fcl.distance(oa, ob, fcl.DistanceRequest(), fcl.DistanceResult())
    return out.numpy(), distance, hulls, pos, rot


@pytest.mark.parametrize("margin", [5e-6, 1e-3, 0.02])
@pytest.mark.parametrize(("a", "b"), [(0, 0), (0, 1), (1, 2), (2, 2)])
def test_hulls_are_separated_exactly_when_fcl_says_so(a: int, b: int, margin: float):
    """Distances of meshes: no miss and no false alarm beyond 2 um, containment included."""
    verdict, distance, hulls, pos, rot = _judge(a, b, 1500, margin, seed=10 * a + b, spread=0.25)
    enclosed = np.zeros(len(verdict), bool)
    solid_a, solid_b = (trimesh.convex.convex_hull(hulls[k].astype(float)) for k in (a, b))
    for i in np.flatnonzero(distance > 0.0):
        inside_a = (solid_a.face_normals @ pos[i] < (solid_a.face_normals * solid_a.triangles[:, 0]).sum(1)).all()
        origin = rot[i].T @ -pos[i]
        inside_b = (solid_b.face_normals @ origin < (solid_b.face_normals * solid_b.triangles[:, 0]).sum(1)).all()
        enclosed[i] = inside_a or inside_b
    distance[enclosed] = 0.0
    assert 0.05 < verdict.mean() < 0.95
    assert not np.any(verdict & (distance < margin - 2e-6))
    assert not np.any(~verdict & (distance > margin + 2e-6))


@pytest.mark.parametrize("a", [4, 5, 6, 7])
@pytest.mark.parametrize("b", [3, 4, 5, 6, 7])
def test_primitives_agree_with_fcl(a: int, b: int):
    """True primitives: no miss and no false alarm beyond the 0.1 mm to which FCL's own distances are good."""
    margin = 1e-3
    verdict, distance, *_ = _judge(a, b, 800, margin, seed=100 + 10 * a + b, spread=0.2)
    assert not np.any(verdict & (distance < margin - 1e-4))
    assert not np.any(~verdict & (distance > margin + 1e-4))
