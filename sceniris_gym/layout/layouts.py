"""`Layouts`: the layout of each world, one per row, and counts of rejected candidates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.random import named_stream
from sceniris_gym.device.tensors import TensorView
from sceniris_gym.layout.columns import columns, row_types
from sceniris_gym.layout.params import ParamTable
from sceniris_gym.program.compiled import MOST_EPISODES, CompiledScene
from sceniris_gym.program.device import Cause, allocate, fill_struct, repeat
from sceniris_gym.program.reach import Reaching
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.scene.layout_table import COLUMNS
from sceniris_gym.scene.poses import joint_address, pose_address

LayoutKeys = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Seeds and episodes of layouts, shape (n,), and their param values, shape (n, nvalue)."""
ADVANCE = wp.constant(-1)
"""The `next_episode` of a world whose next layout is the next episode of its seed."""


class LayoutStatus(IntEnum):
    """State of a row of `Layouts`. The row holds the layout of one world."""

    NONE = 0
    """The row has no layout yet. During compilation, it may also be that no valid layout was found."""
    VALID = 1
    """A fresh layout that passed every test. Parts that no layout moves are not tested against each other."""
    FALLBACK = 2
    """Attempts and restarts ran out, so the row is a valid layout from the split's bank in the CompiledScene."""
    KEPT = 3
    """Attempts and restarts of a redraw ran out, so the objects keep their places."""


@wp.struct
class LayoutsView:
    """The arrays of a `Layouts`, as kernels take them."""

    # Key
    seed: wp.array[wp.uint64]
    episode: wp.array[int]
    param: wp.array2d[float]  # param values of the layout
    # Draws: the random key of physics and appearance
    draw_seed: wp.array[wp.uint64]
    draw_episode: wp.array[int]  # -1 if unknown
    draw_stream: wp.array[int]
    # State
    qpos: wp.array2d[float]
    mocap_pos: wp.array2d[wp.vec3]
    mocap_quat: wp.array2d[wp.quat]
    # Choices
    start: wp.array[int]
    present: wp.array2d[int]
    # Grasps
    grasp: wp.array2d[int]
    grasp_qpos: wp.array3d[float]
    pregrasp_qpos: wp.array3d[float]
    path: wp.array3d[float]
    # Counts
    status: wp.array[int]
    attempts: wp.array[int]
    first_pass_valid: wp.array[int]
    # Next: the layout that a reseed or a chooser selected
    next_seed: wp.array[wp.uint64]
    next_episode: wp.array[int]  # or ADVANCE
    # Pending: the layout that is being made. Its params are in `next_param`.
    pending_seed: wp.array[wp.uint64]
    pending_episode: wp.array[int]
    # Making
    stream: int  # of draws, for new layouts
    next_param: wp.array2d[float]
    default_param: wp.array[float]
    rejections: wp.array2d[wp.int64]  # more than 32 bits in long runs
    row_rejections: wp.array3d[int]  # rejected candidates of the row, by object and cause
    stable: wp.array2d[int]
    # Pivots
    pivot_pose: wp.array2d[wp.vec4]
    bounds: wp.array2d[wp.vec4]
    # Bodies
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]
    # Record
    rejected_cause: wp.array[int]
    rejected_object: wp.array[int]
    rejected_qpos: wp.array2d[float]
    rejected_mocap_pos: wp.array2d[wp.vec3]
    rejected_mocap_quat: wp.array2d[wp.quat]
    # Recording
    record_all: int
    rejected_count: wp.array[int]


def view_of(nrow: int, device: str, arrays: Mapping[str, Any]) -> LayoutsView:
    """Return a LayoutsView of the given arrays.

    A field without a given array gets an array that kernels may read. If the array has one axis, it has blank values.
    If it has several axes, its rows have width 0.

    Args:
        nrow: Number of rows.
        device: The device of the result.
        arrays: NumPy or Warp arrays by name of the field. Warp arrays on the device share their memory.
    """
    view = LayoutsView()  # pyrefly: ignore[missing-argument]
    for name, variable in LayoutsView.vars.items():  # pyrefly: ignore[missing-attribute]
        if isinstance(arrays.get(name), wp.array):
            setattr(view, name, arrays[name].to(device))
        elif name in arrays:
            fill_struct(LayoutsView, view, {name: arrays[name]}, device)
        elif wp.types.is_array(variable.type):
            shape = (0 if name.startswith("rejected") else nrow, 0, 0)[: variable.type.ndim]
            setattr(view, name, wp.zeros(shape, dtype=variable.type.dtype, device=device))
            column = COLUMNS.get(name.removeprefix("next_").removeprefix("pending_"))
            if column is not None:
                getattr(view, name).fill_(column.blank)
    return view


@wp.func
def next_key(layouts: LayoutsView, worldid: int):
    """Return seed and episode of a world's next layout: the chosen ones, or by default the next episode of its seed."""
    seed = layouts.seed[worldid]
    episode = (layouts.episode[worldid] + 1) % MOST_EPISODES
    if layouts.next_episode[worldid] != ADVANCE:
        seed = layouts.next_seed[worldid]
        episode = layouts.next_episode[worldid]
    return seed, episode


@wp.func
def open_episode(layouts: LayoutsView, worldid: int):
    """Set the seed and episode of the layout that is made next for a world: `pending_seed` and `pending_episode`.

    The draws of physics and appearance get the same seed and episode. If the world then falls back to the bank, the
    seed and episode of the draws are overwritten.
    """
    seed, episode = next_key(layouts, worldid)
    layouts.pending_seed[worldid] = seed
    layouts.pending_episode[worldid] = episode
    layouts.draw_seed[worldid] = seed
    layouts.draw_episode[worldid] = episode
    layouts.draw_stream[worldid] = layouts.stream


@wp.func
def copy_draws(source: LayoutsView, row: int, layouts: LayoutsView, worldid: int):
    """Copy a row's seed, episode and stream for the draws of physics and appearance to a world."""
    layouts.draw_seed[worldid] = source.draw_seed[row]
    layouts.draw_episode[worldid] = source.draw_episode[row]
    layouts.draw_stream[worldid] = source.draw_stream[row]


@wp.func
def close_episode(made: LayoutsView, layouts: LayoutsView, worldid: int):
    """Copy a world's new seed, episode and params, and the key of its drawn physics, from `made` to `layouts`.

    By default, the world's next layout is then the next episode of its seed.
    """
    for k in range(layouts.param.shape[1]):
        layouts.param[worldid, k] = made.next_param[worldid, k]
    copy_draws(made, worldid, layouts, worldid)
    layouts.seed[worldid] = made.pending_seed[worldid]
    layouts.episode[worldid] = made.pending_episode[worldid]
    layouts.next_episode[worldid] = ADVANCE


@wp.func
def copy_poses(source: Any, row: int, layouts: LayoutsView, worldid: int, i: int):
    """Copy entry `i` of each array of poses and presence from a row to a world, but no grasps.

    Entry 0 also copies the kind of start.
    """
    if i == 0:
        layouts.start[worldid] = source.start[row]
    if i < source.qpos.shape[1]:
        layouts.qpos[worldid, i] = source.qpos[row, i]
    if i < source.mocap_pos.shape[1]:
        layouts.mocap_pos[worldid, i] = source.mocap_pos[row, i]
        layouts.mocap_quat[worldid, i] = source.mocap_quat[row, i]
    if i < source.present.shape[1]:
        layouts.present[worldid, i] = source.present[row, i]


@wp.func
def copy_layout(source: Any, row: int, layouts: LayoutsView, worldid: int, i: int):
    """Copy entry `i` of each array of a layout from a row to a world, including grasps."""
    copy_poses(source, row, layouts, worldid, i)
    if i < source.grasp.shape[1]:
        layouts.grasp[worldid, i] = source.grasp[row, i]
        for j in range(source.grasp_qpos.shape[2]):
            layouts.grasp_qpos[worldid, i, j] = source.grasp_qpos[row, i, j]
            layouts.pregrasp_qpos[worldid, i, j] = source.pregrasp_qpos[row, i, j]
        for j in range(source.path.shape[2]):
            layouts.path[worldid, i, j] = source.path[row, i, j]


def allocate_record(view: LayoutsView, length: int) -> None:
    """Allocate a record of up to `length` rejected candidates."""
    shapes = {
        "rejected_count": 1,
        "rejected_cause rejected_object": length,
        "rejected_qpos": (length, view.qpos.shape[1]),
        "rejected_mocap_pos rejected_mocap_quat": (length, view.mocap_pos.shape[1]),
    }
    allocate(LayoutsView, view, shapes, view.qpos.device)


def layout_width(view: LayoutsView) -> int:
    """Return the number of entries that `copy_layout` has to copy, one entry per call."""
    return max(array.shape[1] for array in (view.qpos, view.mocap_pos, view.present, view.grasp))


def column_of(layouts: "Layouts", name: str) -> wp.array:
    """Return an array of `Layouts.view` without the rows for parallel restarts."""
    array = getattr(layouts.view, name)
    # Warp cannot slice an array without elements
    return array if array.shape[0] == layouts.nworld or array.size == 0 else array[: layouts.nworld]


@dataclass(frozen=True)
class Layouts(StaysHere):
    """Layouts of `nworld` worlds, as torch tensors that share memory with the Warp arrays in `view`.

    Attributes:
        compiled: The scene of the rows.
        view: The arrays as kernels take them. See `create` for their length. Arrays are never reallocated.
        params: The params of the worlds.
        seed: Seed of the current row, shape (nworld,), int64. From 2^63 on it is the two's complement, as in
            `info["layout"]`. After a reseed, it changes only when the next layout is served, or at once in a world
            without a layout.
        episode: Episode of the current row, -1 before the first, shape (nworld,), int32.
        param: Param values of the current row, shape (nworld, nvalue). Width 0 without params.
        draw_seed: Seed of the draws of physics and appearance, shape (nworld,), int64. It is the seed of the layout
            that the row contains, which differs from `seed` after a fallback and for stored layouts.
        draw_episode: Episode of these draws, shape (nworld,), int32. -1 if unknown.
        draw_stream: Random stream of these draws, shape (nworld,), int32.
        qpos: Joint positions [m, rad] in the order of the MjModel, quaternions wxyz, shape (nworld, nq).
        mocap_pos: Positions of mocap bodies [m], world frame, shape (nworld, nmocap, 3).
        mocap_quat: Orientations of mocap bodies, wxyz, shape (nworld, nmocap, 4).
        start: Index of the kind of start in the scene file, -1 if the scene has no `start`, shape (nworld,), int32.
        present: 1 for present objects, 0 for objects that a group left out, shape (nworld, nslot), slots in the order
            of `CompiledScene.slots`.
        grasp: The accepted grasp of each ReachTarget, as an index into its GraspSet in `CompiledScene.reaching`. -1 for
            absent objects, shape (nworld, nreach), targets in placement order.
        grasp_qpos: Joint positions [rad, m] of the target's arm in this grasp, shape (nworld, nreach, MAX_JOINTS). NaN
            beyond the arm's joints, and everywhere if reach was judged only by the arm's map.
        pregrasp_qpos: The same for the pre-grasp, shape (nworld, nreach, MAX_JOINTS). NaN for tiers below `clear`.
        path: The arm's joints at the start and the two vias of the path to the pre-grasp, MAX_JOINTS numbers each,
            shape (nworld, nreach, 24). NaN without a path, and of width 0 if no layout has a path.
        status: A `LayoutStatus` per world, shape (nworld,), int32.
        attempts: Candidates drawn for the row, summed over objects and restarts, shape (nworld,), int32.
        first_pass_valid: 1 for rows that needed no restart, shape (nworld,), int32.
        rejections: Running count of rejected candidates of all layouts so far, int64, shape (nobject, ncause), objects
            in placement order.
    """

    _SEND = "its arrays as copies on the host, such as layouts.qpos.cpu().clone(), or the ids that make its rows again"

    compiled: CompiledScene
    view: LayoutsView
    _mocap_pose: wp.array  # (nrow, nmocap, 8): an unused number, position, and orientation aligned as a vector of four
    params: ParamTable

    seed, episode, param, draw_seed, draw_episode, draw_stream = (TensorView(column_of) for _ in range(6))
    qpos, mocap_pos, mocap_quat, start, present = (TensorView(column_of) for _ in range(5))
    grasp, grasp_qpos, pregrasp_qpos, path = (TensorView(column_of) for _ in range(4))
    status, attempts, first_pass_valid = (TensorView(column_of) for _ in range(3))
    rejections = TensorView(lambda layouts, name: layouts.view.rejections)

    def __repr__(self) -> str:
        return f"<Layouts of {self.nworld} worlds of {self.compiled!r}>"

    def pose(self, name: str) -> Any:
        """Return the poses of an object as a torch tensor that shares memory with the layouts.

        Args:
            name: An object of the scene, or "robot". For an object with variants, the tensor is a copy with the pose of
                each world's present variant.

        Returns:
            Position [m] and orientation (wxyz) of the object's root body in the world frame, shape (nworld, 7).

        Raises:
            UnknownNameError: The scene has no such object.
            NotSupportedError: Joints other than a freejoint determine the pose of the root body.
        """
        variants = self.compiled.config.variants.get(name)
        if variants is not None:
            there = self.present[:, [self.compiled.slots.index(member) for member in variants]]
            first = there[:, :1] + (there.sum(1, keepdim=True) == 0)  # an absent object is parked as its first variant
            return self.pose(variants[0]) * first + sum(
                self.pose(member) * there[:, [i]] for i, member in enumerate(variants[1:], 1)
            )
        kind, number = pose_address(self.compiled.scene, name, "Layouts.pose")
        if kind == "qpos":
            return self.qpos[:, number : number + 7]
        if kind == "mocap":
            return wp.to_torch(self._mocap_pose)[: self.nworld, number, 1:]
        still = np.concatenate([self.compiled.home_xpos[number], self.compiled.home_xquat[number]])
        return wp.to_torch(wp.array(still, dtype=float, device=self.compiled.device)).expand(self.nworld, 7)

    def joint(self, name: str) -> Any:
        """Return the positions of a joint as a torch tensor that shares memory with the layouts.

        Args:
            name: The joint's name in the model, `object/joint`, or only its name inside the object if that name is
                unique. A joint or part of an object with variants gives a copy, NaN where the present variant lacks it.

        Returns:
            Positions [m or rad], shape (nworld,). For a ball joint (nworld, 4), for a freejoint (nworld, 7).

        Raises:
            UnknownNameError: There is no such joint, or several objects have it.
        """
        owner, _, local = str(name).partition("/")
        named = self.compiled.scene.joints_named(owner, local) if owner in self.compiled.config.variants else {}
        if owned := {member: joint for member, joint in named.items() if joint is not None}:
            values = self.qpos[:, 0].new_full((self.nworld,), np.nan)
            for member, joint in owned.items():
                there = self.present[:, self.compiled.slots.index(member)] > 0
                values = self.qpos[:, int(self.compiled.mjm.jnt_qposadr[joint])].where(there, values)
            return values
        adr, width = joint_address(self.compiled.scene, name, "Layouts.joint")
        return self.qpos[:, adr] if width == 1 else self.qpos[:, adr : adr + width]

    @classmethod
    def create(
        cls, compiled: CompiledScene, nworld: int, *, rows: int = 0, params: Sequence[str] = (), split: str = "train"
    ) -> "Layouts":
        """Allocate `nworld` layouts, without a record of rejected candidates.

        The arrays in `view` have `rows` more rows after the rows of the worlds, for restarts in parallel. `params` are
        names, see `ParamTable`. Physics and appearance of new layouts use the random streams of `split`.
        """
        device, mjm = compiled.device, compiled.mjm
        # a row of `_mocap_pose`, with the model's poses of bodies that are never placed
        poses = np.tile([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (max(mjm.nmocap, 1), 1))
        mocap = np.flatnonzero(mjm.body_mocapid >= 0)
        poses[mjm.body_mocapid[mocap], 1:] = np.hstack([mjm.body_pos[mocap], mjm.body_quat[mocap]])
        nrow, nreach = nworld + rows, 0 if compiled.reaching is None else len(compiled.reaching.targets)
        program, table = compiled.program, ParamTable(compiled, params)
        own = np.tile(table.default, (nworld, 1))
        view = view_of(nworld, device, {"param": own, "next_param": own, "default_param": table.default})
        stands = {"pivot_pose": program.home_pivot_pose.numpy(), "bounds": program.home_bounds.numpy()}
        repeat(LayoutsView, view, nrow, {**compiled.home_state, **stands}, device)
        counts = max(len(compiled.placed), 1), len(Cause)
        shapes = {"rejections": counts, "row_rejections": (nrow, *counts), "stable": (nrow, nreach)}
        allocate(LayoutsView, view, shapes, device)
        with wp.ScopedDevice(device):
            mocap_pose = wp.array(np.tile(poses, (nrow, 1, 1)), dtype=float)
            view.mocap_pos = mocap_pose[:, :, 1:4].view(wp.vec3)
            view.mocap_quat = mocap_pose[:, :, 4:].view(wp.quat)
            for name, (_, shape) in row_types(compiled, njoint=MAX_JOINTS).items():
                if name in columns("pose", "grasp") and name not in ("qpos", "mocap_pos", "mocap_quat"):
                    # pyrefly: ignore[missing-attribute]
                    full, dtype = (nworld if 0 in shape else nrow, *shape), LayoutsView.vars[name].type.dtype
                    setattr(view, name, wp.full(full, COLUMNS[name].blank, dtype=dtype))
            view.present.fill_(1)
            view.stream = named_stream(split)
            allocate_record(view, 0)
        return cls(compiled, view, mocap_pose, table)

    def ids(self, split: str, keys: LayoutKeys | None = None) -> list[str]:
        """Return the ids of the layouts.

        An id includes the params that differ from the scene file. Waits for the device.

        Args:
            split: Split of the ids, "train" or "eval".
            keys: Seeds, episodes and param values of other layouts, one row per layout. If None, the ids are for the
                present layouts.

        Raises:
            ArgumentError: `split` has another value, or a world has no layout.
        """
        view = self.view
        rows = zip(*(keys or (view.seed.numpy(), view.episode.numpy(), view.param.numpy())), strict=True)
        return [self.compiled.layout_id(seed, episode, split, self.params.text(param)) for seed, episode, param in rows]

    @property
    def nworld(self) -> int:
        """Number of worlds."""
        return self.view.seed.shape[0]

    @property
    def reaching(self) -> Reaching | None:
        """The arms, and their reach targets with grasps. None if the scene has no reach targets."""
        return self.compiled.reaching
