"""`SceneWords`: all keys of a scene file, and the names in the scene. `CameraConfig`: a camera of the scene."""

from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, PrivateAttr, Strict, field_validator, model_validator

from sceniris_gym.config.bounds import MOST_ATTEMPTS
from sceniris_gym.config.fields import ROBOT, Extents2, Model, Number, ObjectName, PartName, Point3, within, wrong
from sceniris_gym.config.groups import GroupConfig, HeapConfig, StackConfig, with_chains
from sceniris_gym.config.member_names import object_of, without_support
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.presence import Presence
from sceniris_gym.config.randomize import SceneDraws
from sceniris_gym.config.relations import Beside, Relation
from sceniris_gym.config.robot import RobotConfig, StartConfig
from sceniris_gym.config.section import Section
from sceniris_gym.config.several_supports import Bodies, any_supports
from sceniris_gym.config.variants import owners_of, with_variants

AUTO = "auto"
"""The value of `attempts` that lets `compile_scene` choose the number."""
DEFAULT_BANK = 64
"""Number of valid layouts in the fallback bank of each split, for worlds that run out of restarts."""


def _count_or_auto(value: Any) -> Any:
    if value != AUTO and (isinstance(value, bool) or not isinstance(value, int)):
        raise wrong(f"should be a whole number or '{AUTO}'", value if isinstance(value, str) else "", [AUTO])
    if value != AUTO and not 1 <= value <= MOST_ATTEMPTS:
        raise wrong("should be at least 1" if value < 1 else f"should be at most {MOST_ATTEMPTS}")
    return value


Attempts = Annotated[int | Literal["auto"], BeforeValidator(_count_or_auto)]


class Floor(Section):
    """The ground workspace: a rectangle around the world's origin with the full extents `size` = (x, y) [m]."""

    size: Extents2


class CameraConfig(Section):
    """A camera at `pos` that looks at the point `look_at` [m]. The direction `up` points up in its pictures.

    All three are in the frame of `body`, which carries the camera: an object, a robot, or a body inside them such as
    `robot/hand`. Without a `body`, they are in the world frame. The default of `up` is the z axis, or the x axis for a
    camera that looks along z. `fovy` is the vertical field of view [degrees].
    """

    body: str | None = None
    pos: Point3
    look_at: Point3
    up: Point3 | None = None
    fovy: Annotated[Number, within("field of view")] = 45.0

    @property
    def backward(self) -> np.ndarray:
        """The vector from `look_at` to the camera [m], shape (3,)."""
        return np.subtract(self.pos, self.look_at)

    @property
    def upward(self) -> np.ndarray:
        """The direction that points up in pictures, shape (3,)."""
        if self.up is not None:
            return np.array(self.up)
        return np.array([0.0, 0.0, 1.0] if np.abs(self.backward[:2]).max() > 1e-6 else [1.0, 0.0, 0.0])

    @model_validator(mode="after")
    def _looks_somewhere(self) -> Self:
        if np.linalg.norm(self.backward) < 1e-6:
            raise wrong("should have a 'look_at' that differs from its 'pos'")
        if np.linalg.norm(np.cross(self.upward, self.backward)) < 1e-6 * np.linalg.norm(self.backward):
            raise wrong("should have an 'up' that is not parallel to the viewing direction")
        return self


class SceneWords(Section):
    """The keys and values of a scene, before its names are checked."""

    name: str = "scene"
    floor: Floor | None = None
    robot: RobotConfig | None = None
    robots: dict[ObjectName, RobotConfig] = Field(default_factory=dict)
    objects: dict[PartName, ObjectConfig] = Field(default_factory=dict)
    groups: dict[ObjectName, GroupConfig] = Field(default_factory=dict)
    heaps: dict[ObjectName, HeapConfig] = Field(default_factory=dict)
    stacks: dict[ObjectName, StackConfig] = Field(default_factory=dict)
    cameras: dict[ObjectName, CameraConfig] = Field(default_factory=dict)
    start: tuple[StartConfig, ...] = ()
    geometry: Literal["physics", "visual"] = "physics"
    attempts: Attempts = 10
    restarts: Annotated[int, Strict(), Field(ge=0, le=10_000)] = 8
    bank: Annotated[int, Strict(), Field(ge=1, le=10_000)] = DEFAULT_BANK
    model: Model = None
    home: str | None = None
    randomize: SceneDraws | None = None
    _written: dict[str, Any] = PrivateAttr(default_factory=dict)
    _bodies: Bodies = PrivateAttr(default_factory=dict)

    @property
    def any_supports(self) -> set[tuple[str, str]]:
        """For each support `{any: NAME}` with unknown bodies, the name and the word, such as ('cabinet', 'on')."""
        return any_supports(with_chains(self._written)) - self._bodies.keys()

    @property
    def all_robots(self) -> dict[str, RobotConfig]:
        """The robots, by the names that objects use for them: the keys of `robots`, or 'robot' for a single `robot`."""
        return self.robots if self.robot is None else {ROBOT: self.robot}

    def written(self, name: str) -> str:
        """Return the name of an element of the model as the scene file has it: 'robot/hand' for 'panda/hand'."""
        for key, robot in self.all_robots.items():
            if robot.in_model is None and f"{name}/".startswith(robot.prefix):
                return key + name.removeprefix(robot.name)
        return name

    @cached_property
    def parts(self) -> dict[str, ObjectConfig]:
        """The objects, followed by the robots whose base is drawn, each as an ObjectConfig."""
        drawn = {name: robot.placing for name, robot in self.all_robots.items()}
        return {**self.objects, **{name: part for name, part in drawn.items() if part is not None}}

    @cached_property
    def variants(self) -> dict[str, tuple[str, ...]]:
        """Object with variants -> names of its variants in `objects`."""
        groups = self.groups.items()
        return {name: group.of for name, group in groups if all(object_of(m) == name != m for m in group.of)}

    @cached_property
    def owners(self) -> dict[str, str]:
        """Name of a variant in `objects` -> the object with this variant."""
        return owners_of(self.variants)

    @cached_property
    def presence(self) -> Presence:
        """The draws of the objects that are present."""
        return Presence(self.objects, self.groups)

    @cached_property
    def named_objects(self) -> list[str]:
        """The objects by their names in the scene file: an object with variants or several supports has one name."""
        return [*(name for name in self.objects if name not in self.owners), *self.variants]

    @property
    def absent(self) -> dict[str, str]:
        """Object that may be absent from a world -> the key of the group that draws it, or the object itself."""
        return self.presence.absent

    def joined_by_root(self, name: str, relation: Relation) -> list[str]:
        """Return which of an object and its anchor a relation measures by the root: open furniture beside furniture."""
        pair = [name, relation.beside] if isinstance(relation, Beside) else []
        parts = {one: self.objects.get(one) for one in with_variants(pair, self.variants)}
        if any(part is None or part.kind not in ("fixture", "static") for part in parts.values()):
            return []
        return [one for one, part in parts.items() if part is not None and part.is_open_furniture]

    def markers(self, start: StartConfig) -> dict[str, str]:
        """Return object -> its marker, for a kind of start. A variant has the marker of its object.

        Members of the object on other supports than the marker's are left out.
        """
        pairs = [(one, marker) for name, marker in start.place.items() for one in self.variants.get(name, (name,))]
        return {one: marker for one, marker in pairs if self.objects[one].support == self.objects[marker].support}

    def needs(self, name: str) -> tuple[str, ...]:
        """Return the names that have to be placed before an object or a robot: all names in its relations and keys.

        If a robot with a drawn base has to reach the object, the base is also placed first. But if the base refers to
        the object, directly or through others, the base is placed after the object.
        """
        parts = self.parts
        markers = [found[name] for found in map(self.markers, self.start) if name in found]
        needs = tuple(dict.fromkeys([*self._named(name), *markers]))
        if not parts[name].reachable or self.robot_for(name) not in parts:
            return needs
        robot = self.robot_for(name)
        before, queue = {robot}, [robot]
        while queue:
            found = [other for other in self._named(queue.pop()) if other in parts and other not in before]
            before.update(found)
            queue += found
        return needs if name in before else tuple(dict.fromkeys([*needs, robot]))

    def _named(self, name: str) -> tuple[str, ...]:
        """Return the names in the settings of an object or a robot.

        If a name has variants, the names of all variants replace it.
        """
        return with_variants(self.parts[name].needs, self.variants)

    def robot_for(self, name: str) -> str:
        """Return the robot that has to reach an object: the robot in its `by`, by default the only robot."""
        by = self.objects[name].by
        return by if by in self.all_robots else next(iter(self.all_robots))

    def key(self, name: str) -> str:
        """Return the key of an object or a robot, for messages: 'objects.can', 'robot' or 'robots.left'.

        All members of an object on its several supports have one key.
        """
        robot = self.all_robots.get(name)
        return f"objects.{without_support(name)}" if robot is None else robot.section

    @field_validator("robots")
    @classmethod
    def _know_their_names(cls, robots: dict[str, RobotConfig]) -> dict[str, RobotConfig]:
        return {name: robot.called(name) for name, robot in robots.items()}
