"""Pivots and bounds of an object in drawn joint states, against the corners of its boxes as MuJoCo C poses them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.placement.measure import bounds_of, measure
from sceniris_gym.placement.orientations import DrawnVariant
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Program
from sceniris_gym.scene.build import build_model
from tests.layout.related import drawer_mjcf
from tests.layout.scenes import ANYWHERE
from tests.oracle.solids import Solids

wp.set_module_options({"enable_backward": False})

N = 200


@wp.kernel
def _measure(
    program: Program,
    quat: wp.array[wp.vec4],
    qpos: wp.array2d[float],
    place: wp.array[wp.vec4],
    # Out:
    body_pos: wp.array2d[wp.vec3],
    body_quat: wp.array2d[wp.vec4],
    pivot: wp.array[wp.vec3],
    bounds: wp.array[wp.vec4],
    around: wp.array[wp.vec4],
):
    """Measure object 0 in an orientation of heading 0, and its bounds around another pivot in another heading."""
    i = wp.tid()
    drawn = DrawnVariant()
    drawn.quat = quat[i]
    drawn.pivot = program.variant_pivot[0]
    drawn.bounds = program.variant_bounds[0]
    drawn = measure(program, 0, drawn, qpos[i], body_pos[i], body_quat[i])
    pivot[i] = drawn.pivot
    bounds[i] = drawn.bounds
    around[i] = bounds_of(program, 0, place[i], body_pos[i], body_quat[i])


def _compiled(folder: Path, orientation: Any, geometry: str) -> CompiledScene:
    chest = {"asset": drawer_mjcf(folder, "chest"), "region": {"box": ANYWHERE}, "orientation": orientation}
    chest |= {"joints": {"slide": {"fraction": [0.0, 1.0]}}}
    mark = {"kind": "marker", "region": {"box": ANYWHERE}}
    mark |= {"relations": [{"near": "chest", "distance": {"max": 2.0}, "measure": "bounds"}]}
    config = {"geometry": geometry, "objects": {"chest": chest, "mark": mark}}
    return upload_scene(build_model(SceneConfig.load(config)), "cpu")


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("orientation", ["any", {"yaw": [-20, 60]}])
def test_pivot_and_bounds_are_those_of_the_drawn_state(orientation: Any, geometry: str, tmp_path: Path):
    """The lowest point always; sideways the pivot is drawn anew for `any` alone, and stays that of home for others."""
    compiled, rng = _compiled(tmp_path, orientation, geometry), np.random.default_rng(5)
    mjm, program, solids = compiled.mjm, compiled.program, Solids(compiled.mjm, geometry)
    data, slide = mujoco.MjData(mjm), int(mjm.joint("chest/slide").qposadr[0])
    free = int(mjm.joint("chest/free").qposadr[0])
    turns = Rotation.random(N, rng=rng) if orientation == "any" else Rotation.identity(N)
    quat = turns.as_quat(scalar_first=True)
    qpos = np.tile(compiled.home_qpos, (N, 1))
    qpos[:, slide] = rng.uniform(0.0, 0.2, N)
    place = np.concatenate([rng.uniform(-1.0, 1.0, (N, 3)), rng.uniform(-3.0, 3.0, (N, 1))], axis=1)
    inputs = [program, wp.array(quat, dtype=wp.vec4, device="cpu"), wp.array(qpos, dtype=float, device="cpu")]
    inputs.append(wp.array(place, dtype=wp.vec4, device="cpu"))
    poses = [wp.zeros((N, mjm.nbody), dtype=kind, device="cpu") for kind in (wp.vec3, wp.vec4)]
    out = [wp.zeros(N, dtype=kind, device="cpu") for kind in (wp.vec3, wp.vec4, wp.vec4)]
    wp.launch(_measure, dim=N, inputs=inputs, outputs=[*poses, *out], device="cpu")
    pivot, bounds, around = (a.numpy() for a in out)
    home = program.variant_pivot.numpy()[0]
    for i in range(N):
        data.qpos[:] = qpos[i]
        data.qpos[free : free + 7] = [0.0, 0.0, 0.0, *quat[i]]
        mujoco.mj_kinematics(mjm, data)
        points = np.concatenate([solids.points(data, geom) for geom in solids.geoms("chest")])
        low, high = points.min(0), points.max(0)
        bottom = np.array([*(low + high)[:2] / 2.0, low[2]]) if orientation == "any" else [home[0], home[1], low[2]]
        np.testing.assert_allclose(turns[i].apply(pivot[i]), bottom, atol=2e-6)
        np.testing.assert_allclose(bounds[i], [*(low - bottom)[:2], *(high - bottom)[:2]], atol=2e-6)
        seen = Rotation.from_rotvec([0.0, 0.0, -place[i, 3]]).apply(points - place[i, :3])
        np.testing.assert_allclose(around[i], [*seen.min(0)[:2], *seen.max(0)[:2]], atol=4e-6)
