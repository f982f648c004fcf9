"""A robot of a scene: its source and pose (`RobotConfig`), its tool centre point (`TcpConfig`), and kinds of starts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from sceniris_gym.config.fields import (
    ROBOT,
    Clearance,
    FractionInterval,
    Gap,
    Length,
    Number,
    Point3,
    Turn,
    listed,
    must,
    within,
    wrong,
)
from sceniris_gym.config.loader import ROBOT_FORMS
from sceniris_gym.config.objects import JointConfig, ObjectConfig, RegionConfig
from sceniris_gym.config.orientation import Orientation
from sceniris_gym.config.randomize import DrawConfig, ObjectWord
from sceniris_gym.config.relations import Relations
from sceniris_gym.config.section import Section

_BASE = ("base", "roll", "pitch", "yaw")
"""Words for the fixed pose of an added robot."""
_DRAWS = ("on", "inside", "in_", "region", "relations", "orientation", "gap")
"""Words for a base whose pose is drawn."""


class TcpConfig(Section):
    """The tool centre point of a robot. Its +z is the approach axis, and its +y is the closing axis of the fingers.

    The frame of a `site` or a `body` is moved by `offset` (x, y, z) [m] along its axes. Then it is rotated [degrees] by
    `roll`, `pitch` and `yaw` about the unrotated x, y and z axes, in this order. If a scene file gives a string instead
    of keys, this is the name of a site, or of a body if there is no such site. Without a `yaw`, the frame is rotated
    about z until the fingers close along +y.
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
            raise wrong("should name the 'site' or the 'body' of the tool centre point")
        return self


class RobotConfig(Section):
    """A robot: an `asset`, by name or the path of an MJCF or URDF file, or a body of the scene's model as `in_model`.

    The robot stands at `base` (x, y, z) [m], rotated by `roll`, `pitch` and `yaw` [degrees] about x, then y, then z of
    the world. It starts from `keyframe`, by default 'home'. If no keyframe is given and 'home' does not exist, it
    starts from `qpos0`. A robot that is `in_model` keeps its pose from the model. With `on`, `inside`, `in` or a
    `region`, each reset draws the pose of the base, as for an object of the kind 'fixture' with the same keys.

    `tcp` is the tool centre point, by default the site 'tcp', or a site of another usual name, such as 'pinch'. `map`
    is the file of the reachability map, by default the map of a shipped asset. Placed objects keep `clearance` [m] from
    the robot. With `in_scene: false`, the scene has an empty body at the base instead of the robot, and reach is judged
    relative to this body.
    """

    one_of = ROBOT_FORMS
    model_config = ConfigDict(populate_by_name=True)
    asset: str | None = None
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
        """Return a copy of the robot that stores `name`, its key in `robots`."""
        named = self.model_copy()
        named._called = name
        return named

    @property
    def placing(self) -> ObjectConfig | None:
        """The drawn placement of the robot's base, as the config of an object. None if the base is fixed."""
        given = [word for word in _DRAWS if word in self.model_fields_set]
        if not given:
            return None
        words = {word: getattr(self, word) for word in given}
        return ObjectConfig(body=self.name, kind="fixture", clearance=self.clearance, joints=self.joints, **words)

    @property
    def key(self) -> str:
        """The key of the robot's source in messages, such as 'robot.asset'."""
        return f"{self.section}.{self.given(ROBOT_FORMS)[0]}"

    @property
    def section(self) -> str:
        """The robot's key in the file: 'robot', or 'robots.left'."""
        return ROBOT if self._called is None else f"robots.{self._called}"

    @property
    def name(self) -> str:
        """The name of the root body: `in_model` for a robot of the model, otherwise the robot's key in `robots`.

        The single `robot` of a scene has no key. Its name is the asset's file name without its ending: 'panda' for both
        'panda' and 'my/panda.xml'.
        """
        if self.asset is None:
            return str(self.in_model)
        return Path(self.asset).stem if self._called is None else self._called

    @property
    def prefix(self) -> str:
        """The prefix of names inside the robot: 'panda/', or '' for a robot in a model without prefixes."""
        return f"{self.name}/" if self.in_model is None else self.name[: self.name.rfind("/") + 1]

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> RobotConfig:
        given = [word for word in _BASE if word in self.model_fields_set]
        start = [word for word in (*given, "keyframe") if word in self.model_fields_set]
        if self.in_model is not None and start:
            raise wrong(f"should have no '{start[0]}': a robot 'in_model' keeps its pose from the model")
        if not self.in_scene and (self.in_model is not None or self.joints or self.clearance or self.randomize):
            raise wrong("should be an 'asset' without 'joints', 'clearance' and 'randomize' if 'in_scene' is false")
        try:
            placing = self.placing
        except ValidationError as error:  # contradicting words, as for any object
            raise wrong(error.errors()[0]["msg"]) from None
        if placing is not None and given:
            raise wrong(f"should have no '{given[0]}': resets draw its base. Use 'region' and 'orientation' instead")
        if placing is not None and not placing.is_placed:
            raise wrong("should have a support (on, inside, in) or a 3D region if it has relations, orientation or gap")
        return self


_Weight = Annotated[Number, Field(gt=0.0), within("weight")]
_Heights = Annotated[
    tuple[Length, Length],
    BeforeValidator(listed),
    must(lambda ends: ends[0] <= ends[1] > 0.0, "should be [low, high] in metres with low <= high, and high above 0"),
]


class StartConfig(Section):
    """One kind of start. Each episode draws a kind in proportion to its weight.

    Attributes:
        weight: The weight of this kind among all kinds.
        robot: The pose of the arm: its start pose ('home'), the pre-grasp of an object ('pregrasp'), or the grasp with
            the fingers closed on the object ('grasp'), or a point of the path to a grasp, with open fingers ('path').
        of: The object of the grasp, pre-grasp or path. It may have variants.
        grasp: A glob for the names of grasp sites, written with or without 'grasp_'. None selects all grasps.
        share: Minimum and maximum share of the path's length, for 'path'. 0 is the start pose, 1 the grasp.
        lift: Minimum and maximum height [m] that the object is lifted straight up.
        robot_joints: Draws of the arm's joints, by name or pattern. The hand holds the object in the drawn pose.
        place: Object -> the marker at which the object starts. The object may have variants.
        joints: Draws of objects' joints, by 'object/joint'. They replace the draws in the section of the object.
    """

    weight: _Weight = 1.0
    robot: Literal["home", "pregrasp", "path", "grasp"] = "home"
    of: str | None = None
    grasp: str | None = None
    share: FractionInterval | None = None
    lift: _Heights | None = None
    robot_joints: dict[str, JointConfig] = Field(default_factory=dict)
    place: dict[str, str] = Field(default_factory=dict)
    joints: dict[str, JointConfig] = Field(default_factory=dict)

    @property
    def is_held(self) -> bool:
        """True if the hand holds the object in the air, because `lift` or `robot_joints` move it from its support."""
        return self.lift is not None or bool(self.robot_joints)

    def targets(self, variants: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
        """Return the object named by `of`. If it has variants, return all of them."""
        return () if self.of is None else variants.get(self.of, (self.of,))

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> StartConfig:
        if (self.of is None) != (self.robot == "home"):
            raise wrong("should have 'of' if 'robot' takes the arm to an object, and no 'of' if 'robot' is 'home'")
        if self.grasp is not None and self.of is None:
            raise wrong("should have 'grasp' only together with 'of'")
        if self.share is not None and self.robot != "path":
            raise wrong("should have 'share' only if 'robot' is 'path'")
        if self.is_held and self.robot != "grasp":
            raise wrong("should have 'lift' or 'robot_joints' only if 'robot' is 'grasp'")
        if self.lift is not None and self.robot_joints:
            raise wrong("should have 'lift' or 'robot_joints', not both")
        for words in (*self.robot_joints.values(), *self.joints.values()):
            if words.choice is not None or words.noise_norm is not None:
                raise wrong("should draw a joint by 'fraction', 'range', 'value' or 'noise'")
        return self
