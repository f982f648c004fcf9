"""Poses on the device, against SciPy's rigid transforms."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import RigidTransform, Rotation

from sceniris_gym.device.transforms import (
    apply,
    axis_angle_quat,
    compose,
    mul_quat,
    neg_quat,
    pose_of,
    quat_mat,
    quat_z,
    relative,
    rot_vec_quat,
    rotation_vector,
    turn_z,
    z_axis,
)

wp.set_module_options({"enable_backward": False})

N = 500


@wp.kernel
def _poses(
    pos: wp.array2d[wp.vec3],
    quat: wp.array2d[wp.vec4],
    v: wp.array[wp.vec3],
    axis: wp.array[wp.vec3],
    angle: wp.array[float],
    # Out:
    composed: wp.array[wp.mat44],
    seen: wp.array[wp.mat44],
    applied: wp.array[wp.vec3],
    turns: wp.array2d[wp.mat33],
):
    i = wp.tid()
    a = pose_of(pos[i, 0], quat[i, 0])
    b = pose_of(pos[i, 1], quat[i, 1])
    ab = compose(a, b)
    in_a = relative(a, b)
    for row in range(3):
        for column in range(3):
            composed[i][row, column] = ab.rot[row, column]
            seen[i][row, column] = in_a.rot[row, column]
        composed[i][row, 3] = ab.pos[row]
        seen[i][row, 3] = in_a.pos[row]
    composed[i][3, 3] = 1.0
    seen[i][3, 3] = 1.0
    applied[i] = apply(a, v[i])
    turns[i, 0] = quat_mat(quat_z(angle[i]))
    turns[i, 1] = quat_mat(axis_angle_quat(axis[i], angle[i]))


def test_poses_and_turns_are_those_of_scipy():
    """Composed, seen from each other, applied to points; turns about z and about any axis, more than full ones too."""
    rng = np.random.default_rng(0)
    pos, v, angle = rng.normal(size=(N, 2, 3)), rng.normal(size=(N, 3)), rng.uniform(-9.0, 9.0, N)
    rots = [Rotation.random(N, rng=rng) for _ in range(2)]
    quat = np.stack([r.as_quat(scalar_first=True) for r in rots], axis=1)
    axis = rng.normal(size=(N, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    kinds = (wp.vec3, wp.vec4, wp.vec3, wp.vec3, float)
    inputs = [wp.array(a, dtype=kind, device="cpu") for a, kind in zip((pos, quat, v, axis, angle), kinds, strict=True)]
    out = [wp.zeros(N, dtype=kind, device="cpu") for kind in (wp.mat44, wp.mat44, wp.vec3)]
    out.append(wp.zeros((N, 2), dtype=wp.mat33, device="cpu"))
    wp.launch(_poses, dim=N, inputs=inputs, outputs=out, device="cpu")
    composed, seen, applied, turns = (a.numpy() for a in out)
    a, b = (RigidTransform.from_components(pos[:, k], rots[k]) for k in range(2))
    np.testing.assert_allclose(composed, (a * b).as_matrix(), atol=5e-6)
    np.testing.assert_allclose(seen, (a.inv() * b).as_matrix(), atol=5e-6)
    np.testing.assert_allclose(applied, a.apply(v), atol=5e-6)
    for k, about in enumerate((np.tile([0.0, 0.0, 1.0], (N, 1)), axis)):
        np.testing.assert_allclose(turns[:, k], Rotation.from_rotvec(about * angle[:, None]).as_matrix(), atol=2e-6)


@wp.kernel(enable_backward=False, module="unique")
def _quaternions(
    a: wp.array[wp.vec4],
    b: wp.array[wp.vec4],
    v: wp.array[wp.vec3],
    angle: wp.array[float],
    # Out:
    product: wp.array[wp.vec4],
    inverse: wp.array[wp.vec4],
    turned: wp.array[wp.vec4],
    rotated: wp.array[wp.vec3],
    axis: wp.array[wp.vec3],
    vector: wp.array[wp.vec3],
):
    i = wp.tid()
    product[i] = mul_quat(a[i], b[i])
    inverse[i] = neg_quat(a[i])
    turned[i] = turn_z(a[i], angle[i])
    rotated[i] = rot_vec_quat(v[i], a[i])
    axis[i] = z_axis(a[i])
    vector[i] = rotation_vector(a[i])


class Results:
    """Results of each function for rotations, vectors and angles."""

    def __init__(self, a: Rotation, b: Rotation, v: np.ndarray, angle: np.ndarray, sign: float = 1.0) -> None:
        quats = [sign * r.as_quat(canonical=True, scalar_first=True) for r in (a, b)]
        inputs = [wp.array(q, dtype=wp.vec4, device="cpu") for q in quats]
        inputs += [wp.array(v, dtype=wp.vec3, device="cpu"), wp.array(angle, dtype=float, device="cpu")]
        out = [wp.zeros(len(v), dtype=t, device="cpu") for t in (*[wp.vec4] * 3, *[wp.vec3] * 3)]
        wp.launch(_quaternions, dim=len(v), inputs=[*inputs, *out], device="cpu")
        self.product, self.inverse, self.turned = (_rotation(q.numpy()) for q in out[:3])
        self.rotated, self.axis, self.vector = (v.numpy() for v in out[3:])


def _rotation(quat: np.ndarray) -> Rotation:
    """Rotations of wxyz quaternions, which are of unit length already."""
    np.testing.assert_allclose(np.linalg.norm(quat, axis=1), 1.0, atol=1e-6)
    return Rotation.from_quat(quat, scalar_first=True)


def _largest(a: Rotation, b: Rotation) -> float:
    """The largest angle [rad] between two lists of rotations."""
    return float((a.inv() * b).magnitude().max())


@pytest.fixture(scope="module", params=[1.0, -1.0], ids=["w above 0", "w below 0"])
def drawn(request: pytest.FixtureRequest) -> tuple[Rotation, Rotation, np.ndarray, np.ndarray, Results]:
    """Random rotations, vectors and angles, and what the device makes of them: either sign of a quaternion is one."""
    draws = np.random.default_rng(0)
    a, b = Rotation.random(N, rng=draws), Rotation.random(N, rng=draws)
    v, angle = draws.normal(size=(N, 3)), draws.uniform(-7.0, 7.0, N)
    return a, b, v, angle, Results(a, b, v, angle, request.param)


def test_a_product_is_one_rotation_after_the_other(drawn: tuple[Rotation, Rotation, np.ndarray, np.ndarray, Results]):
    """The second one in the frame of the first; the inverse takes a rotation back."""
    a, b, _, _, found = drawn
    assert _largest(found.product, a * b) < 2e-6
    assert _largest(found.inverse, a.inv()) < 2e-6


def test_vectors_turn_with_the_rotation(drawn: tuple[Rotation, Rotation, np.ndarray, np.ndarray, Results]):
    """Any vector, and the z axis of the frame."""
    a, _, v, _, found = drawn
    np.testing.assert_allclose(found.rotated, a.apply(v), atol=5e-6)
    np.testing.assert_allclose(found.axis, a.apply([0.0, 0.0, 1.0]), atol=2e-6)


def test_a_turn_about_z_is_in_the_frame_itself(drawn: tuple[Rotation, Rotation, np.ndarray, np.ndarray, Results]):
    """By any angle, also of more than a full turn; the z axis stays where it is."""
    a, _, _, angle, found = drawn
    assert _largest(found.turned, a * Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0])) < 5e-6


def test_a_rotation_vector_is_axis_times_angle(drawn: tuple[Rotation, Rotation, np.ndarray, np.ndarray, Results]):
    """The shorter way around, whichever of both quaternions stands for the rotation."""
    a, _, _, _, found = drawn
    np.testing.assert_allclose(found.vector, a.as_rotvec(), atol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1.9e-6, 2.1e-6, 1e-5, 1e-3, 0.1, 3.1, np.pi])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rotation_vectors_of_small_and_half_turns_are_right(angle: float, sign: float):
    """To float32's precision of the vector itself, from nothing to half a turn, whose axis may point either way."""
    axes = np.random.default_rng(1).normal(size=(50, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turn = Rotation.from_rotvec(angle * axes)
    found = Results(turn, turn, axes, np.zeros(50), sign).vector
    off = np.linalg.norm(found - angle * axes, axis=1)
    if angle == np.pi:
        off = np.minimum(off, np.linalg.norm(found + angle * axes, axis=1))
    assert off.max() < 1e-6 * max(angle, 1e-6)
