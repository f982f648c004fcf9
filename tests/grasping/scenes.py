"""Scenes of an arm and one thing that it is to grasp."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.grasping.grasps import Graspable, GraspSet
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.program.plan import Plan, build_plan
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel


class Scene:
    """An arm and one object on the floor, `thing`, with the words that are given."""

    def __init__(self, asset: str | None, robot: str = "panda", **words: Any) -> None:
        thing = {"asset": asset, "on": "floor", **words}
        config = {"floor": {"size": [2.0, 2.0]}, "robot": {"asset": robot}, "objects": {"thing": thing}}
        self.scene: SceneModel = build_model(SceneConfig.load(config))
        self.plan: Plan = build_plan(self.scene)
        self.gripper = Gripper.from_model(self.scene.mjm, robot_arm(self.scene), self.scene.home_qpos, self.plan.pieces)
        self.thing = Graspable(self.scene, "thing", self.plan.pieces, self.gripper)

    def grasp_set(self) -> GraspSet:
        """The grasps of the object."""
        placed = next(o for o in self.plan.objects if o.name == "thing")
        return self.thing.grasp_set(placed.stable_poses)


def rotation(quat: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of a wxyz quaternion."""
    return trimesh.transformations.quaternion_matrix(quat)[:3, :3]
