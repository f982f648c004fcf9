"""What device code sees of a scene: flat arrays, the same for every world, never written after `compile_scene`.

Poses are (pos [m], quat wxyz) of a frame in its parent's; angles are in radians. Ranges of a list are (adr, num) pairs
as in MuJoCo. A *collider* is tested as a whole: all pieces of one body under one tree of boxes, or one plane.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp


class ObjectKind(IntEnum):
    """How an object's pose gets into the simulation."""

    STATIC = 0
    FREE = 1
    FIXTURE = 2
    MARKER = 3


class Cover(IntEnum):
    """What is required above the drawn point: `on` open space, `inside` a cover, `in` either."""

    EITHER = 0
    OPEN = 1
    COVERED = 2


class Cause(IntEnum):
    """Why a candidate was rejected."""

    NONE = 0
    OVERHEAD = 1
    FOOTPRINT = 2
    COLLISION = 3
    EMPTY = 4
    REGION = 5
    UNREACHABLE = 6
    NO_IK = 7
    BLOCKED = 8
    UNSOUND = 9


REACH_CAUSES = (Cause.UNREACHABLE, Cause.NO_IK, Cause.BLOCKED)
"""Causes of failing to reach: by the map, by inverse kinematics, or because something is in the way."""


class RelationType(IntEnum):
    """Shapes of the regions that relations describe."""

    SECTOR = 0
    BETWEEN = 1
    BESIDE = 2
    JOINED = 3


class OrientationType(IntEnum):
    """How an orientation is drawn: a yaw about one of the object's poses, all of SO(3), or towards another object."""

    YAW = 0
    ANY = 1
    FACE_TO = 2


class Measure(IntEnum):
    """What is measured of an object once it is drawn: nothing, its lowest point, or its bounds as well."""

    NOTHING = 0
    LOWEST = 1
    WHOLE = 2


# What turns a relation's direction, where it is not the heading of an object.
FRAME_SUPPORT = -1
FRAME_WORLD = -2


vec7 = wp.types.vector(length=7, dtype=float)


@wp.struct
class Program:
    """The placement program of a scene. Objects are listed in placement order."""

    nobject: int
    ngroup: int
    attempts: int
    restarts: int
    restart_rate: float  # share of restarts that place not everything
    visual: int  # 1: leaves are faces, and round pieces beside them; 0: leaves are convex pieces
    face_vertadr: int  # where `vert` has the corners of faces, if the scene shows round primitives
    # Bodies and joints: what forward kinematics needs, as in mjModel.
    body_parent: wp.array[int]
    body_pos: wp.array[wp.vec3]
    body_quat: wp.array[wp.vec4]
    body_jntadr: wp.array[int]
    body_jntnum: wp.array[int]
    jnt_slide: wp.array[int]
    jnt_pos: wp.array[wp.vec3]
    jnt_axis: wp.array[wp.vec3]
    jnt_qposadr: wp.array[int]
    jnt_qpos0: wp.array[float]
    # Draws of joint positions: uniform in [lo, hi], or one of a list of values.
    draw_qposadr: wp.array[int]
    draw_range: wp.array[wp.vec2]
    draw_choiceadr: wp.array[int]
    draw_choicenum: wp.array[int]
    choice: wp.array[float]
    # Joints that follow drawn ones, see `Coupling`: origin, offset and a1 to a4 in double precision, since MuJoCo
    # multiplies what is missing by a thousand and more.
    follow_driveradr: wp.array[int]
    follow_qposadr: wp.array[int]
    follow_coef: wp.array2d[wp.float64]
    # Objects.
    obj_stream: wp.array[int]
    obj_kind: wp.array[int]
    # (first, number, stream) of its settled poses, -1 if it has none; all things of a heap draw from one stream.
    obj_heap: wp.array[wp.vec3i]
    obj_body: wp.array[int]
    obj_adr: wp.array[int]  # of its qpos (free) or its mocap body (fixture, marker)
    obj_slot: wp.array[int]  # where relations and groups find it: its place in the scene file
    obj_orientation: wp.array[int]
    obj_target: wp.array[int]  # slot of what it faces
    obj_yaw: wp.array[wp.vec2]
    obj_beside: wp.array[int]  # slot whose heading its yaw is added to in place of its support's, or -1
    obj_variantadr: wp.array[int]
    obj_variantnum: wp.array[int]
    obj_measured: wp.array[int]
    obj_ground: wp.array[int]  # body that carries it, or -1
    obj_gap: wp.array[float]
    obj_box_lower: wp.array[wp.vec3]
    obj_box_upper: wp.array[wp.vec3]
    obj_cover: wp.array[int]
    obj_footprint: wp.array[int]
    obj_drawadr: wp.array[int]
    obj_drawnum: wp.array[int]
    obj_followadr: wp.array[int]
    obj_follownum: wp.array[int]
    obj_bodyadr: wp.array[int]
    obj_bodynum: wp.array[int]
    obj_pieceadr: wp.array[int]
    obj_piecenum: wp.array[int]
    obj_shadowadr: wp.array[int]
    obj_shadownum: wp.array[int]
    obj_overheadadr: wp.array[int]
    obj_overheadnum: wp.array[int]
    obj_cutnum: wp.array[int]  # pieces that relations cut a triangle into; 0: the same region in every world
    obj_erosion: wp.array[float]  # distance from the outline, in shares of the drawn bounds' shorter edge
    obj_effort: wp.array[float]  # candidates that it usually takes to place it
    obj_retry_if_empty: wp.array[int]  # 1: redrawing its own bounds or turn may open a region that was empty
    obj_reladr: wp.array[int]
    obj_relnum: wp.array[int]
    obj_pairadr: wp.array[int]
    obj_pairnum: wp.array[int]
    obj_broadadr: wp.array[int]
    obj_broadnum: wp.array[int]
    body_list: wp.array[int]
    piece_list: wp.array[int]
    shadow_list: wp.array[int]  # pieces whose shadows must lie on the support
    overhead_list: wp.array[int]  # pieces (physics) or colliders (visual)
    # Poses that an orientation is drawn from, at heading 0: pivot in the root's frame, bounds around it in xy.
    variant_quat: wp.array[wp.vec4]
    variant_pivot: wp.array[wp.vec3]
    variant_bounds: wp.array[wp.vec4]
    variant_cdf: wp.array[float]
    variant_triadr: wp.array[int]  # of its region
    variant_trinum: wp.array[int]
    # Settled poses of things of heaps, relative to the body that they fill.
    heap_pose: wp.array[vec7]  # position, then orientation
    # Relations. Directions and half angles in rad; distances in m, 1e30 for none.
    rel_type: wp.array[int]
    rel_anchoradr: wp.array[int]
    rel_anchornum: wp.array[int]
    rel_anchor: wp.array[int]  # slots
    rel_frame: wp.array[int]  # slot, or one of FRAME_*
    rel_heading: wp.array[float]
    rel_half_angle: wp.array[float]
    rel_low: wp.array[float]
    rel_high: wp.array[float]
    rel_bounds: wp.array[int]
    rel_width: wp.array[float]  # negative: the shorter edge of the object's own bounds
    rel_gap: wp.array[float]
    rel_sites: wp.array[wp.vec4]  # xy from the pivots, at heading 0: the anchor's site and the gap, own site
    rel_piecenum: wp.array[int]
    rel_sideadr: wp.array[int]  # where the sides of its pieces begin among those of its object
    # Groups: their members' slots and how many of them are present.
    group_adr: wp.array[int]
    group_num: wp.array[int]
    group_slot: wp.array[int]
    group_low: wp.array[int]
    group_high: wp.array[int]
    # Support regions, triangulated; `tri_cdf` is the share of the region's area up to and including a triangle.
    tri_surface: wp.array[int]
    tri_a: wp.array[wp.vec2]
    tri_b: wp.array[wp.vec2]
    tri_c: wp.array[wp.vec2]
    tri_cdf: wp.array[float]
    surface_height: wp.array[float]
    surface_edgeadr: wp.array[int]
    surface_edgenum: wp.array[int]
    surface_convex: wp.array[int]  # 1 or -1 for a convex outline, counter-clockwise or clockwise
    edge_a: wp.array[wp.vec2]
    edge_b: wp.array[wp.vec2]
    # Convex pieces: their frame in the body's, and for hulls their vertices in the piece's frame.
    piece_type: wp.array[int]
    piece_body: wp.array[int]
    piece_pos: wp.array[wp.vec3]
    piece_quat: wp.array[wp.vec4]
    piece_size: wp.array[wp.vec3]
    piece_vertadr: wp.array[int]
    piece_vertnum: wp.array[int]
    piece_radius: wp.array[float]  # of the sphere around its frame's origin that holds it [m]
    inner_center: wp.array[wp.vec3]  # of each piece a box inside of it, in its frame
    inner_half: wp.array[wp.vec3]  # zeros: none
    vert: wp.array[wp.vec3]
    # Colliders: a binary tree of boxes in the body's frame. `node_child` is the left child (the right one follows it),
    # or ~leaf: a piece (physics) or a face (visual).
    collider_body: wp.array[int]
    collider_root: wp.array[int]
    collider_plane: wp.array[int]  # piece of a plane, else -1
    collider_mesh: wp.array[wp.uint64]
    collider_depth: wp.array[float]  # no point inside it is further from its surface than this [m]
    collider_pointadr: wp.array[int]
    collider_pointnum: wp.array[int]
    node_center: wp.array[wp.vec3]
    node_half: wp.array[wp.vec3]
    node_child: wp.array[int]
    face_a: wp.array[wp.vec3]
    face_b: wp.array[wp.vec3]
    face_c: wp.array[wp.vec3]
    point: wp.array[wp.vec3]  # one of each closed component, for containment
    pair_a: wp.array[int]
    pair_b: wp.array[int]
    # Body of a, body of b, bits (1: a is of the object that is placed, or of the robot; 2: b is), and the piece that b
    # is if it is a plane, else -1.
    pair_bodies: wp.array[wp.vec4i]
    pair_margin: wp.array[float]  # negative: how deep two pieces may be that are in each other at home
    pair_touch: wp.array[float]  # the least distance [m] where the pair is an object and its support
    pair_directionadr: wp.array[int]
    pair_directionnum: wp.array[int]
    direction: wp.array[wp.vec3]  # unit vectors out of a: half in the frame of a's body, half in that of b's
    broad_pair: wp.array[wp.vec3i]  # (pair, node of a, node of b) that the collision test begins with
    # What a world holds before anything is drawn.
    home_qpos: wp.array[float]
    home_place: wp.array[wp.vec4]
    home_bounds: wp.array[wp.vec4]
    # What a layout must keep to be served: the greatest absolute value of each entry of qpos, the greatest sum of those
    # of a mocap body's position, and where the quaternions of free and ball joints are.
    bound_qpos: wp.array[float]
    bound_mocap: wp.array[float]
    quat_qposadr: wp.array[int]
    # The bank of valid layouts: rows of the split "train", then those of "eval".
    bank_ntrain: int
    bank_present: wp.array2d[int]
    bank_qpos: wp.array2d[float]
    bank_mocap_pos: wp.array2d[wp.vec3]
    bank_mocap_quat: wp.array2d[wp.vec4]


def fill_struct(declared: Any, instance: Any, arrays: Mapping[str, np.ndarray], device: str) -> None:
    """Set array fields of a struct instance from numpy arrays, with the types that the struct declares."""
    for name, values in arrays.items():
        field = declared.vars[name].type
        values = np.ascontiguousarray(values)
        setattr(instance, name, wp.array(values, dtype=field.dtype, ndim=field.ndim, device=device))


def copied(declared: Any, instance: Any) -> Any:
    """Return a copy of a struct instance, which shares its arrays."""
    other = declared()
    for name in declared.vars:
        setattr(other, name, getattr(instance, name))
    return other
