"""Conversion of a plan into the flat arrays of `device.Program`, and into the structs `Starts` and `Statics`."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import shapely

from sceniris_gym.config.bounds import MAX_FOOT, MOST_WIDE
from sceniris_gym.config.groups import SPLITS
from sceniris_gym.config.member_names import object_of
from sceniris_gym.config.presence import Draw, Presence
from sceniris_gym.geometry.colliders import NO_INNER_BOX, Collider, inner_box
from sceniris_gym.geometry.feet import around
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.ragged import addressed, columns
from sceniris_gym.geometry.resting_poses import weights
from sceniris_gym.geometry.supports import SupportSurface, triangulate
from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_conditions import Conditions
from sceniris_gym.program.device_reach import Starts
from sceniris_gym.program.device_statics import DIRECTIONS, Statics
from sceniris_gym.program.pack.objects import footprint_hulls, pack_objects
from sceniris_gym.program.pack.pairs import PairRules, arm_pairs, collider_pairs
from sceniris_gym.program.pack.relations import joints_of, pack_regions, pack_relations, surfaces_of_regions
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.standing import CURVED, Foot, Roll, carriers_of, chain_below
from sceniris_gym.program.starts import plan_grips, plan_starts
from sceniris_gym.scene.parking import PARKING_SPACING

_ARM_LISTS = ("arm_scene", "arm_hand", "arm_target", "arm_held")
ARM_LISTS = ("arm_pairadr", "arm_pairnum", "arm_broadadr", "arm_broadnum", "arm_self", *_ARM_LISTS, "hand_before")
"""Names of the packed lists for arms in a grasp. They are fields of `Reach`."""


def pack_pairs(plan: Plan, rules: PairRules, lanes: int) -> dict[str, np.ndarray]:
    """Return the pairs of colliders to keep apart, and their margins, as lists for objects and lists for arms.

    The lists for objects are fields of `Program`. The lists for arms that grasp a target are `ARM_LISTS` of `Reach`.

    Args:
        plan: The plan.
        rules: The rules for its colliders.
        lanes: Number of lanes that share the collision test of a world.
    """
    colliders, number = rules.colliders, len(plan.objects)
    arm = arm_pairs(plan, rules)
    names, column = list(arm.itself), np.arange(len(arm.robots))
    lists = [*collider_pairs(plan, rules), *arm.itself.values(), *arm.scene, *arm.hand, *arm.target, *arm.held]
    pairs, of_lists = addressed("pair", lists)
    entries = (
        [(int(first) + i, *nodes) for i, p in enumerate(part) for nodes in p.starts]
        for part, first in zip(lists, of_lists["pairadr"], strict=True)
    )
    firsts = [sorted(rules.trees.first_nodes(part, lanes)) for part in entries]
    starts, of_starts = addressed("broad", firsts)
    hands = zip(arm.owners, firsts[len(firsts) - 3 * len(column) :], strict=False)
    before = [np.searchsorted([own[e[0] - part[0][0]] for e in part], np.arange(number + 1)) for own, part in hands]
    owners = [o.bodies for o in plan.objects] + [plan.scene.subtree(name) for name in (*names, *arm.robots * 3)]
    held = zip(arm.robots, plan.reaching.names, strict=True)
    owners += [plan.scene.subtree(robot) + plan.scene.subtree(name) for robot, name in held]
    body = [c.body for c in colliders]
    bodies = [
        (body[p.a], body[p.b], (body[p.a] in own) + 2 * (body[p.b] in own), colliders[p.b].plane)
        for own, part in zip(owners, lists, strict=True)
        for p in part
    ]
    touching = (() if p.geoms is None else np.concatenate(p.directions) for p in pairs)
    directions, of_pairs = addressed("pair_direction", touching)
    return {
        "pair_bodies": np.reshape(bodies, (-1, 4)).astype(int),
        **{f"obj_{name}": values[:number] for name, values in (of_lists | of_starts).items()},
        **{f"arm_{name}": values[number:] for name, values in (of_lists | of_starts).items()},
        "arm_self": np.array([names.index(name) for name in arm.robots], int),
        **{name: len(names) + i * len(column) + column for i, name in enumerate(_ARM_LISTS)},
        "hand_before": np.ravel(before).astype(int),
        "broad_pair": np.reshape(starts, (-1, 3)).astype(int),
        **columns("pair", pairs, a=1, b=1, margin=1),
        "pair_touch": np.array([rules.touch(p.a, p.b) if p.geoms is None else p.margin for p in pairs], float),
        **of_pairs,
        "direction": np.reshape(directions, (-1, 3)),
    }


# Tolerance of a bound for rounding, both relative and absolute.
_ROUNDING = 1.0e-3
# MuJoCo treats the end of a cylinder as a polygon of 16 corners in its contacts with a face.
_ROUND = np.cos(np.pi / 16)
_ENDLESS = np.zeros((0, 4))
"""The edges of a surface that keeps every foot whole."""
_NO_FOOT = Foot([np.zeros((1, 2))], CURVED, margin=0.0, most=0.0)
"""The foot of an object that does not have to stand."""


def pack_program(plan: Plan, colliders: list[Collider], lanes: int) -> dict[str, np.ndarray]:
    """Return the lists `ARM_LISTS` of `Reach`, and all array fields of `device.Program` except the fields of colliders.

    Args:
        plan: The plan.
        colliders: Its colliders.
        lanes: Number of GPU lanes that share the work of a world.
    """
    scene, rules, joints = plan.scene, PairRules(plan.scene, colliders), joints_of(plan)
    return (
        pack_objects(plan, rules, joints)
        | pack_pairs(plan, rules, lanes)
        | pack_relations(plan, joints)
        | pack_groups(scene.config.presence.draws.values(), plan.slots, areas_of_supports(plan.objects))
        | pack_regions(plan.objects)
        | pack_pieces([*plan.pieces, *footprint_hulls(plan.objects)], scene.config.geometry == "visual")
        | pack_bodies(scene.mjm, scene.home_qpos)
        | layout_bounds(plan)
        | {"start_weight": np.array([kind.weight for kind in scene.config.start], float)}
        | {"home_qpos": scene.home_qpos, "home_pivot_pose": plan.pivot_pose, "home_bounds": plan.bounds}
    )


def pack_starts(plan: Plan, bounds: np.ndarray, device: str) -> Starts | None:
    """Return the kinds of starts of a scene on a device, or None if the scene has no `start`.

    Args:
        plan: The plan.
        bounds: Greatest absolute value of each qpos in a layout, shape (nq,). Values that a start exceeds are raised in
            place.
        device: Warp's name of the device.

    Raises:
        ScenirisError: A kind of start does not fit the scene. `plan_grips` and `plan_starts` raise the errors.
    """
    if not plan.scene.config.start:
        return None
    fields = plan_starts(plan, plan_grips(plan))
    draws = fields["draw_range"]
    adr = [r.qposadr for o in plan.objects for r in o.joint_ranges]
    is_drawn = draws[..., :1] <= draws[..., 1:]
    bounds[adr] = np.maximum(bounds[adr], np.where(is_drawn, np.abs(draws), 0.0).max(axis=(0, 2), initial=0.0))
    for one in plan.reaching.arms:
        limits, adr = np.abs([one.arm.lower, one.arm.upper]), one.arm.qposadr
        most = np.where(np.isfinite(limits), limits, bounds[adr] + 2.0 * np.pi).max(axis=0)  # on a path of such joints
        bounds[adr] = np.maximum(bounds[adr], most)
        adr, qpos = one.gripper.poses(np.linspace(0.0, 1.0, 17))
        bounds[adr] = np.maximum(bounds[adr], np.abs(qpos).max(axis=0, initial=0.0))
    return fill_struct(Starts, Starts(), fields, device)  # pyrefly: ignore[missing-argument]


def pack_groups(draws: Collection[Draw], slots: Sequence[str], areas: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the fields `group` and `group_*`: the slots of each group's members, and how many members are present.

    A member that is a group has the slot of its first object. `areas` are the results of `areas_of_supports`.
    """
    number, groups = {name: i for i, name in enumerate(slots)}, [draw.group for draw in draws]
    members, found = addressed("slot", ([number[m.objects[0]] for m in draw.members] for draw in draws))
    counts = np.reshape([g.count for g in groups], (-1, 2)).T
    return {
        "group": np.column_stack([found["slotadr"], found["slotnum"], *counts]).astype(int),
        "group_slot": np.array(members, int),
        "group_uniform": np.array([g.is_uniform for g in groups], bool),
        "group_weight": np.reshape([w for g in groups for w in zip(*map(g.weights_in, SPLITS), strict=True)], (-1, 2))
        * np.reshape([areas.get(m.key, 1.0) if d.group.by_area else 1.0 for d in draws for m in d.members], (-1, 1)),
    }


def areas_of_supports(objects: Sequence[PlacedObject]) -> dict[str, float]:
    """Return for each member of an object the area [m2], or the number of points, in which its pivot may be.

    All members on one support have the same value, the greatest over variants and stable poses: the smallest footprint
    leaves most of a support.
    """
    found: dict[tuple[str, Any], float] = {}
    for o in objects:
        of_poses = (sum(s.region.area or len(shapely.get_parts(s.region)) for s in some) for some in o.surfaces)
        key = object_of(o.name), o.config.support
        found[key] = max(found.get(key, 0.0), *of_poses, 0.0)
    return {o.name: found[object_of(o.name), o.config.support] for o in objects}


def pack_conditions(presence: Presence, slots: Sequence[str], device: str) -> Conditions | None:
    """Return the conditions of a scene on a device, or None if no draw depends on another one."""
    if not presence.has_conditions:
        return None
    number = {name: i for i, name in enumerate(slots)}
    members = [member for draw in presence.draws.values() for member in draw.members]
    leaf, of_leaves = addressed("member_leaf", ([number[name] for name in m.objects] for m in members))
    terms, of_terms = addressed("member_term", (m.terms for m in members))
    slot, of_slots = addressed("term_slot", ([number[name] for name in term.of] for term in terms))
    arrays = {
        **{**of_leaves, **of_terms, **of_slots},
        "order": np.array(presence.order, int),
        "leaf": np.array(leaf, int),
        "term_holds": np.array([term.holds for term in terms], int),
        "term_slot": np.array(slot, int),
    }
    return fill_struct(Conditions, Conditions(), arrays, device)  # pyrefly: ignore[missing-argument]


def pack_pieces(pieces: list[Piece], visual: bool) -> dict[str, np.ndarray]:
    """Return the fields `piece_*`, `inner_*` and `vert`. With visual geometry, all inner boxes are empty."""
    vert, fields = addressed("piece_vert", (p.vertices for p in pieces))
    boxes = [NO_INNER_BOX if visual else inner_box(p) for p in pieces]
    return {
        **columns("piece", pieces, type=1, body=1, pos=3, quat=4, size=3, radius=1),
        **fields,
        "inner_center": np.reshape([center for center, _ in boxes], (-1, 3)),
        "inner_half": np.reshape([half for _, half in boxes], (-1, 3)),
        "vert": np.reshape(vert, (-1, 3)),
    }


def pack_bodies(mjm: mujoco.MjModel, home_qpos: np.ndarray) -> dict[str, np.ndarray]:
    """Return the fields `body_*` and `jnt_*` for forward kinematics on the device, with only hinges and slides.

    Free and ball joints are never drawn, so they are replaced. The pose of a free body in the start pose becomes its
    fixed pose. A ball joint becomes a hinge whose rotation is the joint's rotation in the start pose.
    """
    pos, quat, num = mjm.body_pos.copy(), mjm.body_quat.copy(), mjm.body_jntnum.copy()
    axis, qpos0 = mjm.jnt_axis.copy(), mjm.qpos0[mjm.jnt_qposadr].copy()
    for joint, (kind, adr) in enumerate(zip(mjm.jnt_type, mjm.jnt_qposadr, strict=True)):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            body = mjm.jnt_bodyid[joint]
            pos[body], quat[body], num[body] = home_qpos[adr : adr + 3], home_qpos[adr + 3 : adr + 7], 0
            quat[body] /= np.linalg.norm(quat[body])
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            rotation = np.zeros(3)
            mujoco.mju_quat2Vel(rotation, home_qpos[adr : adr + 4], 1.0)
            angle = np.linalg.norm(rotation)
            axis[joint] = rotation / angle if angle > 0.0 else axis[joint]
            qpos0[joint] = home_qpos[adr] - angle
    return {
        "body_parent": mjm.body_parentid,
        "body_pos": pos,
        "body_quat": quat,
        "body_jntnum": num,
        "jnt_slide": mjm.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE,
        "jnt_axis": axis,
        **{name: getattr(mjm, name) for name in ("body_jntadr", "jnt_pos", "jnt_qposadr")},
        "jnt_qpos0": qpos0,
    }


def layout_bounds(plan: Plan) -> dict[str, np.ndarray]:
    """Return the fields `bound_*` (greatest absolute values) and `quat_qposadr` (addresses of quaternions in qpos).

    A drawn joint stays within its range, its followers move with it, and other joints keep the start pose. Placed and
    parked objects stay within `MOST_WIDE` of the origin, plus one parking space for each object or robot.
    """
    mjm = plan.scene.mjm
    far = MOST_WIDE + PARKING_SPACING * len(plan.slots)
    bound = np.abs(plan.scene.home_qpos)
    is_free, is_ball = (mjm.jnt_type == kind for kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL))
    places = mjm.jnt_qposadr[is_free][:, None] + np.arange(3)
    bound[places] = np.maximum(bound[places], far)
    quats = (mjm.jnt_qposadr + 3 * is_free)[is_free | is_ball]
    bound[quats[:, None] + np.arange(4)] = 1.0
    for o in plan.objects:
        for adr, ends in o.spans.items():
            bound[adr] = max(map(abs, ends))
    mocap = np.full(mjm.nmocap, 3.0 * far)
    bodies = np.flatnonzero(mjm.body_mocapid >= 0)
    mocap[mjm.body_mocapid[bodies]] += np.abs(mjm.body_pos[bodies]).sum(axis=1)
    bound = (1.0 + _ROUNDING) * bound + _ROUNDING
    return {"bound_qpos": bound, "bound_mocap": mocap, "quat_qposadr": quats}


def pack_statics(plan: Plan, device: str) -> Statics | None:
    """Return the feet, contacts and loads of a plan's objects on a device, or None if no object can fall."""
    found, objects, mjm = plan.stances, plan.objects, plan.scene.mjm
    chains = [[] if stance.is_certain else stance.levels for stance in found]
    if not any(chains):
        return None
    carriers = carriers_of(objects)
    level, of_objects = addressed("obj_level", chains)
    load, of_levels = addressed("level_load", (part for i, c in enumerate(chains) for part in _loads(c, carriers, i)))
    feet = [f for o, s in zip(objects, found, strict=True) for f in s.feet or [_NO_FOOT] * len(o.stable_poses)]
    foot, of_stables = addressed("stable_foot", (f.parts for f in feet))
    corner, of_feet = addressed("foot_corner", foot)
    whole = {id(x) for o, s in zip(objects, found, strict=True) if s.is_whole for mine in o.surfaces for x in mine}
    surfaces = surfaces_of_regions(objects)
    outlines = ([_ENDLESS] if id(x) in whole else _convex_parts(x) for x in surfaces)
    parts, of_surfaces = addressed("surface_part", outlines)
    side, of_parts = addressed("part_side", parts)
    leans = any(s.tilt for s in found)
    radius = [
        np.linalg.norm(np.concatenate(f.parts), axis=1).max() if f.margin > 0.0 and not leans else 1e30 for f in feet
    ]
    drawn = any(draw.word.field == "body_mass" for draw in plan.scene.draws)
    sink = np.array([s.sinks.get(None, 0.0) for s in found])
    give = sink / np.maximum([s.load for s in found], mujoco.mjMINVAL)
    arrays = {
        **{**of_objects, **of_levels, **of_stables, **of_feet, **of_surfaces, **of_parts},
        "direction": around(DIRECTIONS),
        "level_sink": np.array([found[i].sinks.get(n, 0.0) for n, c in enumerate(chains) for i in c]) * (not drawn),
        "obj_give": give * drawn,
        **columns("obj", found, tilt=1, touch=1),
        "stable_law": np.reshape([f.law for f in feet], (-1, len(CURVED))),
        **{f"stable_{name}": np.array([getattr(f.roll, name) for f in feet]) for name in Roll._fields},
        "stable_radius": np.array(radius, float),
        "corner": np.reshape(corner, (-1, 2)),
        "level_obj": np.array(level, int),
        "load": np.array(load, int),
        "side": np.reshape(side, (-1, 4)),
        "body_weight": weights(mjm)[None],
        "body_center": mjm.body_ipos[None],
    }
    return fill_struct(Statics, Statics(), arrays, device)  # pyrefly: ignore[missing-argument]


def _loads(chain: list[int], carriers: list[int | None], number: int) -> list[list[int]]:
    """Return the loads of each object in the stack from object `number` down, as numbers of objects.

    `chain` is the stack: the object `number`, its carrier, the carrier's carrier and so on. The loads of an object in
    the stack stand on it, directly or on other loads. They are not in the stack, and are placed before the object
    `number`.
    """
    loads: dict[int, list[int]] = {i: [] for i in chain}
    for other in range(number):
        at = next((level for level in chain_below(other, carriers) if level in loads), other)
        if at != other:
            loads[at].append(other)
    return list(loads.values())


def _convex_parts(surface: SupportSurface) -> list[np.ndarray]:
    """Split a surface into convex polygons (n, 4). A row (x, y, x, y) [m] is an edge. Edges run counter-clockwise."""
    hull = surface.outline.convex_hull
    if hull.area - surface.outline.area > 1e-9:
        corners = list(triangulate(surface.outline))
    else:
        ring = shapely.get_coordinates(hull)[:-1]
        if len(ring) > MAX_FOOT:
            ring = ring[np.unique((ring @ around(MAX_FOOT).T).argmax(axis=0))]
            middle = shapely.get_coordinates(hull.centroid)
            ring = middle + _ROUND * (ring - middle)
        corners = [ring]
    rings = [np.asarray(shapely.geometry.polygon.orient(shapely.Polygon(c)).exterior.coords)[:, :2] for c in corners]
    return [np.hstack([ring[:-1], ring[1:]]) for ring in rings]
