"""Copy layouts from the device to a LayoutTable on the host, with the TCP poses of their grasps."""

from dataclasses import replace

import numpy as np

from sceniris_gym.layout.columns import columns, row_types
from sceniris_gym.layout.layouts import Layouts, LayoutStatus, column_of
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable
from sceniris_gym.scene.poses import body_poses, product, rotated


def read_layouts(layouts: Layouts, split: str, nrow: int | None) -> LayoutTable:
    """Copy the first `nrow` layouts (all if `nrow` is None) to the host. `split` is the split of the layouts."""
    types = row_types(layouts.compiled, nvalue=layouts.view.param.shape[1])

    def read(name: str) -> np.ndarray:
        dtype, shape = types[name]  # astype also copies: on a CPU, `numpy()` is a view that the next reset overwrites
        return column_of(layouts, name).numpy()[(slice(nrow), *map(slice, shape))].astype(dtype)

    rows = {name: read(name) for name in columns()}
    table = LayoutTable(
        **rows,
        valid=rows["status"] == LayoutStatus.VALID,
        grasp_pose=COLUMNS["grasp_pose"].blanks(0),
        scene=layouts.compiled.hash,
        split=split,
        params=layouts.params.names,
    )
    return replace(table, grasp_pose=grasp_poses(layouts.compiled, table, table.grasp))


def grasp_poses(compiled: CompiledScene, table: LayoutTable, grasp: np.ndarray) -> np.ndarray:
    """Return the TCP poses of grasps in the world frame, shape (nrow, nreach, 7), float32.

    Position [m] and orientation (wxyz), NaN for rows without a grasp.

    Args:
        compiled: The compiled scene.
        table: The layouts.
        grasp: Index of the grasp of each reach target, -1 without a grasp, shape (nrow, nreach).
    """
    poses = np.full((*grasp.shape, 7), np.nan, np.float32)
    if compiled.reaching is None:
        return poses
    for k, target in enumerate(compiled.reaching.targets):
        grasps, chosen = target.grasp_set.grasps, grasp[:, k]
        bodies, places = np.array([g.body for g in grasps]), np.array([g.pos for g in grasps])
        rotations = np.array([g.quat for g in grasps])
        for body in np.unique(bodies):
            rows = np.flatnonzero((chosen >= 0) & (bodies[chosen] == body))
            states = (column[rows] for column in (table.qpos, table.mocap_pos, table.mocap_quat))
            pos, quat = body_poses(compiled.mjm, int(body), *states)
            poses[rows, k, :3] = pos + rotated(places[chosen[rows]], quat)
            poses[rows, k, 3:] = product(quat, rotations[chosen[rows]])
    return poses
