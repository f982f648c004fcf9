"""`StoredLayouts`: a layout source that serves stored layouts, for tests and for evaluation on a fixed set."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from sceniris_gym.device.launch_lock import launching
from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.errors import SceneMismatchError, check_type
from sceniris_gym.layout.counts import as_count
from sceniris_gym.layout.generate import check_mask
from sceniris_gym.layout.layouts import Layouts, Status
from sceniris_gym.layout.seeds import launch_reseed, seeds_on_device
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.scene.layout_table import LayoutTable

wp.set_module_options({"enable_backward": False})

# How far squared lengths of quaternions may be from 1.
_UNIT = 1.0e-4


@wp.kernel
def _serve(
    # Stored in:
    qpos_in: wp.array2d[float],
    mocap_pos_in: wp.array2d[wp.vec3],
    mocap_quat_in: wp.array2d[wp.quat],
    present_in: wp.array2d[int],
    grasp_in: wp.array2d[int],
    grasp_qpos_in: wp.array3d[float],
    pregrasp_qpos_in: wp.array3d[float],
    # In:
    mask: wp.array[wp.bool],
    seed: wp.array[wp.uint64],
    stride: int,
    # Layouts out:
    episode_out: wp.array[int],
    qpos_out: wp.array2d[float],
    mocap_pos_out: wp.array2d[wp.vec3],
    mocap_quat_out: wp.array2d[wp.quat],
    present_out: wp.array2d[int],
    grasp_out: wp.array2d[int],
    grasp_qpos_out: wp.array3d[float],
    pregrasp_qpos_out: wp.array3d[float],
    status_out: wp.array[int],
):
    worldid = wp.tid()
    if not mask[worldid]:
        return
    episode = episode_out[worldid] + 1
    row = int((seed[worldid] + wp.uint64(episode) * wp.uint64(stride)) % wp.uint64(qpos_in.shape[0]))
    for i in range(qpos_in.shape[1]):
        qpos_out[worldid, i] = qpos_in[row, i]
    for i in range(mocap_pos_in.shape[1]):
        mocap_pos_out[worldid, i] = mocap_pos_in[row, i]
        mocap_quat_out[worldid, i] = mocap_quat_in[row, i]
    for i in range(present_in.shape[1]):
        present_out[worldid, i] = present_in[row, i]
    for i in range(grasp_in.shape[1]):
        grasp_out[worldid, i] = grasp_in[row, i]
        for j in range(grasp_qpos_in.shape[2]):
            grasp_qpos_out[worldid, i, j] = grasp_qpos_in[row, i, j]
            pregrasp_qpos_out[worldid, i, j] = pregrasp_qpos_in[row, i, j]
    episode_out[worldid] = episode
    status_out[worldid] = Status.VALID


class StoredLayouts(StaysHere):
    """Serves row `((seed + stride * episode) mod 2^64) mod nrow` of a table; a `LayoutSource`, as `LayoutGenerator` is.

    Args:
        compiled: The scene that the layouts are of.
        table: The layouts. A table of states alone (`LayoutTable.from_states`) has no grasps.
        nworld: Number of worlds.
        seed: World i gets seed + i; a sequence of length nworld is used as it is. 64-bit, not negative.
        stride: How many rows a world goes on with every episode. With 1, worlds whose seeds follow each other see the
            same rows one after another; with nworld - 1 they go through a table that is larger than their number.

    Attributes:
        layouts: The rows served last, with status VALID once a world has one.

    Raises:
        ArgumentTypeError: `compiled` is no CompiledScene, or `table` no LayoutTable.
        CountError: A number of worlds or a stride that is no integer, or out of range.
        SeedError: A seed that is not a 64-bit integer, or a wrong number of them.
        SceneMismatchError: A table without rows, or of another scene.
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
        self.layouts = Layouts.create(compiled, nworld)
        _check_table(compiled, table)
        _check_rows(compiled, table)
        self.device = compiled.device
        self._stored = _on_device(table, self.device)
        self._all = wp.ones(nworld, dtype=wp.bool, device=self.device)
        self.reseed(seed)

    @launching
    def reseed(self, seed: int | Sequence[int] | np.ndarray | wp.array, mask: wp.array | None = None) -> None:
        """Give the masked worlds (None: all) new seeds, as in the class; their next layouts are those of episode 0."""
        check_mask(mask, self.layouts)
        self.launch_reseed(seeds_on_device(seed, self.layouts.nworld, self.device), mask)

    @launching
    def generate(self, mask: wp.array | None = None) -> None:
        """Serve the next row to the masked worlds (None: all)."""
        check_mask(mask, self.layouts)
        self.launch_generate(mask)

    def launch_reseed(self, seeds: wp.array, mask: wp.array | None) -> None:
        """See `LayoutSource`."""
        launch_reseed(seeds, mask, self.layouts.seed, self.layouts.episode)

    def launch_generate(self, mask: wp.array | None) -> None:
        """Serve the next row to the masked worlds; see `LayoutSource`."""
        out = self.layouts
        wp.launch(
            _serve,
            dim=out.nworld,
            inputs=[*self._stored, self._all if mask is None else mask, out.seed, self._stride],
            outputs=[
                out.episode,
                out.qpos,
                out.mocap_pos,
                out.mocap_quat,
                out.present,
                out.grasp,
                out.grasp_qpos,
                out.pregrasp_qpos,
                out.status,
            ],
            device=self.device,
        )

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """Return no counts: stored layouts are not searched for."""
        return {}


def _check_table(compiled: CompiledScene, table: LayoutTable) -> None:
    """Refuse columns that the kernel would read beyond their ends."""
    mjm, nrow, nreach = compiled.mjm, len(table), table.grasp.shape[1]
    known = 0 if compiled.reaching is None else len(compiled.reaching.targets)
    joints = table.grasp_qpos.shape[2] if table.grasp_qpos.ndim == 3 else -1
    wanted = {
        "qpos": (mjm.nq,),
        "mocap_pos": (mjm.nmocap, 3),
        "mocap_quat": (mjm.nmocap, 4),
        "present": (len(compiled.slots),),
        "grasp": (0 if nreach == 0 else known,),
        "grasp_qpos": (nreach, min(joints, MAX_JOINTS)),
        "pregrasp_qpos": (nreach, min(joints, MAX_JOINTS)),
    }
    for name, shape in wanted.items():
        found = getattr(table, name).shape
        if nrow == 0 or found != (nrow, *shape):
            wanted_shape = ", ".join(map(str, ("nrow", *shape)))
            raise SceneMismatchError(
                f"StoredLayouts: table.{name} should have shape ({wanted_shape}), with one row or more and as many as "
                f"the other columns, got {found}. Store layouts of the same scene."
            )


def _check_rows(compiled: CompiledScene, table: LayoutTable) -> None:
    """Refuse rows with a number that is not finite, or with a quaternion that is not of length one."""
    first = compiled.program.quat_qposadr.numpy()
    quats = np.concatenate([table.qpos[:, first[:, None] + np.arange(4)], table.mocap_quat], axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        unit = np.abs(np.square(quats.astype(float)).sum(axis=2) - 1.0) < _UNIT
        finite = np.isfinite(table.qpos).all(axis=1) & np.isfinite(table.mocap_pos).all(axis=(1, 2))
    wrong = np.flatnonzero(~(finite & unit.all(axis=1)))
    if len(wrong):
        raise SceneMismatchError(
            f"StoredLayouts: row {wrong[0]} of the table holds a number that is not finite, or a quaternion whose "
            f"length is not 1 ({len(wrong)} rows of {len(table)} do). Store layouts as a generator makes them."
        )


def _on_device(table: LayoutTable, device: str) -> list[wp.array]:
    """The columns that are served, joints of grasps as wide as Layouts have them."""

    def wide(qpos: np.ndarray) -> np.ndarray:
        nrow, nreach, njoint = qpos.shape
        padded = np.full((nrow, nreach, MAX_JOINTS), np.nan, np.float32)
        padded[:, :, :njoint] = qpos
        return padded

    with wp.ScopedDevice(device):
        return [
            wp.array(table.qpos, dtype=float, ndim=2),
            wp.array(table.mocap_pos, dtype=wp.vec3, ndim=2),
            wp.array(table.mocap_quat, dtype=wp.quat, ndim=2),
            wp.array(table.present, dtype=int, ndim=2),
            wp.array(table.grasp, dtype=int, ndim=2),
            wp.array(wide(table.grasp_qpos), dtype=float, ndim=3),
            wp.array(wide(table.pregrasp_qpos), dtype=float, ndim=3),
        ]
