"""Complete arms: links on hinges with position actuators, a gripper and a start pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from .fields import Point
from .gripper import Gripper, add_grip, add_gripper, couple_fingers
from .links import Link, add_caps, dress
from .mjcf import Document, add

COLOURS = {"white": (0.93, 0.93, 0.92), "light": (0.78, 0.79, 0.80), "dark": (0.17, 0.18, 0.20)}


@dataclass(frozen=True)
class Joint:
    """A hinge: its frame in the previous joint's frame (position [m], wxyz), limits [rad] and drive.

    ``torque`` [N m] and ``speed`` [rad/s] are maxima. Stiffness is in N m/rad, damping in N m s/rad. The next link is
    given in the joint's frame.
    """

    pos: Point
    quat: tuple[float, float, float, float]
    limits: tuple[float, float]
    torque: float
    speed: float
    stiffness: float
    damping: float
    axis: Point = (0, 0, 1)

    @property
    def friction(self) -> float:
        """Passive damping of the joint [N m s/rad], against which the maximum torque reaches the maximum speed."""
        return round(self.torque / self.speed, 3)


@dataclass(frozen=True)
class Arm:
    """An arm: base and links with masses [kg] and materials, joints between them, and the gripper on its flange.

    ``flange`` [m] is the hand's position along the last link's z axis, and ``turn`` [rad] the hand's rotation about
    this axis. ``home`` has the joint angles [rad]. Contacts between links at most ``apart`` joints apart are excluded.
    """

    name: str
    joints: Sequence[Joint]
    links: Sequence[Link]
    masses: Sequence[float]
    materials: Sequence[str]
    gripper: Gripper
    flange: float
    home: Sequence[float]
    turn: float = 0.0
    apart: int = 1
    caps: str = "dark"

    def excluded(self) -> list[tuple[str, str]]:
        """Return the pairs of bodies whose contacts are excluded. Neighbouring links share a joint's drum."""
        chain = [self.name, *(f"link{i}" for i in range(1, len(self.links))), "hand"]
        return [pair for k in range(1, self.apart + 1) for pair in zip(chain, chain[k:], strict=False)]


def write_arm(arm: Arm, colours: dict[str, Point] | None = None) -> None:
    """Write the arm's MJCF and meshes, with gravity compensation."""
    document = Document(arm.name, gravcomp=1)
    add(add(document.default, "default", class_="revolute"), "joint", axis=(0, 0, 1), armature=0.1)
    for name, rgb in (COLOURS | (colours or {})).items():
        document.colour(name, rgb, shine=0.5)
    add_caps(document, arm.links)
    last = add_links(document, arm)
    add_gripper(document, last, arm.gripper, arm.flange, arm.turn)
    contact = add(document.tree, "contact")
    for first, second in arm.excluded():
        add(contact, "exclude", body1=first, body2=second)
    couple_fingers(document)
    add_actuators(document, arm)
    home = [*arm.home, arm.gripper.travel, arm.gripper.travel]
    add(add(document.tree, "keyframe"), "key", name="home", qpos=home, ctrl=home[:-1])
    document.save()


def add_links(document: Document, arm: Arm) -> Element:
    """Add the chain of bodies from the base to the last link, and return the last body."""
    body = document.root
    for i, (link, mass, material) in enumerate(zip(arm.links, arm.masses, arm.materials, strict=True)):
        if i > 0:
            joint = arm.joints[i - 1]
            body = add(body, "body", name=f"link{i}", pos=joint.pos, quat=joint.quat, gravcomp=1)
            axis = {} if joint.axis == (0, 0, 1) else {"axis": joint.axis}
            add(body, "joint", name=f"joint{i}", class_="revolute", range=joint.limits, damping=joint.friction, **axis)
        dress(document, body, f"link{i}", link, mass, material, arm.caps)
    return body


def add_actuators(document: Document, arm: Arm) -> None:
    """Add a position actuator for each joint, and the gripper's actuator."""
    actuator = add(document.tree, "actuator")
    for i, joint in enumerate(arm.joints, start=1):
        add(
            actuator,
            "position",
            name=f"joint{i}",
            joint=f"joint{i}",
            kp=joint.stiffness,
            kv=joint.damping - joint.friction,
            ctrlrange=joint.limits,
            forcerange=(-joint.torque, joint.torque),
        )
    add_grip(actuator, arm.gripper)


def hinge_frame(a: float, alpha: float, d: float) -> tuple[Point, tuple[float, float, float, float]]:
    """Return position [m] and orientation (wxyz) of a joint's frame in Craig's convention: Rx(alpha) Tx(a) Tz(d)."""
    pos = (a, -np.sin(alpha) * d, np.cos(alpha) * d)
    return pos, (np.cos(alpha / 2), np.sin(alpha / 2), 0, 0)
