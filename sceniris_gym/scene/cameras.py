"""The cameras that a scene adds to its model."""

from __future__ import annotations

import mujoco

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.geometry.framing import camera_axes
from sceniris_gym.geometry.rotations import quaternion


def add_cameras(spec: mujoco.MjSpec, config: SceneConfig) -> None:
    """Add the cameras of a scene to a specification that has all its bodies.

    Raises:
        SceneKeyError: The model has a camera of that name already.
        UnknownNameError: There is no such body.
    """
    for name, camera in config.cameras.items():
        where = f"{config.where}: cameras.{name}"
        if spec.camera(name) is not None:
            raise SceneKeyError(f"{where}: the model has a camera of this name already. Give this one another name.")
        carrier = spec.worldbody if camera.body is None else spec.body(_name_in_model(config, camera.body))
        if carrier is None and camera.body in config.variants:  # the body that they share comes later
            carrier = spec.body(config.variants[camera.body][0])
        if carrier is None:
            bodies = [body.name for body in spec.bodies if body.name != "world"]
            raise UnknownNameError("body", str(camera.body), f"{where}.body", filter(None, bodies))
        turned = quaternion(camera_axes(camera.backward, camera.upward))
        carrier.add_camera(name=name, pos=camera.pos, quat=turned, fovy=camera.fovy)


def _name_in_model(config: SceneConfig, name: str) -> str:
    """Return the model's name of an object, a robot, or a body inside one."""
    owner, _, part = name.partition("/")
    if owner in config.all_robots:
        robot = config.all_robots[owner]
        return f"{robot.prefix}{part}" if part else robot.name
    return config.objects[name].body or name if name in config.objects else name
