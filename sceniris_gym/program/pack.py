"""The placement program as the flat arrays of `device.Program`."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from sceniris_gym.config.limits import MAX_CORNERS, MAX_PIECES
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.relations import Relation
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry import supports
from sceniris_gym.geometry.colliders import Colliders
from sceniris_gym.geometry.pieces import Piece, PieceType
from sceniris_gym.geometry.ragged import ranges
from sceniris_gym.program.device import (
    FRAME_SUPPORT,
    FRAME_WORLD,
    Measure,
    ObjectKind,
    OrientationType,
    RelationType,
    Roof,
)
from sceniris_gym.program.pairs import arm_pairs, collider_pairs, first_nodes
from sceniris_gym.program.parking_check import check_parking
from sceniris_gym.program.plan import PlacedObject, Plan, roof_rule
from sceniris_gym.scene.model import SceneModel

_ORIENTATIONS = {
    "yaw": OrientationType.YAW,
    "stable": OrientationType.YAW,
    "any": OrientationType.ANY,
    "face_to": OrientationType.FACE_TO,
}
_TYPES = {
    "direction": RelationType.SECTOR,
    "near": RelationType.SECTOR,
    "between": RelationType.BETWEEN,
    "beside": RelationType.BESIDE,
}
_FRAMES = {"support": FRAME_SUPPORT, "world": FRAME_WORLD}
_NO_LIMIT = 1.0e30
# A ring is cut into slices of at most 30 degrees, of as many as this: chord and tangent of a slice hold about
# radius * angle^2 / 4 more than its width, which is kept below that width.
_SLICE = math.pi / 6.0
_MOST_SLICES = 256


def pack_program(scene: SceneModel, plan: Plan, colliders: Colliders, lanes: int) -> dict[str, np.ndarray]:
    """All fields of `device.Program` but those of colliders and of the bank, for `lanes` that share a world's work.

    Raises:
        SceneKeyError: an object with more relations than fit into the polygons of the device.
    """
    return (
        _objects(scene, plan, colliders, lanes)
        | _relations(scene, plan)
        | _groups(scene, plan)
        | _regions(plan, scene.config.where)
        | _pieces([*plan.pieces, *_hulls(plan)])
        | _bodies(scene)
        | {"home_qpos": scene.home_qpos, "home_place": plan.place, "home_bounds": plan.bounds}
    )


def _objects(scene: SceneModel, plan: Plan, c: Colliders, lanes: int) -> dict[str, np.ndarray]:
    objects = plan.objects
    draws, drawadr, drawnum = ranges(o.draws for o in objects)
    choice, choiceadr, choicenum = ranges(d.choice for d in draws)
    bodies, bodyadr, bodynum = ranges(o.bodies for o in objects)
    own = [[i for i, p in enumerate(plan.pieces) if p.body in o.bodies] for o in objects]
    numbers = iter(range(len(plan.pieces), len(plan.pieces) + len(_hulls(plan))))
    shadows, shadowadr, shadownum = ranges(
        [next(numbers)] if o.footprint is not None else mine for o, mine in zip(objects, own, strict=True)
    )
    own_pieces, pieceadr, piecenum = ranges(own)
    roof_list, roofadr, roofnum = ranges(_roofs(scene, plan, c, o.config) for o in objects)
    meetings = [*collider_pairs(scene, plan, c), *arm_pairs(scene, plan, c)]
    pairs, pairadr, pairnum = ranges(meetings)
    start, startadr, startnum = ranges(
        first_nodes(c, part, int(first), lanes) for part, first in zip(meetings, pairadr, strict=True)
    )
    variants, variantadr, variantnum = ranges(o.variants for o in objects)
    boxes = [_box(o.config) for o in objects]
    turns = [o.config.drawn_orientation if o.config is not None else None for o in objects]
    return {
        "draw_qposadr": np.array([d.qposadr for d in draws], int),
        "draw_range": np.reshape([(d.low, d.high) for d in draws], (-1, 2)),
        "draw_choiceadr": choiceadr,
        "draw_choicenum": choicenum,
        "choice": np.array(choice, float),
        "obj_stream": np.array([o.stream for o in objects], int),
        "obj_kind": np.array([o.kind for o in objects], int),
        "obj_body": np.array([o.bodies[0] for o in objects], int),
        "obj_adr": np.array([_address(scene.mjm, o.bodies[0], o.kind) for o in objects], int),
        "obj_slot": np.array([plan.slots.index(o.name) for o in objects], int),
        "obj_orientation": np.array(
            [_ORIENTATIONS[t.kind] if t is not None else OrientationType.YAW for t in turns], int
        ),
        "obj_target": np.array([plan.slots.index(t.target) if t is not None and t.target else 0 for t in turns], int),
        "obj_yaw": np.reshape([t.yaw if t is not None else (0.0, 0.0) for t in turns], (-1, 2)),
        "obj_variantadr": variantadr,
        "obj_variantnum": variantnum,
        "obj_measured": np.array([_measured(plan, o) for o in objects], int),
        "obj_ground": np.array([-1 if o.ground is None else o.ground for o in objects], int),
        "obj_gap": np.array([o.config.gap if o.config else 0.0 for o in objects]),
        "obj_box_lower": np.reshape([b[0] for b in boxes], (-1, 3)),
        "obj_box_upper": np.reshape([b[1] for b in boxes], (-1, 3)),
        "obj_roof": np.array([roof_rule(o.config) for o in objects], int),
        "obj_footprint": np.array([bool(o.config and o.config.ratio_on_support == 1.0) for o in objects], int),
        "obj_drawadr": drawadr,
        "obj_drawnum": drawnum,
        "obj_bodyadr": bodyadr,
        "obj_bodynum": bodynum,
        "obj_pieceadr": pieceadr,
        "obj_piecenum": piecenum,
        "obj_shadowadr": shadowadr,
        "obj_shadownum": shadownum,
        "obj_roofadr": roofadr,
        "obj_roofnum": roofnum,
        "obj_pairadr": pairadr,
        "obj_pairnum": pairnum,
        "obj_startadr": startadr,
        "obj_startnum": startnum,
        "body_list": np.array(bodies, int),
        "piece_list": np.array(own_pieces, int),
        "shadow_list": np.array(shadows, int),
        "roof_list": np.array(roof_list, int),
        "variant_quat": np.reshape([v.quat for v in variants], (-1, 4)),
        "variant_pivot": np.reshape([v.pivot for v in variants], (-1, 3)),
        "variant_bounds": np.reshape([v.bounds for v in variants], (-1, 4)),
        "variant_cdf": np.array([s for o in objects for s in np.cumsum([v.probability for v in o.variants])], float),
        "start": np.reshape(start, (-1, 3)).astype(int),
        "pair_a": np.array([p[0] for p in pairs], int),
        "pair_b": np.array([p[1] for p in pairs], int),
        "pair_margin": np.array([p[2] for p in pairs], float),
    }


def _relations(scene: SceneModel, plan: Plan) -> dict[str, np.ndarray]:
    relations, reladr, relnum = ranges(_relations_of(o) for o in plan.objects)
    anchors, anchoradr, anchornum = ranges([plan.slots.index(a) for a in r.anchors] for r in relations)
    for o in plan.objects:
        _check_size(scene, o)
    return {
        "obj_reladr": reladr,
        "obj_insists": np.array([_insists(o) for o in plan.objects]),
        "obj_relnum": relnum,
        "rel_type": np.array([_TYPES[r.kind] for r in relations], int),
        "rel_anchoradr": anchoradr,
        "rel_anchornum": anchornum,
        "rel_anchor": np.array(anchors, int),
        "rel_frame": np.array([_frame(r, plan.slots) for r in relations], int),
        "rel_heading": np.array([r.heading for r in relations], float),
        "rel_half_angle": np.array([r.half_angle for r in relations], float),
        "rel_low": np.array([r.low for r in relations], float),
        "rel_high": np.array([min(r.high, _NO_LIMIT) for r in relations], float),
        "rel_bounds": np.array([r.bounds for r in relations], int),
        "rel_width": np.array([-1.0 if r.width is None else r.width for r in relations], float),
        "rel_gap": np.array([r.gap for r in relations], float),
        "rel_piecenum": np.array([_pieces_of(r) for r in relations], int),
    }


def _groups(scene: SceneModel, plan: Plan) -> dict[str, np.ndarray]:
    groups = scene.config.groups.values()
    members, adr, num = ranges([plan.slots.index(name) for name in g.of] for g in groups)
    check_parking(scene, plan)
    return {
        "group_adr": adr,
        "group_num": num,
        "group_slot": np.array(members, int),
        "group_low": np.array([g.count[0] for g in groups], int),
        "group_high": np.array([g.count[1] for g in groups], int),
    }


def _regions(plan: Plan, where: str) -> dict[str, np.ndarray]:
    """Triangles of the regions of all variants; those that share one have it once."""
    surfaces: list[supports.SupportSurface] = []
    triangles, owners, cdf = [np.zeros((0, 3, 2))], [], [np.zeros(0)]
    adr, num = [], []
    for o in plan.objects:
        places: dict[int, tuple[int, int]] = {}
        for mine in o.surfaces:
            if id(mine) not in places:
                parts = [supports.triangulate(s.region) for s in mine]
                corners = np.concatenate([*parts, np.zeros((0, 3, 2))])
                share = np.cumsum(supports.areas(corners))
                places[id(mine)] = (len(owners), len(corners))
                owners += [len(surfaces) + i for i, part in enumerate(parts) for _ in part]
                surfaces += mine
                triangles.append(corners)
                cdf.append(share / share[-1] if len(share) else share)
            adr.append(places[id(mine)][0])
            num.append(places[id(mine)][1])
        _check_cuts(o, max((n for _, n in places.values()), default=0), where)
    side, edgeadr, edgenum = ranges(supports.edges(s.outline) for s in surfaces)
    side = np.reshape(side, (-1, 2, 2))
    corners = np.concatenate(triangles)
    return {
        "obj_cutnum": np.array([_cuts(o) for o in plan.objects], int),
        "obj_erosion": np.array([o.erosion for o in plan.objects], float),
        "variant_triadr": np.array(adr, int),
        "variant_trinum": np.array(num, int),
        "tri_surface": np.array(owners, int),
        "tri_a": corners[:, 0],
        "tri_b": corners[:, 1],
        "tri_c": corners[:, 2],
        "tri_cdf": np.concatenate(cdf),
        "surface_height": np.array([s.height for s in surfaces]),
        "surface_edgeadr": edgeadr,
        "surface_edgenum": edgenum,
        "edge_a": side[:, 0],
        "edge_b": side[:, 1],
    }


def _cuts(o: PlacedObject) -> int:
    """How many pieces the relations of an object cut each triangle into; 0 where its region is never another one."""
    if _relations_of(o) or o.tilts or o.erosion > 0.0:
        return math.prod(_pieces_of(r) for r in _relations_of(o))
    return 0


def _check_cuts(o: PlacedObject, triangles: int, where: str) -> None:
    pieces = triangles * _cuts(o)
    if pieces > MAX_PIECES:
        raise SceneKeyError(
            f"{where}: objects.{o.name}.relations: together cut the region into {pieces} pieces, and there is "
            f"room for {MAX_PIECES}. Use fewer rings, or wider ones: a thin one makes up to {_MOST_SLICES} slices."
        )


def _insists(o: PlacedObject) -> bool:
    """Whether another draw of its own turn or joints may open a region that was empty."""
    varies = len(o.variants) > 1 or bool(o.draws) or (o.config is not None and o.config.drawn_orientation.kind == "any")
    by_bounds = any(r.bounds or r.kind == "beside" or (varies and _has_own_width(r)) for r in _relations_of(o))
    return by_bounds or o.erosion > 0.0 or len({id(surfaces) for surfaces in o.surfaces}) > 1


def _has_own_width(relation: Relation) -> bool:
    return relation.kind == "between" and relation.width is None


def _pieces(pieces: list[Piece]) -> dict[str, np.ndarray]:
    vert, adr, num = ranges(p.vertices for p in pieces)
    return {
        "piece_type": np.array([p.type for p in pieces], int),
        "piece_body": np.array([p.body for p in pieces], int),
        "piece_pos": np.reshape([p.pos for p in pieces], (-1, 3)),
        "piece_quat": np.reshape([p.quat for p in pieces], (-1, 4)),
        "piece_size": np.reshape([p.size for p in pieces], (-1, 3)),
        "piece_vertadr": adr,
        "piece_vertnum": num,
        "piece_contype": np.array([p.contype for p in pieces], int),
        "piece_conaffinity": np.array([p.conaffinity for p in pieces], int),
        "vert": np.reshape(vert, (-1, 3)),
    }


def _bodies(scene: SceneModel) -> dict[str, np.ndarray]:
    """Bodies and joints for forward kinematics, which knows hinges and slides only.

    Free and ball joints are never drawn. A root that stays at the start pose of its freejoint gets that as its body's
    pose; a ball joint becomes a hinge that stands at the angle of its start pose.
    """
    mjm = scene.mjm
    pos, quat, num = mjm.body_pos.copy(), mjm.body_quat.copy(), mjm.body_jntnum.copy()
    axis, qpos0 = mjm.jnt_axis.copy(), mjm.qpos0[mjm.jnt_qposadr].copy()
    for joint, (kind, adr) in enumerate(zip(mjm.jnt_type, mjm.jnt_qposadr, strict=True)):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            body = mjm.jnt_bodyid[joint]
            pos[body], quat[body], num[body] = scene.home_qpos[adr : adr + 3], scene.home_qpos[adr + 3 : adr + 7], 0
            quat[body] /= np.linalg.norm(quat[body])
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            rotation = np.zeros(3)
            mujoco.mju_quat2Vel(rotation, scene.home_qpos[adr : adr + 4], 1.0)
            angle = np.linalg.norm(rotation)
            axis[joint] = rotation / angle if angle > 0.0 else axis[joint]
            qpos0[joint] = scene.home_qpos[adr] - angle
    return {
        "body_parent": mjm.body_parentid,
        "body_pos": pos,
        "body_quat": quat,
        "body_jntadr": mjm.body_jntadr,
        "body_jntnum": num,
        "jnt_slide": mjm.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE,
        "jnt_pos": mjm.jnt_pos,
        "jnt_axis": axis,
        "jnt_qposadr": mjm.jnt_qposadr,
        "jnt_qpos0": qpos0,
    }


def _hulls(plan: Plan) -> list[Piece]:
    """Footprints that are pieces of their own, numbered after all obstacles."""
    return [o.footprint for o in plan.objects if o.footprint is not None]


def _roofs(scene: SceneModel, plan: Plan, c: Colliders, config: ObjectConfig | None) -> list[int]:
    """Pieces, or colliders of visual geometry, of the parent object: any of its bodies may be the roof, no plane is."""
    if roof_rule(config) == Roof.EITHER:
        return []
    assert config is not None
    assert config.support is not None
    parent = scene.subtree(config.support.parent.split("/")[0])
    if scene.config.geometry == "visual":
        return [i for i, body in enumerate(c.body) if body in parent and c.plane[i] < 0]
    return [i for i, p in enumerate(plan.pieces) if p.body in parent and p.type != PieceType.PLANE]


def _measured(plan: Plan, o: PlacedObject) -> Measure:
    """What of an object must be measured for each candidate. Bounds matter only where a relation looks at them."""
    if not any(p.body in o.bodies for p in plan.pieces):
        return Measure.NOTHING
    if o.config is not None and o.config.drawn_orientation.kind == "any":
        return Measure.WHOLE
    if not o.draws:
        return Measure.NOTHING
    if o.erosion > 0.0 or any(_has_own_width(r) for r in _relations_of(o)):
        return Measure.WHOLE
    seen = [r for other in plan.objects for r in _relations_of(other) if o.name in (other.name, *r.anchors)]
    return Measure.WHOLE if any(r.bounds or r.kind == "beside" for r in seen) else Measure.LOWEST


def _relations_of(o: PlacedObject) -> tuple[Relation, ...]:
    return o.config.relations if o.config is not None and o.kind != ObjectKind.STATIC else ()


def _pieces_of(relation: Relation) -> int:
    """How many convex pieces a relation is cut into."""
    if relation.kind in ("between", "beside"):
        return 1
    angle = math.pi
    if relation.low > 0.0 or relation.high < math.inf:
        width = relation.high - relation.low
        thin = 2.0 * math.sqrt(width / relation.high) if relation.high < math.inf else _SLICE
        angle = max(min(thin, _SLICE), 2.0 * relation.half_angle / _MOST_SLICES)
    return math.ceil(2.0 * relation.half_angle / angle - 1e-9)


def _check_size(scene: SceneModel, o: PlacedObject) -> None:
    corners = 3 + sum(max(4, len(r.anchors)) for r in _relations_of(o))
    where = f"{scene.config.where}: objects.{o.name}.relations"
    if corners > MAX_CORNERS:
        raise SceneKeyError(
            f"{where}: together may cut a support into pieces of {corners} corners, and there is room for "
            f"{MAX_CORNERS}. Use fewer relations, or fewer anchors of 'between'."
        )
    if (
        o.config is not None
        and o.config.drawn_orientation.kind == "face_to"
        and any(r.kind == "beside" for r in _relations_of(o))
    ):
        raise SceneKeyError(
            f"{where}: 'beside' needs to know how the object is turned, and 'face_to' where it is. Use one of them."
        )
    for i, relation in enumerate(_relations_of(o)):
        if _has_own_width(relation) and max(v.short_edge for v in o.variants) == 0.0:
            raise SceneKeyError(
                f"{where}.{i}.width: is missing. '{o.name}' has nothing that collides, so no bounds and no width of "
                "its own."
            )


def _frame(relation: Relation, slots: tuple[str, ...]) -> int:
    if relation.frame == "anchor":
        return slots.index(relation.anchors[0])
    return _FRAMES[relation.frame] if relation.frame in _FRAMES else slots.index(relation.frame)


def _address(mjm: mujoco.MjModel, body: int, kind: ObjectKind) -> int:
    if kind == ObjectKind.FREE:
        return int(mjm.jnt_qposadr[mjm.body_jntadr[body]])
    return int(mjm.body_mocapid[body])


def _box(config: ObjectConfig | None) -> tuple:
    """Corners of the box in space that an object is drawn in; an empty one for all others."""
    box = config.region.box if config is not None and config.region is not None and config.region.is_3d else None
    return box if box is not None else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
