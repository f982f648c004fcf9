"""What a scene is said to be: SceneConfig and its parts, from YAML, a dict or Python.

Lengths are metres. Angles are degrees in files; `ObjectConfig.turn`, the attributes of relations and the joints'
ranges are radians.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, PrivateAttr, Strict, model_validator

from sceniris_gym.scene.complaints import reading, where_now
from sceniris_gym.scene.files import JOINT_FORMS, REGION_FORMS, SUPPORT_WORDS, override, read_scene
from sceniris_gym.scene.groups import GroupConfig
from sceniris_gym.scene.limits import MAX_RELATIONS
from sceniris_gym.scene.orientations import Orientation, Turn
from sceniris_gym.scene.part import Part, check_one_of
from sceniris_gym.scene.references import check_names
from sceniris_gym.scene.relations import RELATION_WORDS, Relation
from sceniris_gym.scene.values import (
    FLOOR,
    MOST_FAR,
    Box,
    Choice,
    Extents2,
    Fraction,
    FractionBox,
    FractionInterval,
    Gap,
    Interval,
    NotNegative,
    Number,
    ObjectName,
    Point3,
    Polygon,
    Reachable,
    wrong,
)


class Floor(Part):
    """The ground workspace: a rectangle around the world's origin, `size` = (x, y) full extents [m]."""

    size: Extents2


class JointConfig(Part):
    """How one joint is drawn at a reset; exactly one of the words is given.

    `fraction` [low, high] of the joint's limits, `range` [low, high] in m or rad, `choice` of values and `value` in
    m or rad, and `noise` n: uniform in [home - n, home + n], cut off at the limits.
    """

    fraction: FractionInterval | None = None
    range: Interval | None = None
    choice: Choice | None = None
    value: Number | None = None
    noise: NotNegative | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> JointConfig:
        return check_one_of(self, JOINT_FORMS)


class RegionConfig(Part):
    """A crop of the support, in its body frame (the world's for the floor); exactly one of the words is given.

    `box` ((x, y), (x, y)) [m], or ((x, y, z), (x, y, z)) in the world without a support; `fraction` ((x, y), (x, y))
    of the support's bounds; `polygon` ((x, y), ...) [m].
    """

    box: Box | None = None
    fraction: FractionBox | None = None
    polygon: Polygon | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> RegionConfig:
        if self.is_3d and max(abs(x) for corner in self.box or () for x in corner) > MOST_FAR:
            raise wrong(
                f"should have its box within {MOST_FAR:g} m of the world's origin: rounding grows with distance"
            )
        return check_one_of(self, REGION_FORMS)

    @property
    def is_3d(self) -> bool:
        """Whether this is a box in space rather than a crop of a support."""
        return self.box is not None and len(self.box[0]) == 3


@dataclass(frozen=True)
class SupportConfig:
    """What an object is placed on: `word` is 'on', 'inside' or 'in'; `parent` is 'floor', 'object' or 'object/body'."""

    word: Literal["on", "inside", "in"]
    parent: str


class ObjectConfig(Part):
    """One object of the scene; the words are explained in the scene language."""

    model_config = ConfigDict(populate_by_name=True)
    misplaced = dict.fromkeys(RELATION_WORDS, "should stand in 'relations', as in relations: [{near: mug, ...}]")
    asset: str | None = None
    kind: Literal["free", "fixture", "static", "marker"] = "free"
    on: str | None = None
    inside: str | None = None
    in_: str | None = Field(default=None, alias="in")
    ratio_on_support: Fraction = 0.0
    region: RegionConfig | None = None
    relations: Annotated[tuple[Relation, ...], Field(max_length=MAX_RELATIONS)] = ()
    orientation: Orientation | None = None
    joints: dict[str, JointConfig] = Field(default_factory=dict)
    clearance: NotNegative = 0.001
    gap: Gap = 0.0005
    reachable: Reachable = False
    by: Literal["robot"] = "robot"

    @property
    def support(self) -> SupportConfig | None:
        """The support that the scene names, or None."""
        words: tuple[tuple[Literal["on", "inside", "in"], str | None], ...]
        words = (("on", self.on), ("inside", self.inside), ("in", self.in_))
        return next((SupportConfig(word, parent) for word, parent in words if parent is not None), None)

    @property
    def turn(self) -> Turn:
        """How the orientation is drawn: any yaw by default."""
        return Turn("yaw") if self.orientation is None else self.orientation.turn

    @property
    def yaw(self) -> tuple[float, float]:
        """Interval [rad] from which the turn about the vertical is drawn; see `Turn`."""
        return self.turn.yaw

    @property
    def is_placed(self) -> bool:
        """Whether a reset draws a pose for it; else it stays where the model has it."""
        return self.kind != "static" and (self.support is not None or self.region is not None)

    @property
    def references(self) -> list[tuple[str, str]]:
        """The objects that its relations and orientation name: (key path inside of the object, name)."""
        found = []
        for i, relation in enumerate(self.relations):
            word = "of" if relation.word == "direction" else relation.word
            found += [(f"relations.{i}.{word}", anchor) for anchor in relation.anchors]
            found += [(f"relations.{i}.frame", relation.frame_object)] if relation.frame_object else []
        return found + ([("orientation.face_to", self.turn.target)] if self.turn.target is not None else [])

    @property
    def needs(self) -> tuple[str, ...]:
        """The objects that are placed before it ('robot' for the robot): its support, then all that it refers to."""
        owner = [] if self.support is None else [self.support.parent.split("/")[0]]
        names = [*owner, *(name for _, name in self.references)]
        return tuple(dict.fromkeys(name for name in names if name != FLOOR))

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> ObjectConfig:
        words = [word for word in SUPPORT_WORDS if getattr(self, "in_" if word == "in" else word) is not None]
        if len(words) > 1:
            raise wrong(f"should have one of {', '.join(SUPPORT_WORDS)}, and has {' and '.join(words)}")
        if self.kind == "static" and (
            words or self.region or self.orientation or self.ratio_on_support or self.relations
        ):
            raise wrong("should have no support, region, relations or orientation: it stays where the model has it")
        if words and self.region is not None and self.region.is_3d:
            raise wrong("should have a region in two dimensions: a 3D box is for an object without a support")
        if not words and self.region is not None and not self.region.is_3d:
            raise wrong("should name its support ('on', 'inside' or 'in'), or have a region that is a 3D box")
        if not words and self.ratio_on_support > 0.0:
            raise wrong("should have a 'ratio_on_support' only with a support ('on', 'inside' or 'in')")
        if not words and self.relations and self.region is None:
            raise wrong(
                "should name its support ('on', 'inside' or 'in') or have a region that is a 3D box: it has relations"
            )
        if self.reachable and not self.is_placed:
            raise wrong("should be placed ('on', 'inside', 'in' or a 3D region) to be 'reachable'")
        if "by" in self.model_fields_set and not self.reachable:
            raise wrong("should say what is 'reachable' by the robot, or leave out 'by'")
        if not words and any(relation.frame == "support" for relation in self.relations):
            raise wrong("should name its support ('on', 'inside' or 'in'), which is the frame of one of its relations")
        return self


class RobotConfig(Part):
    """The robot: an asset at `base` (x, y, z) [m], turned by `yaw` [degrees], started from `keyframe`."""

    asset: str
    base: Point3 = (0.0, 0.0, 0.0)
    yaw: Number = 0.0
    keyframe: str = "home"
    joints: dict[str, JointConfig] = Field(default_factory=dict)


class SceneConfig(Part):
    """A whole scene, validated. Made by `SceneConfig.load` from a file, a name or a dict, or directly in Python.

    Raises:
        SceneKeyError: a key or a value is wrong.
        UnknownNameError: a support, or an object that another refers to, that is not in the scene.
        CycleError: objects that are placed relative to each other.
    """

    name: str = "scene"
    floor: Floor | None = None
    robot: RobotConfig | None = None
    objects: dict[ObjectName, ObjectConfig] = Field(default_factory=dict)
    groups: dict[ObjectName, GroupConfig] = Field(default_factory=dict)
    geometry: Literal["physics", "visual"] = "physics"
    attempts: Annotated[int, Strict(), Field(ge=1, le=10_000)] = 10
    restarts: Annotated[int, Strict(), Field(ge=0, le=10_000)] = 8
    model: Path | None = None
    _where: str = PrivateAttr("SceneConfig")

    @classmethod
    def load(cls, scene: str | Path | Mapping | SceneConfig, overrides: Mapping[str, Any] | None = None) -> SceneConfig:
        """Read and validate a scene.

        Args:
            scene: the name of a shipped scene, the path of a YAML file, a mapping of the same form, or a SceneConfig.
            overrides: parts to replace, by dotted keys: `{"objects.apple.clearance": 0.01}`. A new object is given as a
                whole: `{"objects.pear": {...}}`.

        Raises:
            SceneFileError: the file is missing, or is not YAML, or gives a key twice.
            ScenirisError: as in the class.
        """
        if isinstance(scene, SceneConfig):
            if not overrides:
                return scene
            data, where, name = scene.model_dump(by_alias=True, exclude_unset=True), scene.where, scene.name
        else:
            raw = read_scene(scene)
            data, where, name = raw.data, raw.where, raw.name
        if overrides:
            data = override(data, overrides, where)
        with reading(where):
            config = cls.model_validate({"name": name, **data})
        config._where = where
        return config

    @property
    def where(self) -> str:
        """The file this scene was read from, for messages."""
        return self._where

    def canonical(self) -> str:
        """Return all that shapes the layouts, defaults included, as JSON that is equal for equal scenes.

        Names of files are left out: what counts is what is in them.
        """
        parts = {"name", "model"}
        data = self.model_dump(mode="json", by_alias=True, exclude=parts)
        for part in (*data["objects"].values(), *filter(None, [data["robot"]])):
            part.pop("asset")
        for part in data["objects"].values():
            if not part["reachable"]:
                del part["reachable"], part["by"]
        return json.dumps(data, separators=(",", ":"))

    @model_validator(mode="after")
    def _names_are_known(self) -> SceneConfig:
        check_names(self, where_now.get() or type(self).__name__)
        return self
