"""Judges of built furniture, from the compiled model only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import mujoco
import numpy as np

STEPS = 20
DEEPEST = -1e-4  # m


def load(path: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A unit by itself with all joints at 0."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def bounds(model: mujoco.MjModel, data: mujoco.MjData, geoms: list[int]) -> np.ndarray:
    """Bounds [m] of geoms in the world frame, shape (2, 3)."""
    found = []
    for geom in geoms:
        middle, half = model.geom_aabb[geom].reshape(2, 3)
        axes = data.geom_xmat[geom].reshape(3, 3)
        pos, reach = data.geom_xpos[geom] + axes @ middle, np.abs(axes) @ half
        found += [pos - reach, pos + reach]
    return np.stack([np.min(found, axis=0), np.max(found, axis=0)])


def is_handle(model: mujoco.MjModel, geom: int) -> bool:
    """Return whether a geom belongs to a handle, by its name."""
    return str(model.geom(geom).name).endswith(("_bar", "_foot_0", "_foot_1"))


def opened(model: mujoco.MjModel) -> Iterator[np.ndarray]:
    """Yield positions of all joints: each one at 20 steps of its range, with the others at 0."""
    for joint in range(model.njnt):
        for share in np.linspace(0.0, 1.0, STEPS):
            qpos = np.zeros(model.nq)
            qpos[model.jnt_qposadr[joint]] = model.jnt_range[joint] @ (1.0 - share, share)
            yield qpos


def mixed(model: mujoco.MjModel) -> Iterator[np.ndarray]:
    """Yield 20 random positions of all joints together, and their upper limits."""
    yield model.jnt_range[:, 1]
    yield from np.random.default_rng(0).uniform(size=(STEPS, model.nq)) * model.jnt_range[:, 1]


def deepest(model: mujoco.MjModel, states: Iterable[np.ndarray]) -> tuple[float, str]:
    """Return the least distance [m] of two parts, or of a part and the root, with the joints at some positions."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    data, worst = mujoco.MjData(model), (np.inf, "")
    for data.qpos[:] in states:
        mujoco.mj_fwdPosition(model, data)
        for contact in data.contact:
            names = [model.geom(geom).name for geom in contact.geom]
            worst = min(worst, (contact.dist, f"{names} {data.qpos}"))
    return worst
