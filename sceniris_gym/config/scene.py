"""A whole scene as the user writes it: `SceneConfig`, from YAML, a dict or Python."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from pydantic import ModelWrapValidatorHandler, PrivateAttr, TypeAdapter, ValidationInfo, model_validator

from sceniris_gym.config.fields import in_memory, reading, where_now, wrong
from sceniris_gym.config.folders import is_pattern
from sceniris_gym.config.groups import with_chains, with_places
from sceniris_gym.config.loader import override, read_scene
from sceniris_gym.config.member_names import MemberName, object_of, split_support, variant_of
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene_words import SceneWords
from sceniris_gym.config.several_supports import Bodies, names_any, with_supports
from sceniris_gym.config.validation import check_names
from sceniris_gym.config.variants import check_parts, check_shared, with_members

_FILES = ("asset", "map", "rows")
"""Keys of objects, robots and heaps that name files."""
_HASHED_AS = {"site": "my", "of_site": "its", "angle": "turn"}
"""Keys of a `Connection` -> their former names, which hashes still use."""
_PLAIN = TypeAdapter(Any)
"""Converts the words of a scene to plain values. Some words may be parts made in Python."""


class SceneConfig(SceneWords):
    """A whole, validated scene, made by `SceneConfig.load` from a file, a name or a dict, or directly in Python.

    `model` is the path of an MJCF file, a `mujoco.MjSpec` or a `mujoco.MjModel`. None means that all parts are assets.

    Raises:
        SceneKeyError: A key or a value is wrong, or objects are placed relative to each other in a cycle.
        UnknownNameError: A support, or an object that another refers to, is not in the scene.
    """

    _where: str = PrivateAttr("SceneConfig")

    @classmethod
    def load(cls, scene: str | Path | Mapping | SceneConfig, overrides: Mapping[str, Any] | None = None) -> SceneConfig:
        """Read and validate a scene.

        Args:
            scene: The name of a shipped scene, the path of a YAML file, a mapping of the same form, or a SceneConfig.
            overrides: Parts to replace, by dotted keys: `{"objects.apple.clearance": 0.01}`. Give a new object as a
                whole: `{"objects.pear": {...}}`.

        Raises:
            SceneFileError: The file is missing, is not YAML, or gives a key twice.
            ScenirisError: The scene is invalid, see the class.
        """
        if isinstance(scene, SceneConfig):
            if overrides is None or (isinstance(overrides, Mapping) and not overrides):
                return scene
            data = scene._written or scene.model_dump(by_alias=True, exclude_unset=True)
            where, name = scene.where, scene.name
        else:
            data, where, name = read_scene(scene)
        return cls._made({"name": name, **override(data, {} if overrides is None else overrides, where)}, where)

    @classmethod
    def _made(
        cls, words: Mapping[str, Any], where: str, left_out: Collection[str] = (), bodies: Bodies | None = None
    ) -> SceneConfig:
        """Return the scene of a mapping in the form of a file.

        Args:
            words: The mapping.
            where: The file, for messages.
            left_out: Full names of variants to leave out.
            bodies: The known bodies of each `{any: NAME}`.
        """
        with reading(where):
            config = cls.model_validate(words, context=(left_out, bodies or {}))
        config._where = where
        return config

    @property
    def where(self) -> str:
        """The file of the scene, for messages."""
        return self._where

    def with_shared_objects(self) -> SceneConfig:
        """Return the scene in which each object with variants is one object with the settings of the first variant.

        If there are such objects, groups, conditions and starts are left out, because they may need single variants.
        """
        if not self.variants:
            return self
        objects = {
            self.owners.get(name, name): self._without_members(part, has_joints=name not in self.owners)
            for name, part in [*self.objects.items()][::-1]
        }
        fields = {name: getattr(self, name) for name in self.model_fields_set}
        fields |= {"objects": dict(reversed(objects.items())), "groups": {}, "stacks": {}, "start": ()}
        return self._made(fields, self.where)

    def _without_members(self, part: ObjectConfig, has_joints: bool) -> ObjectConfig:
        """Return an object without conditions, whose support names an object instead of one of its members.

        The names of its joints are those of its asset only if it has no variants.
        """
        words: dict[str, Any] = {"if_": (), "unless": ()} | ({} if has_joints else {"joints": {}, "parts": {}})
        if part.support is not None:
            owner = split_support(part.support.parent, self.objects)[0]
            word = "in_" if part.support.word == "in" else part.support.word
            words[word] = self.owners.get(owner) or part.support.parent
        return part.model_copy(update=words)

    @property
    def folders(self) -> dict[str, tuple[str, ...]]:
        """Object whose variants are the files of a folder -> names of these variants."""
        written = self._written.get("objects", {})
        return {name: of for name, of in self.variants.items() if is_pattern(written.get(name, {}).get("asset"))}

    def carriers(self) -> SceneConfig:
        """Return a scene with only the objects that `any_supports` names, at their poses in the model."""
        names, words = {name for name, _ in self.any_supports}, {"asset", "scale", "body", "kind"}
        found = {name: part for name, part in self.objects.items() if object_of(name) in names}
        parts = {MemberName(name): part.model_dump(include=words) for name, part in found.items()}
        of_model = {"model": self.model, "home": self.home} if any(p["asset"] is None for p in parts.values()) else {}
        return self._made({"objects": parts, "geometry": self.geometry, **of_model}, self.where)

    def with_bodies(self, bodies: Bodies) -> SceneConfig:
        """Return the scene with the names of bodies for each of `any_supports`."""
        return self._made(self._written, self.where, bodies=bodies)

    def alternatives(self, member: str) -> list[str]:
        """Return the members of an object on other bodies of `{any: NAME}`, on the same variant of its support."""
        name, carrier = object_of(member), self.presence.carrier
        if not names_any(with_chains(self._written).get("objects", {}).get(name)):
            return []
        same = [other for other in self.groups[name].of if variant_of(other) == variant_of(member) and other != member]
        return [other for other in same if carrier(other) == carrier(member)]

    def without(self, members: Collection[str]) -> SceneConfig:
        """Return the scene without some variants of its objects."""
        return self._made(self._written, self.where, members, self._bodies)

    @property
    def is_randomized(self) -> bool:
        """True if physics or appearance is drawn."""
        parts = (*self.objects.values(), *self.all_robots.values())
        return self.randomize is not None or any(part.randomize for part in parts)

    @property
    def has_model_in_memory(self) -> bool:
        """True if `model` is a MjSpec or a MjModel, not a file."""
        return in_memory(self.model)

    def canonical(self) -> str:
        """Return the values that differ from their defaults, as JSON. Equal scenes give equal text.

        File names are left out, because only the contents of the files matter. Cameras are left out too.
        """
        data = self.model_dump(mode="json", by_alias=True, exclude={"name", "model", "cameras"}, exclude_defaults=True)
        parts = [*data.get("objects", {}).values(), *data.get("robots", {}).values(), data.get("robot", {})]
        for part in (*parts, *data.get("heaps", {}).values()):
            for word in _FILES:
                part.pop(word, None)
            for relation in part.get("relations", ()):
                if isinstance(beside := relation.get("beside"), dict):
                    relation["beside"] = {_HASHED_AS.get(word, word): value for word, value in beside.items()}
        return json.dumps(data, separators=(",", ":"))

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> SceneConfig:
        if self.robot is not None and self.robots:
            raise wrong("should have a single 'robot', or 'robots' by name, not both")
        owners: dict[str, str] = {}
        for name, robot in self.all_robots.items():
            if name in self.objects:
                raise wrong(f"should have different names for robots and objects, but both have a '{name}'")
            if (other := owners.setdefault(robot.name, name)) != name:
                raise wrong(f"should have a body for each robot, but '{other}' and '{name}' share '{robot.name}'")
        if self.home is not None and self.model is None:
            advice = "should have 'home', the name of a keyframe, only together with 'model'"
            raise wrong(f"{advice}. For a robot with an 'asset', set the robot's 'keyframe' instead")
        if self.model is None and any(robot.in_model is not None for robot in self.all_robots.values()):
            raise wrong("should have a 'model', because a robot is 'in_model'")
        return self

    @model_validator(mode="wrap")  # pyrefly: ignore[bad-argument-type]
    @classmethod
    def _is_written_out(
        cls, data: Any, handler: ModelWrapValidatorHandler[SceneConfig], info: ValidationInfo
    ) -> SceneConfig:
        if not isinstance(data, Mapping):
            return handler(data)
        data = _PLAIN.dump_python(data, by_alias=True, exclude_unset=True)
        left_out, bodies = info.context or ((), {})
        config = handler(with_supports(with_members(with_places(with_chains(data)), left_out), bodies))
        check_shared(config.variants, config.objects)
        check_parts(config.variants, config.objects, left_out)
        if config.variants or config.stacks:
            config._written, config._bodies = data, bodies
        check_names(config, where_now.get() or cls.__name__)
        return config
