"""Device code of `reachable`: TCP poses at grasps of a posed object, and tests of grasps with a reachability map."""

import warp as wp

from sceniris_gym.device.transforms import Pose, apply, mul_quat, pose_of, quat_mat, relative, rot_vec_quat
from sceniris_gym.grasping.grasps import MOST_RISING
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.lookup import map_verdict


@wp.func
def grasp_pose(reach: Reach, grasp: int, base: Pose, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]) -> Pose:
    """Return the pose of the TCP at a grasp, in the frame of the arm's base.

    `base` is the world pose of the arm's base. `body_pos` and `body_quat` are world poses, indexed by body.
    """
    body = reach.grasp_body[grasp]
    quat = mul_quat(body_quat[body], reach.grasp_quat[grasp])
    return relative(base, pose_of(apply(pose_of(body_pos[body], body_quat[body]), reach.grasp_pos[grasp]), quat))


@wp.func
def tcp_of(reach: Reach, grasp: int, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]):
    """Return the position [m] and the orientation (wxyz) of the TCP at a grasp, in the world frame."""
    body = reach.grasp_body[grasp]
    quat = body_quat[body]
    return body_pos[body] + rot_vec_quat(reach.grasp_pos[grasp], quat), mul_quat(quat, reach.grasp_quat[grasp])


@wp.func
def approaches(reach: Reach, column: int, grasp: int, body_quat: wp.array[wp.vec4]) -> bool:
    """Test whether the hand can approach a grasp without passing through the support of the object.

    If the object stands on a support, the z component of the approach axis may be at most `MOST_RISING`. A steeper axis
    would pass through the support from below. `column` is the number of the reach target.
    """
    if not reach.reach_below[column]:
        return True
    rot = quat_mat(mul_quat(body_quat[reach.grasp_body[grasp]], reach.grasp_quat[grasp]))
    return rot[2, 2] <= MOST_RISING


@wp.func
def first_accepted(
    reach: Reach, column: int, stable: int, base: Pose, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> int:
    """Return the first grasp of a stable pose for which `passes_map` is True, or -1 if there is none.

    The result is the grasp's number among all grasps of the reach target `column`, from 0. `stable` is the number of
    the stable pose, and `base` is the world pose of the arm's base.
    """
    adr = reach.stable_graspadr[stable]
    for grasp in range(adr, adr + reach.stable_graspnum[stable]):
        if passes_map(reach, column, grasp, base, body_pos, body_quat):
            return grasp - reach.reach_graspadr[column]
    return -1


@wp.func
def passes_map(
    reach: Reach, column: int, grasp: int, base: Pose, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]
) -> bool:
    """Return True if a grasp has a free approach (see `approaches`), and the arm's reachability map accepts the grasp.

    If the arm has no reachability map, only the approach is tested. `column` is the number of the reach target, and
    `base` is the world pose of the arm's base.
    """
    through = approaches(reach, column, grasp, body_quat)
    if reach.mapped and through:
        tcp = grasp_pose(reach, grasp, base, body_pos, body_quat)
        approach = wp.vec3(tcp.rot[0, 2], tcp.rot[1, 2], tcp.rot[2, 2])
        through = map_verdict(reach.map, tcp.pos, approach) >= reach.reach_least[column]
    return through
