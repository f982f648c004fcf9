"""Kinds of starts: `StartConfig`, a state that an episode may begin in: the arm before an object, or holding it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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
    must(lambda ends: ends[0] <= ends[1], "should be [low, high] with low <= high"),
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
    owners = owners_of(variants_of(groups))
    absent = {name for name, group in ((n, g) for g in groups.values() for n in g.of) if not group.always_whole}
    for i, start in enumerate(starts):
        at = f"{where}: start.{i}"
        if start.of is not None:
            _check_target(start, start.of, objects, groups, absent, at)
        for name, marker in start.place.items():
            _check_place(name, marker, objects, absent, f"{at}.place")
        for key in start.joints:
            name, _, joint = key.rpartition("/")
            if not name or not joint:
                raise SceneKeyError(f"{at}.joints: '{key}' should be 'object/joint', as in 'cabinet/upper'.")
            _check_object(name, objects, f"{at}.joints")
            if name in owners:
                raise SceneKeyError(f"{at}.joints: '{name}' is one of several variants and may be absent.")


def _check_object(name: str, objects: Iterable[str], where: str) -> None:
    if name not in objects:
        raise UnknownNameError("object", name, where, objects)


def _check_target(
    start: StartConfig,
    of: str,
    objects: Mapping[str, ObjectConfig],
    groups: Mapping[str, GroupConfig],
    absent: set[str],
    where: str,
) -> None:
    """Check the object that an arm holds at the start, or all of its variants."""
    variants = variants_of(groups)
    members = start.targets(groups)
    if of not in variants:
        _check_object(of, [*objects, *variants], f"{where}.of")
        if of in absent:
            raise SceneKeyError(f"{where}.of: '{of}' may be absent, as it is in a group. Name another object.")
    for name in members:
        part = objects[name]
        if not part.reachable:
            raise SceneKeyError(f"{where}.of: '{name}' should be 'reachable', as an arm is to be there at the start.")
        if start.is_held and part.kind != "free":
            raise SceneKeyError(f"{where}: '{name}' is no free object, so it cannot be held in the air.")
        for other, words in objects.items():
            if start.is_held and words.support is not None and words.support.parent.split("/")[0] == name:
                raise SceneKeyError(f"{where}: '{other}' stands on '{name}', which should stay where it is.")


def _check_place(name: str, marker: str, objects: Mapping[str, ObjectConfig], absent: set[str], where: str) -> None:
    """Check an object that is placed at a marker."""
    for one in (name, marker):
        _check_object(one, objects, where)
        if one in absent:
            raise SceneKeyError(f"{where}: '{one}' may be absent, as it is in a group. Name another object.")
    if objects[marker].kind != "marker":
        valid = [other for other, part in objects.items() if part.kind == "marker"]
        raise UnknownNameError("marker", marker, where, valid)
    if not objects[name].is_placed or objects[name].support is None or objects[name].support != objects[marker].support:
        raise SceneKeyError(
            f"{where}: '{name}' should be placed on what its marker '{marker}' is on: give both the same support."
        )
