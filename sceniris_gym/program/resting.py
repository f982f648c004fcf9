"""Stable poses of an object as it is simulated: with its weight, its contact margins, and its joints as drawn."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, product

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import Piece, extract_pieces
from sceniris_gym.geometry.resting_poses import HomeShape, weights
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.scene.couplings import follow
from sceniris_gym.scene.model import SceneModel

# A pose is tested in this many states of its joints, on a grid of at most so many levels of each joint, or at random
# corners and points.
_STATES = 128
_LEVELS = 33
# Height [m] that an object may fall until it is carried; more moves it by a centimetre as it tilts.
_FALL = 2.5e-3
# An object that weighs less than this share of its mass does not rest.
_LEAST_WEIGHT = 1.0e-3


def stable_poses(scene: SceneModel, o: PlacedObject, own: list[Piece]) -> list[tuple[np.ndarray, float]]:
    """Return the stable poses of an object and their probabilities, by its physics also with `geometry: visual`.

    The poses and probabilities are those of its home state. A free object keeps those in which it rests in all states
    that its joints are drawn in, on those of its pieces that touch its support, at the distance at which MuJoCo acts.

    Args:
        scene: The scene.
        o: The object, without its stable poses.
        own: Its pieces, taken where it has no collision geometry.

    Raises:
        SceneKeyError: It has no such pose.
    """
    where, bodies, home = f"{scene.config.where}: objects.{o.name}.orientation", o.bodies, scene.home
    physics = scene.config.geometry == "physics"
    pieces = sorted(own, key=lambda p: p.geom) if physics else extract_pieces(scene.mjm, "physics", set(bodies))
    if not (pieces or own):
        raise SceneKeyError(
            f"{where}: it has no collision geometry and so no stable pose. Give it geoms that collide, or another "
            "orientation."
        )
    touch = [None] * len(pieces) if o.ground is None else touch_distances(scene, pieces, o.ground)
    carried = [(p, distance) for p, distance in zip(pieces, touch, strict=True) if distance is not None]
    if o.kind != ObjectKind.FREE or not carried:  # without a carrier it falls in any pose
        return HomeShape(home, bodies[0], pieces or own).stable(where)
    check_weight(scene, bodies, where)
    resting, margins = [p for p, _ in carried], np.array([distance for _, distance in carried])
    poses = HomeShape(home, bodies[0], resting, margins).stable(where)
    states = chain([home], drawn_states(scene, o))
    shapes = [(HomeShape(s, bodies[0], resting, margins), HomeShape(s, bodies[0], pieces)) for s in states]
    # with visual geometry it stands on that, whatever carries it
    kept = [pose for pose in poses if not physics or all(_drop(*shape, pose[0]) <= _FALL for shape in shapes)]
    if not kept:
        raise SceneKeyError(
            f"{where}: in no stable pose its lowest part is the one that touches its support first: contact margins or "
            f"contact bits of its geoms differ, and it would drop by more than {1e3 * _FALL:g} mm. Make them alike, or "
            "give it another orientation."
        )
    kept = [pose for pose in kept if all(shape.holds(pose[0]) for shape, _ in shapes[1:])]
    if not kept:
        raise SceneKeyError(
            f"{where}: it has no pose that is stable in all states that its joints are drawn in. Draw "
            f"{drawn_joints(scene, o)} from less, or give it another orientation."
        )
    total = sum(share for _, share in kept)
    return [(quat, share / total) for quat, share in kept] if len(kept) < len(poses) else poses


def check_weight(scene: SceneModel, bodies: list[int], where: str) -> None:
    """Refuse an object that rises off its support; one that nothing pulls at stays wherever it is."""
    left = np.minimum(weights(scene.least), weights(scene.most))[bodies]
    least = _LEAST_WEIGHT * scene.least.body_mass[bodies].sum()
    if left.sum() <= least and np.abs(left).max() > least:
        raise SceneKeyError(
            f"{where}: 'gravcomp' leaves it no weight that holds it down, so it rises. Lower the gravcomp of "
            "its bodies."
        )


def touch_distances(scene: SceneModel, pieces: list[Piece], ground: int) -> list[float | None]:
    """Return the distance [m] from which on each piece rests on a body in MuJoCo; None for pieces that never do."""
    mjm, rules = scene.mjm, scene.contact_rules
    under = {int(rules.classes[g]) for g in np.flatnonzero(mjm.geom_bodyid == ground) if rules.collides(int(g))}

    def meets(p: Piece, other: int) -> bool:
        excluded = rules.excludes(p.body, ground) and not rules.is_explicit(p.contact_class, other)
        return rules.meet(p.contact_class, other) and not excluded

    return [
        max((rules.distance(p.contact_class, other) for other in under if meets(p, other)), default=None)
        for p in pieces
    ]


def drawn_states(scene: SceneModel, o: PlacedObject) -> Iterator[mujoco.MjData]:
    """Yield states that the joints of an object are drawn in, their ends among them.

    They are on a grid, or at random where there are many. All of them are in one MjData, as making many takes long.
    """
    levels = [np.unique([np.linspace(low, high, _LEVELS) for low, high in d.intervals]) for d in o.joint_ranges]
    if not levels:
        return
    most = max(int(_STATES ** (1.0 / len(levels))), 2)
    if most ** len(levels) <= _STATES:
        thin = [values[np.unique(np.linspace(0, len(values) - 1, most).round().astype(int))] for values in levels]
        chosen = [np.array(values) for values in product(*thin)]
    else:
        rng = np.random.default_rng(0)
        inner = [[rng.choice(values) for values in levels] for _ in range(_STATES // 2)]
        ends = [[rng.choice(values[[0, -1]]) for values in levels] for _ in range(_STATES // 2)]
        chosen = [np.array(values) for values in (*ends, *inner)]
    state = mujoco.MjData(scene.mjm)
    state.qpos[:] = scene.home_qpos
    for values in chosen:
        state.qpos[[d.qposadr for d in o.joint_ranges]] = values
        follow(o.followers, state.qpos)
        mujoco.mj_kinematics(scene.mjm, state)
        mujoco.mj_comPos(scene.mjm, state)
        yield state


def _drop(resting: HomeShape, whole: HomeShape, quat: np.ndarray) -> float:
    """Return the height [m] that an object in a pose falls until its support carries it.

    It is put down with its lowest point as high as the largest of the distances from which its pieces are carried.
    """
    return float(resting.margins.max()) + resting.bottom(quat) - whole.bottom(quat)


def drawn_joints(scene: SceneModel, o: PlacedObject) -> str:
    """Return the drawn joints of an object, as errors name them."""
    joints = [int(np.flatnonzero(scene.mjm.jnt_qposadr == d.qposadr)[0]) for d in o.joint_ranges]
    return ", ".join(f"'{scene.mjm.joint(j).name}'" for j in joints)
