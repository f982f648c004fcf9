"""Containment in a hollow ball, against half-spaces and distances in double precision."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.collide.boxes import encloses, in_bounds, in_solid
from sceniris_gym.geometry.colliders import collect_colliders, collider_arrays
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.program.device import Program, fill_struct

wp.set_module_options({"enable_backward": False})

SHELL, BALL, GROUND = 1, 2, 0
"""The colliders: a hollow ball of 0.3 m with walls of 0.1 m, a ball of 0.04 m, and a plane."""


@wp.kernel
def _contained(
    program: Program,
    collider: int,
    points: wp.array[wp.vec3],
    # Out:
    solid: wp.array[bool],
    bounds: wp.array[bool],
):
    i = wp.tid()
    solid[i] = in_solid(program, collider, points[i])
    bounds[i] = in_bounds(program, collider, points[i])


@wp.kernel
def _enclosed(
    program: Program,
    pairadr: int,
    pairnum: int,
    own_pos: wp.array2d[wp.vec3],
    own_quat: wp.array2d[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
    # Out:
    out: wp.array[bool],
):
    i = wp.tid()
    out[i] = encloses(program, pairadr, pairnum, 0, own_pos[i], own_quat[i], body_pos, body_quat)


@pytest.fixture(scope="module")
def scene() -> tuple[Program, tuple[trimesh.Trimesh, trimesh.Trimesh], list]:
    """Return the program of the colliders and their pairs, the two surfaces of the shell, and meshes to keep alive."""
    outer, inner = (trimesh.creation.icosphere(3, radius) for radius in (0.3, 0.2))
    inner.invert()
    shell = trimesh.util.concatenate(outer, inner)
    spec = mujoco.MjSpec()
    spec.add_mesh(
        name="shell",
        uservert=np.ravel(shell.vertices),  # pyrefly: ignore[missing-attribute]
        userface=np.ravel(shell.faces),  # pyrefly: ignore[missing-attribute]
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
    spec.worldbody.add_body(name="a").add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="shell")
    spec.worldbody.add_body(name="b").add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.04, 0, 0], pos=[0.1, 0, 0])
    mjm = spec.compile()
    pieces = sorted(extract_pieces(mjm, "visual"), key=lambda p: p.body)
    colliders = collect_colliders(pieces, True, "cpu")
    assert [c.body for c in colliders] == [0, 1, 2]
    program = Program()  # pyrefly: ignore[missing-argument]
    program.visual = True
    pairs = [(SHELL, BALL), (SHELL, GROUND), (BALL, GROUND)]
    arrays = {
        "pair_a": np.array([a for a, _ in pairs]),
        "pair_b": np.array([b for _, b in pairs]),
        # the ball is what is tested, so it is posed by `own_pos`
        "pair_bodies": np.array([(a, b, (a == BALL) + 2 * (b == BALL), 0 if b == GROUND else -1) for a, b in pairs]),
    }
    fill_struct(Program, program, collider_arrays(colliders) | arrays, "cpu")
    inner.invert()
    return program, (outer, inner), [c.mesh for c in colliders]


def _height(surface: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """The greatest height [m] of points over the planes of a convex surface's faces; negative inside."""
    offsets = (surface.face_normals * surface.triangles[:, 0]).sum(1)
    return (points @ surface.face_normals.T - offsets).max(1)


def test_points_are_in_the_solid_exactly_where_they_are_in_the_wall(scene: tuple):
    """Between both surfaces of the shell, and neither in its hollow nor outside; bounds are those of the outer one."""
    program, (outer, inner), _ = scene
    points = np.random.default_rng(0).uniform(-0.35, 0.35, (4000, 3)).astype(np.float32)
    solid, bounds = (wp.zeros(len(points), dtype=bool, device="cpu") for _ in range(2))
    inputs = [program, SHELL, wp.array(points, dtype=wp.vec3, device="cpu")]
    wp.launch(_contained, dim=len(points), inputs=inputs, outputs=[solid, bounds], device="cpu")
    in_outer, in_inner = _height(outer, points), _height(inner, points)
    clear = (np.abs(in_outer) > 1e-5) & (np.abs(in_inner) > 1e-5)
    assert (solid.numpy() == ((in_outer < 0.0) & (in_inner > 0.0)))[clear].all()
    assert 0.1 < solid.numpy().mean() < 0.6
    assert (bounds.numpy() == (np.abs(points) <= outer.bounds[1] + 1e-6).all(1)).all()


def test_a_ball_is_enclosed_in_the_wall_and_not_in_the_hollow(scene: tuple):
    """By its distance from the centre, with both bodies turned and moved; a plane encloses nothing."""
    program, _, _ = scene
    rng, count = np.random.default_rng(1), 400
    distance = np.concatenate([rng.uniform(0.0, 0.15, count // 2), rng.uniform(0.245, 0.255, count // 2)])
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    at, turn = np.array([0.5, -0.2, 0.7]), Rotation.random(rng=rng)
    turns = Rotation.random(count, rng=rng)
    pos = np.zeros((count, 3, 3))
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (count, 3, 1))
    pos[:, 2] = at + distance[:, None] * ways - turns.apply([0.1, 0.0, 0.0])
    quat[:, 2] = turns.as_quat(scalar_first=True)
    stands = np.array([[0.0, 0.0, 0.0], at, [9.0, 9.0, 9.0]])
    turned = np.array([[1.0, 0, 0, 0], turn.as_quat(scalar_first=True), [1.0, 0, 0, 0]])
    poses = [wp.array(pos, dtype=wp.vec3, device="cpu"), wp.array(quat, dtype=wp.vec4, device="cpu")]
    poses += [wp.array(stands, dtype=wp.vec3, device="cpu"), wp.array(turned, dtype=wp.vec4, device="cpu")]
    for adr, num, expected in ((0, 3, distance > 0.2), (0, 1, distance > 0.2), (1, 2, np.zeros(count, bool))):
        out = wp.zeros(count, dtype=bool, device="cpu")
        wp.launch(_enclosed, dim=count, inputs=[program, adr, num, *poses], outputs=[out], device="cpu", block_dim=1)
        assert (out.numpy() == expected).all()
