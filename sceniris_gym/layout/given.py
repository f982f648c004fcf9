"""Rows that begin with what is given: the poses of all bodies by a state, and anchors seen from above.

`_read_state` works as `mj_kinematics` does, in single precision, since the poses of bodies in a state may be one step
older than its positions. What is to be redrawn is not read: its joints are at home until they are drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.variants import owners_of, with_variants
from sceniris_gym.device.angles import unit_circle
from sceniris_gym.device.quaternions import mul_quat, rot_vec_quat
from sceniris_gym.device.random import REDRAW_STREAM, philox
from sceniris_gym.device.transforms import axis_angle_quat, quat_mat, quat_z
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.geometry.ragged import addressed
from sceniris_gym.geometry.resting_poses import of_heading_zero
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import numbered_stream
from sceniris_gym.placement.measure import bounds_of_pieces
from sceniris_gym.placement.orientations import heading_of
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, fill_struct

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FREE = wp.constant(int(mujoco.mjtJoint.mjJNT_FREE))
_BALL = wp.constant(int(mujoco.mjtJoint.mjJNT_BALL))
_SLIDE = wp.constant(int(mujoco.mjtJoint.mjJNT_SLIDE))


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
class Tree:
    """The bodies and joints of a model, as in mjModel, and the positions that are not read."""

    body_parent: wp.array[int]
    body_mocapid: wp.array[int]
    body_pos: wp.array[wp.vec3]
    body_quat: wp.array[wp.vec4]
    body_jntadr: wp.array[int]
    body_jntnum: wp.array[int]
    jnt_type: wp.array[int]
    jnt_pos: wp.array[wp.vec3]
    jnt_axis: wp.array[wp.vec3]
    jnt_qposadr: wp.array[int]
    qpos0: wp.array[float]
    home_qpos: wp.array[float]
    is_redrawn: wp.array[bool]  # of each element of qpos


def tree_of(compiled: CompiledScene, redrawn: Sequence[int]) -> Tree:
    """Return the bodies and joints of a scene on its device, of which the bodies `redrawn` are not read."""
    mjm, tree = compiled.mjm, Tree()
    names = ("body_mocapid", "body_pos", "body_quat", "body_jntadr", "body_jntnum")
    names += ("jnt_type", "jnt_pos", "jnt_axis", "jnt_qposadr", "qpos0")
    owner = np.repeat(mjm.jnt_bodyid, np.diff([*mjm.jnt_qposadr, mjm.nq]))
    arrays = {name: getattr(mjm, name) for name in names} | {
        "body_parent": mjm.body_parentid,
        "home_qpos": compiled.home_qpos,
        "is_redrawn": np.isin(owner, redrawn),
    }
    fill_struct(Tree, tree, arrays, compiled.device)
    return tree


@wp.func
def _quat_at(qpos: wp.array[float], adr: int) -> wp.vec4:
    return wp.normalize(wp.vec4(qpos[adr], qpos[adr + 1], qpos[adr + 2], qpos[adr + 3]))


@wp.func
def _pose_body(tree: Tree, layouts: LayoutsView, row: int, body: int):
    """Pose one body of a row by its joints or its mocap pose, given the pose of its parent."""
    qpos = layouts.qpos[row]
    parent = tree.body_parent[body]
    turn = layouts.body_quat[row, parent]
    pos = layouts.body_pos[row, parent] + rot_vec_quat(tree.body_pos[body], turn)
    quat = mul_quat(turn, tree.body_quat[body])
    if tree.body_mocapid[body] >= 0:
        pos = layouts.mocap_pos[row, tree.body_mocapid[body]]
        q = layouts.mocap_quat[row, tree.body_mocapid[body]]
        quat = wp.vec4(q[0], q[1], q[2], q[3])
    for joint in range(tree.body_jntadr[body], tree.body_jntadr[body] + tree.body_jntnum[body]):
        kind = tree.jnt_type[joint]
        adr = tree.jnt_qposadr[joint]
        if kind == _FREE:
            pos = wp.vec3(qpos[adr], qpos[adr + 1], qpos[adr + 2])
            quat = _quat_at(qpos, adr + 3)
        elif kind == _SLIDE:
            pos += rot_vec_quat(tree.jnt_axis[joint], quat) * (qpos[adr] - tree.qpos0[adr])
        else:
            anchor = tree.jnt_pos[joint]
            pivot = pos + rot_vec_quat(anchor, quat)
            if kind == _BALL:
                quat = mul_quat(quat, _quat_at(qpos, adr))
            else:
                quat = mul_quat(quat, axis_angle_quat(tree.jnt_axis[joint], qpos[adr] - tree.qpos0[adr]))
            pos = pivot - rot_vec_quat(anchor, quat)
    layouts.body_pos[row, body] = pos
    layouts.body_quat[row, body] = wp.normalize(quat)


@wp.kernel
def _read_state(
    tree: Tree,
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
    # Layouts in: qpos, mocap_pos, mocap_quat, body_pos, body_quat
    # Layouts out: qpos, mocap_pos, mocap_quat, present, pending_seed, pending_episode, body_pos, body_quat
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    origin = wp.vec3(0.0)
    if origins:
        origin = origins[worldid]
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
        layouts.qpos[worldid, i] = wp.where(tree.is_redrawn[i], tree.home_qpos[i], qpos[worldid, i])
    for i in range(mocap_pos.shape[1]):  # without a mocap body layouts have an unused one
        q = mocap_quat[worldid, i]
        layouts.mocap_pos[worldid, i] = mocap_pos[worldid, i] - origin
        layouts.mocap_quat[worldid, i] = wp.normalize(q)
    for body in range(1, tree.body_parent.shape[0]):
        joint = tree.body_jntadr[body]
        if tree.body_jntnum[body] > 0 and tree.jnt_type[joint] == _FREE:
            for i in range(3):
                layouts.qpos[worldid, tree.jnt_qposadr[joint] + i] -= origin[i]
        _pose_body(tree, layouts, worldid, body)


def launch_read_state(
    tree: Tree,
    state: State,
    mask: wp.array | None,
    split: int,
    layouts: LayoutsView,
    number: wp.array | None = None,
    origins: wp.array | None = None,
    added: wp.array | None = None,
) -> None:
    """Begin the rows of the masked worlds with a state, and choose the seed that its redraw draws from.

    Args:
        tree: The bodies and joints of the scene.
        state: The state.
        mask: Which worlds, shape (nworld,), bool; all if None.
        split: Number of the split.
        layouts: The rows.
        number: Redraws of each world since its reset, shape (nworld,), int32; this one is the next. None is number 0.
        origins: Origins of the worlds [m], shape (nworld,), vec3, that positions of free and mocap bodies include.
        added: Slots that become present, shape (n,), int32.
    """
    nworld, device = layouts.seed.shape[0], layouts.seed.device
    wp.launch(_read_state, nworld, [tree, mask, split, number, origins, added, *state], [layouts], device=device)


@wp.struct
class Anchors:
    """Objects, robots and bodies that redrawn objects refer to, and the poses that their pivots are taken in."""

    slot: wp.array[int]
    place: wp.array[int]  # column of its place and bounds
    root: wp.array[int]
    is_centred: wp.array[bool]  # the pivot is the centre of the bounds
    poseadr: wp.array[int]
    posenum: wp.array[int]
    quat: wp.array[wp.vec4]  # of heading 0
    pivot: wp.array[wp.vec3]  # in the root's frame
    pieceadr: wp.array[int]
    piecenum: wp.array[int]
    piece: wp.array[int]


def anchors_of(compiled: CompiledScene, names: Sequence[str]) -> Anchors | None:
    """Return what objects refer to beside themselves, on the device of the scene; None if there is nothing."""
    plan, config = compiled.plan, compiled.config
    shared, placed = owners_of(config.variants), {o.name: o for o in plan.objects if o.variants}
    needed = [word for name in names for word in config.parts[name].needs]
    found = [n for n in with_variants(needed, config.variants) if n not in names and n in plan.slots]
    if not found:
        return None
    roots = [plan.scene.bodies[name] for name in found]
    owned = [plan.scene.subtree(name) for name in found]
    pieces = [
        [i for i, p in enumerate(plan.pieces) if p.body in bodies and p.type != PieceType.PLANE] for bodies in owned
    ]
    poses = []
    for name, root in zip(found, roots, strict=True):
        if name in placed:
            poses.append([(v.quat, v.pivot) for v in placed[name].variants])
        else:
            mat, at = plan.home.xmat[root].reshape(3, 3), plan.place[plan.slots.index(name)][:3]
            poses.append([(of_heading_zero(mat), mat.T @ (at - plan.home.xpos[root]))])
    pose, of_poses = addressed("pose", poses)
    piece, of_pieces = addressed("piece", pieces)
    anchors = Anchors()
    arrays = {
        "slot": np.array([plan.slots.index(name) for name in found]),
        "place": np.array([plan.places.index(shared.get(name, name)) for name in found]),
        "root": np.array(roots),
        "is_centred": np.array([name in placed and placed[name].orientation == "any" for name in found]),
        **of_poses,
        "quat": np.array([quat for quat, _ in pose]),
        "pivot": np.array([pivot for _, pivot in pose]),
        **of_pieces,
        "piece": np.array(piece, int),
    }
    fill_struct(Anchors, anchors, arrays, compiled.device)
    return anchors


@wp.func
def _nearest_pose(anchors: Anchors, i: int, quat: wp.vec4) -> int:
    """Return the pose of an anchor that is turned least against an orientation of heading 0."""
    best = float(-1.0)
    found = int(0)
    for k in range(anchors.poseadr[i], anchors.poseadr[i] + anchors.posenum[i]):
        near = wp.abs(wp.dot(anchors.quat[k], quat))
        if near > best:
            best = near
            found = k
    return found


@wp.kernel
def _read_anchors(
    program: Program,
    anchors: Anchors,
    mask: wp.array[bool],
    # Layouts in: present, body_pos, body_quat
    # Layouts out: place, bounds
    layouts: LayoutsView,
):
    worldid, i = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    if layouts.present[worldid, anchors.slot[i]] == 0:
        return
    quat = layouts.body_quat[worldid, anchors.root[i]]
    heading = heading_of(quat)
    pose = _nearest_pose(anchors, i, mul_quat(quat_z(-heading), quat))
    at = layouts.body_pos[worldid, anchors.root[i]] + quat_mat(quat) * anchors.pivot[pose]
    place = wp.vec4(at[0], at[1], at[2], heading)
    bounds = wp.vec4(0.0)
    if anchors.piecenum[i] > 0:
        bounds = bounds_of_pieces(
            program,
            anchors.piece,
            anchors.pieceadr[i],
            anchors.piecenum[i],
            place,
            layouts.body_pos[worldid],
            layouts.body_quat[worldid],
        )
    if anchors.is_centred[i]:
        x = 0.5 * (bounds[0] + bounds[2])
        y = 0.5 * (bounds[1] + bounds[3])
        to = unit_circle(heading)
        place += wp.vec4(x * to[0] - y * to[1], x * to[1] + y * to[0], 0.0, 0.0)
        bounds -= wp.vec4(x, y, x, y)
    layouts.place[worldid, anchors.place[i]] = place
    layouts.bounds[worldid, anchors.place[i]] = bounds


def launch_read_anchors(program: Program, anchors: Anchors, mask: wp.array | None, layouts: LayoutsView) -> None:
    """Write places and bounds of anchors, as relations see them, into the rows of the masked worlds.

    Args:
        program: A program of the scene, for its pieces.
        anchors: The anchors.
        mask: Which worlds, shape (nworld,), bool; all if None.
        layouts: Rows in which all bodies are posed.
    """
    dim = (layouts.seed.shape[0], anchors.slot.shape[0])
    wp.launch(_read_anchors, dim, [program, anchors, mask], [layouts], device=layouts.seed.device)
