"""The objects of a plan as fields of `device.Program`: what is drawn for each, and what it is tested against."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np

from sceniris_gym.config.bounds import LEAST_GAP
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.orientation import DrawnOrientation
from sceniris_gym.geometry.colliders import Colliders
from sceniris_gym.geometry.pieces import Piece, PieceType
from sceniris_gym.geometry.ragged import ranges
from sceniris_gym.program.couplings import coupling_arrays
from sceniris_gym.program.device import Cover, Measure, ObjectKind, OrientationType
from sceniris_gym.program.pack.descent import first_nodes
from sceniris_gym.program.pack.pairs import ArmPairs, Pair, PairRules, arm_pairs, collider_pairs
from sceniris_gym.program.pack.relations import joints_of, relations_of
from sceniris_gym.program.plan import PlacedObject, Plan
from sceniris_gym.scene.model import SceneModel

_ORIENTATIONS = {
    "yaw": OrientationType.YAW,
    "stable": OrientationType.YAW,
    "any": OrientationType.ANY,
    "face_to": OrientationType.FACE_TO,
}
_ARM_LISTS = ("arm_scene", "arm_hand", "arm_target")
ARM_LISTS = ("arm_pairadr", "arm_pairnum", "arm_broadadr", "arm_broadnum", "arm_self", *_ARM_LISTS)
"""What of the packed lists are fields of `Reach`: those of an arm in a grasp."""


def pack_objects(scene: SceneModel, plan: Plan, colliders: Colliders, lanes: int) -> dict[str, np.ndarray]:
    """Fields `obj_*`, and the lists that they address; `lanes` share the collision test of a world."""
    objects, rules = plan.objects, PairRules(scene, colliders)
    boxes = [_box(o.config) for o in objects]
    return {
        "obj_stream": np.array([o.stream for o in objects], int),
        "obj_kind": np.array([o.kind for o in objects], int),
        "obj_body": np.array([o.bodies[0] for o in objects], int),
        "obj_adr": np.array([_address(scene.mjm, o.bodies[0], o.kind) for o in objects], int),
        "obj_slot": np.array([plan.slots.index(o.name) for o in objects], int),
        "obj_measured": np.array([_measured(plan, o) for o in objects], int),
        "obj_ground": np.array([-1 if o.ground is None else o.ground for o in objects], int),
        "obj_gap": np.array([_gap(rules, o) for o in objects]),
        "obj_box_lower": np.reshape([b[0] for b in boxes], (-1, 3)),
        "obj_box_upper": np.reshape([b[1] for b in boxes], (-1, 3)),
        "obj_cover": np.array([o.cover for o in objects], int),
        "obj_footprint": np.array([bool(o.config and o.config.ratio_on_support == 1.0) for o in objects], int),
        **_heaps(objects),
        **_joint_ranges(objects),
        **_followers(objects),
        **_orientations(scene, plan),
        **_bodies_and_pieces(scene, plan, colliders),
        "obj_effort": np.ones(len(plan.objects)),
        **_pairs(scene, plan, rules, lanes),
    }


def _heaps(objects: list[PlacedObject]) -> dict[str, np.ndarray]:
    """The settled poses of things of heaps, one thing after the other."""
    rows, adr, num = ranges([] if o.heap is None else list(np.hstack([o.heap.pos, o.heap.quat])) for o in objects)
    streams = np.array([0 if o.heap is None else o.heap.stream for o in objects], int)
    heaped = np.array([o.heap is not None for o in objects], bool)
    return {
        "obj_heap": np.stack([np.where(heaped, adr, -1), num, streams], axis=1),
        "heap_pose": np.reshape(rows, (-1, 7)),
    }


def _joint_ranges(objects: list[PlacedObject]) -> dict[str, np.ndarray]:
    drawn, drawadr, drawnum = ranges(o.joint_ranges for o in objects)
    choice, choiceadr, choicenum = ranges(r.choice for r in drawn)
    return {
        "obj_drawadr": drawadr,
        "obj_drawnum": drawnum,
        "draw_qposadr": np.array([r.qposadr for r in drawn], int),
        "draw_range": np.reshape([(r.low, r.high) for r in drawn], (-1, 2)),
        "draw_choiceadr": choiceadr,
        "draw_choicenum": choicenum,
        "choice": np.array(choice, float),
    }


def _followers(objects: list[PlacedObject]) -> dict[str, np.ndarray]:
    found, adr, num = ranges([f.coupling for f in o.followers] for o in objects)
    driver, follower, coef = coupling_arrays(found)
    return {
        "obj_followadr": adr,
        "obj_follownum": num,
        "follow_driveradr": driver,
        "follow_qposadr": follower,
        "follow_coef": coef,
    }


def _orientations(scene: SceneModel, plan: Plan) -> dict[str, np.ndarray]:
    """How orientations are drawn, and from which variants; what has no config only draws joints and keeps its own."""
    upright = DrawnOrientation("yaw", (0.0, 0.0))
    drawn = [o.config.drawn_orientation if o.config is not None else upright for o in plan.objects]
    joints = joints_of(scene, plan)
    yaws = [(joints[o.name].turn,) * 2 if o.name in joints else d.yaw for o, d in zip(plan.objects, drawn, strict=True)]
    variants, variantadr, variantnum = ranges(o.variants for o in plan.objects)
    shares = [s for o in plan.objects for s in np.cumsum([v.probability for v in o.variants])]
    return {
        "obj_orientation": np.array([_ORIENTATIONS[d.kind] for d in drawn], int),
        "obj_target": np.array([plan.slots.index(d.target) if d.target else 0 for d in drawn], int),
        "obj_yaw": np.reshape(yaws, (-1, 2)),
        "obj_beside": np.array(
            [plan.slots.index(joints[o.name].to) if o.name in joints else -1 for o in plan.objects], int
        ),
        "obj_variantadr": variantadr,
        "obj_variantnum": variantnum,
        "variant_quat": np.reshape([v.quat for v in variants], (-1, 4)),
        "variant_pivot": np.reshape([v.pivot for v in variants], (-1, 3)),
        "variant_bounds": np.reshape([v.bounds for v in variants], (-1, 4)),
        "variant_cdf": np.array(shares, float),
    }


def _bodies_and_pieces(scene: SceneModel, plan: Plan, colliders: Colliders) -> dict[str, np.ndarray]:
    """Which bodies and pieces an object has, which of them are its footprint, and what may be a roof over it."""
    objects = plan.objects
    of_body: dict[int, list[int]] = {}
    for i, p in enumerate(plan.pieces):
        of_body.setdefault(p.body, []).append(i)
    own = [sorted(i for body in o.bodies for i in of_body.get(body, ())) for o in objects]
    hulls = iter(range(len(plan.pieces), len(plan.pieces) + len(footprint_hulls(plan))))
    shadows = [[next(hulls)] if o.footprint is not None else mine for o, mine in zip(objects, own, strict=True)]
    lists = {
        "body": [o.bodies for o in objects],
        "piece": own,
        "shadow": shadows,
        "overhead": [_overhead(scene, plan, colliders, o) for o in objects],
    }
    fields = {}
    for name, entries in lists.items():
        flat, adr, num = ranges(entries)
        fields |= {f"{name}_list": np.array(flat, int), f"obj_{name}adr": adr, f"obj_{name}num": num}
    return fields


def _pairs(scene: SceneModel, plan: Plan, rules: PairRules, lanes: int) -> dict[str, np.ndarray]:
    """Pairs of colliders that are kept apart, with their margins: in lists of objects, then in those of the arm."""
    colliders = rules.colliders
    arm_lists, arm_owners, arm_fields = _arm_lists(scene, arm_pairs(scene, plan, colliders))
    number = len(plan.objects)
    lists = [*collider_pairs(scene, plan, colliders), *arm_lists]
    pairs, pairadr, pairnum = ranges(lists)
    start, startadr, startnum = ranges(
        first_nodes(colliders, [(int(first) + i, *nodes) for i, p in enumerate(part) for nodes in p.starts], lanes)
        for part, first in zip(lists, pairadr, strict=True)
    )
    owners = [o.bodies for o in plan.objects] + arm_owners
    own = [[int(colliders.body[c] in owners[i]) for c in (p.a, p.b)] for i, part in enumerate(lists) for p in part]
    way, wayadr, waynum = ranges(() if p.geoms is None else (*p.ways[0], *p.ways[1]) for p in pairs)
    return {
        "pair_bodies": np.reshape(
            [
                (colliders.body[p.a], colliders.body[p.b], a + 2 * b, colliders.plane[p.b])
                for p, (a, b) in zip(pairs, own, strict=True)
            ],
            (-1, 4),
        ).astype(int),
        "obj_pairadr": pairadr[:number],
        "obj_pairnum": pairnum[:number],
        "obj_broadadr": startadr[:number],
        "obj_broadnum": startnum[:number],
        "arm_pairadr": pairadr[number:],
        "arm_pairnum": pairnum[number:],
        "arm_broadadr": startadr[number:],
        "arm_broadnum": startnum[number:],
        **arm_fields,
        "broad_pair": np.reshape(start, (-1, 3)).astype(int),
        "pair_a": np.array([p.a for p in pairs], int),
        "pair_b": np.array([p.b for p in pairs], int),
        "pair_margin": np.array([p.margin for p in pairs], float),
        "pair_touch": np.array([rules.touch(p.a, p.b) if p.geoms is None else p.margin for p in pairs], float),
        "pair_directionadr": wayadr,
        "pair_directionnum": waynum,
        "direction": np.reshape(way, (-1, 3)),
    }


def _arm_lists(
    scene: SceneModel, arm: ArmPairs | None
) -> tuple[list[list[Pair]], list[list[int]], dict[str, np.ndarray]]:
    """The lists of arms in a grasp, the bodies of the robot of each, and for each reach target which list is what."""
    if arm is None:
        return [], [], dict.fromkeys(("arm_self", *_ARM_LISTS), np.zeros(0, int))
    names = list(arm.itself)
    column = np.arange(len(arm.robots))
    fields = {"arm_self": np.array([names.index(name) for name in arm.robots], int)}
    lists, robots = list(arm.itself.values()), list(names)
    for field, part in zip(_ARM_LISTS, (arm.scene, arm.hand, arm.target), strict=True):
        fields[field] = len(lists) + column
        lists += part
        robots += arm.robots
    return lists, [scene.subtree(name) for name in robots], fields


def footprint_hulls(plan: Plan) -> list[Piece]:
    """Footprints that are pieces of their own, numbered after all obstacles."""
    return [o.footprint for o in plan.objects if o.footprint is not None]


def _gap(rules: PairRules, o: PlacedObject) -> float:
    """Height [m] over the support: the scene's, or more where MuJoCo acts from further away."""
    if o.config is None or o.heap is not None:
        return 0.0
    own, under = (
        [c for c, body in enumerate(rules.colliders.body) if body in bodies] for bodies in (o.bodies, [o.ground])
    )
    touch = max((rules.touch(a, b) for a, b in product(own, under) if rules.meet(a, b)), default=0.0)
    return max(o.config.gap, touch + LEAST_GAP if touch > 0.0 else 0.0)


def _overhead(scene: SceneModel, plan: Plan, colliders: Colliders, o: PlacedObject) -> list[int]:
    """Pieces, or colliders of visual geometry, of the parent: any body of an object may be the roof, no plane is."""
    if o.cover == Cover.EITHER:
        return []
    assert o.support is not None
    parent = scene.around(o.support)
    if scene.config.geometry == "visual":
        return [i for i, body in enumerate(colliders.body) if body in parent and colliders.plane[i] < 0]
    return [i for i, p in enumerate(plan.pieces) if p.body in parent and p.type != PieceType.PLANE]


def _measured(plan: Plan, o: PlacedObject) -> Measure:
    """What of an object must be measured for each candidate. Bounds matter only where a relation looks at them."""
    if not any(p.body in o.bodies for p in plan.pieces):
        return Measure.NOTHING
    if o.config is not None and o.config.drawn_orientation.kind == "any":
        return Measure.WHOLE
    if not o.joint_ranges:
        return Measure.NOTHING
    if o.erosion > 0.0 or any(r.has_own_width for r in relations_of(o)):
        return Measure.WHOLE
    seen = [r for other in plan.objects for r in relations_of(other) if o.name in (other.name, *r.anchors)]
    return Measure.WHOLE if any(r.by_bounds for r in seen) else Measure.LOWEST


def _address(mjm: mujoco.MjModel, body: int, kind: ObjectKind) -> int:
    if kind == ObjectKind.FREE:
        return int(mjm.jnt_qposadr[mjm.body_jntadr[body]])
    return int(mjm.body_mocapid[body])


def _box(config: ObjectConfig | None) -> tuple:
    """Corners of the box in space that an object is drawn in; an empty one for all others."""
    region = None if config is None else config.region
    if region is None or region.box is None or not region.is_3d:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return region.box
