"""Parallel grippers: one actuator moves two coupled fingers along the y axis of the hand."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from manifold3d import Manifold

from .links import Link, dress
from .make_furniture import EDGE, Corners, inset
from .mjcf import Document, add, inertial
from .shapes import box, hull, surface, write_obj

# Rubber pads resist spinning about the contact. Their contacts are stiff, because held objects creep through soft ones
# (2.3 mm/s for a 0.2 kg cube with MuJoCo's default solimp). The priority applies these values to all contacts of pads.
PAD = {
    "friction": (1.2, 0.01, 0.0001),
    "condim": 4,
    "priority": 1,
    "solref": (0.01, 1),
    "solimp": (0.995, 0.999, 0.001),
}
# The gripper's stiffness [N/m], and the inertia of its gears at each finger [kg]. The inertia keeps fingers below
# 0.5 m/s. Light fingers close at 2 m/s, penetrate an object deeply within a step, and push it sideways.
GRIP, GEARS = 4000.0, 2.0


@dataclass(frozen=True)
class Gripper:
    """A gripper in the hand's frame: z is the approach axis, y the closing axis. Units are metres.

    ``carriage`` and ``pad`` are corners in a finger's frame. In this frame, the pad's face is at y = 0, and the finger
    leaves the hand at z = 0. ``taper`` is the height where the blade starts to narrow to the thickness of its pad.
    """

    housing: Link
    mass: float
    root: float
    tcp: float
    travel: float
    carriage: Corners
    pad: Corners
    taper: float
    force: float = 140.0
    finger_mass: float = 0.03


def finger_solid(gripper: Gripper) -> Manifold:
    """A finger: the carriage with rounded edges, and a blade that is thicker than its pad except at the tip."""
    (x0, y0, z0), (x1, y1, z1) = gripper.pad
    back = [(x, y, z) for x in (x0, x1) for y, z in ((y1 + 0.0015, z0), (y1 + 0.0015, gripper.taper), (y1, z1))]
    blade = hull(np.array([(x, y0, z) for x in (x0, x1) for z in (z0, z1)] + back))
    return box(*gripper.carriage, radius=EDGE) + blade


def add_gripper(document: Document, parent: Element, gripper: Gripper, flange: float, turn: float = 0.0) -> None:
    """Attach the hand, two fingers and the TCP at ``flange`` [m] along the last link's z, rotated by ``turn`` [rad].

    Each finger is critically damped for half of the stiffness. Damping without the inertia of the gears is not enough:
    the constraint solver ignores that damping is integrated implicitly, so contacts shake if time step x damping is
    close to the mass.
    """
    default = add(document.default, "default", class_="finger")
    damping = round(2 * np.sqrt(0.5 * GRIP * GEARS))
    add(default, "joint", type="slide", axis=(0, 1, 0), range=(0, gripper.travel), damping=damping, armature=GEARS)
    quat = (np.cos(turn / 2), 0, 0, np.sin(turn / 2))
    hand = add(parent, "body", name="hand", pos=(0, 0, flange), quat=quat, gravcomp=1)
    dress(document, hand, "hand", gripper.housing, gripper.mass, "light")
    add(hand, "site", name="tcp", pos=(0, 0, gripper.tcp), size=0.005, group=4)
    mesh = surface(finger_solid(gripper))
    write_obj(f"{document.name}_finger", mesh)
    document.mesh("finger", f"{document.name}_finger")
    for name, quat in (("left", (1, 0, 0, 0)), ("right", (0, 0, 0, 1))):
        finger = add(hand, "body", name=f"{name}_finger", pos=(0, 0, gripper.root), quat=quat, gravcomp=1)
        add(finger, "joint", name=f"finger_joint{1 + (name == 'right')}", class_="finger")
        inertial(finger, mesh, mass=gripper.finger_mass)
        document.visual(finger, f"{name}_finger", "finger", "dark")
        document.collision_box(finger, f"{name}_carriage", *inset(gripper.carriage, "xy"))
        document.collision_box(finger, f"{name}_pad", *gripper.pad, **PAD)


def couple_fingers(document: Document) -> None:
    """Couple the fingers. The gripper's command is the travel of one finger, 0 when closed."""
    tendon = add(add(document.tree, "tendon"), "fixed", name="gripper")
    for i in (1, 2):
        add(tendon, "joint", joint=f"finger_joint{i}", coef=0.5)
    add(
        add(document.tree, "equality"),
        "joint",
        name="fingers",
        joint1="finger_joint1",
        joint2="finger_joint2",
        solref=(0.005, 1),
        solimp=(0.95, 0.99, 0.001),
    )


def add_grip(actuator: Element, gripper: Gripper) -> None:
    """Add the actuator of the fingers, after the joint actuators."""
    add(
        actuator,
        "position",
        name="gripper",
        tendon="gripper",
        kp=GRIP,
        ctrlrange=(0, gripper.travel),
        forcerange=(-gripper.force, gripper.force),
    )
