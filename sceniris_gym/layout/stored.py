"""`StoredLayouts`: a source of stored layouts, for tests and for evaluation on a fixed set."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.errors import SceneMismatchError, check_type
from sceniris_gym.layout.columns import columns, row_types
from sceniris_gym.layout.layouts import (
    LayoutKeys,
    Layouts,
    LayoutStatus,
    LayoutsView,
    copy_draws,
    copy_layout,
    layout_width,
    view_of,
)
from sceniris_gym.layout.masks import as_count, selects
from sceniris_gym.layout.params import ParamTable
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.program.compiled import MOST_EPISODES, USER_SPLITS, CompiledScene
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.scene.layout_table import LayoutTable

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Tolerance of the squared norm of a quaternion around 1.
_UNIT = 1.0e-4
# Tolerance of joint limits [m or rad], because limits are soft.
_BEYOND = 0.1
INTEGERS = ("present", "start", "grasp", "status", "episode", "draw_episode", "draw_stream")
"""Integer columns of layouts with bounded values."""
# Allowed kinds of NumPy types by column. Other columns may have any numbers.
_KINDS: dict[str, str] = dict.fromkeys((*INTEGERS, "seed", "draw_seed"), "biu")
_MOST = (1 << 31) - 1


@wp.kernel
def _make(
    # Layouts in: param, draws*, state*, choices*, grasps*
    stored: LayoutsView,
    mask: wp.array[wp.bool],
    stride: int,
    # Layouts in: pending*; out: draws*, state*, choices*, grasps*, status, next_param
    layouts: LayoutsView,
):
    worldid, i = wp.tid()
    if not selects(mask, worldid):
        return
    rank = layouts.pending_seed[worldid] + wp.uint64(layouts.pending_episode[worldid]) * wp.uint64(stride)
    row = int(rank % wp.uint64(stored.qpos.shape[0]))
    copy_layout(stored, row, layouts, worldid, i)
    if i < layouts.next_param.shape[1]:
        layouts.next_param[worldid, i] = stored.param[row, i]
    if i == 0:
        copy_draws(stored, row, layouts, worldid)
        layouts.status[worldid] = LayoutStatus.VALID


class StoredLayouts(LayoutSource):
    """A source of stored layouts. A world gets row `((seed + stride * episode) mod 2^64) mod nrow` of a table.

    Physics and appearance are drawn with the key of the stored layout. Random numbers of a task depend on the seed and
    episode of the world.

    Args:
        compiled: The scene of the layouts.
        table: The layouts. A table with only states (`LayoutTable.from_states`) has no grasps, and worlds keep their
            present physics.
        nworld: Number of worlds.
        seed: One integer (world i gets seed + i), or one 64-bit seed per world.
        stride: Rows that a world advances in every episode. With 1, worlds with consecutive seeds see the same rows one
            after another. Use nworld - 1 to go through a table with more rows than worlds.

    Attributes:
        layouts: The latest row of each world, with status VALID once a world has one.

    Raises:
        ArgumentTypeError: `compiled` is no CompiledScene, or `table` no LayoutTable.
        ArgumentError: `nworld` or `stride` is not an integer or is out of range. A seed is not a 64-bit integer, or the
            number of seeds is not the number of worlds.
        SceneMismatchError: The table has no rows, belongs to another scene, or has a row that no layout of the scene
            can have.
    """

    def __init__(
        self,
        compiled: CompiledScene,
        table: LayoutTable,
        nworld: int,
        *,
        seed: int | Sequence[int] | np.ndarray = 0,
        stride: int = 1,
    ) -> None:
        check_type(compiled, CompiledScene, "StoredLayouts: compiled")
        check_type(table, LayoutTable, "StoredLayouts: table")
        nworld = as_count(nworld, "StoredLayouts: nworld")
        self._stride = as_count(stride, "StoredLayouts: stride")
        check_table(compiled, table, "StoredLayouts: table")
        self.layouts = Layouts.create(compiled, nworld, params=table.params)
        self.layouts.params.are_kept = True
        self._table, self._stored = table, _on_device(table, compiled.device)
        self.reseed(seed=seed)

    def launch_make(self, mask: wp.array | None) -> None:
        """Copy the next rows of the masked worlds. See `LayoutSource`."""
        out, inputs = self.layouts.view, [self._stored, mask, self._stride]
        dim = self.layouts.nworld, max(layout_width(out), out.param.shape[1])
        wp.launch(_make, dim=dim, inputs=inputs, outputs=[out], device=out.qpos.device)

    def served(self, split: str, keys: LayoutKeys) -> tuple[str, LayoutKeys]:
        """Return split, seeds, episodes and params of the stored layouts that worlds with `keys` get."""
        seed, episode, _ = keys
        rank = seed.astype(np.uint64) + episode.astype(np.uint64) * np.uint64(self._stride)
        table = self._table[(rank % np.uint64(len(self._table))).astype(np.int64)]
        return table.split, (table.seed, np.where(episode < 0, -1, table.episode), table.param)


def check_table(compiled: CompiledScene, table: LayoutTable, where: str) -> None:
    """Validate a table of stored layouts, because kernels trust its shapes and indices.

    Args:
        compiled: The scene.
        table: The layouts.
        where: Name of the argument, at the beginning of errors.

    Raises:
        SceneMismatchError: The table has another scene, split or names of params, columns of a wrong shape, or a row
            that no layout of the scene can have.
        ArgumentTypeError, UnknownNameError, ArgumentError: The table has params that the scene does not have, or param
            values out of range.
    """
    compiled.scene.check_hash(table.scene, where, "Give layouts of this scene.")
    params = ParamTable(compiled, table.params)
    if table.split not in USER_SPLITS or table.params != params.names:
        raise SceneMismatchError(
            f"{where}: split should be 'train' or 'eval' and params should be {params.names}, got {short(table.split)} "
            f"and {short(table.params)}. Store layouts exactly as a generator makes them."
        )
    arrays = {name: array for name, array in vars(table).items() if isinstance(array, np.ndarray)}
    shapes = {name: array.shape for name, array in arrays.items() if array.dtype.kind in _KINDS.get(name, "biuf")}
    mjm, nreach = compiled.mjm, (*shapes.get("grasp", ()), 0, 0)[1]
    nrow = (*shapes.get("qpos", ()), 0)[0]
    joints, nvalue = (*shapes.get("grasp_qpos", ()), 0, 0, 0)[2], (*shapes.get("param", ()), 0, 0)[1]
    widths = {"njoint": min(joints, MAX_JOINTS), "nvalue": nvalue} | ({} if nreach else {"nreach": 0})
    for name, (_, shape) in row_types(compiled, **widths).items():
        found = shapes.get(name)
        if nrow == 0 or found != (nrow, *shape):
            wanted_shape = ", ".join(map(str, ("nrow", *shape)))
            raise SceneMismatchError(
                f"{where}.{name} should have shape ({wanted_shape}), with the same nrow >= 1 in all columns, "
                f"{'integers, ' if name in _KINDS else ''}got {found or type(arrays.get(name))}. Store layouts of the "
                "same scene."
            )
    first = compiled.program.quat_qposadr.numpy()
    quats = np.concatenate([table.qpos[:, first[:, None] + np.arange(4)], table.mocap_quat], axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        unit = np.abs(np.square(quats.astype(float)).sum(axis=2) - 1.0) < _UNIT
        near = np.abs(table.mocap_pos).sum(axis=2) <= compiled.program.bound_mocap.numpy()[: mjm.nmocap]
    limited = np.flatnonzero((mjm.jnt_limited != 0) & (mjm.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)))
    adr, ranges = mjm.jnt_qposadr[limited], mjm.jnt_range[limited].T
    home = compiled.home_qpos[adr]
    at, least, most = table.qpos[:, adr], np.minimum(ranges[0], home) - _BEYOND, np.maximum(ranges[1], home) + _BEYOND
    within = np.isfinite(table.qpos).all(axis=1) & ((at >= least) & (at <= most)).all(axis=1)
    wrong = np.flatnonzero(~(within & near.all(axis=1) & unit.all(axis=1)))
    if len(wrong):
        raise SceneMismatchError(
            f"{where}: row {wrong[0]} has a non-finite or out-of-bounds value, or a non-unit quaternion "
            f"({len(wrong)} of {len(table)} rows are affected). Store layouts exactly as a generator makes them."
        )
    unmade = np.flatnonzero(table.status == LayoutStatus.NONE) if table.scene else []
    if len(unmade):
        raise SceneMismatchError(f"{where}: row {unmade[0]} has no layout yet. Generate before you store the table.")
    check_numbers(compiled, {name: getattr(table, name) for name in INTEGERS}, where)
    params.checked(table.param, nrow)


def check_numbers(compiled: CompiledScene, numbers: Mapping[str, np.ndarray], where: str) -> None:
    """Validate integer columns of layouts, given by name, and the variants in each row.

    Raises:
        SceneMismatchError: A value out of bounds, or a row without exactly one variant of an object.
    """
    targets = () if compiled.reaching is None else compiled.reaching.targets
    grasps = np.array([len(target.grasp_set.grasps) for target in targets], int)
    kinds = {"present": (0, 1), "start": (-1, len(compiled.config.start) - 1), "grasp": (-1, grasps - 1)}
    kinds |= dict.fromkeys(("episode", "draw_episode", "next_episode"), (-1, MOST_EPISODES - 1))
    kinds |= dict.fromkeys(("elapsed", "draw_stream", "attempts"), (0, _MOST)) | {"status": (0, max(LayoutStatus))}
    kinds |= {"tree_asleep": (-_MOST - 1, compiled.sim_mjm.ntree - 1)}
    variants, sure = compiled.config.variants, compiled.config.presence.is_sure
    least = np.array([0 if sure(name) else -1 for name in variants], int)
    kinds |= {"variant": (least, np.array([len(members) - 1 for members in variants.values()], int))}
    for name, (least, most) in kinds.items():
        values = numbers.get(name, np.zeros(0))
        wrong = np.argwhere(~((values >= least) & (values <= most)) if values.size else [])
        if len(wrong):
            got = f"got {values[tuple(wrong[0])]} in row {wrong[0][0]}"
            raise SceneMismatchError(f"{where}.{name} should be from {least} to {most}, {got}.")
    for name, members in variants.items():
        there = numbers["present"][:, [compiled.slots.index(member) for member in members]].sum(axis=1)
        if (there > 1).any() or (sure(name) and not there.all()):
            number = "exactly" if sure(name) else "at most"
            raise SceneMismatchError(f"{where}.present: each row should have {number} one variant of '{name}'.")


def _on_device(table: LayoutTable, device: str) -> LayoutsView:
    """Return a table as a LayoutsView on the device, with the joints of grasps padded to the width of Layouts."""
    rows = {name: getattr(table, name) for name in ("param", *columns("draw", "pose", "grasp"))}
    padding = ((0, 0), (0, 0), (0, MAX_JOINTS - table.grasp_qpos.shape[2]))
    for name in ("grasp_qpos", "pregrasp_qpos"):
        rows[name] = np.pad(rows[name].astype(np.float32), padding, constant_values=np.nan)
    return view_of(len(table), device, rows)
