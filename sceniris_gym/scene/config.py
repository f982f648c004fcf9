"""What a scene is said to be: SceneConfig and its parts, from YAML, a dict or Python.

Lengths are metres. Angles are degrees in files; `ObjectConfig.yaw` and the joints' ranges are radians.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    Strict,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from sceniris_gym.errors import CycleError, NoSupportError, SceneKeyError, UnknownNameError
from sceniris_gym.scene.complaints import UNKNOWN_KEY, UNSUPPORTED, reading, where_now
from sceniris_gym.scene.files import JOINT_FORMS, REGION_FORMS, SUPPORT_WORDS, merge, nest, read_scene
from sceniris_gym.scene.values import (
    FLOOR,
    Box,
    Choice,
    Extents2,
    Fraction,
    FractionBox,
    FractionInterval,
    Interval,
    NotNegative,
    Number,
    ObjectName,
    Point3,
    Polygon,
    wrong,
)


class Part(BaseModel):
    """A mapping of the scene file: frozen, and every wrong key or value is a ScenirisError."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    unsupported: ClassVar[tuple[str, ...]] = ()
    """Words of the scene language that this version knows of and refuses."""

    @model_validator(mode="wrap")
    @classmethod
    def _in_words(cls, data: Any, handler: ModelWrapValidatorHandler) -> Any:
        # A part that is made in Python by itself is named by its class; inside of a scene, the scene does the reading.
        with reading(cls.__name__) if where_now.get() is None else nullcontext():
            if isinstance(data, Mapping):
                cls._check_keys(data)
            return handler(data)

    @classmethod
    def _check_keys(cls, data: Mapping) -> None:
        valid = [field.alias or name for name, field in cls.model_fields.items()]
        problems = [
            InitErrorDetails(
                type=PydanticCustomError(UNSUPPORTED, "not supported", {"word": key})
                if key in cls.unsupported
                else PydanticCustomError(UNKNOWN_KEY, "unknown key", {"key": key, "valid": valid}),
                loc=(str(key),),
                input=value,
            )
            for key, value in data.items()
            if key not in valid and key not in cls.model_fields
        ]
        if problems:
            raise ValidationError.from_exception_data(cls.__name__, problems)


_PartT = TypeVar("_PartT", bound=Part)


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
        return _check_one_of(self, JOINT_FORMS)


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
        return _check_one_of(self, REGION_FORMS)

    @property
    def is_3d(self) -> bool:
        """Whether this is a box in space rather than a crop of a support."""
        return self.box is not None and len(self.box[0]) == 3


class Orientation(Part):
    """The yaw about the support's normal, drawn uniformly from `yaw` [low, high] in degrees."""

    unsupported = ("face_to",)
    yaw: Interval

    @model_validator(mode="before")
    @classmethod
    def _from_word(cls, data: Any) -> Any:
        if data == "fixed":
            return {"yaw": (0.0, 0.0)}
        if isinstance(data, str):
            if data in ("any", "stable"):
                raise PydanticCustomError(UNSUPPORTED, "not supported", {"word": data})
            raise wrong("should be 'fixed' or {yaw: [low, high]} in degrees")
        return data


@dataclass(frozen=True)
class SupportConfig:
    """What an object is placed on: `word` is 'on', 'inside' or 'in'; `parent` is 'floor', 'object' or 'object/body'."""

    word: Literal["on", "inside", "in"]
    parent: str


class ObjectConfig(Part):
    """One object of the scene; the words are explained in the scene language."""

    model_config = ConfigDict(populate_by_name=True)
    unsupported = ("relations", "between", "beside", "reachable")
    asset: str | None = None
    kind: Literal["free", "fixture", "static", "marker"] = "free"
    on: str | None = None
    inside: str | None = None
    in_: str | None = Field(default=None, alias="in")
    ratio_on_support: Fraction = 0.0
    region: RegionConfig | None = None
    orientation: Orientation | None = None
    joints: dict[str, JointConfig] = {}
    clearance: NotNegative = 0.001
    gap: NotNegative = 0.0005

    @property
    def support(self) -> SupportConfig | None:
        """The support that the scene names, or None."""
        words: tuple[tuple[Literal["on", "inside", "in"], str | None], ...]
        words = (("on", self.on), ("inside", self.inside), ("in", self.in_))
        return next((SupportConfig(word, parent) for word, parent in words if parent is not None), None)

    @property
    def yaw(self) -> tuple[float, float]:
        """Interval [rad] from which the yaw is drawn; (0, 0) for a fixed one, (-pi, pi) by default."""
        if self.orientation is None:
            return (-math.pi, math.pi)
        low, high = self.orientation.yaw
        return (math.radians(low), math.radians(high))

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> ObjectConfig:
        words = [word for word in SUPPORT_WORDS if getattr(self, "in_" if word == "in" else word) is not None]
        if len(words) > 1:
            raise wrong(f"should have one of {', '.join(SUPPORT_WORDS)}, and has {' and '.join(words)}")
        if self.kind == "static" and (words or self.region or self.orientation or self.ratio_on_support):
            raise wrong("should have no support, region or orientation: a static object stays where the model has it")
        if words and self.region is not None and self.region.is_3d:
            raise wrong("should have a region in two dimensions: a 3D box is for an object without a support")
        if not words and self.region is not None and not self.region.is_3d:
            raise wrong("should name its support ('on', 'inside' or 'in'), or have a region that is a 3D box")
        return self


class RobotConfig(Part):
    """The robot: an asset at `base` (x, y, z) [m], turned by `yaw` [degrees], started from `keyframe`."""

    asset: str
    base: Point3 = (0.0, 0.0, 0.0)
    yaw: Number = 0.0
    keyframe: str = "home"
    joints: dict[str, JointConfig] = {}


class SceneConfig(Part):
    """A whole scene, validated. Made by `SceneConfig.load` from a file, a name or a dict, or directly in Python.

    Raises:
        SceneKeyError: a key or a value is wrong.
        NotSupportedError: a word that is not supported yet.
        UnknownNameError: an object is placed on something that is not in the scene.
        CycleError: objects that are placed on each other.
    """

    unsupported = ("groups",)
    name: str = "scene"
    floor: Floor | None = None
    robot: RobotConfig | None = None
    objects: dict[ObjectName, ObjectConfig] = {}
    geometry: Literal["physics", "visual"] = "physics"
    attempts: Annotated[int, Strict(), Field(ge=1)] = 10
    restarts: Annotated[int, Strict(), Field(ge=0)] = 8
    model: Path | None = None
    _where: str = PrivateAttr("SceneConfig")

    @classmethod
    def load(cls, scene: str | Path | Mapping | SceneConfig, overrides: Mapping[str, Any] | None = None) -> SceneConfig:
        """Read and validate a scene.

        Args:
            scene: the name of a shipped scene, the path of a YAML file, a mapping of the same form, or a SceneConfig.
            overrides: parts to replace, by dotted keys: `{"objects.apple.clearance": 0.01}`.

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
            data = merge(data, nest(overrides))
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
        return json.dumps(data, separators=(",", ":"))

    @model_validator(mode="after")
    def _names_are_known(self) -> SceneConfig:
        where = where_now.get() or type(self).__name__
        for name, part in self.objects.items():
            if part.asset is None and self.model is None and part.kind != "marker":
                raise SceneKeyError(
                    f"{where}: objects.{name}.asset: is missing. Name an asset, or give the scene a 'model' with a "
                    f"body '{name}'; only a marker needs none."
                )
            if (support := part.support) is not None:
                self._check_parent(f"{where}: objects.{name}.{support.word}", support.parent)
        self._check_cycles(where)
        return self

    def _check_parent(self, where: str, parent: str) -> None:
        owner = parent.split("/")[0]
        if parent == FLOOR and self.floor is None:
            raise UnknownNameError(
                "support", parent, f"{where}: the scene has no floor (add 'floor: {{size: [x, y]}}')", self.objects
            )
        if parent != FLOOR and owner not in self.objects:
            raise UnknownNameError("support", parent, where, [*([FLOOR] if self.floor else []), *self.objects])
        if parent != FLOOR and self.objects[owner].kind == "marker":
            raise NoSupportError(f"{where}: '{parent}' is a marker and has no surface. Name a support of another kind.")

    def _check_cycles(self, where: str) -> None:
        parents = {name: part.support.parent.split("/")[0] for name, part in self.objects.items() if part.support}
        for name in parents:
            chain = [name]
            while (above := parents.get(chain[-1])) is not None:
                if above in chain:
                    raise CycleError(where, chain[chain.index(above) :], "objects are placed on each other")
                chain.append(above)


def _check_one_of(part: _PartT, words: tuple[str, ...]) -> _PartT:
    given = [word for word in words if getattr(part, word) is not None]
    if len(given) != 1:
        has = " and ".join(given) if given else "none"
        raise wrong(f"should have exactly one of {', '.join(words)}, and has {has}")
    return part
