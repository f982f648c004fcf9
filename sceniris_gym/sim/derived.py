"""Derived fields of worlds that differ in masses, centres of mass, armatures, gears, cameras or lights.

MuJoCo computes these fields in `mj_setConst`. For bodies (at their centres of mass), joints and tendons with Jacobian
J, inverse weights are the diagonal of J M^-1 J^T at qpos0, with the mass matrix M. For actuators, `actuator_acc0` is
the norm of M^-1 J^T. M couples degrees of freedom only within a kinematic tree.

All worlds have the same poses at qpos0, so the Jacobians at the origins of bodies are computed once, on the host. The
exception are trees that variants share, because the poses and axes of their joints differ by world.
"""

from collections.abc import Container

import mujoco
import mujoco_warp as mjw
import warp as wp

from sceniris_gym.device.blocks import block_sync
from sceniris_gym.device.transforms import quat_mat
from sceniris_gym.sim.derived_tables import Derived

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_LEAST = wp.constant(1.0e-15)
"""Smallest divisor in MuJoCo (mjMINVAL)."""
_SLIDES = wp.constant(2)
"""Value of `body_simple` for a single body on slides. MuJoCo computes the weights of this body without armature."""
_SLIDE = wp.constant(int(mujoco.mjtJoint.mjJNT_SLIDE))
_LANES = 128
"""Lanes that share a world."""


_INERTIA = (
    *("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_armature", "tendon_armature"),
    *("actuator_armature", "actuator_gear"),
)
_CENTERS = ("body_mass", "body_ipos")
FOLLOWS = {
    "body_subtreemass": ("body_mass",),
    **dict.fromkeys(("body_invweight0", "dof_invweight0", "tendon_invweight0", "actuator_acc0"), _INERTIA),
    **dict.fromkeys(("cam_pos0", "cam_poscom0", "cam_mat0"), ("cam_pos", "cam_quat", *_CENTERS)),
    **dict.fromkeys(("light_pos0", "light_poscom0", "light_dir0"), ("light_pos", "light_dir", *_CENTERS)),
}
"""Sources of each derived field. If a source has a row for each world, so do all fields derived from it."""


@wp.func
def _mass(w: Derived, worldid: int, bodyid: int) -> float:
    return w.body_mass[worldid % w.body_mass.shape[0], bodyid]


@wp.func
def _pose(w: Derived, worldid: int, bodyid: int):
    """Return the position and the rotation matrix of a body at qpos0."""
    root = w.shared_root[bodyid]
    if root == 0:
        return w.xpos[bodyid], w.xmat[bodyid]
    pos = wp.vec3(0.0)
    mat = wp.identity(3, dtype=float)
    above = int(bodyid)
    while above != root:
        q = w.body_quat[worldid % w.body_quat.shape[0], above]
        turn = quat_mat(wp.vec4(q[0], q[1], q[2], q[3]))
        pos = w.body_pos[worldid % w.body_pos.shape[0], above] + turn * pos
        mat = turn * mat
        above = w.body_parentid[above]
    return w.xpos[root] + w.xmat[root] * pos, w.xmat[root] * mat


@wp.func
def _motion(w: Derived, worldid: int, row: int, dofid: int) -> wp.vec3:
    """Return the entry of `Derived.jacobian` for a row and a degree of freedom, in one world."""
    nbody = w.body_end.shape[0]
    bodyid, moved = row % nbody, w.dof_bodyid[dofid]
    if row >= 2 * nbody or w.shared_root[moved] == 0 or w.shared_root[bodyid] != w.shared_root[moved]:
        return w.jacobian[row, dofid]
    if bodyid < moved or bodyid >= w.body_end[moved]:
        return wp.vec3(0.0)
    jointid = w.dof_jntid[dofid]
    pos, mat = _pose(w, worldid, moved)
    axis = mat * w.jnt_axis[worldid % w.jnt_axis.shape[0], jointid]
    is_slide = w.jnt_type[jointid] == _SLIDE
    if row >= nbody:
        return wp.where(is_slide, wp.vec3(0.0), axis)
    at, _ = _pose(w, worldid, bodyid)
    anchor = pos + mat * w.jnt_pos[worldid % w.jnt_pos.shape[0], jointid]
    return wp.where(is_slide, axis, wp.cross(axis, at - anchor))


@wp.func
def _arm(w: Derived, worldid: int, bodyid: int) -> wp.vec3:
    """Return the vector from a body's origin to the body's centre of mass, at qpos0."""
    _, mat = _pose(w, worldid, bodyid)
    return mat * w.body_ipos[worldid % w.body_ipos.shape[0], bodyid]


@wp.func
def _jacobian(w: Derived, worldid: int, row: int, dofid: int) -> wp.vec3:
    """Return the entry of a Jacobian's row, of a body at its centre of mass, and of an actuator with its gear."""
    nbody, nactuator = w.body_end.shape[0], w.actuator_gear.shape[1]
    jac = _motion(w, worldid, row, dofid)
    if row < nbody:
        jac += wp.cross(_motion(w, worldid, nbody + row, dofid), _arm(w, worldid, row))
    actuatorid = row + 2 * nactuator - w.jacobian.shape[0]
    if actuatorid >= 0:
        gear = w.actuator_gear[worldid % w.actuator_gear.shape[0], actuatorid]
        turning = wp.dot(wp.spatial_bottom(gear), w.jacobian[row + nactuator, dofid])
        jac = wp.vec3(wp.dot(wp.spatial_top(gear), jac) + turning, 0.0, 0.0)
    return jac


@wp.func
def _armature(w: Derived, worldid: int, row: int) -> float:
    """Return the armature of a tendon, or the armature of an actuator times its squared gear."""
    nactuator = w.actuator_gear.shape[1]
    actuatorid = row + 2 * nactuator - w.jacobian.shape[0]
    if actuatorid < 0:
        return w.tendon_armature[worldid % w.tendon_armature.shape[0], actuatorid + w.tendon_armature.shape[1]]
    actuatorid %= nactuator
    gear = w.actuator_gear[worldid % w.actuator_gear.shape[0], actuatorid][0]
    return w.actuator_armature[worldid % w.actuator_armature.shape[0], actuatorid] * gear * gear


@wp.func
def _mass_matrix(w: Derived, worldid: int, i: int, j: int) -> float:
    """Return the element (i, j) of the mass matrix M at qpos0 in a world, with i >= j."""
    lower = w.dof_bodyid[i]
    total = float(0.0)
    for bodyid in range(lower, w.body_end[lower]):  # bodies that i moves, but bodies that j does not move add 0
        q = w.body_iquat[worldid % w.body_iquat.shape[0], bodyid]
        inertia = w.body_inertia[worldid % w.body_inertia.shape[0], bodyid]
        _, mat = _pose(w, worldid, bodyid)
        rotation = wp.transpose(mat * quat_mat(wp.vec4(q[0], q[1], q[2], q[3])))
        jacr_i = rotation * _motion(w, worldid, w.body_end.shape[0] + bodyid, i)
        jacr_j = rotation * _motion(w, worldid, w.body_end.shape[0] + bodyid, j)
        jacp = wp.dot(_jacobian(w, worldid, bodyid, i), _jacobian(w, worldid, bodyid, j))
        total += _mass(w, worldid, bodyid) * jacp + wp.dot(wp.cw_mul(inertia, jacr_i), jacr_j)
    if i == j:
        total += w.dof_armature[worldid % w.dof_armature.shape[0], i]
    has_place = lower < w.body_end[w.dof_bodyid[j]] and (i == j or w.body_simple[lower] == 0)
    if has_place:  # MuJoCo's sparse M stores this element
        for k in range(w.geared.shape[0]):
            square = wp.dot(w.jacobian[w.geared[k], i], w.jacobian[w.geared[k], j])
            if square != 0.0:
                total += square * _armature(w, worldid, w.geared[k])
    return total


@wp.func
def _eliminate(old: wp.array2d[float], i: int, k: int, pivot: int, step: int) -> float:
    """Return an element of a block of M after a step of Gauss-Jordan elimination, without row exchanges."""
    if i == pivot:
        return wp.where(k == step, 1.0, old[pivot, k]) / old[pivot, step]
    factor = old[i, step] / old[pivot, step]
    if k == step:
        return -factor
    return old[i, k] - factor * old[pivot, k]


@wp.func
def _write_weight(w: Derived, worldid: int, row: int):
    """Write the inverse weight J M^-1 J^T of a Jacobian row, or for an actuator the norm of M^-1 J^T."""
    weight = float(0.0)
    square = float(0.0)
    for i in range(w.moved[row][0], w.moved[row][1]):
        acceleration = wp.vec3(0.0)
        for j in range(w.dof_block[i][0], w.dof_block[i][1]):
            acceleration += w.inverse[worldid, 0, i, j - w.dof_block[i][0]] * _jacobian(w, worldid, row, j)
        weight += wp.dot(acceleration, _jacobian(w, worldid, row, i))
        square += wp.dot(acceleration, acceleration)
    nbody, nv, ntendon = w.body_end.shape[0], w.dof_block.shape[0], w.tendon_invweight0.shape[1]
    if row < 2 * nbody:
        angular = row // nbody
        bodyid = row - angular * nbody
        if w.body_simple[bodyid] == _SLIDES:
            weight = wp.where(angular == 1, 0.0, 3.0 / _mass(w, worldid, bodyid))
        w.body_invweight0[worldid, bodyid][angular] = weight / 3.0
    elif row < 2 * nbody + nv:
        bodyid = w.dof_bodyid[row - 2 * nbody]
        if w.body_simple[bodyid] == _SLIDES:
            weight = 1.0 / _mass(w, worldid, bodyid)
        w.dof_invweight0[worldid, row - 2 * nbody] = weight
    elif row < 2 * nbody + nv + ntendon:
        w.tendon_invweight0[worldid, row - 2 * nbody - nv] = weight
    else:
        w.actuator_acc0[worldid, row - 2 * nbody - nv - ntendon] = wp.sqrt(square)


@wp.func
def _subtree(w: Derived, worldid: int, bodyid: int) -> wp.vec4:
    """Return the centre of mass of a body's subtree at qpos0, and the subtree's mass."""
    moment = wp.vec3(0.0)
    total = float(0.0)
    for i in range(bodyid, w.body_end[bodyid]):
        mass = _mass(w, worldid, i)
        pos, _ = _pose(w, worldid, i)
        moment += mass * (pos + _arm(w, worldid, i))
        total += mass
    center = w.xpos[bodyid] + _arm(w, worldid, bodyid)
    if total >= _LEAST:
        center = moment / total
    return wp.vec4(center[0], center[1], center[2], total)


@wp.func
def _from_center(w: Derived, worldid: int, bodyid: int, targetbodyid: int, offset: wp.vec3) -> wp.vec3:
    """Return the vector from a centre of mass to the point at `offset` from a body's origin, at qpos0.

    The centre of mass belongs to the subtree of the target body or, without a target (-1), to the subtree of the body.
    """
    subtree = _subtree(w, worldid, wp.where(targetbodyid >= 0, targetbodyid, bodyid))
    return w.xpos[bodyid] + offset - wp.vec3(subtree[0], subtree[1], subtree[2])


@wp.func
def _camera(w: Derived, worldid: int, camid: int):
    bodyid = w.cam_bodyid[camid]
    offset = w.xmat[bodyid] * w.cam_pos[worldid % w.cam_pos.shape[0], camid]
    q = w.cam_quat[worldid % w.cam_quat.shape[0], camid]
    w.cam_pos0[worldid, camid] = offset
    w.cam_poscom0[worldid, camid] = _from_center(w, worldid, bodyid, w.cam_targetbodyid[camid], offset)
    w.cam_mat0[worldid, camid] = w.xmat[bodyid] * quat_mat(wp.vec4(q[0], q[1], q[2], q[3]))


@wp.func
def _light(w: Derived, worldid: int, lightid: int):
    bodyid = w.light_bodyid[lightid]
    offset = w.xmat[bodyid] * w.light_pos[worldid % w.light_pos.shape[0], lightid]
    dir = w.xmat[bodyid] * w.light_dir[worldid % w.light_dir.shape[0], lightid]
    w.light_pos0[worldid, lightid] = offset
    w.light_poscom0[worldid, lightid] = _from_center(w, worldid, bodyid, w.light_targetbodyid[lightid], offset)
    w.light_dir0[worldid, lightid] = wp.normalize(dir)


@wp.kernel
def _derive(
    mask: wp.array[wp.bool],
    # Derived in: tables*, fields*; out: following*; both: inverse
    w: Derived,
):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    for i in range(lane, w.body_subtreemass.shape[1], wp.block_dim()):
        w.body_subtreemass[worldid, i] = _subtree(w, worldid, i)[3]
    # start at the last lane: elements fixed to the world need all bodies, and the first lane already sums them
    for i in range(wp.block_dim() - 1 - lane, w.cam_pos0.shape[1], wp.block_dim()):
        _camera(w, worldid, i)
    for i in range((lane + wp.block_dim() // 2) % wp.block_dim(), w.light_pos0.shape[1], wp.block_dim()):
        _light(w, worldid, i)
    if w.dof_invweight0.shape[1] == 0:
        return
    width = w.inverse.shape[3]
    for at in range(lane, w.dof_block.shape[0] * width, wp.block_dim()):
        i = at // width
        j = w.dof_block[i][0] + at % width
        if j <= i:
            total = _mass_matrix(w, worldid, i, j)
            w.inverse[worldid, width & 1, i, at % width] = total
            w.inverse[worldid, width & 1, j, i - w.dof_block[i][0]] = total
    block_sync()
    for step in range(width):  # in all blocks at once, and the last step writes into the first half
        old = w.inverse[worldid, (width - step) & 1]
        for at in range(lane, w.dof_block.shape[0] * width, wp.block_dim()):
            i = at // width
            value = old[i, at % width]
            pivot = w.dof_block[i][0] + step
            if pivot < w.dof_block[i][1]:
                value = _eliminate(old, i, at % width, pivot, step)
            w.inverse[worldid, (width - step - 1) & 1, i, at % width] = value
        block_sync()
    for row in range(lane, w.moved.shape[0], wp.block_dim()):
        _write_weight(w, worldid, row)


def launch_derived(tables: Derived, m: mjw.Model, mask: wp.array, wide: Container[str]) -> None:
    """Recompute derived fields in the masked worlds.

    Args:
        tables: The `derived_tables` of the model.
        m: The Model. The launch reads and writes the arrays that the Model has at the time of this call.
        mask: Selected worlds, shape (nworld,), bool.
        wide: Names of the fields that have a row for each world.
    """
    for name in Derived.vars:  # pyrefly: ignore[missing-attribute]
        if (array := getattr(m, name, None)) is not None:
            setattr(tables, name, None if name in FOLLOWS and name not in wide else array)
    wp.launch_tiled(_derive, dim=[mask.shape[0]], inputs=[mask, tables], block_dim=_LANES, device=mask.device)
