"""Measure how long a step of physics takes with four cups of 1, 8, 32 or 76 convex parts each on a floor.

    python -m benchmarks.part_steps

Times are those of the process, of MuJoCo C and of MuJoCo-Warp on a CPU, so other programs hardly matter. Gaps of 2 mm
separate the cups, and only their bottoms touch the floor. Contacts are therefore the same for any number of parts.
"""

from __future__ import annotations

import time
from itertools import pairwise

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

NWORLD, STEPS = 16, 40
RADIUS, INNER, FLOOR, HEIGHT = 0.04, 0.034, 0.006, 0.09  # m


def cups(parts: int) -> mujoco.MjModel:
    """Return a model of four cups, each of a bottom and `parts` - 1 pieces of the wall."""
    ends = np.linspace(0.0, 2.0 * np.pi, parts) if parts > 1 else np.zeros(0)
    shapes = [_corners(np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False), (RADIUS,), (0.0, FLOOR))]
    shapes += [_corners(np.array(pair), (INNER, RADIUS), (FLOOR, HEIGHT)) for pair in pairwise(ends)]
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.005
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1.0, 1.0, 0.1])
    for k, shape in enumerate(shapes):
        spec.add_mesh(name=f"part{k}", uservert=shape.ravel())
    for x in (0.0, 0.082):
        for y in (0.0, 0.082):
            body = spec.worldbody.add_body(pos=[x, y, 0.0005])
            body.add_freejoint()
            for k in range(len(shapes)):
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"part{k}", density=500.0)
    return spec.compile()


def _corners(angles: np.ndarray, radii: tuple[float, ...], heights: tuple[float, ...]) -> np.ndarray:
    return np.array([[r * np.cos(a), r * np.sin(a), z] for a in angles for r in radii for z in heights])


def main() -> None:
    """Print the time of a step in one world [ms] for each number of parts."""
    for parts in (1, 8, 32, 76):
        mjm = cups(parts)
        data = mujoco.MjData(mjm)
        mujoco.mj_step(mjm, data, 50)
        start = time.process_time()
        mujoco.mj_step(mjm, data, 10 * STEPS)
        plain = (time.process_time() - start) / (10 * STEPS)
        with wp.ScopedDevice("cpu"):
            m, d = mjw.put_model(mjm), mjw.put_data(mjm, data, nworld=NWORLD, nconmax=100, njmax=400)
            for i in range(STEPS + 5):
                start = time.process_time() if i == 5 else start  # the first steps compile kernels
                mjw.step(m, d)
            warp = (time.process_time() - start) / (STEPS * NWORLD)
        print(f"{parts:3} parts: MuJoCo C {1e3 * plain:.3f} ms, MuJoCo-Warp {1e3 * warp:.3f} ms")


if __name__ == "__main__":
    main()
