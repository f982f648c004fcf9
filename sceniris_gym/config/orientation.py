"""Orientation of an object: `Orientation` as written in a scene, and `DrawnOrientation`, its distribution."""

import math
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from sceniris_gym.config.fields import TurnInterval, check_words, wrong
from sceniris_gym.config.loader import ORIENTATION_FORMS
from sceniris_gym.config.section import Section

_WORDS = {"fixed": {"yaw": (0.0, 0.0)}, "any": {"any": True}, "stable": {"stable": {}}}


class DrawnOrientation(NamedTuple):
    """The distribution of an orientation.

    Attributes:
        kind: 'yaw' is upright with a rotation about the vertical. 'stable' is a stable pose, drawn by its probability,
            with a rotation about the vertical. 'any' is uniform in SO(3). 'face_to' is upright, with the front (-y)
            towards `target`. 'with' is upright, with the heading of `target`.
        yaw: Interval of the rotation about the vertical [rad]. For 'face_to', the rotation is added to the heading
            towards `target`, and for 'with' to the heading of `target`.
        target: The object that 'face_to' or 'with' names.
    """

    kind: Literal["yaw", "stable", "any", "face_to", "with"]
    yaw: tuple[float, float] = (-math.pi, math.pi)
    target: str | None = None


def _all_around(value: Any) -> Any:
    if isinstance(value, str) and value != "free":
        raise wrong("should be 'free' or [low, high] in degrees", value, ("free",))
    return (-180.0, 180.0) if isinstance(value, str) else value


class Stable(Section):
    """A stable pose, and its `yaw` about the vertical: 'free' or [low, high] in degrees."""

    yaw: Annotated[TurnInterval, BeforeValidator(_all_around)] = (-180.0, 180.0)


class Orientation(Section):
    """Orientation of an object, in one of the forms below.

    - `fixed`
    - {yaw: [low, high]} in degrees about the support's normal
    - `any`
    - `stable`, or {stable: {yaw: [low, high]}}
    - {face_to: object} or {with: object}, with an optional `yaw` [low, high] in degrees to add
    """

    model_config = ConfigDict(populate_by_name=True)

    yaw: TurnInterval | None = None
    any: Literal[True] | None = None
    stable: Stable | None = None
    face_to: str | None = None
    with_: str | None = Field(default=None, alias="with")

    @property
    def drawn(self) -> DrawnOrientation:
        """The distribution of the orientation."""
        if self.any is not None:
            return DrawnOrientation("any")
        if self.stable is not None:
            return DrawnOrientation("stable", _radians(self.stable.yaw))
        kind = "face_to" if self.face_to is not None else "yaw" if self.with_ is None else "with"
        return DrawnOrientation(kind, _radians(self.yaw or (0.0, 0.0)), self.face_to or self.with_)

    @model_validator(mode="before")
    @classmethod
    def _from_word(cls, data: Any) -> Any:
        if not isinstance(data, str):
            return data
        forms = "{yaw: [low, high]} in degrees, {stable: {yaw: [low, high]}}, {face_to: object} or {with: object}"
        check_words([data], _WORDS, f"should be 'fixed', 'any', 'stable', or a mapping such as {forms}")
        return _WORDS[data]

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        given = [word.rstrip("_") for word in self.given(tuple(self.__class__.model_fields))]
        if len(given) != 1 and given not in (["yaw", "face_to"], ["yaw", "with"]):
            forms, has = ", ".join(ORIENTATION_FORMS), " and ".join(given) or "none"
            raise wrong(f"should have exactly one of {forms}, or a yaw next to face_to or with, but has {has}")
        return self


def _radians(interval: tuple[float, float]) -> tuple[float, float]:
    return (math.radians(interval[0]), math.radians(interval[1]))
