"""`Redraw`: new places for some objects of a scene, while all other objects stay in place.

Each row begins from a state: a LayoutsView with seeds, episodes, keys of draws, kinds of start, presence, and positions
of joints and mocap bodies. Body poses and the bounds of anchors are computed from these positions as in
`mj_kinematics`, because body poses in the simulation may be one step older.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.variants import with_variants
from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.random import REDRAW_STREAM, philox
from sceniris_gym.device.transforms import mul_quat, quat_mat, quat_z, rot_vec_quat, unit_circle
from sceniris_gym.layout.layouts import LayoutStatus, LayoutsView, copy_draws, copy_poses, layout_width
from sceniris_gym.layout.wave.search import Search, Workspace, numbered_stream
from sceniris_gym.placement.kinematics import pose_body
from sceniris_gym.placement.measure import bounds_of, heading_of
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import OrientationType, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


class RedrawCounts(NamedTuple):
    """Counts of redraws, on the device, all int32.

    Attributes:
        number: Redraws of each world since its reset, shape (nworld,).
        status: The latest `LayoutStatus` of each world: VALID, KEPT, or NONE if it had no redraw, shape (nworld,).
        kept: Running number of redraws that found no place, shape (1,).
    """

    number: wp.array
    status: wp.array
    kept: wp.array

    @classmethod
    def zeros(cls, nworld: int, device: str | wp.Device) -> RedrawCounts:
        """Return counts of 0."""
        return cls(*(wp.zeros(num, dtype=int, device=device) for num in (nworld, nworld, 1)))


# An object further than this [m] from all surfaces of its support is held or elsewhere, and has no carrying surface.
_LIFTED = wp.constant(0.01)


@wp.func
def _pose_given(program: Program, adr: wp.vec3i, layouts: LayoutsView, row: int, body: int):
    """Compute the pose of a row's body from the pose of its parent.

    `adr` has the addresses of the body's freejoint and ball joint in `qpos`, and its mocap id, each -1 if missing.
    """
    qpos = layouts.qpos[row]
    k = wp.where(adr[0] >= 0, adr[0] + 3, adr[1])
    if adr[0] >= 0:
        layouts.body_pos[row, body] = wp.vec3(qpos[k - 3], qpos[k - 2], qpos[k - 1])
        layouts.body_quat[row, body] = wp.normalize(wp.vec4(qpos[k], qpos[k + 1], qpos[k + 2], qpos[k + 3]))
    elif adr[1] >= 0:
        parent = program.body_parent[body]
        outer = layouts.body_quat[row, parent]
        anchor = program.jnt_pos[program.body_jntadr[body]]
        quat = mul_quat(outer, program.body_quat[body])
        pivot = layouts.body_pos[row, parent] + rot_vec_quat(program.body_pos[body], outer) + rot_vec_quat(anchor, quat)
        quat = mul_quat(quat, wp.normalize(wp.vec4(qpos[k], qpos[k + 1], qpos[k + 2], qpos[k + 3])))
        layouts.body_pos[row, body] = pivot - rot_vec_quat(anchor, quat)
        layouts.body_quat[row, body] = quat
    elif adr[2] >= 0:
        q = layouts.mocap_quat[row, adr[2]]
        layouts.body_pos[row, body] = layouts.mocap_pos[row, adr[2]]
        layouts.body_quat[row, body] = wp.vec4(q[0], q[1], q[2], q[3])
    else:
        pose_body(program, body, qpos, layouts.body_pos[row], layouts.body_quat[row])


@wp.func
def _stable_of(program: Program, obj: int, quat: wp.vec4) -> int:
    """Return the object's stable pose that is nearest to an orientation."""
    stable = program.obj_stableadr[obj]
    flat = mul_quat(quat_z(-heading_of(quat)), quat)  # at heading 0, like stable poses
    for v in range(stable, program.obj_stableadr[obj] + program.obj_stablenum[obj]):
        # a quaternion and its negative are the same orientation
        if wp.abs(wp.dot(program.stable_quat[v], flat)) > wp.abs(wp.dot(program.stable_quat[stable], flat)):
            stable = v
    return stable


@wp.func
def _place_anchor(program: Program, layouts: LayoutsView, row: int, obj: int):
    """Write pivot pose and bounds of an anchor in its current pose, for the stable pose nearest to its orientation."""
    root = program.obj_body[obj]
    quat = layouts.body_quat[row, root]
    pivot_pose = layouts.pivot_pose[row, program.obj_column[obj]]
    if program.obj_stablenum[obj] > 0:
        stable = _stable_of(program, obj, quat)
        at = layouts.body_pos[row, root] + quat_mat(quat) * program.stable_pivot[stable]
        pivot_pose = wp.vec4(at[0], at[1], at[2], heading_of(quat))
    bounds = wp.vec4(0.0)
    if program.obj_piecenum[obj] > 0:
        bounds = bounds_of(program, obj, pivot_pose, layouts.body_pos[row], layouts.body_quat[row])
    if program.obj_orientation[obj] == OrientationType.ANY:
        x = 0.5 * (bounds[0] + bounds[2])
        y = 0.5 * (bounds[1] + bounds[3])
        to = unit_circle(pivot_pose[3])
        pivot_pose += wp.vec4(x * to[0] - y * to[1], x * to[1] + y * to[0], 0.0, 0.0)
        bounds -= wp.vec4(x, y, x, y)
    layouts.pivot_pose[row, program.obj_column[obj]] = pivot_pose
    layouts.bounds[row, program.obj_column[obj]] = bounds


@wp.kernel
def _read_state(
    program: Program,
    mask: wp.array[bool],
    split: wp.uint32,
    # For each body: address of its freejoint in qpos, address of its ball joint, and mocap id, each -1 if missing
    body_adr: wp.array[wp.vec3i],
    # Elements of qpos to draw again, placed objects that are supports or anchors, and slots to make present:
    is_redrawn: wp.array[bool],
    anchor: wp.array[int],
    added: wp.array[int],
    # In:
    number: wp.array[int],
    origins: wp.array[wp.vec3],
    # Layouts in: seed, episode, draws*, state*, present
    state: LayoutsView,
    # Layouts out: draws*, pending*, bounds; both: state*, present, pivot_pose, bodies*
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if not mask[worldid]:
        return
    episode, stream = state.episode[worldid], numbered_stream(split, wp.static(REDRAW_STREAM))
    counter = wp.vec4ui(wp.uint32(episode), stream, wp.uint32(number[worldid]), wp.uint32(0))
    words = philox(state.seed[worldid], counter)
    layouts.pending_seed[worldid] = wp.uint64(words[0]) | (wp.uint64(words[1]) << wp.uint64(32))
    layouts.pending_episode[worldid] = episode
    copy_draws(state, worldid, layouts, worldid)
    for i in range(layouts.present.shape[1]):
        layouts.present[worldid, i] = state.present[worldid, i]
    for i in range(added.shape[0]):
        layouts.present[worldid, added[i]] = 1
    for i in range(layouts.qpos.shape[1]):
        layouts.qpos[worldid, i] = wp.where(is_redrawn[i], program.home_qpos[i], state.qpos[worldid, i])
    for i in range(state.mocap_pos.shape[1]):  # layouts of a model without mocap bodies have an unused one
        layouts.mocap_pos[worldid, i] = state.mocap_pos[worldid, i]
        layouts.mocap_quat[worldid, i] = wp.normalize(state.mocap_quat[worldid, i])
    for body in range(1, program.body_parent.shape[0]):
        adr = body_adr[body]
        if origins:
            if adr[2] >= 0:
                layouts.mocap_pos[worldid, adr[2]] -= origins[worldid]
            elif adr[0] >= 0:
                for i in range(3):
                    layouts.qpos[worldid, adr[0] + i] -= origins[worldid][i]
        _pose_given(program, adr, layouts, worldid, body)
    for i in range(anchor.shape[0]):
        if layouts.present[worldid, program.obj_slot[anchor[i]]] != 0:
            _place_anchor(program, layouts, worldid, anchor[i])


@wp.kernel
def _find_carriers(
    program: Program,
    mask: wp.array[bool],
    # Layouts in: pivot_pose, bodies*
    layouts: LayoutsView,
    # Search out: placed*
    search: Search,
):
    worldid, obj = wp.tid()
    ground = program.obj_ground[obj]
    if not mask[worldid] or ground < 0:
        return
    stable = _stable_of(program, obj, layouts.body_quat[worldid, program.obj_body[obj]])
    search.row_stable[worldid, obj] = stable
    pivot_pose = layouts.pivot_pose[worldid, program.obj_column[obj]]
    at = wp.vec3(pivot_pose[0], pivot_pose[1], pivot_pose[2]) - layouts.body_pos[worldid, ground]
    height = wp.dot(at, quat_mat(layouts.body_quat[worldid, ground]) * wp.vec3(0.0, 0.0, 1.0))
    nearest = float(_LIFTED)
    search.row_surface[worldid, obj] = -1
    for i in range(program.stable_trinum[stable]):
        surface = program.tri_surface[program.stable_triadr[stable] + i]
        distance = wp.abs(program.surface_height[surface] - height)
        if distance < nearest:
            nearest = distance
            search.row_surface[worldid, obj] = surface


@wp.kernel
def _finish(
    mask: wp.array[bool],
    width: int,
    # Layouts in: seed, episode, state*, choices*
    state: LayoutsView,
    # Layouts out: seed, episode, state*, choices*; both: status
    layouts: LayoutsView,
    # Out:
    placed_out: wp.array[bool],
    number_out: wp.array[int],
    status_out: wp.array[int],
    kept_out: wp.array[int],
):
    worldid = wp.tid()
    placed_out[worldid] = False
    if not mask[worldid]:
        return
    number_out[worldid] += 1
    layouts.seed[worldid] = state.seed[worldid]
    layouts.episode[worldid] = state.episode[worldid]
    layouts.start[worldid] = state.start[worldid]
    status_out[worldid] = LayoutStatus.VALID
    if layouts.status[worldid] == LayoutStatus.VALID:
        placed_out[worldid] = True
        return
    layouts.status[worldid] = LayoutStatus.KEPT
    status_out[worldid] = LayoutStatus.KEPT
    wp.atomic_add(kept_out, 0, 1)
    # grasps are not copied: `state` has columns for all targets, `layouts` only for redrawn targets
    for i in range(width):
        copy_poses(state, worldid, layouts, worldid, i)


class Redraw(StaysHere):
    """Finds new places for some objects of a state, while all its other objects stay in place.

    A redraw is a pure function of scene, split, seed, episode, redraw number and state. Other objects are obstacles
    and relation anchors. Their horizontal surfaces are also supports. Absent objects stay absent unless `adds` is set.

    Args:
        compiled: The scene.
        objects: Names of the objects to move, as `chosen_objects` returns them.
        generator: A LayoutGenerator of the part of the scene that places only these objects. See `part_of`.
        adds: Whether absent objects become present if they are in `objects` and have no variants.

    Attributes:
        bodies: Ids of the bodies of the objects.
        layouts: The layouts after their latest redraw. `status` is VALID, or KEPT if no place was found.
        placed: Worlds whose objects got new places in the latest redraw, shape (nworld,), bool.
    """

    def __init__(self, compiled: CompiledScene, objects: Sequence[str], generator: Any, *, adds: bool) -> None:
        mjm, config = compiled.mjm, compiled.config
        self.bodies = [body for name in objects for body in compiled.scene.subtree(name)]
        self.layouts, self._program, self._device = generator.layouts, compiled.program, compiled.device
        self._work: Workspace = generator._work
        self._make: Callable[[wp.array, Callable[[], None]], None] = generator.launch_make
        adr = np.full((mjm.nbody, 3), -1)
        for i, kind in enumerate((mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)):
            joints = mjm.jnt_type == kind
            adr[mjm.jnt_bodyid[joints], i] = mjm.jnt_qposadr[joints]
        adr[:, 2] = mjm.body_mocapid
        owner = np.repeat(mjm.jnt_bodyid, np.diff([*mjm.jnt_qposadr, mjm.nq]))
        part, needed = self.layouts.compiled, {n for name in objects for n in config.parts[name].needs}
        needed = with_variants([*needed, *part.placed[: part.program.ngiven]], config.variants)
        anchors = [i for i, name in enumerate(compiled.placed) if name in needed and name not in objects]
        # the presence of variants does not change, so that an object never has two of them
        slots = [compiled.slots.index(name) for name in objects if adds and name not in config.owners]
        with wp.ScopedDevice(self._device):
            self._given = [wp.array(adr, dtype=wp.vec3i), wp.array(np.isin(owner, self.bodies), dtype=bool)]
            self._given += [wp.array(anchors, dtype=int, ndim=1), wp.array(slots, dtype=int, ndim=1)]
            self.placed = wp.zeros(self.layouts.nworld, dtype=wp.bool)

    def launch(self, state: LayoutsView, mask: wp.array, counts: RedrawCounts, origins: wp.array | None = None) -> None:
        """Redraw the objects in the masked worlds.

        Args:
            state: Seeds, episodes, keys of draws, kinds of start, presence, and positions of joints and mocap bodies.
            mask: Selected worlds, shape (nworld,), bool.
            counts: Counts to increase.
            origins: Origins of the worlds [m], shape (nworld,), vec3, to subtract from the positions of `state`.
        """
        view, device, nworld = self.layouts.view, self._device, self.layouts.nworld
        read = [self._program, mask, self._work.split, *self._given, counts.number, origins, state]
        program, search = self._work.program, self._work.search

        def prepare() -> None:
            wp.launch(_read_state, nworld, read, [view], device=device)
            if self._work.statics is not None and program.ngiven > 0:
                dim = nworld, program.ngiven
                wp.launch(_find_carriers, dim, [program, mask, view], [search], device=device)

        self._make(mask, prepare)
        wp.launch(_finish, nworld, [mask, layout_width(view), state, view], [self.placed, *counts], device=device)
