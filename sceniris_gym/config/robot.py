"""A robot of a scene: `RobotConfig`, its source and its pose; `TcpConfig`, its tool centre point; and `StartConfig`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from sceniris_gym.config.fields import ROBOT, Clearance, Gap, Length, Number, Point3, Turn, listed, must, within, wrong
from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.loader import ROBOT_FORMS
from sceniris_gym.config.objects import JointConfig, ObjectConfig, RegionConfig
from sceniris_gym.config.orientation import Orientation
from sceniris_gym.config.randomize import DrawConfig, ObjectWord
from sceniris_gym.config.relations import Relations
from sceniris_gym.config.section import Section
from sceniris_gym.config.variants import variants_of

_BASE = ("base", "roll", "pitch", "yaw")
"""Words for the fixed pose of a robot that is added to a scene."""
_DRAWS = ("on", "inside", "in_", "region", "relations", "orientation", "gap")
"""Words with which its base is drawn instead."""


class TcpConfig(Section):
    """The tool centre point of a robot; its +z is the approach axis.

    It is at the origin of a `site` or a `body`, moved by `offset` (x, y, z) [m] in that frame, then turned [degrees] by
    `roll` about the x axis, `pitch` about y and `yaw` about z of the frame before turning, in this order. A name alone
    stands for the site of this name, or for the body if there is no such site. The fingers close along +y: without a
    `yaw` the frame is turned about z so that they do.
    """

    site: str | None = None
    body: str | None = None
    offset: Point3 = (0.0, 0.0, 0.0)
    roll: Turn = 0.0
    pitch: Turn = 0.0
    yaw: Turn | None = None

    @property
    def turns(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw [degrees]."""
        return self.roll, self.pitch, self.yaw or 0.0

    @model_validator(mode="before")
    @classmethod
    def _from_name(cls, data: Any) -> Any:
        return {"site": data, "body": data} if isinstance(data, str) else data

    @model_validator(mode="after")
    def _is_somewhere(self) -> TcpConfig:
        if self.site is None and self.body is None:
            raise wrong("should name the 'site' or the 'body' at which the tool centre point is")
        return self


class RobotConfig(Section):
    """A robot: an `asset`, any MJCF or URDF file as `model`, or a body of the scene's own model as `in_model`.

    It stands at `base` (x, y, z) [m], turned by `roll`, `pitch` and `yaw` [degrees] about x, then y, then z of the
    world, and starts from `keyframe`, by default from 'home' or, without such a keyframe, from `qpos0`. A robot of the
    model keeps the pose that it has there. With `on`, `inside`, `in` or a `region`, the base is drawn in every world
    like the pose of a fixture, by the words of an object. `tcp` is the tool centre point, by default the site 'tcp';
    `map` is the file of the reachability map, which shipped assets bring along. Placed objects keep `clearance` [m]
    from the robot. With `in_scene: false` only the frame of its base is in the scene, from which its map judges reach.
    """

    one_of = ROBOT_FORMS
    model_config = ConfigDict(populate_by_name=True)
    asset: str | None = None
    model: str | None = None
    in_model: str | None = None
    tcp: TcpConfig | None = None
    map: str | None = None
    base: Point3 = (0.0, 0.0, 0.0)
    roll: Turn = 0.0
    pitch: Turn = 0.0
    yaw: Turn = 0.0
    keyframe: str = "home"
    clearance: Clearance = 0.0
    joints: dict[str, JointConfig] = Field(default_factory=dict)
    in_scene: bool = True
    on: str | None = None
    inside: str | None = None
    in_: str | None = Field(default=None, alias="in")
    region: RegionConfig | None = None
    relations: Relations = ()
    orientation: Orientation | None = None
    gap: Gap = 0.0005
    randomize: dict[ObjectWord, DrawConfig] = Field(default_factory=dict)
    _called: str | None = PrivateAttr(None)

    def called(self, name: str) -> RobotConfig:
        """Return the robot with the name that `robots` gives it."""
        named = self.model_copy()
        named._called = name
        return named

    @property
    def placing(self) -> ObjectConfig | None:
        """The words of an object that its base is drawn by; None if its base is fixed."""
        given = [word for word in _DRAWS if word in self.model_fields_set]
        if not given:
            return None
        words = {word: getattr(self, word) for word in given}
        return ObjectConfig(body=self.name, kind="fixture", clearance=self.clearance, joints=self.joints, **words)

    @property
    def file(self) -> str | None:
        """The asset or the file that is added to the scene; None for a robot of the scene's model."""
        return self.asset if self.model is None else self.model

    @property
    def key(self) -> str:
        """The key of the robot's source, for messages."""
        return f"{self.section}.{self.given(ROBOT_FORMS)[0]}"

    @property
    def section(self) -> str:
        """The key that it is written under: 'robot', or 'robots.left'."""
        return ROBOT if self._called is None else f"robots.{self._called}"

    @property
    def name(self) -> str:
        """The name of its root body: from the model or `robots`, else 'panda' for 'panda' and 'my/panda.xml'."""
        if self.file is None:
            return str(self.in_model)
        return Path(self.file).stem if self._called is None else self._called

    @property
    def prefix(self) -> str:
        """The prefix of names inside the robot: 'panda/', or '' for a robot in a model without prefixes."""
        return f"{self.name}/" if self.in_model is None else self.name[: self.name.rfind("/") + 1]

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> RobotConfig:
        given = [word for word in _BASE if word in self.model_fields_set]
        start = [word for word in (*given, "keyframe") if word in self.model_fields_set]
        if self.in_model is not None and start:
            raise wrong(f"should have no '{start[0]}': a robot that is in the model stands as the model has it")
        if not self.in_scene and (self.in_model is not None or self.joints or self.clearance or self.randomize):
            raise wrong(
                "should be an 'asset' or a 'model' without 'joints', 'clearance' and 'randomize' if 'in_scene' is false"
            )
        try:
            placing = self.placing
        except ValidationError as error:  # words that contradict each other in any object
            raise wrong(error.errors()[0]["msg"]) from None
        if placing is not None and given:
            raise wrong(f"should have no '{given[0]}': its base is drawn. Say where by 'region' and 'orientation'")
        if placing is not None and not placing.is_placed:
            raise wrong("should name its support ('on', 'inside' or 'in'), or have a 3D box as its region")
        return self


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
