"""The upright box around geoms, against trimesh."""

from __future__ import annotations

import mujoco
import numpy as np
import trimesh

from sceniris_gym.geometry.upright_box import upright_box


def test_it_just_holds_boxes_in_any_pose():
    """For boxes, which fill theirs, its corners are the bounds of their vertices."""
    rng = np.random.default_rng(0)
    spec = mujoco.MjSpec()
    vertices = []
    for _ in range(5):
        quat, pos, size = rng.normal(size=4), rng.normal(size=3), rng.uniform(0.01, 0.3, 3)
        quat /= np.linalg.norm(quat)
        spec.worldbody.add_body(pos=pos, quat=quat).add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size)
        turn = trimesh.transformations.quaternion_matrix(quat)
        turn[:3, 3] = pos
        vertices.append(trimesh.creation.box(2.0 * size, turn).vertices)
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    for chosen in ([2], [0, 3], range(5)):
        of_them = np.concatenate([vertices[i] for i in chosen])
        low, high = upright_box(mjm, data, np.array(chosen))
        assert np.allclose(low, of_them.min(axis=0))
        assert np.allclose(high, of_them.max(axis=0))
