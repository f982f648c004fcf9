"""A 6-joint arm with the kinematics that Universal Robots publishes for its UR5e, and a parallel gripper.

Housings and gripper are our design. Drums are side by side along the axes of the shoulder, the elbow and the first
wrist joint, so that the arm folds far. Shapes are given in the links' frames: frame i is at joint i, with z along its
axis. This frame is frame i - 1 of the published (standard) Denavit-Hartenberg table.
"""

from __future__ import annotations

import numpy as np

from .arms import Arm, Joint, write_arm
from .fields import block, rod
from .gripper import Gripper
from .links import Link

# The published table: d [m], a [m], alpha [rad] of each joint.
DH = [
    (0.1625, 0.0, np.pi / 2),
    (0.0, -0.425, 0.0),
    (0.0, -0.3922, 0.0),
    (0.1333, 0.0, np.pi / 2),
    (0.0997, 0.0, -np.pi / 2),
    (0.0996, 0.0, 0.0),
]
SHOULDER, UPPER_ARM, FOREARM, FLANGE = 0.1625, 0.425, 0.3922, 0.0996
WRIST_1, WRIST_2 = 0.1333, 0.0997
FULL, HALF = 2 * np.pi, np.pi
# For each joint: limits [rad], maximum torque [N m] and speed [rad/s], stiffness [N m/rad], damping [N m s/rad].
JOINTS = [
    ((-FULL, FULL), 150, HALF, 2500, 180),
    ((-FULL, FULL), 150, HALF, 2500, 180),
    ((-HALF, HALF), 150, HALF, 2000, 120),
    ((-FULL, FULL), 28, HALF, 600, 25),
    ((-FULL, FULL), 28, HALF, 500, 20),
    ((-FULL, FULL), 28, HALF, 400, 14),
]
# Masses [kg] of the base and the six links, close to the published masses.
MASSES = [3.4, 3.76, 8.06, 2.85, 1.37, 1.30, 0.37]
HOME = np.radians([0, -95, -100, -75, 90, 90]).tolist()
# Radii [m] of the drums at shoulder, elbow and wrist, and half of the gap between links.
DRUM, ELBOW, WRIST, GAP = 0.064, 0.056, 0.0455, 0.0015
# Positions [m] along the axes of shoulder, elbow and first wrist joint: where drums meet, and middles of the tubes.
INNER, OUTER, JOINT_4 = 0.068, 0.206, 0.068
UPPER_TUBE, FORE_TUBE = 0.1375, 0.007


def links() -> list[Link]:
    """The base and the six links."""
    base = Link(
        [rod((0, 0, -0.03), (0, 0, 0.03), 0.0745, edge=0.006), rod((0, 0, 0), (0, 0, 0.12), 0.0685, 0.0625)],
        (-0.1, -0.1, -0.04), (0.1, 0.1, 0.14), fillet=0.012,
        trims=[((0, 0, 1), 0.0), ((0, 0, -1), GAP - 0.088)], pieces=[[0], [1]],
    )  # fmt: skip
    shoulder = Link(
        [
            rod((0, 0, 0.06), (0, 0, SHOULDER), 0.0625, DRUM),
            rod((0, 0.072, SHOULDER), (0, -0.1, SHOULDER), DRUM),
        ],
        (-0.09, -0.12, 0.04), (0.09, 0.1, 0.25),
        trims=[((0, 0, 1), 0.088 + GAP), ((0, 1, 0), GAP - INNER)], pieces=[[0], [1]],
        caps=[((0, 0.072, SHOULDER), (0, 1, 0), DRUM)],
    )  # fmt: skip
    upper_arm = Link(
        [
            rod((0, 0, 0.04), (0, 0, OUTER), DRUM),
            rod((0, 0, UPPER_TUBE), (-UPPER_ARM, 0, UPPER_TUBE), 0.054, 0.049),
            rod((-UPPER_ARM, 0, 0.04), (-UPPER_ARM, 0, OUTER - 0.012), ELBOW),
        ],
        (-0.52, -0.09, 0.02), (0.09, 0.09, 0.23),
        trims=[((0, 0, 1), INNER + GAP)], pieces=[[0], [1], [2]],
        caps=[((0, 0, OUTER), (0, 0, 1), DRUM), ((-UPPER_ARM, 0, OUTER - 0.012), (0, 0, 1), ELBOW)],
    )  # fmt: skip
    forearm = Link(
        [
            rod((0, 0, -0.056), (0, 0, 0.1), ELBOW),
            rod((0, 0, FORE_TUBE), (-FOREARM, 0, FORE_TUBE), 0.0455, 0.040),
            rod((-FOREARM, 0, -0.046), (-FOREARM, 0, 0.1), WRIST),
        ],
        (-0.47, -0.08, -0.08), (0.08, 0.08, 0.12),
        trims=[((0, 0, -1), GAP - INNER)], pieces=[[0], [1], [2]],
        caps=[((0, 0, -0.056), (0, 0, -1), ELBOW), ((-FOREARM, 0, -0.046), (0, 0, -1), WRIST)],
    )  # fmt: skip
    wrist_1 = Link(
        [
            rod((0, 0, 0.04), (0, 0, WRIST_1 + 0.049), WRIST),
            rod((0, 0, WRIST_1), (0, -0.08, WRIST_1), 0.0445),
        ],
        (-0.07, -0.1, 0.02), (0.07, 0.07, 0.21), fillet=0.014,
        trims=[((0, 0, 1), JOINT_4 + GAP), ((0, 1, 0), GAP - 0.052)], pieces=[[0], [1]],
        caps=[((0, 0, WRIST_1 + 0.049), (0, 0, 1), WRIST)],
    )  # fmt: skip
    wrist_2 = Link(
        [
            rod((0, 0, 0.03), (0, 0, WRIST_2 + 0.049), WRIST),
            rod((0, 0, WRIST_2), (0, 0.08, WRIST_2), 0.0445),
        ],
        (-0.07, -0.07, 0.01), (0.07, 0.1, 0.17), fillet=0.014,
        trims=[((0, 0, 1), 0.052 + GAP), ((0, -1, 0), GAP - 0.052)], pieces=[[0], [1]],
        caps=[((0, 0, WRIST_2 + 0.049), (0, 0, 1), WRIST)],
    )  # fmt: skip
    flange = Link(
        [rod((0, 0, 0.03), (0, 0, 0.13), 0.0375, 0.036)],
        (-0.06, -0.06, 0.02), (0.06, 0.06, 0.15),
        trims=[((0, 0, 1), 0.052 + GAP), ((0, 0, -1), -FLANGE)], pieces=[[0]],
    )  # fmt: skip
    return [base, shoulder, upper_arm, forearm, wrist_1, wrist_2, flange]


def hand_link() -> Link:
    """The gripper's housing in the hand's frame: wide along y, with the fingers leaving it at z = 0.073."""
    parts = [
        block((-0.033, -0.088, 0.020), (0.033, 0.088, 0.080), 0.010),
        rod((0, 0, -0.02), (0, 0, 0.04), 0.036, 0.033, 0.004),
    ]
    return Link(parts, (-0.05, -0.11, -0.03), (0.05, 0.11, 0.10), trims=[((0, 0, 1), 0.0)], pieces=[[0], [1]])


def joints() -> list[Joint]:
    """The six joints. Joint i + 1 is at frame i of the Denavit-Hartenberg table."""
    frames = [(0.0, 0.0, 0.0), *DH[:-1]]
    return [
        Joint((a, 0, d), (np.cos(alpha / 2), np.sin(alpha / 2), 0, 0), *rest)
        for (d, a, alpha), rest in zip(frames, JOINTS, strict=True)
    ]


def main() -> None:
    """Write ``ur5e.xml``."""
    gripper = Gripper(
        housing=hand_link(),
        mass=0.8,
        root=0.073,
        tcp=0.128,
        travel=0.0475,
        carriage=((-0.012, 0.003, 0.0), (0.012, 0.030, 0.022)),
        pad=((-0.011, 0.0, 0.018), (0.011, 0.010, 0.064)),
        taper=0.036,
    )
    write_arm(
        Arm(
            name="ur5e",
            joints=joints(),
            links=links(),
            masses=MASSES,
            materials=["light", *["silver"] * 5, "light"],
            gripper=gripper,
            flange=FLANGE,
            home=HOME,
            caps="blue",
        ),
        {"silver": (0.72, 0.74, 0.76), "blue": (0.28, 0.50, 0.68)},
    )


if __name__ == "__main__":
    main()
