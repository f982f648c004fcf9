"""A 7-joint arm with the kinematics that Franka publishes for its Panda, and a parallel gripper.

Housings are our own: from link to link a round tube ends in half of a drum about the next joint's axis; the other half
of the drum belongs to the next link. Shapes are given in the links' frames, which are those of the published (modified,
Craig) Denavit-Hartenberg table: frame i sits on joint i, z along its axis.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from manifold3d import Manifold

from .fields import Field, Point, block, carve, flow, rod
from .hulls import few_corners, press_in
from .make_furniture import EDGE, Corners, inset
from .mjcf import Document, add, inertial
from .shapes import box, hull, lathe, solid, surface, write_obj

# Of each joint: a [m], alpha [rad], d [m], limits [rad], greatest torque [N m], stiffness [N m/rad], damping.
HALF_PI = 0.5 * np.pi
JOINTS = [
    (0.0, 0.0, 0.333, (-2.8973, 2.8973), 87, 2000, 140),
    (0.0, -HALF_PI, 0.0, (-1.7628, 1.7628), 87, 2000, 140),
    (0.0, HALF_PI, 0.316, (-2.8973, 2.8973), 87, 1500, 100),
    (0.0825, HALF_PI, 0.0, (-3.0718, -0.0698), 87, 1500, 80),
    (-0.0825, -HALF_PI, 0.384, (-2.8973, 2.8973), 12, 500, 20),
    (0.0, HALF_PI, 0.0, (-0.0175, 3.7525), 12, 500, 20),
    (0.088, HALF_PI, 0.0, (-2.8973, 2.8973), 12, 400, 14),
]
FLANGE, GRIPPER_TURN, TCP, FINGER_ROOT = 0.107, -0.25 * np.pi, 0.1034, 0.0584
HOME = [0.0, -0.25 * np.pi, 0.0, -0.75 * np.pi, 0.0, HALF_PI, 0.25 * np.pi]
# Masses [kg] of the base, the seven links and the hand, near those identified for the real arm.
MASSES = [2.8, 2.9, 2.8, 2.5, 2.4, 2.6, 1.5, 0.5, 0.7]
DRUM, WRIST = 0.058, 0.049
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


Plane = tuple[Point, float]


@dataclass
class Link:
    """A link's housing: what fills space, where the neighbour's drum turns, and how it falls into convex pieces.

    A plane (normal, offset) stands for its positive side.
    """

    parts: list[Field]
    low: Point
    high: Point
    fillet: float = 0.02
    trims: list[Plane] = field(default_factory=list)
    # What lies in neither of the two sides is cut away: there the neighbour's drum turns.
    seat: tuple[Plane, Plane] | None = None
    # Parts whose hulls make convex pieces: on the first side of the seat, and on the second side only.
    pieces: list[list[int]] = field(default_factory=list)
    second: list[list[int]] = field(default_factory=list)
    # Places and directions of dark caps on drums: (centre, axis, radius).
    caps: list[tuple[Point, Point, float]] = field(default_factory=list)


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


def housing(link: Link) -> Manifold:
    """The solid of a link."""
    return seated(carved(link, link.parts), link).as_original().simplify(0.0003)


def carved(link: Link, parts: list[Field]) -> Manifold:
    """Some parts of a link as one solid, trimmed."""
    body = carve(flow(parts, link.fillet), link.low, link.high, edge=0.008, tolerance=0.0005)
    for normal, offset in link.trims:
        body = body.trim_by_plane(normal, offset)
    return body


def seated(body: Manifold, link: Link) -> Manifold:
    """A solid without what is on neither side of the seat."""
    if link.seat is None:
        return body
    return body.trim_by_plane(*link.seat[0]) + body.trim_by_plane(*link.seat[1])


def convex_pieces(link: Link) -> list[np.ndarray]:
    """Points (n, 3) [m] whose hulls fill the housing except for its fillets."""
    groups = [[carved(link, [link.parts[part]]) for part in parts] for parts in link.pieces + link.second]
    if link.seat is not None:
        first, second = link.seat
        for i, bodies in enumerate(groups):
            if i < len(link.pieces):
                groups[i] = [body.trim_by_plane(*first) for body in bodies]
            else:
                groups[i] = [body.trim_by_plane(*second).split_by_plane(*first)[1] for body in bodies]
    pieces = []
    for bodies in groups:
        points = np.concatenate([surface(body).vertices for body in bodies])
        # The housing's own surface is up to 0.3 mm simpler.
        foot = np.append(points.mean(axis=0)[:2], points[:, 2].min())
        pieces.append(foot + 0.995 * (points - foot))
    return pieces


def cap() -> Manifold:
    """A shallow dish of radius 1 and thickness 0.08, around z, that closes a drum."""
    profile = [(0, 0.075), (0.78, 0.075), (0.80, 0.06), (0.80, 0.0), (0.80, -0.06), (0, -0.06)]
    return solid(lathe(np.array(profile), 40))


def facing(direction: Point) -> np.ndarray:
    """The quaternion (wxyz) that turns z into ``direction`` (a unit vector)."""
    quat = np.array([1.0 + direction[2], -direction[1], direction[0], 0.0])
    return quat / np.linalg.norm(quat) if np.linalg.norm(quat) > 0 else np.array([0.0, 1.0, 0.0, 0.0])


def dress(document: Document, body: Element, name: str, link: Link, mass: float, material: str) -> None:
    """Give a link's body its mass, its housing with caps, and its convex pieces."""
    shape = housing(link)
    mesh = surface(shape)
    write_obj(f"panda_{name}", mesh)
    document.mesh(name, f"panda_{name}")
    inertial(body, mesh, mass)
    document.visual(body, name, name, material)
    for i, (centre, axis, radius) in enumerate(link.caps):
        size = f"cap_{round(radius * 1000)}"
        document.visual(body, f"{name}_cap_{i}", size, "dark", pos=centre, quat=facing(axis))
    for i, points in enumerate(convex_pieces(link)):
        write_obj(f"panda_{name}_hull_{i}", press_in(few_corners(points, 32), [mesh]))
        document.mesh(f"{name}_hull_{i}", f"panda_{name}_hull_{i}")
        document.collision(body, f"{name}_hull_{i}", f"{name}_hull_{i}")


def hand_link() -> Link:
    """The gripper's housing in the hand's frame: broad along y, its fingers leave it at z = 0.0584."""
    parts = [
        block((-0.031, -0.102, 0.006), (0.031, 0.102, 0.0655), 0.014),
        rod((0, 0, -0.02), (0, 0, 0.03), 0.040, 0.034, 0.004),
    ]
    return Link(parts, (-0.05, -0.12, -0.03), (0.05, 0.12, 0.085), trims=[((0, 0, 1), 0.0)], pieces=[[0], [1]])


def finger_boxes() -> dict[str, Corners]:
    """Corners of a finger's carriage and of its pad, which is the plane y = 0 in the finger's frame."""
    return {
        "carriage": ((-0.0105, 0.003, 0.0), (0.0105, 0.026, 0.021)),
        "pad": ((-0.0105, 0.0, 0.017), (0.0105, 0.0085, 0.0538)),
    }


def finger_solid() -> Manifold:
    """A finger: the carriage with rounded edges, and a blade that is thicker than its pad but for the tip."""
    carriage, pad = finger_boxes().values()
    (x0, y0, z0), (x1, y1, z1) = pad
    back = [(x, y, z) for x in (x0, x1) for y, z in ((y1 + 0.0015, z0), (y1 + 0.0015, 0.032), (y1, z1))]
    blade = hull(np.array([(x, y0, z) for x in (x0, x1) for z in (z0, z1)] + back))
    return box(*carriage, radius=EDGE) + blade


def add_gripper(document: Document, parent: Element) -> None:
    """Hang the hand, its two fingers and the TCP behind the flange."""
    turn = GRIPPER_TURN / 2
    hand = add(parent, "body", name="hand", pos=(0, 0, FLANGE), quat=(np.cos(turn), 0, 0, np.sin(turn)), gravcomp=1)
    dress(document, hand, "hand", hand_link(), MASSES[8], "light")
    add(hand, "site", name="tcp", pos=(0, 0, TCP), size=0.005, group=4)
    mesh = surface(finger_solid())
    write_obj("panda_finger", mesh)
    document.mesh("finger", "panda_finger")
    for name, quat in (("left", (1, 0, 0, 0)), ("right", (0, 0, 0, 1))):
        finger = add(hand, "body", name=f"{name}_finger", pos=(0, 0, FINGER_ROOT), quat=quat, gravcomp=1)
        add(finger, "joint", name=f"finger_joint{1 + (name == 'right')}", class_="finger")
        inertial(finger, mesh, mass=0.03)
        document.visual(finger, f"{name}_finger", "finger", "dark")
        for part, corners in finger_boxes().items():
            grip = PAD if part == "pad" else {}
            document.collision_box(finger, f"{name}_{part}", *(corners if grip else inset(corners, "xy")), **grip)


def add_actuators(document: Document) -> None:
    """Couple the fingers, and add a position actuator for each joint and one for the gripper."""
    tendon = add(add(document.tree, "tendon"), "fixed", name="gripper")
    # Half of the sum: the gripper's command is the travel of one finger, 0 (closed) to 0.04 m.
    for i in (1, 2):
        add(tendon, "joint", joint=f"finger_joint{i}", coef=0.5)
    equality = add(document.tree, "equality")
    add(
        equality,
        "joint",
        name="fingers",
        joint1="finger_joint1",
        joint2="finger_joint2",
        solref=(0.005, 1),
        solimp=(0.95, 0.99, 0.001),
    )
    actuator = add(document.tree, "actuator")
    for i, (_, _, _, limits, torque, stiffness, _) in enumerate(JOINTS, start=1):
        add(
            actuator,
            "position",
            name=f"joint{i}",
            joint=f"joint{i}",
            kp=stiffness,
            ctrlrange=limits,
            forcerange=(-torque, torque),
        )
    add(actuator, "position", name="gripper", tendon="gripper", kp=GRIP, ctrlrange=(0, 0.04), forcerange=(-140, 140))


def main() -> None:
    """Write ``panda.xml``."""
    document = Document("panda", gravcomp=1)
    revolute = add(document.default, "default", class_="revolute")
    add(revolute, "joint", axis=(0, 0, 1), armature=0.1)
    finger = add(document.default, "default", class_="finger")
    # Critically damped; each finger feels half of the stiffness. Damping alone would not do: the constraint solver
    # knows nothing of its implicit integration, and contacts shake where time step x damping nears the mass.
    damping = round(2 * np.sqrt(0.5 * GRIP * GEARS))
    add(finger, "joint", type="slide", axis=(0, 1, 0), range=(0, 0.04), damping=damping, armature=GEARS)
    document.colour("white", (0.93, 0.93, 0.92), shine=0.5)
    document.colour("light", (0.78, 0.79, 0.80), shine=0.5)
    document.colour("dark", (0.17, 0.18, 0.20), shine=0.5)
    write_obj("panda_cap", surface(cap()))
    for size in (round(1000 * r) for r in (DRUM, WRIST, 0.047)):
        add(document.asset, "mesh", name=f"cap_{size}", file="panda_cap.obj", scale=(size / 1000,) * 3)
    body = document.root
    for i, link in enumerate(links()):
        if i > 0:
            a, alpha, d, limits, _, _, damping = JOINTS[i - 1]
            pos, quat = (a, -np.sin(alpha) * d, np.cos(alpha) * d), (np.cos(alpha / 2), np.sin(alpha / 2), 0, 0)
            body = add(body, "body", name=f"link{i}", pos=pos, quat=quat, gravcomp=1)
            add(body, "joint", name=f"joint{i}", class_="revolute", range=limits, damping=damping)
        dress(document, body, f"link{i}", link, MASSES[i], "light" if i in (0, 7) else "white")
    add_gripper(document, body)
    contact = add(document.tree, "contact")
    # Neighbours share a joint's drum; links two apart meet only where their pieces are fatter than the arm.
    chain = ["panda", *(f"link{i}" for i in range(1, 8)), "hand"]
    for apart in (1, 2):
        for first, second in zip(chain, chain[apart:], strict=False):
            add(contact, "exclude", body1=first, body2=second)
    add_actuators(document)
    home = [*HOME, 0.04, 0.04]
    add(add(document.tree, "keyframe"), "key", name="home", qpos=home, ctrl=home[:8])
    document.save()


if __name__ == "__main__":
    main()
