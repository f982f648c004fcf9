"""Look up a scene's robots and the joints of their arms, for a controller."""

import mujoco

from sceniris_gym.errors import ArgumentError, ArmError, UnknownNameError
from sceniris_gym.reach.arm import chain_up
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector.names import FREE, SCALAR


def find_robot(scene: SceneModel, name: str | None, where: str) -> str:
    """Return the key in `SceneConfig.all_robots` of the robot called `name`, or of the only robot if `name` is None."""
    robots = scene.config.all_robots
    if not robots:
        raise ArmError(
            f"{where}: the scene has no robot. Name a robot in the scene: 'robot: {{asset: panda}}', or "
            "'robot: {in_model: BODY, tcp: SITE}' for an arm of the scene's 'model'."
        )
    if name is None and len(robots) > 1:
        raise ArgumentError(f"{where}: name should be one of the scene's robots: {', '.join(robots)}.")
    found = {robot.name: key for key, robot in robots.items()} | {key: key for key in robots}
    key = next(iter(robots)) if name is None else found.get(name)
    if key is None:
        written = robots if scene.config.robots else [robot.name for robot in robots.values()]
        raise UnknownNameError("robot", str(name), where, written)
    if key in scene.apart:
        raise ArmError(
            f"{where}: {robots[key].section} has 'in_scene: false', so it has no joints to drive. Remove 'in_scene'."
        )
    return key


def arm_joints(scene: SceneModel, robot: str, where: str) -> tuple[int, ...]:
    """Return the ids of the joints from a robot's root body to its tool centre point, in this order."""
    mjm, root, tcp = scene.mjm, scene.bodies[robot], scene.tcps[robot]
    section = scene.config.all_robots[robot].section
    site = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_SITE, tcp)
    if site < 0 or int(mjm.site_bodyid[site]) not in scene.subtree(robot):
        raise ArmError(
            f"{where}: the robot has no tool centre point: no site '{tcp}' is on its body '{mjm.body(root).name}' or "
            f"below it. Name a site or a body of the robot: '{section}.tcp: NAME' in the scene."
        )
    path = chain_up(mjm, int(mjm.site_bodyid[site]), root)
    joints = [j for j in range(mjm.njnt) if int(mjm.jnt_bodyid[j]) in path and mjm.jnt_type[j] != FREE]
    ball = [mjm.joint(j).name for j in joints if mjm.jnt_type[j] not in SCALAR]
    if ball or not joints:
        lacks = "no joint is between them. Put the site on a body that the arm's joints move"
        if ball:
            lacks = f"'{ball[0]}' between them is a ball joint. Replace it by hinges"
        raise ArmError(
            f"{where}: the arm from body '{mjm.body(root).name}' to site '{tcp}' should consist of hinges and slides, "
            f"but {lacks}."
        )
    return tuple(joints)
