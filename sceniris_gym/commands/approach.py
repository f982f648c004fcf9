"""Notes about the reach of an arm: its share of the objects, also with other approach axes of the hand."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.robot import TcpConfig
from sceniris_gym.errors import ArmError, NotSupportedError
from sceniris_gym.geometry.rotations import matrix, of_angles, product, quaternion
from sceniris_gym.grasping.grasps import tcp_axes
from sceniris_gym.importers.models.first_scene import flow
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.solve import solve

_LAYOUTS, _RESTARTS = 16, 16
_YAWS, _TILTS = range(0, 360, 60), (0.0, 45.0)  # degrees, of approaches to an object
_TURNS = ((0, 0), (0, 180), (0, 90), (0, -90), (90, 0), (-90, 0))  # roll and pitch in degrees, all six axes
# An axis is named if it brings this much more of the objects within reach.
_BETTER = 0.1


def reach_notes(compiled: CompiledScene, names: Sequence[str]) -> tuple[str, ...]:
    """Return comments for the scene file: how to use `reachable` with the robot, or why the robot does not allow it.

    An object counts as within reach if inverse kinematics brings the TCP to its origin from above, at any yaw.

    Args:
        compiled: The scene, with a robot `in_model` that has a `tcp`.
        names: The free objects.
    """
    try:
        arm = robot_arm(compiled.scene)
    except (ArmError, NotSupportedError) as error:
        return (f"`reachable` does not work with it: {error}",)
    note = "Check that +z of the `tcp` is the approach axis. To keep an object within reach: `reachable: ik`."
    return (note, _shares(compiled, arm, names)) if names else (note,)


def _shares(compiled: CompiledScene, arm: SerialArm, names: Sequence[str]) -> str:
    """Return the share of objects within reach as text, with a better `tcp` if there is one."""
    mjm, home, tcp = compiled.mjm, compiled.scene.home, compiled.config.all_robots[ROBOT].tcp
    assert tcp is not None
    adr = [int(mjm.jnt_qposadr[mjm.body_jntadr[compiled.scene.bodies[name]]]) for name in names]
    places = make_table(compiled, _LAYOUTS, 0).qpos[:, np.add.outer(adr, range(3))].reshape(-1, 3)
    base = home.xmat[arm.base_body].reshape(3, 3)
    quats = [quaternion(base.T @ tcp_axes(yaw, tilt)) for yaw in _YAWS for tilt in _TILTS]
    poses = [[*place, *quat] for place in (places - home.xpos[arm.base_body]) @ base for quat in quats]
    kind = "site" if tcp.site in [mjm.site(i).name for i in range(mjm.nsite)] else "body"
    name = getattr(tcp, kind)
    from_tool = home.site_xmat[arm.tcp_site].reshape(3, 3).T @ getattr(home, kind)(name).xmat.reshape(3, 3)
    shares = {}
    for turn in dict.fromkeys((tcp.turns[:2], *_TURNS)):
        link_quat = arm.link_quat.copy()
        link_quat[-1] = product(link_quat[-1], quaternion(from_tool @ matrix(of_angles(np.radians([*turn, 0.0])))))
        _, is_reached = solve(replace(arm, link_quat=link_quat), np.array(poses), compiled.device, restarts=_RESTARTS)
        shares[turn] = is_reached.reshape(len(places), -1).any(axis=1).mean()
    now, best = shares[tcp.turns[:2]], max(shares, key=lambda turn: shares[turn])
    note = f"{now:.0%} of the objects are within reach from above"
    if shares[best] > now + _BETTER:
        words = TcpConfig.model_validate({kind: name, "offset": tcp.offset, "roll": best[0], "pitch": best[1]})
        note += f", but {shares[best]:.0%} with `tcp: {flow(words.model_dump(mode='json', exclude_defaults=True))}`"
    return f"{note}."
