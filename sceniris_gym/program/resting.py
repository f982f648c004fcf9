"""Stable poses of an object, from its weight, contact margins and drawn joints."""

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

# A pose is tested in at most this number of joint states, on a grid or at random corners and points.
_STATES = 128
# Greatest number of grid levels of each interval of a joint.
_LEVELS = 33
# Greatest fall [m] of an object until its support carries it. A longer fall moves it by a centimetre as it tilts.
_FALL = 2.5e-3
# An object that weighs less than this fraction of its mass does not rest.
_LEAST_WEIGHT = 1.0e-3


def stable_poses(scene: SceneModel, o: PlacedObject, own: list[Piece]) -> list[tuple[np.ndarray, float]]:
    """Return the stable poses of an object and their probabilities, from its collision geometry if it has any.

    Poses and probabilities are computed with the joints in the start pose. A free object only keeps a pose
    if it rests in this pose for all drawn joint positions. It rests on the pieces that collide with its support, at the
    distance where their contacts begin.

    Args:
        scene: The scene.
        o: The object, without its stable poses.
        own: Its pieces, used with `geometry: physics` or if the object has no collision geometry.

    Raises:
        SceneKeyError: The object has no stable pose.
    """
    where, bodies, home = f"{scene.config.where}: objects.{o.name}.orientation", o.bodies, scene.home
    physics = scene.config.geometry == "physics"
    pieces = sorted(own, key=lambda p: p.geom) if physics else extract_pieces(scene.mjm, "physics", set(bodies))
    if not (pieces or own):
        raise SceneKeyError(
            f"{where}: the object has no collision geometry and no stable pose. Give it geoms that collide, or use "
            "another orientation."
        )
    touch = [None] * len(pieces) if o.ground is None else touch_distances(scene, pieces, o.ground)
    carried = [(p, distance) for p, distance in zip(pieces, touch, strict=True) if distance is not None]
    if o.kind != ObjectKind.FREE or not carried:  # an object without a carrier falls in any pose
        return HomeShape(home, bodies[0], pieces or own).stable(where)
    check_weight(scene, bodies, where)
    resting, margins = [p for p, _ in carried], np.array([distance for _, distance in carried])
    poses = HomeShape(home, bodies[0], resting, margins).stable(where)
    states = chain([home], drawn_states(scene, o))
    shapes = [(HomeShape(s, bodies[0], resting, margins), HomeShape(s, bodies[0], pieces)) for s in states]
    # with `geometry: visual`, the object is placed by its visible pieces, so the drop does not matter
    kept = [pose for pose in poses if not physics or all(_drop(*shape, pose[0]) <= _FALL for shape in shapes)]
    if not kept:
        raise SceneKeyError(
            f"{where}: in each stable pose, the object would drop by more than {1e3 * _FALL:g} mm, because its lowest "
            "part is not the first to touch the support. Give all its geoms equal contact margins and bits, or use "
            "another orientation."
        )
    kept = [pose for pose in kept if all(shape.holds(pose[0]) for shape, _ in shapes[1:])]
    if not kept:
        raise SceneKeyError(
            f"{where}: the object has no pose that is stable in all states of its drawn joints. Narrow the range of "
            f"{drawn_joints(scene, o)}, or use another orientation."
        )
    total = sum(share for _, share in kept)
    return [(quat, share / total) for quat, share in kept] if len(kept) < len(poses) else poses


def check_weight(scene: SceneModel, bodies: list[int], where: str) -> None:
    """Reject an object that `gravcomp` lifts off its support. An object without any weight floats and is accepted."""
    left = np.minimum(weights(scene.least), weights(scene.most))[bodies]
    least = _LEAST_WEIGHT * scene.least.body_mass[bodies].sum()
    if left.sum() <= least and np.abs(left).max() > least:
        raise SceneKeyError(
            f"{where}: 'gravcomp' leaves the object no weight, so it rises off its support. Lower 'gravcomp' of the "
            "object's bodies."
        )


def touch_distances(scene: SceneModel, pieces: list[Piece], ground: int) -> list[float | None]:
    """For each piece, return the distance [m] at which MuJoCo's contact with a body begins, or None without contact."""
    mjm, rules = scene.mjm, scene.contact_rules
    under = {int(rules.classes[g]) for g in np.flatnonzero(mjm.geom_bodyid == ground) if rules.collides(int(g))}
    found = []
    for p in pieces:
        met = [other for other in under if rules.may_touch(p.contact_class, other, p.body, ground)]
        found.append(max((rules.distance(p.contact_class, other) for other in met), default=None))
    return found


def drawn_states(scene: SceneModel, o: PlacedObject) -> Iterator[mujoco.MjData]:
    """Yield states of a model that together cover the ranges of the drawn joints of an object.

    The positions form a grid that includes the ends of the ranges. If the grid would be too large, they are random.
    Each state is the same MjData object with other values, because it takes long to create many.
    """
    levels = [np.unique([np.linspace(low, high, _LEVELS) for low, high in d.intervals]) for d in o.joint_ranges]
    if not levels:
        return
    most = max(int(_STATES ** (1.0 / len(levels))), 2)
    if most ** len(levels) <= _STATES:
        thin = [values[np.unique(np.linspace(0, len(values) - 1, most).round().astype(int))] for values in levels]
        chosen = [np.array(values) for values in product(*thin)]
    else:
        rng = np.random.default_rng(0)  # a fixed seed, so that a scene has the same stable poses at every compilation
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
    """Return the height [m] by which an object in a pose falls until its support carries it.

    `resting` has the pieces that collide with the support, and `whole` has all pieces. Before the fall, the
    lowest point is as high above the support as the greatest contact distance of the pieces in `resting`.
    """
    return float(resting.margins.max()) + resting.bottom(quat) - whole.bottom(quat)


def drawn_joints(scene: SceneModel, o: PlacedObject) -> str:
    """Return the names of the drawn joints of an object, for errors."""
    joints = [int(np.flatnonzero(scene.mjm.jnt_qposadr == d.qposadr)[0]) for d in o.joint_ranges]
    return ", ".join(f"'{scene.mjm.joint(j).name}'" for j in joints)
