"""Scenes of a box beside its frame, and of a gadget with a slide and a hinge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.colliders import Collider, collect_colliders
from sceniris_gym.program.compiled import CHECKS
from sceniris_gym.program.pack.program import pack_program
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.plan import Plan, build_plan
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel

BOX = (
    '<mujoco><worldbody><body name="box"><geom type="box" size=".05 .02 .1" pos=".3 0 .4"/></body></worldbody></mujoco>'
)
GADGET = """
<mujoco><worldbody><body name="gadget"><geom type="box" size=".02 .02 .02"/>
  <body name="a" pos="0 0 .1"><joint name="slide" type="slide" range="-.1 .3"/>
    <geom type="box" size=".01 .01 .01"/></body>
  <body name="b" pos="0 0 .8"><joint name="hinge" axis="0 0 1" range="-30 90"/>
    <geom type="box" size=".01 .01 .01"/></body>
</body></worldbody><keyframe><key name="home" qpos=".25 .5"/></keyframe></mujoco>"""


def scene_of(objects: dict[str, Any], **others: Any) -> SceneModel:
    """The model of a scene of these objects on a floor of 3 m x 3 m."""
    return build_model(SceneConfig.load({"floor": {"size": [3, 3]}, "objects": objects, **others}))


@dataclass(frozen=True)
class Packed:
    """A scene on the host, from its model to the flat arrays."""

    scene: SceneModel
    plan: Plan
    colliders: list[Collider]
    arrays: dict[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.arrays[name]

    def number(self, name: str) -> int:
        """The place of an object in placement order."""
        return [o.name for o in self.plan.objects].index(name)

    def object(self, name: str) -> PlacedObject:
        """An object of the plan."""
        return self.plan.objects[self.number(name)]

    def listed(self, name: str, key: str, values: str) -> list:
        """Return a list of an object: the entries of `values` at `obj_{key}adr` and `obj_{key}num`."""
        i = self.number(name)
        adr, num = int(self[f"obj_{key}adr"][i]), int(self[f"obj_{key}num"][i])
        return self[values][adr : adr + num].tolist()


def checked(scene: SceneModel) -> Plan:
    """Plan a scene, with all that is checked before it is uploaded."""
    plan = build_plan(scene)
    for check in CHECKS:
        check(plan)
    return plan


def pack(scene: SceneModel, lanes: int = 1) -> Packed:
    """Pack a scene for so many lanes a world."""
    plan = build_plan(scene)
    colliders = collect_colliders(plan.pieces, scene.config.geometry == "visual", "cpu")
    return Packed(scene, plan, colliders, pack_program(plan, colliders, lanes))
