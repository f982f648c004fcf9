"""A whole scene as written by the user: `SceneConfig`, from YAML, a dict or Python."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, Strict, model_validator

from sceniris_gym.config.fields import Extents2, Model, ObjectName, in_memory, wrong
from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.heaps import HeapConfig, with_places
from sceniris_gym.config.limits import MOST_ATTEMPTS
from sceniris_gym.config.loader import override, read_scene
from sceniris_gym.config.messages import reading, where_now
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.section import Section
from sceniris_gym.config.validation import SceneNames, check_names

AUTO = "auto"
"""`attempts` that `compile_scene` finds."""
DEFAULT_BANK = 64
"""Valid layouts that are kept for each split, for worlds that run out of restarts."""
_FILES = ("asset", "model", "map", "rows")
"""Words of objects, of the robot and of heaps that name files."""


def _count_or_auto(value: Any) -> Any:
    if isinstance(value, str) and value != AUTO:
        raise wrong(f"should be a whole number or '{AUTO}'", value, [AUTO])
    if value != AUTO and (isinstance(value, bool) or not isinstance(value, int)):
        raise wrong(f"should be a whole number or '{AUTO}'")
    if value != AUTO and not 1 <= value <= MOST_ATTEMPTS:
        raise wrong("should be at least 1" if value < 1 else f"should be at most {MOST_ATTEMPTS}")
    return value


Attempts = Annotated[int | Literal["auto"], BeforeValidator(_count_or_auto)]


class Floor(Section):
    """The ground workspace: a rectangle around the world's origin, `size` = (x, y) full extents [m]."""

    size: Extents2


class SceneConfig(Section):
    """A whole scene, validated. Made by `SceneConfig.load` from a file, a name or a dict, or directly in Python.

    `model` is the path of an MJCF file, a `mujoco.MjSpec` or a `mujoco.MjModel`; None for a scene of assets alone.

    Raises:
        SceneKeyError: A key or a value is wrong.
        UnknownNameError: A support, or an object that another one refers to, is not in the scene.
        CycleError: Objects that are placed relative to each other.
    """

    name: str = "scene"
    floor: Floor | None = None
    robot: RobotConfig | None = None
    objects: dict[ObjectName, ObjectConfig] = Field(default_factory=dict)
    groups: dict[ObjectName, GroupConfig] = Field(default_factory=dict)
    heaps: dict[ObjectName, HeapConfig] = Field(default_factory=dict)
    geometry: Literal["physics", "visual"] = "physics"
    attempts: Attempts = 10
    restarts: Annotated[int, Strict(), Field(ge=0, le=10_000)] = 8
    bank: Annotated[int, Strict(), Field(ge=1, le=10_000)] = DEFAULT_BANK
    model: Model = None
    home: str | None = None
    _where: str = PrivateAttr("SceneConfig")

    @classmethod
    def load(cls, scene: str | Path | Mapping | SceneConfig, overrides: Mapping[str, Any] | None = None) -> SceneConfig:
        """Read and validate a scene.

        Args:
            scene: The name of a shipped scene, the path of a YAML file, a mapping of the same form, or a SceneConfig.
            overrides: Parts to replace, by dotted keys: `{"objects.apple.clearance": 0.01}`. A new object is given as a
                whole: `{"objects.pear": {...}}`.

        Raises:
            SceneFileError: The file is missing, or is not YAML, or gives a key twice.
            ScenirisError: As in the class.
        """
        if isinstance(overrides, Mapping) and not overrides:
            overrides = None
        if isinstance(scene, SceneConfig):
            if overrides is None:
                return scene
            data, where, name = scene.model_dump(by_alias=True, exclude_unset=True), scene.where, scene.name
        else:
            raw = read_scene(scene)
            data, where, name = raw.data, raw.where, raw.name
        if overrides is not None:
            data = override(data, overrides, where)
        with reading(where):
            config = cls.model_validate({"name": name, **data})
        config._where = where
        return config

    @property
    def where(self) -> str:
        """The file this scene was read from, for messages."""
        return self._where

    @property
    def has_model_in_memory(self) -> bool:
        """Whether `model` is a MjSpec or a MjModel rather than a file."""
        return in_memory(self.model)

    def canonical(self) -> str:
        """Return the words that differ from their defaults as JSON that is equal for equal scenes.

        File names are left out: only the contents of the files matter, and they are no words.
        """
        data = self.model_dump(mode="json", by_alias=True, exclude={"name", "model"}, exclude_defaults=True)
        parts = (*data.get("objects", {}).values(), *data.get("heaps", {}).values())
        for part in (*parts, *filter(None, [data.get("robot")])):
            for word in _FILES:
                part.pop(word, None)
        return json.dumps(data, separators=(",", ":"))

    @model_validator(mode="before")
    @classmethod
    def _heaps_are_placed(cls, data: Any) -> Any:
        return with_places(data)

    @model_validator(mode="after")
    def _home_is_of_a_model(self) -> SceneConfig:
        if self.home is not None and self.model is None:
            raise wrong("should have 'home', the name of a keyframe, only together with 'model'")
        return self

    @model_validator(mode="after")
    def _robot_is_of_a_model(self) -> SceneConfig:
        if self.robot is not None and self.robot.in_model is not None and self.model is None:
            raise wrong("should have a robot that is 'in_model' only together with 'model'")
        return self

    @model_validator(mode="after")
    def _names_are_known(self) -> SceneConfig:
        names = SceneNames(
            self.objects,
            self.groups,
            self.heaps,
            has_floor=self.floor is not None,
            has_robot=self.robot is not None,
            has_model=self.model is not None,
        )
        check_names(names, where_now.get() or type(self).__name__)
        return self
