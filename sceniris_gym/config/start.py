"""Kinds of starts: `StartConfig`, a state that an episode may begin in: the arm before an object, or holding it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from sceniris_gym.config.fields import Length, Number, listed, must, within, wrong
from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.section import Section
from sceniris_gym.config.variants import variants_of

_Weight = Annotated[Number, Field(gt=0.0), within("weight")]
_Heights = Annotated[
    tuple[Length, Length],
    BeforeValidator(listed),
    must(lambda ends: ends[0] <= ends[1] > 0.0, "should be [low, high] with low <= high, and high above 0"),
]


class StartConfig(Section):
    """One kind of start; an episode has one of them, drawn in proportion to its weight.

    Attributes:
        weight: Its weight among all kinds.
        robot: The pose of the arm: its start pose ('home'), the pre-grasp of an object, or the grasp with the fingers
            closed on it.
        of: The object that is grasped, or an object with variants.
        grasp: A glob of the names of the grasps that count, those of sites with or without 'grasp_'; None for all.
        lift: Least and greatest height [m] by which the object is lifted straight up.
        robot_joints: Draws of the arm's joints, by name or pattern: the object is held wherever they bring the hand.
        place: Objects that are placed at a marker, and the marker of each.
        joints: Draws of objects' joints instead of their usual ones, by 'object/joint'.
    """

    weight: _Weight = 1.0
    robot: Literal["home", "pregrasp", "grasp"] = "home"
    of: str | None = None
    grasp: str | None = None
    lift: _Heights | None = None
    robot_joints: dict[str, JointConfig] = Field(default_factory=dict)
    place: dict[str, str] = Field(default_factory=dict)
    joints: dict[str, JointConfig] = Field(default_factory=dict)

    @property
    def is_held(self) -> bool:
        """True if the object is in the hand, away from where it was placed."""
        return self.lift is not None or bool(self.robot_joints)

    def targets(self, groups: Mapping[str, GroupConfig]) -> tuple[str, ...]:
        """Return the objects that `of` stands for: itself, or all of its variants."""
        return () if self.of is None else variants_of(groups).get(self.of, (self.of,))

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> StartConfig:
        if (self.of is None) != (self.robot == "home"):
            raise wrong("should name an object as 'of' where 'robot' is 'pregrasp' or 'grasp', and only there")
        if self.grasp is not None and self.of is None:
            raise wrong("should have 'grasp' only together with 'of'")
        if self.is_held and self.robot != "grasp":
            raise wrong("should have 'lift' or 'robot_joints' only where 'robot' is 'grasp'")
        if self.lift is not None and self.robot_joints:
            raise wrong("should have 'lift' or 'robot_joints', not both")
        for words in (*self.robot_joints.values(), *self.joints.values()):
            if words.choice is not None:
                raise wrong("should draw joints by 'fraction', 'range', 'value' or 'noise'")
        return self
