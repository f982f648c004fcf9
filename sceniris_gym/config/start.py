"""Kinds of starts: `StartConfig`, a state that an episode may begin in: the arm before an object, or holding it."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from sceniris_gym.config.fields import Length, Number, listed, must, within, wrong
from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.objects import JointConfig, ObjectConfig
from sceniris_gym.config.section import Section
from sceniris_gym.config.variants import owners_of, variants_of
from sceniris_gym.errors import SceneKeyError, UnknownNameError

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


def check_starts(
    starts: Sequence[StartConfig],
    objects: Mapping[str, ObjectConfig],
    groups: Mapping[str, GroupConfig],
    where: str,
) -> None:
    """Check all names in kinds of starts; errors begin with `where`.

    Raises:
        UnknownNameError: An object or a marker that the scene does not have.
        SceneKeyError: An object that a start cannot do this with.
    """
    variants = variants_of(groups)
    absent = {name for group in groups.values() if not group.always_whole for name in group.of}
    for i, start in enumerate(starts):
        at = f"{where}: start.{i}"
        if start.of is not None and start.of not in variants:
            _check_object(start.of, [*objects, *variants], absent, f"{at}.of")
        for name in start.targets(groups):
            _check_target(start, name, objects, at)
        for name, marker in start.place.items():
            _check_place(name, marker, objects, absent, f"{at}.place")
        for key in start.joints:
            name, _, joint = key.rpartition("/")
            if not name or not joint:
                raise SceneKeyError(f"{at}.joints: '{key}' should be 'object/joint', as in 'cabinet/upper'.")
            _check_object(name, objects, owners_of(variants), f"{at}.joints")


def _check_object(name: str, objects: Iterable[str], absent: Container[str], where: str) -> None:
    """Check that there is an object, in all worlds."""
    if name not in objects:
        raise UnknownNameError("object", name, where, [other for other in objects if other not in absent])
    if name in absent:
        raise SceneKeyError(f"{where}: '{name}' may be absent, as one of a group or of variants. Name another object.")


def _check_target(start: StartConfig, name: str, objects: Mapping[str, ObjectConfig], where: str) -> None:
    """Check an object that an arm is at."""
    if not objects[name].reachable:
        raise SceneKeyError(f"{where}.of: '{name}' should be 'reachable', as an arm is to be there at the start.")
    if start.is_held and objects[name].kind != "free":
        raise SceneKeyError(f"{where}: '{name}' is no free object, so it cannot be held in the air.")
    for other, words in objects.items():
        if start.is_held and words.support is not None and words.support.parent.split("/")[0] == name:
            raise SceneKeyError(f"{where}: '{other}' stands on '{name}', which should stay where it is.")


def _check_place(
    name: str, marker: str, objects: Mapping[str, ObjectConfig], absent: Container[str], where: str
) -> None:
    """Check an object that is placed at a marker."""
    _check_object(name, objects, absent, where)
    markers = [other for other, part in objects.items() if part.kind == "marker"]
    if marker not in markers:
        raise UnknownNameError("marker", marker, where, markers)
    _check_object(marker, objects, absent, where)
    if not objects[name].is_placed or objects[name].support is None or objects[name].support != objects[marker].support:
        raise SceneKeyError(
            f"{where}: '{name}' should be placed on what its marker '{marker}' is on: give both the same support."
        )
