"""The robot of a scene: `RobotConfig`, where it comes from and how it stands, and `TcpConfig`, where its tool is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from sceniris_gym.config.fields import Clearance, Point3, Turn, wrong
from sceniris_gym.config.loader import ROBOT_FORMS
from sceniris_gym.config.objects import JointConfig
from sceniris_gym.config.section import Section, check_one_of

_STANDS = ("base", "roll", "pitch", "yaw", "keyframe")
"""Words that say how a robot that is added to a scene stands in it."""


class TcpConfig(Section):
    """Where the tool centre point of a robot is: its +z is the approach axis.

    At the origin of a `site` or a `body`, moved by `offset` (x, y, z) [m] in that frame, then turned by `roll` about
    its x axis, `pitch` about y and `yaw` about z, in this order and about the axes before turning [degrees]. A name
    alone stands for the site of this name, or for the body if there is no such site. The fingers close along +y; where
    no `yaw` is given, the frame is turned about z so that they do.
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
    """The robot: an `asset`, any MJCF or URDF file as `model`, or a body of the scene's own model as `in_model`.

    It stands at `base` (x, y, z) [m], turned by `roll`, `pitch` and `yaw` [degrees] about x, then y, then z of the
    world, and starts from `keyframe`, by default from 'home' or, without such a keyframe, from `qpos0`. One that is in
    the model stands as the model has it. `tcp` is its tool centre point, by default the site 'tcp'; `map` is the file
    of its reachability map, which a shipped asset has already. Whatever is placed keeps `clearance` [m] from it.
    """

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

    @property
    def file(self) -> str | None:
        """The asset or the file that is added to the scene; None for a robot that is in its model."""
        return self.asset if self.model is None else self.model

    @property
    def key(self) -> str:
        """The word that says where the robot comes from, for messages."""
        return f"robot.{self.given(ROBOT_FORMS)[0]}"

    @property
    def name(self) -> str:
        """Its name, which is that of its root body: 'panda' for the asset 'panda' and for 'my/panda.xml'."""
        return Path(self.file).stem if self.file is not None else str(self.in_model)

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> RobotConfig:
        check_one_of(self, ROBOT_FORMS)
        given = [word for word in _STANDS if word in self.model_fields_set]
        if self.in_model is not None and given:
            raise wrong(f"should have no '{given[0]}': a robot that is in the model stands as the model has it")
        return self
