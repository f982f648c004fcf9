"""The objects of a plan as fields of `device.Program`, and its reach targets as fields of `device_reach.Reach`."""

import itertools
from collections.abc import Mapping

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.bounds import LEAST_GAP
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.geometry.colliders import Collider
from sceniris_gym.geometry.pieces import Piece, PieceType
from sceniris_gym.geometry.ragged import addressed, columns, ranges
from sceniris_gym.geometry.resting_poses import HomeShape
from sceniris_gym.geometry.rotations import matrix, product, quaternion
from sceniris_gym.grasping.gripper import carried
from sceniris_gym.program.device import Cover, Measure, ObjectKind, OrientationType, fill_struct
from sceniris_gym.program.device_reach import BASE, UNASKED, Reach
from sceniris_gym.program.pack.moves import moves_of
from sceniris_gym.program.pack.pairs import PairRules
from sceniris_gym.program.pack.relations import JoinedSites
from sceniris_gym.program.placed_object import COS_MAX_TILT_32, PlacedObject
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import ReachingArm
from sceniris_gym.reach.arm import chain_up, fixed_base
from sceniris_gym.reach.lookup import MapView
from sceniris_gym.reach.solve import arm_view
from sceniris_gym.scene.couplings import coupling_arrays

_ORIENTATIONS = {"any": OrientationType.ANY, "face_to": OrientationType.FACE_TO}
# A piece that rises above a surface by less than this [m] does not cover it: half of the height of a ray's origin.
_FLUSH = 5.0e-5
# An axis is level or vertical if its vertical part is within this of 0 or 1.
_LEVEL = 1.0e-6


def pack_objects(plan: Plan, rules: PairRules, joints: dict[str, JoinedSites]) -> dict[str, np.ndarray]:
    """Return the fields `obj_*` and the lists that they index, except pairs. `joints` is the result of `joints_of`."""
    objects, slots, shared = plan.objects, plan.slots, plan.scene.config.owners
    boxes = [_box(o.config) for o in objects]
    followers, followed = addressed("obj_follow", (o.followers for o in objects))
    return {
        **columns("obj", objects, stream=1, kind=1, cover=1, erosion=1),
        "obj_body": np.array([o.bodies[0] for o in objects], int),
        "obj_adr": np.array([_address(rules.mjm, o.bodies[0], o.kind) for o in objects], int),
        "obj_slot": np.array([slots.index(o.name) for o in objects], int),
        "obj_column": np.array([plan.columns.index(shared.get(o.name, o.name)) for o in objects], int),
        "obj_measured": np.array([_measured(plan, o) for o in objects], int),
        "obj_ground": np.array([-1 if o.ground is None else o.ground for o in objects], int),
        "obj_upright": np.full(len(objects), COS_MAX_TILT_32),
        "obj_gap": np.array([_gap(rules, o) for o in objects]),
        "obj_box_lower": np.reshape([b[0] for b in boxes], (-1, 3)),
        "obj_box_upper": np.reshape([b[1] for b in boxes], (-1, 3)),
        "obj_footprint": np.array([o.config.ratio_on_support == 1.0 for o in objects], int),
        **_heaps(objects),
        **_joint_ranges(objects),
        **followed,
        **coupling_arrays(followers),
        **_orientations(plan, joints),
        **_bodies_and_pieces(plan, rules.colliders),
        "obj_effort": np.ones(len(objects)),
    }


def _heaps(objects: list[PlacedObject]) -> dict[str, np.ndarray]:
    """Return the field `obj_heap`, and the settled poses of all objects in heaps, object after object."""
    rows, adr, num = ranges([] if o.heap is None else list(np.hstack([o.heap.pos, o.heap.quat])) for o in objects)
    streams = np.array([0 if o.heap is None else o.heap.stream for o in objects], int)
    heaped = np.array([o.heap is not None for o in objects], bool)
    heaps = np.stack([np.where(heaped, adr, -1), num, streams], axis=1)
    return {"obj_heap": heaps, "heap_pose": np.reshape(rows, (-1, 7))}


def _joint_ranges(objects: list[PlacedObject]) -> dict[str, np.ndarray]:
    """Return the fields `obj_draw*`, `draw_*` and `choice`: the ranges or choices of each drawn joint."""
    drawn, draws = addressed("obj_draw", (o.joint_ranges for o in objects))
    choice, choices = addressed("draw_choice", ((*r.norm, r.low, r.high) if r.norm else r.choice for r in drawn))
    return {
        **draws,
        **choices,
        "draw_choicenum": np.array([len(r.choice) for r in drawn], int),
        "draw_qposadr": np.array([r.qposadr for r in drawn], int),
        # low > high marks a draw by choice, or by a norm
        "draw_range": np.reshape([(1.0, -1.0) if r.choice or r.norm else (r.low, r.high) for r in drawn], (-1, 2)),
        "choice": np.array(choice, float),
    }


def _orientations(plan: Plan, joints: dict[str, JoinedSites]) -> dict[str, np.ndarray]:
    """Return the fields for drawing orientations, and the stable poses of each object. Static objects have no poses."""
    drawn = [o.config.drawn_orientation for o in plan.objects]
    yaws = [
        (joints[o.name].yaw[0],) * 2 if o.name in joints else d.yaw for o, d in zip(plan.objects, drawn, strict=True)
    ]
    poses, fields = addressed("obj_stable", (o.stable_poses for o in plan.objects))
    turned = [d.target if d.kind == "with" else None for d in drawn]
    turned = [joints[o.name].to if o.name in joints else to for o, to in zip(plan.objects, turned, strict=True)]
    shares = [s for o in plan.objects for s in np.cumsum([v.probability for v in o.stable_poses])]
    return {
        "obj_orientation": np.array([_ORIENTATIONS.get(d.kind, OrientationType.YAW) for d in drawn], int),
        "obj_target": np.array([plan.columns.index(d.target) if d.target else 0 for d in drawn], int),
        "obj_yaw": np.reshape(yaws, (-1, 2)),
        "obj_with": np.array([-1 if to is None else plan.columns.index(to) for to in turned], int),
        **fields,
        **columns("stable", poses, quat=4, pivot=3, bounds=4),
        "stable_cdf": np.array(shares, float),
    }


def _bodies_and_pieces(plan: Plan, colliders: list[Collider]) -> dict[str, np.ndarray]:
    """Return four lists for each object: its bodies, its pieces, its footprint, and the obstacles that may cover it."""
    objects = plan.objects
    of_body: dict[int, list[int]] = {}
    for i, p in enumerate(plan.pieces):
        of_body.setdefault(p.body, []).append(i)
    low, own = [], []
    for o in objects:
        pieces = sorted(i for body in o.bodies for i in of_body.get(body, ()))
        first = _can_be_lowest(plan, o, pieces)
        low.append(len(first))
        own.append([*first, *(i for i in pieces if i not in first)])
    hulls = iter(range(len(plan.pieces), len(plan.pieces) + len(footprint_hulls(objects))))
    shadows = [[next(hulls)] if o.footprint is not None else mine for o, mine in zip(objects, own, strict=True)]
    lists = {
        "body": [o.bodies for o in objects],
        "piece": own,
        "shadow": shadows,
        "overhead": [_overhead(plan, colliders, o) for o in objects],
    }
    fields = {"obj_lownum": np.array(low, int)}
    for name, entries in lists.items():
        flat, of_objects = addressed(f"obj_{name}", entries)
        fields |= {f"{name}_list": np.array(flat, int), **of_objects}
    return fields


def _can_be_lowest(plan: Plan, o: PlacedObject, pieces: list[int]) -> list[int]:
    """Return the pieces that can have an object's lowest point, if only that is measured. Otherwise, return all pieces.

    Level drawers and doors do not change their heights, so pieces on them that are not lowest at home never are.
    """
    if o.heap is not None or not o.stable_poses or _measured(plan, o) != Measure.LOWEST:
        return pieces
    mjm, home, root = plan.scene.mjm, plan.scene.home, o.bodies[0]
    upright = [matrix(v.quat) @ home.xmat[root].reshape(3, 3).T for v in o.stable_poses]

    def keeps_height(i: int) -> bool:
        chain = np.isin(mjm.jnt_bodyid, chain_up(mjm, plan.pieces[i].body, root))
        joints = np.flatnonzero(chain & (mjm.jnt_type != mujoco.mjtJoint.mjJNT_FREE))
        rises = np.abs([(mat @ home.xaxis[joints].T)[2] for mat in upright])
        return bool((np.abs(rises - (mjm.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE)) < _LEVEL).all())

    heights = {i: [HomeShape(home, root, [plan.pieces[i]]).bottom(v.quat) for v in o.stable_poses] for i in pieces}
    still = [i for i in pieces if keeps_height(i)]
    lowest = np.min([heights[i] for i in still], axis=0, initial=np.inf) + _FLUSH
    return [i for i in pieces if i not in still or np.any(heights[i] <= lowest)]


def footprint_hulls(objects: list[PlacedObject]) -> list[Piece]:
    """Return the hulls that serve as footprints. The fields `piece_*` have these hulls after all obstacles."""
    return [o.footprint for o in objects if o.footprint is not None]


def _gap(rules: PairRules, o: PlacedObject) -> float:
    """Return the height [m] at which an object is placed over its support: `gap`, or more if contacts begin higher."""
    if o.heap is not None:
        return 0.0
    pairs = itertools.product(rules.of(o.bodies), rules.of([o.ground]))
    touch = max((rules.touch(a, b) for a, b in pairs if rules.meet(a, b)), default=0.0)
    return max(o.config.gap, touch + LEAST_GAP if touch > 0.0 else 0.0)


def _overhead(plan: Plan, colliders: list[Collider], o: PlacedObject) -> list[int]:
    """Return the pieces that may cover an object on its support. With visual geometry, return colliders instead.

    Planes never cover an object. A piece of the supporting body is left out if it does not rise above any of the
    object's surfaces.
    """
    if o.cover == Cover.EITHER:
        return []
    assert o.support is not None
    parent = plan.scene.around(o.support)
    if plan.scene.config.geometry == "visual":
        return [i for i, c in enumerate(colliders) if c.body in parent and c.plane < 0]
    found = [i for i, p in enumerate(plan.pieces) if p.body in parent and p.type != PieceType.PLANE]
    if any(o.name in plan.scene.config.markers(kind) for kind in plan.scene.config.start):
        return found  # a marker may be on a lower surface
    lowest = min(s.height for surfaces in o.surfaces for s in surfaces) + _FLUSH
    return [i for i in found if plan.pieces[i].body != o.ground or plan.pieces[i].bounds[1][2] > lowest]


def _measured(plan: Plan, o: PlacedObject) -> Measure:
    """Return the quantities of an object that have to be computed for each candidate."""
    if not any(p.body in o.bodies for p in plan.pieces):
        return Measure.NOTHING
    if o.orientation == "any":
        return Measure.WHOLE
    if not o.joint_ranges:
        return Measure.NOTHING
    if o.erosion > 0.0 or any(r.has_own_width for r in o.config.relations):
        return Measure.WHOLE
    names = {o.name, plan.scene.config.owners.get(o.name)}
    seen = [
        r.by_bounds and not names.intersection(plan.joined_bounds(other.name, r))
        for other in plan.objects
        for r in other.config.relations
        if names.intersection((other.name, *r.anchors))
    ]
    return Measure.WHOLE if any(seen) else Measure.LOWEST


def _address(mjm: mujoco.MjModel, body: int, kind: ObjectKind) -> int:
    """Return the address of a free object's pose in qpos. For other objects, return the mocap id of the body."""
    return int(mjm.jnt_qposadr[mjm.body_jntadr[body]] if kind == ObjectKind.FREE else mjm.body_mocapid[body])


def _box(config: ObjectConfig) -> tuple:
    """Return the lower and the upper corner of an object's 3D box. Both are zeros if its region is not a 3D box."""
    region = config.region
    if region is None or region.box is None or not region.is_3d:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return region.box


def fill_views(plan: Plan, arm_lists: Mapping[str, np.ndarray], device: str) -> None:
    """Fill `view`, the struct for device code, of each arm that has reach targets.

    Args:
        plan: The plan of the scene.
        arm_lists: The fields `pack.program.ARM_LISTS`, which all arms share.
        device: Warp's name of the device.
    """
    arms, names = plan.reaching.arms, [o.name for o in plan.objects]
    late = {target.arm for target in plan.reaching.targets if target.late}
    bases = [names.index(one.robot) if i in late else UNASKED for i, one in enumerate(arms)]
    shared = _target_arrays(plan, bases)
    for i, one in enumerate(arms):
        set_map_and_arm(one, device)
        one.view.number, one.view.last, one.view.base_obj = i, len(arms) - 1, bases[i]
        own = _arm_fields(plan, plan.scene.home, one)
        fill_struct(Reach, one.view, {**arm_lists, **shared, **own}, device)


def set_map_and_arm(one: ReachingArm, device: str) -> None:
    """Set the map and the joints in `one.view`, the struct of an arm for device code."""
    one.view.map = MapView() if one.map is None else one.map.view(device)  # pyrefly: ignore[missing-argument]
    one.view.arm = arm_view(one.arm, device)


def _arm_fields(plan: Plan, home: mujoco.MjData, one: ReachingArm) -> dict[str, np.ndarray]:
    """Set the scalar fields of `one.view`, and return the values of its arrays that differ between arms."""
    scene, view, gripper, present = plan.scene, one.view, one.gripper, one.robot not in plan.scene.apart
    hand = sorted(carried(scene.mjm, one.arm)) if present else []
    view.base_body = fixed_base(scene.mjm, scene.bodies[one.robot]) if one.arm.base_body else 0
    view.mapped = one.map is not None
    view.gap_closed, view.gap_open = gripper.closed, gripper.opening
    if present:
        site, body = one.arm.tcp_site, hand[0]
        back = home.site_xmat[site].reshape(3, 3).T
        view.hand_pos = wp.vec3(*(back @ (home.xpos[body] - home.site_xpos[site])))
        view.hand_quat = wp.vec4(*product(quaternion(back), home.xquat[body]))
    moves = moves_of(plan, one) if present else np.zeros((scene.mjm.nbody, len(one.arm.joints)))
    return {
        "arm_qposadr": one.arm.qposadr if present else np.zeros(0, int),
        "arm_body": np.array(scene.moving(one.robot), int),
        "hand_body": np.array(hand, int),
        "arm_moves": moves,
        "arm_link": ((moves > 0.0) * np.arange(1, moves.shape[1] + 1)).max(axis=1),
        "grip_qposadr": gripper.qposadr,
        "grip_closed": gripper.closed_qpos,
        "grip_open": gripper.open_qpos,
        **coupling_arrays(gripper.couplings),
    }


def _target_arrays(plan: Plan, bases: list[int]) -> dict[str, np.ndarray]:
    """Return the arrays that all arms share: reach targets and grasps. `bases` is each arm's `Reach.base_obj`."""
    targets, rows = plan.reaching.targets, len(plan.reaching.targets)
    grasps, fields = addressed("reach_grasp", (t.grasp_set.grasps for t in targets))
    numbers = np.full(len(plan.objects), UNASKED)
    numbers[[t.number for t in targets]] = np.arange(rows)
    numbers[[base for base in bases if base != UNASKED]] = BASE
    spans = [np.zeros((len(o.stable_poses), 2), int) for o in plan.objects]
    for target, first in zip(targets, fields["reach_graspadr"], strict=True):
        spans[target.number] = np.array(target.grasp_set.spans) + [int(first), 0]
    all_spans = np.concatenate([np.zeros((0, 2), int), *spans])  # address and number of the grasps of each
    return {
        "obj_reach": numbers,
        "stable_graspadr": all_spans[:, 0],
        "stable_graspnum": all_spans[:, 1],
        "reach_obj": np.array([t.number for t in targets], int),
        "reach_slot": np.array([plan.slots.index(t.name) for t in targets], int),
        **columns("reach", targets, arm=1, late=1, early=1, tier=1, margin=1),
        "reach_least": np.array([t.tier.least_verdict for t in targets], int),
        "reach_below": np.array([plan.objects[t.number].ground is not None for t in targets], int),
        **fields,
        "early_grasp": np.flatnonzero([t.early for t in targets for _ in t.grasp_set.grasps]),
        "grasp_reach": np.repeat(np.arange(rows), fields["reach_graspnum"]),
        **columns("grasp", grasps, body=1, pos=3, quat=4, opening=1),
    }
