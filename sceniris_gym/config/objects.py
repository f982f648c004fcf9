"""One object of a scene: `ObjectConfig`, with its support, region, relations and joints.

Lengths are in metres. Angles are in degrees in files, except for joint positions. Joint positions,
`ObjectConfig.drawn_orientation` and the attributes of relations are in radians.
"""

import itertools
from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from sceniris_gym.config import fields
from sceniris_gym.config.bounds import STANDING_GAP
from sceniris_gym.config.fields import DEFAULT, DRAWN, FLOOR, ROBOT, check_words, wrong
from sceniris_gym.config.loader import JOINT_FORMS, OF_VARIANTS, REGION_FORMS, SUPPORT_WORDS
from sceniris_gym.config.member_names import object_of
from sceniris_gym.config.orientation import DrawnOrientation, Orientation
from sceniris_gym.config.randomize import DrawConfig, ObjectWord
from sceniris_gym.config.relations import RELATION_WORDS, Joined, Relations
from sceniris_gym.config.section import Section

_REACH_WORDS = ("tier", "by", "grasp", "firm", "margin")


class JointConfig(Section):
    """The draw of one joint position by a reset. Give exactly one of these keys.

    `fraction`: [low, high] as fractions of the joint's limits. `range`: [low, high] in m or rad. `choice`: a list of
    values in m or rad. `value`: one value in m or rad. `noise`: a number n in m or rad, for a uniform draw between
    home - n and home + n that is clipped to the joint's limits. `noise_norm`: a number n in m or rad: all joints
    of the object or robot with this key differ from home by a vector with norm n in a uniform direction, and are
    clipped to their limits.
    """

    one_of = JOINT_FORMS
    fraction: fields.FractionInterval | None = None
    range: fields.JointInterval | None = None
    choice: fields.Choice | None = None
    value: fields.JointPosition | None = None
    noise: fields.Noise | None = None
    noise_norm: fields.Noise | None = None

    @property
    def most_noise(self) -> float | None:
        """The largest deviation from home, or None for a draw that does not depend on home."""
        return self.noise_norm if self.noise is None else self.noise


class RegionConfig(Section):
    """A part of the support, in the frame of the support's body, or in the world frame for the floor.

    Give exactly one of these keys. `box`: two corners ((x, y), (x, y)) [m]. `fraction`: two corners as fractions of the
    support's bounds. `polygon`: corners ((x, y), ...) [m]. `points`: positions ((x, y), ...) [m] to choose from. For an
    object without a support, the region is a `box` or `points` of (x, y, z) in the world frame.
    """

    one_of = REGION_FORMS
    box: fields.Box | None = None
    fraction: fields.FractionBox | None = None
    polygon: fields.Polygon | None = None
    points: fields.Points | None = None

    @property
    def is_3d(self) -> bool:
        """True for a box or points in space, False for a part of a support."""
        return len((self.box or self.points or ((),))[0]) == 3

    @property
    def corners(self) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
        """The low and high corner [m] of the `box`, or of the axis-aligned box around the `points`, else None."""
        if self.points is None:
            return self.box
        axes = list(zip(*self.points, strict=True))
        return tuple(map(min, axes)), tuple(map(max, axes))


class SupportConfig(NamedTuple):
    """The support of an object. `word` is the key in the scene file: 'on', 'inside' or 'in'.

    `parent` names the support: 'floor', an object, 'object/body', or a static geom or body of the scene's model.
    """

    word: str
    parent: str


class ObjectConfig(Section):
    """One object of the scene. docs/language/ explains each key."""

    model_config = ConfigDict(populate_by_name=True)
    misplaced = dict.fromkeys(
        RELATION_WORDS, "should be given in 'relations', as in relations: [{near: mug, ...}]"
    ) | dict.fromkeys(DRAWN, "should be given for a single variant, as in variants: {can: {weight: 2, ...}}")
    misplaced |= {"needs": "should be the value of 'if', for an object that is present only with it"}
    asset: str | None = None
    scale: fields.Scale = 1.0
    body: str | None = None
    kind: Literal["free", "fixture", "static", "marker"] = "free"
    on: str | None = None
    inside: str | None = None
    in_: str | None = Field(default=None, alias="in")
    ratio_on_support: fields.Fraction = 0.0
    region: RegionConfig | None = None
    relations: Relations = ()
    orientation: Orientation | None = None
    parts: dict[fields.ObjectName, fields.JointOfPart] = Field(default_factory=dict)
    joints: dict[str, JointConfig] = Field(default_factory=dict)
    clearance: fields.Clearance = 0.001
    gap: fields.Gap = 0.0005
    stands: bool = True
    reachable: fields.Reachable = False
    by: str = ROBOT
    grasp: str | None = None
    firm: bool = False
    margin: Annotated[float, Field(ge=1e-4, le=0.1)] = 0.003
    randomize: dict[ObjectWord, DrawConfig] = Field(default_factory=dict)
    if_: fields.NameOrNames = Field(default=(), alias="if")
    unless: fields.NameOrNames = ()

    @property
    def support(self) -> SupportConfig | None:
        """The support that the scene names, or None."""
        parents = zip(SUPPORT_WORDS, (self.on, self.inside, self.in_), strict=True)
        return next((SupportConfig(word, parent) for word, parent in parents if parent is not None), None)

    @property
    def drawn_orientation(self) -> DrawnOrientation:
        """The distribution of the object's orientation, by default any yaw."""
        return DrawnOrientation("yaw") if self.orientation is None else self.orientation.drawn

    @property
    def is_placed(self) -> bool:
        """True if a reset draws the object's pose. Otherwise, the object keeps its pose from the model."""
        return self.kind != "static" and (self.support is not None or self.region is not None)

    @property
    def has_to_stand(self) -> bool:
        """True if a free object has to stay where it is put.

        This holds for a free object with `stands: true`, a support, a gap of at most `STANDING_GAP`, and an orientation
        other than 'any'.
        """
        is_put_down = self.kind == "free" and self.support is not None and self.gap <= STANDING_GAP
        return self.stands and is_put_down and self.drawn_orientation.kind != "any"

    @property
    def is_turned(self) -> bool:
        """True if a placed free object may lie on different sides: its stable pose is drawn, or it may fall over."""
        is_drawn = self.drawn_orientation.kind == "stable" or not self.has_to_stand
        return is_drawn and self.is_placed and self.kind == "free"

    @property
    def is_open_furniture(self) -> bool:
        """True for an upright fixture or static object with drawn joints."""
        is_upright = self.drawn_orientation.kind not in ("any", "stable")
        return bool(self.joints) and self.kind in ("fixture", "static") and is_upright

    def joint_of(self, part: str, variant: str) -> str | None:
        """Return the name or pattern of a part's joint in a variant, or None if the variant lacks the part.

        The variant's name takes precedence over a pattern of variants, and both over `default`.

        Raises:
            KeyError: The part has no key for the variant.
        """
        names = self.parts[part]
        return names[next((key for key in (variant, *names) if key in names and fnmatchcase(variant, key)), DEFAULT)]

    @property
    def joined_to(self) -> str | None:
        """The object that this object is joined to at sites, or None."""
        return next((relation.beside.of for relation in self.relations if isinstance(relation, Joined)), None)

    @property
    def references(self) -> list[tuple[str, str]]:
        """The objects named by the relations and the orientation: (path of the key in the object, name)."""
        found = [(f"relations.{i}.{key}", name) for i, r in enumerate(self.relations) for key, name in r.references]
        drawn = self.drawn_orientation
        return found + ([(f"orientation.{drawn.kind}", drawn.target)] if drawn.target is not None else [])

    @property
    def needs(self) -> tuple[str, ...]:
        """Names that have to be placed before this object: its support, then the objects and robots it refers to."""
        owner = [] if self.support is None else [object_of(self.support.parent)]
        return tuple(dict.fromkeys(name for name in (*owner, *(of for _, of in self.references)) if name != FLOOR))

    @classmethod
    def _problem(cls, key: Any, valid: list[str]) -> PydanticCustomError:
        return super()._problem(key, [*valid, *OF_VARIANTS])

    @model_validator(mode="before")
    @classmethod
    def _reachable_in_words(cls, data: Any) -> Any:
        """Expand `reachable: {tier: ik, by: left, grasp: ...}` to the three keys `reachable`, `by` and `grasp`."""
        words = data.get("reachable") if isinstance(data, Mapping) else None
        if not isinstance(words, Mapping):
            return data
        check_words(words, _REACH_WORDS, f"should have only the keys {', '.join(_REACH_WORDS)} in 'reachable'")
        if twice := [key for key in words if key in data]:
            raise wrong(f"should have '{twice[0]}' only once: inside 'reachable' or next to it")
        named = {key: value for key, value in words.items() if key != "tier"}
        return {**data, "reachable": words.get("tier", True), **named}

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if self.asset is not None and self.body is not None:
            raise wrong("should have an 'asset' or a 'body' of the model, not both")
        if self.asset is None and self.scale != 1.0:
            raise wrong("should have a 'scale' only together with an 'asset'")
        words = [word.rstrip("_") for word in self.given(("on", "inside", "in_"))]
        if len(words) > 1:
            raise wrong(f"should have only one of {', '.join(SUPPORT_WORDS)}, but has {' and '.join(words)}")
        is_put = words or self.region or self.orientation or self.ratio_on_support or self.relations
        if self.kind == "static" and is_put:
            raise wrong("should have no support, region, relations or orientation: 'static' objects never move")
        if words and self.region is not None and self.region.is_3d:
            raise wrong("should have a 2D region: 3D boxes and 3D points are only for objects without a support")
        if not words and self.region is not None and not self.region.is_3d:
            raise wrong("should have a support ('on', 'inside' or 'in'), or its region should be a 3D box or 3D points")
        if not words and self.ratio_on_support > 0.0:
            raise wrong("should have a 'ratio_on_support' only with a support ('on', 'inside' or 'in')")
        if not words and self.relations and self.region is None:
            raise wrong(
                "should have a support ('on', 'inside' or 'in') or a 3D region (box or points), because it has "
                "relations"
            )
        joined = [relation for relation in self.relations if isinstance(relation, Joined)]
        if joined and self.orientation is not None:
            raise wrong("should have no 'orientation': the sites in 'beside' already determine it")
        if len(joined) > 1:
            raise wrong("should be joined to one other object at most: one pair of sites already determines its pose")
        for one, other in itertools.combinations(self.relations, 2):
            if one.excludes(other):
                raise wrong(
                    f"should have relations that can hold together: '{one.word}' and '{other.word}' of "
                    f"'{one.anchors[0]}' have no area in common. Remove one, or give both a wider 'angle'"
                )
        if self.reachable and not self.is_placed:
            raise wrong("should have a support ('on', 'inside' or 'in') or a 3D region, because it is 'reachable'")
        said = self.model_fields_set
        for word in ("by", "grasp", "firm"):  # with `reachable: false`, these words have no effect but are kept
            if word in said and getattr(self, word) is not None and "reachable" not in said:
                raise wrong(f"should have '{word}' only together with 'reachable'")
        if self.firm and self.kind != "free":
            raise wrong(f"should have 'firm' only if its kind is 'free': no hand lifts a {self.kind}")
        if "margin" in said and self.reachable != "path":
            raise wrong("should have 'margin' only together with 'reachable: path'")
        if not words and any(relation.reference_frame == "support" for relation in self.relations):
            raise wrong("should name its support ('on', 'inside' or 'in'), because a relation has 'frame: support'")
        return self
