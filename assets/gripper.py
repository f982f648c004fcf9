"""Parallel grippers: a hand with two fingers that slide apart along its y axis, coupled, on one actuator."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
from manifold3d import Manifold

from .links import Link, dress
from .make_furniture import EDGE, Corners, inset
from .mjcf import Document, add, inertial
from .shapes import box, hull, surface, write_obj

# Rubber pads: they resist spinning about the contact, and their contacts are stiff, since what is held creeps through
# soft ones (2.3 mm/s for a 0.2 kg cube with MuJoCo's default solimp). Priority: so whatever they touch.
PAD = {
    "friction": (1.2, 0.01, 0.0001),
    "condim": 4,
    "priority": 1,
    "solref": (0.01, 1),
    "solimp": (0.995, 0.999, 0.001),
}
# The gripper's stiffness [N/m], and the inertia of its gears, felt at each finger [kg]. It keeps fingers below 0.5 m/s:
# light ones close at 2 m/s, are deep in what they grip within a step, and push it away sideways.
GRIP, GEARS = 4000.0, 2.0


@dataclass(frozen=True)
class Gripper:
    """A gripper in the hand's frame: z is the approach, y the direction in which the fingers close. Units are metres.

    ``carriage`` and ``pad`` are corners in a finger's frame, in which the pad's face is the plane y = 0 and the finger
    leaves the hand at z = 0. ``taper`` is the height from which the blade gets as thin as its pad.
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
    """A finger: the carriage with rounded edges, and a blade that is thicker than its pad but for the tip."""
    (x0, y0, z0), (x1, y1, z1) = gripper.pad
    back = [(x, y, z) for x in (x0, x1) for y, z in ((y1 + 0.0015, z0), (y1 + 0.0015, gripper.taper), (y1, z1))]
    blade = hull(np.array([(x, y0, z) for x in (x0, x1) for z in (z0, z1)] + back))
    return box(*gripper.carriage, radius=EDGE) + blade


def add_gripper(document: Document, parent: Element, gripper: Gripper, flange: float, turn: float = 0.0) -> None:
    """Hang the hand, its two fingers and the TCP at ``flange`` [m] along z of the last link, turned by ``turn`` [rad].

    Fingers are critically damped; each feels half of the stiffness. Damping alone would not do: the constraint solver
    knows nothing of its implicit integration, and contacts shake where time step x damping nears the mass.
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
    """Make the fingers move as one. The gripper's command is the travel of one finger, 0 when closed."""
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
    """The actuator of the fingers, after those of the joints."""
    add(
        actuator,
        "position",
        name="gripper",
        tendon="gripper",
        kp=GRIP,
        ctrlrange=(0, gripper.travel),
        forcerange=(-gripper.force, gripper.force),
    )
