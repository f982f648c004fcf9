"""Heron: a slim 6-joint bench arm of our design. Its base and last joint rotate by less than 360 degrees.

With all joints at zero, the arm points straight up, all frames are aligned with the base, and the axes are z, y, y,
z, y, z. The first two axes intersect, the second and third are parallel, and the last three intersect at the wrist's
centre, so inverse kinematics has a closed form. The arm folds far, because the upper arm runs next to the shoulder and
the forearm, and a single cheek carries the wrist. Shapes are given in the links' frames.
"""

from __future__ import annotations

import numpy as np

from .arms import Arm, Joint, write_arm
from .fields import block, rod
from .gripper import Gripper
from .links import Link

SHOULDER, UPPER_ARM, FOREARM, FLANGE = 0.24, 0.32, 0.30, 0.085
STRAIGHT = (1, 0, 0, 0)
Y, Z = (0, 1, 0), (0, 0, 1)
# For each joint: position in the previous frame [m], axis, limit [degrees, +-], maximum torque [N m] and speed [rad/s],
# stiffness [N m/rad], damping [N m s/rad].
JOINTS = [
    ((0, 0, 0), Z, 150, 60, 2.5, 1200, 80),
    ((0, 0, SHOULDER), Y, 115, 60, 2.5, 1200, 80),
    ((0, 0, UPPER_ARM), Y, 150, 40, 2.5, 900, 50),
    ((0, 0, FOREARM), Z, 170, 14, 3.5, 400, 14),
    ((0, 0, 0), Y, 115, 14, 3.5, 400, 14),
    ((0, 0, 0), Z, 160, 9, 4.0, 300, 9),
]
# Masses [kg] of the base and the six links.
MASSES = [2.4, 2.2, 2.3, 1.3, 0.8, 0.5, 0.2]
HOME = np.radians([0, 20, 100, 0, 60, 0]).tolist()
# Radii [m] of the drums, where the drums of shoulder and elbow meet the upper arm, and half of the gap between links.
DRUM, ELBOW, WRIST, SIDE, GAP = 0.055, 0.047, 0.034, 0.056, 0.0015
# Height of the forearm's roll joint below the wrist's centre, and of the wrist's underside above its neck [m].
ROLL, CHEEK = 0.175, 0.034


def links() -> list[Link]:
    """The base and the six links."""
    base = Link(
        [block((-0.10, -0.085, -0.04), (0.085, 0.085, 0.024), 0.020), rod((0, 0, -0.02), (0, 0, 0.12), 0.070, 0.060)],
        (-0.13, -0.11, -0.05), (0.11, 0.11, 0.14),
        trims=[((0, 0, 1), 0.0), ((0, 0, -1), GAP - 0.09)], pieces=[[0], [1]],
    )  # fmt: skip
    turret = Link(
        [
            rod((0, 0, 0.06), (0, 0, SHOULDER - 0.01), 0.060, 0.054),
            rod((0, -0.062, SHOULDER), (0, 0.09, SHOULDER), DRUM),
        ],
        (-0.08, -0.09, 0.04), (0.08, 0.11, 0.32),
        trims=[((0, 0, 1), 0.09 + GAP), ((0, -1, 0), GAP - SIDE)], pieces=[[0], [1]],
        caps=[((0, -0.062, SHOULDER), (0, -1, 0), DRUM)],
    )  # fmt: skip
    upper_arm = Link(
        [
            rod((0, 0.03, 0), (0, 0.135, 0), DRUM),
            block((-0.034, 0.068, -0.02), (0.034, 0.126, UPPER_ARM), 0.024),
            rod((0, 0.03, UPPER_ARM), (0, 0.131, UPPER_ARM), ELBOW),
        ],
        (-0.08, 0.01, -0.08), (0.08, 0.16, 0.40), trims=[((0, 1, 0), SIDE + GAP)], pieces=[[0], [1], [2]],
        caps=[((0, 0.135, 0), (0, 1, 0), DRUM), ((0, 0.131, UPPER_ARM), (0, 1, 0), ELBOW)],
    )  # fmt: skip
    elbow = Link(
        [
            rod((0, -0.048, 0), (0, 0.09, 0), ELBOW),
            rod((0, 0, 0), (0, 0, 0.2), 0.044, 0.038),
        ],
        (-0.07, -0.07, -0.07), (0.07, 0.11, 0.22),
        trims=[((0, -1, 0), GAP - SIDE), ((0, 0, -1), GAP + ROLL - FOREARM)], pieces=[[0], [1]],
        caps=[((0, -0.048, 0), (0, -1, 0), ELBOW)],
    )  # fmt: skip
    forearm = Link(
        [
            rod((0, 0, -0.21), (0, 0, -0.075), 0.038, 0.036),
            block((-0.030, -0.066, -0.125), (0.030, -0.034, -0.005), 0.012),
            rod((0, -0.066, 0), (0, -0.02, 0), WRIST),
        ],
        (-0.06, -0.09, -0.23), (0.06, 0.06, 0.06), fillet=0.012,
        trims=[((0, 0, 1), GAP - ROLL)], seat=(((0, 0, -1), 0.044), ((0, -1, 0), CHEEK)),
        pieces=[[0], [1]], second=[[1], [2]],
        caps=[((0, -0.066, 0), (0, -1, 0), WRIST)],
    )  # fmt: skip
    wrist = Link(
        [
            rod((0, -0.06, 0), (0, 0.042, 0), WRIST),
            rod((0, 0, 0), (0, 0, 0.08), 0.033, 0.032),
        ],
        (-0.05, -0.08, -0.05), (0.05, 0.06, 0.10), fillet=0.012,
        trims=[((0, 1, 0), 2 * GAP - CHEEK), ((0, 0, -1), GAP - 0.052)], pieces=[[0], [1]],
        caps=[((0, 0.042, 0), (0, 1, 0), WRIST)],
    )  # fmt: skip
    flange = Link(
        [rod((0, 0, 0.03), (0, 0, 0.12), 0.032)],
        (-0.05, -0.05, 0.02), (0.05, 0.05, 0.14), trims=[((0, 0, 1), 0.052 + GAP), ((0, 0, -1), -FLANGE)], pieces=[[0]],
    )  # fmt: skip
    return [base, turret, upper_arm, elbow, forearm, wrist, flange]


def hand_link() -> Link:
    """The gripper's housing in the hand's frame: wide along y, with the fingers leaving it at z = 0.047."""
    parts = [
        block((-0.026, -0.085, 0.006), (0.026, 0.085, 0.054), 0.012),
        rod((0, 0, -0.02), (0, 0, 0.03), 0.031, 0.028, 0.004),
    ]
    return Link(parts, (-0.04, -0.10, -0.03), (0.04, 0.10, 0.07), trims=[((0, 0, 1), 0.0)], pieces=[[0], [1]])


def joints() -> list[Joint]:
    """The six joints. All frames have the base's orientation."""
    return [
        Joint(pos, STRAIGHT, (-np.radians(limit), np.radians(limit)), torque, speed, stiffness, damping, axis)
        for pos, axis, limit, torque, speed, stiffness, damping in JOINTS
    ]


def main() -> None:
    """Write ``heron.xml``."""
    gripper = Gripper(
        housing=hand_link(),
        mass=0.45,
        root=0.047,
        tcp=0.095,
        travel=0.044,
        carriage=((-0.010, 0.003, 0.0), (0.010, 0.026, 0.020)),
        pad=((-0.010, 0.0, 0.016), (0.010, 0.0085, 0.056)),
        taper=0.032,
    )
    write_arm(
        Arm(
            name="heron",
            joints=joints(),
            links=links(),
            masses=MASSES,
            materials=["slate", "slate", "sand", "slate", "sand", "slate", "light"],
            gripper=gripper,
            flange=FLANGE,
            home=HOME,
            caps="rust",
        ),
        {"slate": (0.36, 0.41, 0.46), "sand": (0.88, 0.85, 0.78), "rust": (0.78, 0.38, 0.20)},
    )


if __name__ == "__main__":
    main()
