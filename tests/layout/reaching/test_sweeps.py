"""Tests of pairs of bodies along a path: their poses and motions, compared with MuJoCo C, and the margin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus, LayoutsView
from sceniris_gym.layout.reaching.search import ReachSearch, pose_index
from sceniris_gym.layout.reaching.sweeps import sweep_pair, write_joints
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.scene.build import build_model

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _sweep(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    reach_search: ReachSearch,
    pairs: wp.array[int],
    interval: int,
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    motion: wp.array[float],
):
    write_joints(reach, layouts, reach_search, 0, 0)
    for i in range(pairs.shape[0]):
        swept = sweep_pair(program, reach, layouts, reach_search, 0, 0, pairs[i], interval)
        pos[i] = swept.poses.rel.pos
        rot[i] = swept.poses.rel.rot
        motion[i] = swept.motion


@pytest.mark.parametrize("robot", ["panda", "heron", "ur5e"])
def test_pairs_are_posed_as_by_mujoco_and_move_at_most_by_their_bound(robot: str):
    """Hinges and slides, intervals between random joint positions within the limits; 5 um, and 5e-6 of a rotation."""
    can = {"asset": "can", "on": "floor", "region": {"box": [[0.35, -0.1], [0.55, 0.1]]}, "reachable": "path"}
    words = {"robot": {"asset": robot, "base": [0.0, 0.0, 0.0]}, "objects": {"can": can}}
    compiled = compile_scene({"floor": {"size": [2.4, 2.0]}, **words}, "cpu")
    generator = LayoutGenerator(compiled, 1)
    generator.generate()
    assert compiled.reaching is not None
    assert generator._stage is not None
    one, search, work = compiled.reaching.arms[0], generator._stage.search, generator._work
    mjm, program, view, layouts = compiled.mjm, compiled.program, one.view, generator.layouts
    data, rng = mujoco.MjData(mjm), np.random.default_rng(5)
    low, high = np.maximum(one.arm.lower, -3.0), np.minimum(one.arm.upper, 3.0)
    lists = np.concatenate([view.arm_self.numpy(), view.arm_scene.numpy()])
    first, number = view.arm_pairadr.numpy()[lists], view.arm_pairnum.numpy()[lists]
    pairs = np.concatenate([np.arange(a, a + n) for a, n in zip(first, number, strict=True)])
    bodies = program.pair_bodies.numpy()[pairs, :2]
    own = np.zeros(mjm.nq, bool)
    own[mjm.jnt_qposadr[np.isin(mjm.jnt_bodyid, view.arm_body.numpy())]] = True
    corners = search.corner.numpy()
    corners[0, 3, : len(low)] = search.pregrasp_qpos.numpy()[0, : len(low)]

    def poses(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and rotations of the second bodies in the frames of the first, by MuJoCo C."""
        data.qpos[:] = np.where(own, search.qpos.numpy()[int(pose_index.func(search, 0, 1))], layouts.qpos.numpy()[0])
        data.qpos[one.arm.qposadr] = joints
        data.mocap_pos[:], data.mocap_quat[:] = layouts.mocap_pos.numpy()[0], layouts.mocap_quat.numpy()[0]
        mujoco.mj_kinematics(mjm, data)
        a, b = data.xmat[bodies[:, 0]].reshape(-1, 3, 3), data.xmat[bodies[:, 1]].reshape(-1, 3, 3)
        apart = data.xpos[bodies[:, 1]] - data.xpos[bodies[:, 0]]
        return np.einsum("nji,nj->ni", a, apart), np.einsum("nji,njk->nik", a, b)

    for level in (1, 2, 5):
        ends = rng.uniform(low, high, (2, len(low)))
        corners[0, :2, : len(low)] = ends
        search.corner.assign(corners)
        index = int(rng.integers(2 ** (level - 1)))
        half, share = 0.5**level, (2 * index + 1) * 0.5**level
        out = [wp.zeros(len(pairs), dtype=dtype, device="cpu") for dtype in (wp.vec3, wp.mat33, float)]
        given = wp.array(pairs, dtype=int, device="cpu"), (level << 16) + index
        wp.launch(_sweep, 1, [program, view, work.layouts, search, *given, *out], device="cpu")
        middle = poses(ends[0] + share * (ends[1] - ends[0]))
        np.testing.assert_allclose(out[0].numpy(), middle[0], atol=5e-6)
        np.testing.assert_allclose(out[1].numpy(), middle[1], atol=5e-6)
        for side in (-1.0, -0.5, 0.5, 1.0):
            moved = poses(ends[0] + (share + side * half) * (ends[1] - ends[0]))
            for k, (a, b) in enumerate(bodies):
                far = a if view.arm_link.numpy()[a] > view.arm_link.numpy()[b] else b
                for at in mjm.geom_pos[mjm.geom_bodyid == far]:
                    before, after = (
                        rot @ at + pos if far == b else rot.T @ (at - pos)
                        for pos, rot in ((middle[0][k], middle[1][k]), (moved[0][k], moved[1][k]))
                    )
                    distance = np.linalg.norm(after - before)
                    assert distance <= out[2].numpy()[k] + 1e-5, f"{mjm.body(a).name} {mjm.body(b).name}"


@pytest.mark.parametrize(("margin", "found"), [(0.001, True), (0.003, False)])
def test_a_start_pose_nearer_than_the_margin_has_no_path(tmp_path: Path, margin: float, found: bool):
    """A ball is 2 mm in front of the hand at home, measured by MuJoCo C."""
    can = {"asset": "can", "on": "floor", "region": {"box": [[0.4, -0.1], [0.5, 0.1]]}}
    words: dict[str, Any] = {
        "floor": {"size": [2.4, 2.0]},
        "restarts": 0,
        "bank": 1,
        "robot": {"asset": "panda", "base": [0, 0, 0]},
    }
    words["objects"] = {
        "ball": {"asset": str(tmp_path / "ball.xml"), "kind": "static"},
        "can": {**can, "reachable": "path", "margin": margin},
    }
    x, gap = 0.8, 1.0
    while abs(gap - 0.002) > 2e-5:
        ball = f"<body name='ball' pos='{x} 0 .55'><geom type='sphere' size='.01'/></body>"
        (tmp_path / "ball.xml").write_text(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
        scene = build_model(SceneConfig.load(words))
        mjm, robot = scene.mjm, scene.subtree("robot")
        own = np.flatnonzero(np.isin(mjm.geom_bodyid, robot) & (mjm.geom_contype > 0)).tolist()
        (other,) = np.flatnonzero(np.isin(mjm.geom_bodyid, scene.subtree("ball"))).tolist()
        gap = min(mujoco.mj_geomDistance(mjm, scene.home, geom, other, 1.0, None) for geom in own)
        x -= gap - 0.002
    if found:
        generator = LayoutGenerator(compile_scene(words, "cpu"), 4)
        generator.generate()
        assert (generator.layouts.status.numpy() == LayoutStatus.VALID).all()
    else:
        with pytest.raises(InfeasibleSceneError, match="no_path"):
            compile_scene(words, "cpu")
