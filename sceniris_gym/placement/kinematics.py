"""Device code of `joints`: draw the joint positions of one object, and pose its bodies as `mj_kinematics` does."""

import warp as wp

from sceniris_gym.device.random import normals, uniforms
from sceniris_gym.device.transforms import axis_angle_quat, mul_quat, rot_vec_quat
from sceniris_gym.program.device import ObjectKind, Program

# Index of the first draw for joints in a trial. Each draw has four random numbers.
_FIRST_DRAW = wp.constant(2)
# The distance between two uniform numbers. At least this number gives normal numbers that are not all 0.
_STEP = wp.constant(2.0**-24)


@wp.func
def draw_joints(
    program: Program,
    worldid: int,
    obj: int,
    seed: wp.uint64,
    episode: int,
    stream: wp.uint32,
    trial: int,
    qpos: wp.array[float],
):
    """Draw the joint positions of an object in a world, and write them to `qpos`.

    Joints with `noise_norm` differ from home by a vector of normal numbers that is scaled to this norm, so that its
    direction is uniform. This also sets the joints that equality constraints couple to the drawn joints.
    """
    adr = program.obj_drawadr[obj]
    u = wp.vec4(0.0)
    square = float(0.0)
    for i in range(program.obj_drawnum[obj]):
        if i % 4 == 0:
            u = uniforms(seed, episode, stream, trial, _FIRST_DRAW + i // 4)
        interval = program.draw_range[worldid, adr + i]
        value = interval[0] + u[i % 4] * (interval[1] - interval[0])
        if interval[0] > interval[1]:
            num = program.draw_choicenum[adr + i]
            if num > 0:
                value = program.choice[program.draw_choiceadr[adr + i] + wp.min(int(u[i % 4] * float(num)), num - 1)]
            else:
                first = i % 4 < 2
                two = normals(wp.max(wp.where(first, u[0], u[2]), _STEP), wp.where(first, u[1], u[3]))
                value = wp.where(i % 2 == 0, two[0], two[1])
                square += value * value
        qpos[program.draw_qposadr[adr + i]] = value
    if square > 0.0:
        for i in range(adr, adr + program.obj_drawnum[obj]):
            interval = program.draw_range[worldid, i]
            if interval[0] > interval[1] and program.draw_choicenum[i] == 0:
                q = program.draw_qposadr[i]
                at = program.draw_choiceadr[i]
                value = program.choice[at] + program.choice[at + 1] * qpos[q] / wp.sqrt(square)
                qpos[q] = wp.clamp(value, program.choice[at + 2], program.choice[at + 3])
    follow_joints(program, obj, qpos)


@wp.func
def follow_joints(program: Program, obj: int, qpos: wp.array[float]):
    """Set the joint positions that equality constraints couple to the drawn joint positions of an object."""
    adr = program.obj_followadr[obj]
    for i in range(adr, adr + program.obj_follownum[obj]):
        follow_joint(program.follow_driveradr, program.follow_qposadr, program.follow_coef, i, qpos)


@wp.func
def follow_joint(
    driveradr: wp.array[int], qposadr: wp.array[int], coef: wp.array2d[wp.float64], i: int, qpos: wp.array[float]
):
    """Set coupled joint `i` to the value of its equality constraint's polynomial, which is evaluated as in MuJoCo."""
    x = wp.float64(qpos[driveradr[i]]) - coef[i, 0]
    y = coef[i, 1] + x * (coef[i, 2] + x * (coef[i, 3] + x * (coef[i, 4] + x * coef[i, 5])))
    qpos[qposadr[i]] = float(y)


@wp.func
def pose_body(
    program: Program, body: int, qpos: wp.array[float], body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
):
    """Compute the world pose of one body from its parent's pose and the positions of its joints."""
    parent = program.body_parent[body]
    quat = mul_quat(body_quat[parent], program.body_quat[body])
    pos = body_pos[parent] + rot_vec_quat(program.body_pos[body], body_quat[parent])
    for j in range(program.body_jntnum[body]):
        joint = program.body_jntadr[body] + j
        q = qpos[program.jnt_qposadr[joint]] - program.jnt_qpos0[joint]
        axis = program.jnt_axis[joint]
        if program.jnt_slide[joint]:
            pos += rot_vec_quat(axis, quat) * q
        else:
            anchor = program.jnt_pos[joint]
            pivot = pos + rot_vec_quat(anchor, quat)
            quat = mul_quat(quat, axis_angle_quat(axis, q))
            pos = pivot - rot_vec_quat(anchor, quat)
    body_pos[body] = pos
    body_quat[body] = wp.normalize(quat)


@wp.func
def pose_bodies(
    program: Program,
    obj: int,
    first: int,
    qpos: wp.array[float],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
):
    """Compute the world poses of an object's bodies, parents before children.

    `first` is the index in the object's list of bodies from which poses are computed: 0, or 1 if the root already has
    its pose.
    """
    adr = program.obj_bodyadr[obj]
    for i in range(first, program.obj_bodynum[obj]):
        pose_body(program, program.body_list[adr + i], qpos, body_pos, body_quat)


@wp.func
def write_root(
    program: Program,
    obj: int,
    pos: wp.vec3,
    quat: wp.vec4,
    qpos: wp.array[float],
    mocap_pos: wp.array[wp.vec3],
    mocap_quat: wp.array[wp.quat],
):
    """Write the pose of an object's root to its free joint or its mocap body."""
    adr = program.obj_adr[obj]
    if program.obj_kind[obj] == ObjectKind.FREE:
        for i in range(3):
            qpos[adr + i] = pos[i]
        for i in range(4):
            qpos[adr + 3 + i] = quat[i]
    else:
        mocap_pos[adr] = pos
        mocap_quat[adr] = wp.quat(quat[0], quat[1], quat[2], quat[3])
