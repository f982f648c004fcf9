"""`Redraw`: new places for some objects of a scene, while all else stays where it is.

Rows begin with a state: its positions, the poses of bodies that follow, as `mj_kinematics` has them, and what relations
see of these. The poses of bodies in a state may be one step older than its positions, so they are not read.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.variants import with_variants
from sceniris_gym.device.angles import unit_circle
from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.device.quaternions import mul_quat, rot_vec_quat
from sceniris_gym.device.random import REDRAW_STREAM, SPLITS, philox
from sceniris_gym.device.transforms import quat_mat, quat_z
from sceniris_gym.layout.layouts import Layouts, LayoutsView, Status
from sceniris_gym.layout.wave.search import numbered_stream
from sceniris_gym.placement.kinematics import pose_body
from sceniris_gym.placement.measure import bounds_of
from sceniris_gym.placement.orientations import heading_of
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import OrientationType, Program, fill_struct

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


class State(NamedTuple):
    """The state of worlds that objects are redrawn in, on the device.

    Attributes:
        seed: Seeds, shape (nworld,), uint64.
        episode: Episodes, shape (nworld,), int32.
        present: 1 for each slot that is present, shape (nworld, nslot), int32.
        qpos: Joint positions [m, rad], quaternions wxyz, shape (nworld, nq).
        mocap_pos: Positions of mocap bodies [m], world frame, shape (nworld, nmocap).
        mocap_quat: Their orientations, wxyz inside `wp.quat`, shape (nworld, nmocap).
    """

    seed: wp.array
    episode: wp.array
    present: wp.array
    qpos: wp.array
    mocap_pos: wp.array
    mocap_quat: wp.array


@wp.struct
class _Given:
    """The parts of a state that are read, and joints that `Program` does not know."""

    body_free: wp.array[int]  # address of the pose of its freejoint, or -1
    body_ball: wp.array[int]  # address of the orientation of its ball joint, or -1
    body_mocapid: wp.array[int]
    is_redrawn: wp.array[bool]  # elements of qpos that are not read
    anchor: wp.array[int]  # placed objects that redrawn ones refer to


@wp.func
def _quat_at(qpos: wp.array[float], adr: int) -> wp.vec4:
    return wp.normalize(wp.vec4(qpos[adr], qpos[adr + 1], qpos[adr + 2], qpos[adr + 3]))


@wp.func
def _pose_given(program: Program, given: _Given, layouts: LayoutsView, row: int, body: int):
    """Pose a body of a row by its joints or its mocap pose; its parent is posed."""
    qpos = layouts.qpos[row]
    free = given.body_free[body]
    ball = given.body_ball[body]
    mocap = given.body_mocapid[body]
    if free >= 0:
        layouts.body_pos[row, body] = wp.vec3(qpos[free], qpos[free + 1], qpos[free + 2])
        layouts.body_quat[row, body] = _quat_at(qpos, free + 3)
    elif mocap >= 0:
        q = layouts.mocap_quat[row, mocap]
        layouts.body_pos[row, body] = layouts.mocap_pos[row, mocap]
        layouts.body_quat[row, body] = wp.vec4(q[0], q[1], q[2], q[3])
    elif ball >= 0:
        parent = program.body_parent[body]
        turn = layouts.body_quat[row, parent]
        anchor = program.jnt_pos[program.body_jntadr[body]]
        quat = mul_quat(turn, program.body_quat[body])
        pivot = layouts.body_pos[row, parent] + rot_vec_quat(program.body_pos[body], turn) + rot_vec_quat(anchor, quat)
        quat = mul_quat(quat, _quat_at(qpos, ball))
        layouts.body_pos[row, body] = pivot - rot_vec_quat(anchor, quat)
        layouts.body_quat[row, body] = quat
    else:
        pose_body(program, body, qpos, layouts.body_pos[row], layouts.body_quat[row])


@wp.func
def _place_anchor(program: Program, layouts: LayoutsView, row: int, obj: int):
    """Write the place and the bounds of an object as it is: its pivot is that of the pose which it is turned to."""
    root = program.obj_body[obj]
    quat = layouts.body_quat[row, root]
    place = layouts.place[row, program.obj_place[obj]]
    variant = program.obj_variantadr[obj]
    if program.obj_variantnum[obj] > 0:
        heading = heading_of(quat)
        flat = mul_quat(quat_z(-heading), quat)
        for v in range(variant, program.obj_variantadr[obj] + program.obj_variantnum[obj]):
            if wp.abs(wp.dot(program.variant_quat[v], flat)) > wp.abs(wp.dot(program.variant_quat[variant], flat)):
                variant = v
        at = layouts.body_pos[row, root] + quat_mat(quat) * program.variant_pivot[variant]
        place = wp.vec4(at[0], at[1], at[2], heading)
    bounds = wp.vec4(0.0)
    if program.obj_piecenum[obj] > 0:
        bounds = bounds_of(program, obj, place, layouts.body_pos[row], layouts.body_quat[row])
    if program.obj_orientation[obj] == OrientationType.ANY:
        x = 0.5 * (bounds[0] + bounds[2])
        y = 0.5 * (bounds[1] + bounds[3])
        to = unit_circle(place[3])
        place += wp.vec4(x * to[0] - y * to[1], x * to[1] + y * to[0], 0.0, 0.0)
        bounds -= wp.vec4(x, y, x, y)
    layouts.place[row, program.obj_place[obj]] = place
    layouts.bounds[row, program.obj_place[obj]] = bounds


@wp.kernel
def _read_state(
    program: Program,
    given: _Given,
    mask: wp.array[bool],
    split: wp.uint32,
    # State in:
    number: wp.array[int],
    origins: wp.array[wp.vec3],
    added: wp.array[int],
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    present: wp.array2d[int],
    qpos: wp.array2d[float],
    mocap_pos: wp.array2d[wp.vec3],
    mocap_quat: wp.array2d[wp.quat],
    # Layouts in: qpos, mocap_pos, mocap_quat, present, place, body_pos, body_quat
    # Layouts out: qpos, mocap_pos, mocap_quat, present, pending_seed, pending_episode, place, bounds, body_pos,
    #   body_quat
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    draw = int(0)
    if number:
        draw = number[worldid] + 1
    stream = numbered_stream(split, wp.static(REDRAW_STREAM))
    words = philox(seed[worldid], wp.vec4ui(wp.uint32(episode[worldid]), stream, wp.uint32(draw), wp.uint32(0)))
    layouts.pending_seed[worldid] = wp.uint64(words[0]) | (wp.uint64(words[1]) << wp.uint64(32))
    layouts.pending_episode[worldid] = episode[worldid]
    for i in range(layouts.present.shape[1]):
        layouts.present[worldid, i] = present[worldid, i]
    if added:
        for i in range(added.shape[0]):
            layouts.present[worldid, added[i]] = 1
    for i in range(layouts.qpos.shape[1]):
        layouts.qpos[worldid, i] = wp.where(given.is_redrawn[i], program.home_qpos[i], qpos[worldid, i])
    for i in range(mocap_pos.shape[1]):  # layouts have an unused one where there is none
        layouts.mocap_pos[worldid, i] = mocap_pos[worldid, i]
        layouts.mocap_quat[worldid, i] = wp.normalize(mocap_quat[worldid, i])
    for body in range(1, program.body_parent.shape[0]):
        if origins:
            if given.body_mocapid[body] >= 0:
                layouts.mocap_pos[worldid, given.body_mocapid[body]] -= origins[worldid]
            elif given.body_free[body] >= 0:
                for i in range(3):
                    layouts.qpos[worldid, given.body_free[body] + i] -= origins[worldid][i]
        _pose_given(program, given, layouts, worldid, body)
    for i in range(given.anchor.shape[0]):
        if layouts.present[worldid, program.obj_slot[given.anchor[i]]] != 0:
            _place_anchor(program, layouts, worldid, given.anchor[i])


@wp.kernel
def _finish(
    mask: wp.array[bool],
    # State in:
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    present: wp.array2d[int],
    qpos: wp.array2d[float],
    mocap_pos: wp.array2d[wp.vec3],
    mocap_quat: wp.array2d[wp.quat],
    # Layouts in: status
    # Layouts out: seed, episode, qpos, mocap_pos, mocap_quat, status, present
    layouts: LayoutsView,
    # Out:
    placed_out: wp.array[bool],
):
    worldid = wp.tid()
    placed_out[worldid] = False
    if mask:
        if not mask[worldid]:
            return
    layouts.seed[worldid] = seed[worldid]
    layouts.episode[worldid] = episode[worldid]
    if layouts.status[worldid] == Status.VALID:
        placed_out[worldid] = True
        return
    layouts.status[worldid] = Status.KEPT
    for i in range(layouts.present.shape[1]):
        layouts.present[worldid, i] = present[worldid, i]
    for i in range(layouts.qpos.shape[1]):
        layouts.qpos[worldid, i] = qpos[worldid, i]
    for i in range(mocap_pos.shape[1]):
        layouts.mocap_pos[worldid, i] = mocap_pos[worldid, i]
        layouts.mocap_quat[worldid, i] = mocap_quat[worldid, i]


class Redraw(StaysHere):
    """A search for new places of some objects among everything else, which it reads from a state.

    A redraw is a pure function of scene, split, seed, episode, number of the redraw and state. Everything but the named
    objects is an obstacle, a support if it is level, and an anchor of relations. Absent objects stay absent.

    Args:
        compiled: The scene.
        objects: The objects, as from `chosen_objects`.
        split: "train" or "eval".
        layouts: Layouts of the part of the scene that places these objects alone; see `part_of`.
        make: Launches that make them for the masked worlds, after others that fill their rows.

    Attributes:
        bodies: Ids of the bodies of the objects.
        layouts: The worlds after their latest redraw. `status` is VALID, or KEPT where nothing fitted.
        placed: The worlds of the latest redraw in which all objects have new places, shape (nworld,), bool.
    """

    def __init__(
        self,
        compiled: CompiledScene,
        objects: Sequence[str],
        split: str,
        layouts: Layouts,
        make: Callable[[wp.array | None, Callable[[], None]], None],
    ) -> None:
        config, slots = compiled.config, [compiled.slots.index(name) for name in objects]
        self.bodies = [body for name in objects for body in compiled.scene.subtree(name)]
        self.layouts, self._make = layouts, make
        self._program, self._split, self._device = compiled.program, SPLITS[split], compiled.device
        needed = with_variants((n for name in objects for n in config.parts[name].needs), config.variants)
        anchors = [i for i, name in enumerate(compiled.placed) if name in needed and name not in objects]
        self._given = _given(compiled, self.bodies, anchors)
        with wp.ScopedDevice(self._device):
            self._slots, self.placed = wp.array(slots, dtype=int), wp.zeros(layouts.nworld, dtype=wp.bool)

    def launch(
        self,
        state: State,
        mask: wp.array | None,
        *,
        number: wp.array | None = None,
        origins: wp.array | None = None,
        adds: bool = False,
    ) -> None:
        """Redraw the objects in the masked worlds.

        Args:
            state: What all else is read from.
            mask: Which worlds, shape (nworld,), bool; all if None.
            number: Redraws of each world since its reset, without this one, shape (nworld,), int32; None for number 0.
            origins: Origins of the worlds [m], shape (nworld,), vec3, which the state has and layouts do not.
            adds: Make the objects present that are not.
        """
        view, device, nworld = self.layouts.view, self._device, self.layouts.nworld
        read = [self._program, self._given, mask, self._split, number, origins, self._slots if adds else None]
        self._make(mask, lambda: wp.launch(_read_state, nworld, [*read, *state], [view], device=device))
        wp.launch(_finish, nworld, [mask, *state, view], [self.placed], device=device)


def _given(compiled: CompiledScene, redrawn: Sequence[int], anchors: Sequence[int]) -> _Given:
    """Return what is read of a state, for the bodies that are redrawn, and the anchors in placement order."""
    mjm, given = compiled.mjm, _Given()
    adr = {kind: np.full(mjm.nbody, -1) for kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)}
    for kind, found in adr.items():
        joints = mjm.jnt_type == kind
        found[mjm.jnt_bodyid[joints]] = mjm.jnt_qposadr[joints]
    owner = np.repeat(mjm.jnt_bodyid, np.diff([*mjm.jnt_qposadr, mjm.nq]))
    arrays = {
        "body_free": adr[mujoco.mjtJoint.mjJNT_FREE],
        "body_ball": adr[mujoco.mjtJoint.mjJNT_BALL],
        "body_mocapid": mjm.body_mocapid,
        "is_redrawn": np.isin(owner, redrawn),
        "anchor": np.array(anchors, int),
    }
    fill_struct(_Given, given, arrays, compiled.device)
    return given
