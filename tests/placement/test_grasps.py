"""Grasps of a posed object, against rotations of SciPy and the known shape of a map."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from benchmarks.sampled_map import canonical
from sceniris_gym.config.tier import Verdict
from sceniris_gym.device.transforms import pose_of
from sceniris_gym.placement.grasps import first_accepted, grasp_pose, passes_map, tcp_of
from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_reach import Reach
from tests.reach.shapes import ball, gantry, map_of

wp.set_module_options({"enable_backward": False})

BODIES, GRASPS, WORLDS = 3, 40, 200
BASE = 0
"""The body that carries the arm; the grasps are on both others."""


@wp.kernel
def _tcp(
    reach: Reach,
    body_pos: wp.array2d[wp.vec3],
    body_quat: wp.array2d[wp.vec4],
    # Out:
    pos: wp.array2d[wp.vec3],
    quat: wp.array2d[wp.vec4],
    from_base: wp.array2d[wp.vec3],
    approach: wp.array2d[wp.vec3],
    passes: wp.array2d[bool],
    first: wp.array[int],
):
    world, grasp = wp.tid()
    base = pose_of(body_pos[world, reach.base_body], body_quat[world, reach.base_body])
    at, turn = tcp_of(reach, grasp, body_pos[world], body_quat[world])
    pos[world, grasp] = at
    quat[world, grasp] = turn
    seen = grasp_pose(reach, grasp, base, body_pos[world], body_quat[world])
    from_base[world, grasp] = seen.pos
    approach[world, grasp] = wp.vec3(seen.rot[0, 2], seen.rot[1, 2], seen.rot[2, 2])
    passes[world, grasp] = passes_map(reach, 0, grasp, base, body_pos[world], body_quat[world])
    if grasp == 0:
        first[world] = first_accepted(reach, 0, 1, base, body_pos[world], body_quat[world])


@pytest.mark.parametrize("stands", [False, True])
@pytest.mark.parametrize("mapped", [False, True])
def test_grasps_pass_by_the_map_and_by_their_approach(mapped: bool, stands: bool, monkeypatch: pytest.MonkeyPatch):
    """The TCP is where SciPy has it. At most 10 degrees upwards to what stands; the map decides nearly as its shape."""
    rng = np.random.default_rng(3)
    reach_map = map_of(ball, monkeypatch, gantry()[1], 0.05, np.radians(7.5))
    reach = Reach()  # pyrefly: ignore[missing-argument]
    reach.base_body, reach.mapped = BASE, mapped
    reach.map = reach_map.view("cpu")
    body, grasp_pos = rng.integers(1, BODIES, GRASPS), rng.uniform(-0.2, 0.2, (GRASPS, 3))
    grasp_turn = Rotation.random(GRASPS, rng=rng)
    arrays = {
        "grasp_body": body,
        "grasp_pos": grasp_pos,
        "grasp_quat": grasp_turn.as_quat(scalar_first=True),
        "reach_below": np.array([stands]),
        "reach_least": np.array([Verdict.MIXED_YES]),
        "reach_graspadr": np.array([10]),
        "stable_graspadr": np.array([10, 25]),
        "stable_graspnum": np.array([15, 4]),
    }
    fill_struct(Reach, reach, arrays, "cpu")
    body_pos = rng.uniform([-0.8, -0.8, -0.5], [0.8, 0.8, 1.0], (WORLDS, BODIES, 3))
    body_pos[:, BASE] *= 0.1
    turns = [Rotation.random(BODIES, rng=rng) for _ in range(WORLDS)]
    quat = np.array([t.as_quat(scalar_first=True) for t in turns])
    shape = (WORLDS, GRASPS)
    kinds = (wp.vec3, wp.vec4, wp.vec3, wp.vec3, bool)
    out = [wp.zeros(shape, dtype=kind, device="cpu") for kind in kinds] + [wp.zeros(WORLDS, dtype=int, device="cpu")]
    inputs = [reach, wp.array(body_pos, dtype=wp.vec3, device="cpu"), wp.array(quat, dtype=wp.vec4, device="cpu")]
    wp.launch(_tcp, dim=shape, inputs=inputs, outputs=out, device="cpu")
    pos, tcp_quat, from_base, approach, passes, first = (a.numpy() for a in out)
    allowed = np.empty(shape, bool)
    for world in range(WORLDS):
        of_body = Rotation.from_quat(quat[world, body], scalar_first=True)
        turn, where = of_body * grasp_turn, of_body.apply(grasp_pos) + body_pos[world, body]
        np.testing.assert_allclose(pos[world], where, atol=1e-6)
        assert (Rotation.from_quat(tcp_quat[world], scalar_first=True) * turn.inv()).magnitude().max() < 1e-5
        back = turns[world][BASE].inv()
        np.testing.assert_allclose(from_base[world], back.apply(where - body_pos[world, BASE]), atol=1e-6)
        np.testing.assert_allclose(approach[world], (back * turn).as_matrix()[:, :, 2], atol=1e-6)
        rising = turn.as_matrix()[:, 2, 2] > np.sin(np.radians(10.0))
        allowed[world] = ~rising if stands else True
        if mapped:
            allowed[world] &= ball(canonical(from_base[world], approach[world], np.zeros(2)))
    assert (passes != allowed).mean() < (0.01 if mapped else 1e-3)
    assert mapped or stands or passes.all()
    own = passes[:, 25:29]
    assert (first == np.where(own.any(1), 15 + own.argmax(1), -1)).all()
