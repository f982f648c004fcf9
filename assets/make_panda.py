"""A 7-joint arm with the kinematics that Franka publishes for its Panda, and a parallel gripper.

The housings are our design. The round tube of each link ends in half of a drum about the next joint's axis. The other
half of the drum belongs to the next link. Shapes are given in the links' frames, which follow the published (modified,
Craig) Denavit-Hartenberg table: frame i is at joint i, with z along its axis.
"""

from __future__ import annotations

import numpy as np

from .arms import Arm, Joint, hinge_frame, write_arm
from .fields import block, rod
from .gripper import Gripper
from .links import Link

HALF_PI = 0.5 * np.pi
# The published table: a [m], alpha [rad], d [m] of each joint.
DH = [
    (0.0, 0.0, 0.333),
    (0.0, -HALF_PI, 0.0),
    (0.0, HALF_PI, 0.316),
    (0.0825, HALF_PI, 0.0),
    (-0.0825, -HALF_PI, 0.384),
    (0.0, HALF_PI, 0.0),
    (0.088, HALF_PI, 0.0),
]
# For each joint: limits [rad], maximum torque [N m] and speed [rad/s], stiffness [N m/rad], damping [N m s/rad].
JOINTS = [
    ((-2.8973, 2.8973), 87, 2.175, 2000, 140),
    ((-1.7628, 1.7628), 87, 2.175, 2000, 140),
    ((-2.8973, 2.8973), 87, 2.175, 1500, 100),
    ((-3.0718, -0.0698), 87, 2.175, 1500, 80),
    ((-2.8973, 2.8973), 12, 2.61, 500, 20),
    ((-0.0175, 3.7525), 12, 2.61, 500, 20),
    ((-2.8973, 2.8973), 12, 2.61, 400, 14),
]
FLANGE, GRIPPER_TURN, TCP, FINGER_ROOT = 0.107, -0.25 * np.pi, 0.1034, 0.0584
HOME = [0.0, -0.25 * np.pi, 0.0, -0.75 * np.pi, 0.0, HALF_PI, 0.25 * np.pi]
# Masses [kg] of the base, the seven links and the hand, close to identified masses of the real arm.
MASSES = [2.8, 2.9, 2.8, 2.5, 2.4, 2.6, 1.5, 0.5, 0.7]
DRUM, WRIST = 0.058, 0.049
DRUM, WRIST = 0.058, 0.049


def links() -> list[Link]:
    """The base and the seven links."""
    d, w, far, near, reach, grip = DRUM, WRIST, 0.116, 0.105, 0.086, 0.002
    elbow, wrist = 0.0825, 0.088
    base = Link(
        [
            block((-0.145, -0.095, -0.03), (0.07, 0.095, 0.045), 0.028),
            block((-0.15, -0.05, -0.03), (-0.05, 0.05, 0.075), 0.02),
            rod((0, 0, 0), (0, 0, 0.17), 0.066, 0.061),
        ],
        (-0.18, -0.12, -0.05), (0.1, 0.12, 0.19),
        trims=[((0, 0, 1), 0.0), ((0, 0, -1), -0.1415)], pieces=[[0], [1], [2]],
    )  # fmt: skip
    shoulder = Link(
        [rod((0, 0, -0.22), (0, 0, -0.01), 0.061, d), rod((0, -far, 0), (0, 0.01, 0), d)],
        (-0.1, -0.14, -0.24), (0.1, 0.1, 0.09), trims=[((0, 0, 1), -0.1905)],
        seat=(((0, 0, -1), d + grip), ((0, -1, 0), 0.0)), pieces=[[0]], second=[[0], [1]],
        caps=[((0, -far, 0), (0, -1, 0), d)],
    )  # fmt: skip
    upper_arm = Link(
        [rod((0, 0.01, 0), (0, -0.22, 0), d, 0.060), rod((0, 0, far), (0, 0, -0.01), d)],
        (-0.1, -0.24, -0.1), (0.1, 0.09, 0.14), trims=[((0, 1, 0), -0.1895)],
        seat=(((0, -1, 0), d + grip), ((0, 0, 1), 0.0)), pieces=[[0]], second=[[0], [1]],
        caps=[((0, 0, far), (0, 0, 1), d)],
    )  # fmt: skip
    to_elbow = Link(
        [
            rod((0, 0, -0.155), (0, 0, -0.045), 0.060, d),
            rod((elbow, near, 0), (elbow, -0.01, 0), d),
            rod((0, 0, -0.062), (elbow, 0.03, 0), 0.054),
        ],
        (-0.1, -0.1, -0.17), (0.17, 0.13, 0.09), trims=[((0, 0, 1), -0.1245)],
        seat=(((-0.8, 0, -0.6), d + grip - 0.8 * elbow), ((0, 1, 0), 0.0)), pieces=[[0], [2]], second=[[1], [2]],
        caps=[((elbow, near, 0), (0, 1, 0), d)],
    )  # fmt: skip
    from_elbow = Link(
        [
            rod((-elbow, 0.045, 0), (-elbow, 0.15, 0), d, 0.058),
            rod((0, 0, near), (0, 0, -0.01), d),
            rod((-elbow, 0.062, 0), (0, 0, 0.03), 0.054),
        ],
        (-0.17, -0.1, -0.1), (0.1, 0.17, 0.13), trims=[((0, -1, 0), -0.1205)],
        seat=(((-0.8, 0.6, 0), d + grip), ((0, 0, 1), 0.0)), pieces=[[0], [2]], second=[[1], [2]],
        caps=[((0, 0, near), (0, 0, 1), d)],
    )  # fmt: skip
    forearm = Link(
        [
            rod((0, 0, -0.29), (0, 0, -0.17), 0.058, 0.054),
            rod((0, 0.008, -0.2), (0, 0.03, -0.02), 0.054, 0.043),
            rod((0, reach, 0), (0, -0.01, 0), w),
        ],
        (-0.09, -0.09, -0.31), (0.09, 0.11, 0.08), trims=[((0, 0, 1), -0.2625)],
        seat=(((0, 0, -1), w + grip), ((0, 1, 0), 0.0)), pieces=[[0], [1]], second=[[1, 2]],
        caps=[((0, reach, 0), (0, 1, 0), w)],
    )  # fmt: skip
    wrist_link = Link(
        [
            rod((0, 0, reach), (0, 0, -0.01), w),
            rod((wrist, 0.052, 0), (wrist, -0.08, 0), 0.047, 0.046),
            rod((0, 0, 0.035), (wrist, 0, 0), 0.040),
        ],
        (-0.08, -0.1, -0.08), (0.16, 0.08, 0.11), trims=[((0, 1, 0), -0.0505)],
        seat=(((1, 0, 0), w + grip), ((0, 0, 1), 0.0)), pieces=[[1], [2]], second=[[0], [1, 2]],
        caps=[((0, 0, reach), (0, 0, 1), w), ((wrist, 0.052, 0), (0, 1, 0), 0.047)],
    )  # fmt: skip
    flange = Link(
        [rod((0, 0, 0.03), (0, 0, 0.14), 0.045, 0.043), rod((0.046, 0, 0.062), (0.046, 0, 0.096), 0.021, edge=0.006)],
        (-0.07, -0.07, 0.02), (0.09, 0.07, 0.16), trims=[((0, 0, 1), 0.0525), ((0, 0, -1), -FLANGE)], pieces=[[0], [1]],
    )  # fmt: skip
    return [base, shoulder, upper_arm, to_elbow, from_elbow, forearm, wrist_link, flange]


def hand_link() -> Link:
    """The gripper's housing in the hand's frame: wide along y, with the fingers leaving it at z = 0.0584."""
    parts = [
        block((-0.031, -0.102, 0.006), (0.031, 0.102, 0.0655), 0.014),
        rod((0, 0, -0.02), (0, 0, 0.03), 0.040, 0.034, 0.004),
    ]
    return Link(parts, (-0.05, -0.12, -0.03), (0.05, 0.12, 0.085), trims=[((0, 0, 1), 0.0)], pieces=[[0], [1]])


def main() -> None:
    """Write ``panda.xml``."""
    gripper = Gripper(
        housing=hand_link(),
        mass=MASSES[8],
        root=FINGER_ROOT,
        tcp=TCP,
        travel=0.04,
        carriage=((-0.0105, 0.003, 0.0), (0.0105, 0.026, 0.021)),
        pad=((-0.0105, 0.0, 0.017), (0.0105, 0.0085, 0.0538)),
        taper=0.032,
    )
    # Neighbours share a joint's drum. Links two joints apart touch only where collision pieces exceed the housings.
    write_arm(
        Arm(
            name="panda",
            joints=[Joint(*hinge_frame(a, alpha, d), *gains) for (a, alpha, d), gains in zip(DH, JOINTS, strict=True)],
            links=links(),
            masses=MASSES[:8],
            materials=["light" if i in (0, 7) else "white" for i in range(8)],
            gripper=gripper,
            flange=FLANGE,
            turn=GRIPPER_TURN,
            home=HOME,
            apart=2,
        )
    )


if __name__ == "__main__":
    main()
