"""The scene as device code reads it: flat arrays, shared by all worlds and never written after `compile_scene`.

Lengths are in metres, angles in radians, quaternions wxyz. Poses are relative to the parent frame. As in MuJoCo, a pair
(`xadr`, `xnum`) selects a range of the list `x` or `x_*`. *Slots* number the objects in the order of the scene file,
then the robots. Pivot poses and bounds are numbered by *columns*: the slots, then one more column for each object with
variants, which has the values of the present variant. A *collider* is tested as a whole. It is one plane, or the pieces
of one body that share a tree of boxes.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import Any

import numpy as np
import warp as wp


class ObjectKind(IntEnum):
    """The kind of an object, which determines where MuJoCo stores its pose."""

    STATIC = 0
    FREE = 1
    FIXTURE = 2
    MARKER = 3


OWN_A, OWN_B = wp.constant(1), wp.constant(2)
"""Bits of a pair: a is part of the tested candidate, and b is part of it."""


class Cover(IntEnum):
    """The rule for obstacles above a drawn point: `on` forbids them, `inside` requires one, `in` accepts both cases."""

    EITHER = 0
    OPEN = 1
    COVERED = 2


class Cause(IntEnum):
    """The test that rejected a candidate. docs/language/sampling.md describes each cause."""

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
    FALLS = 10
    NO_PATH = 11


REACH_CAUSES = (Cause.UNREACHABLE, Cause.NO_IK, Cause.BLOCKED, Cause.NO_PATH)
"""The causes of a missed reach target: the map, inverse kinematics, an obstacle, or no path."""


class OrientationType(IntEnum):
    """Ways to draw an orientation: add a yaw to a pose of the object, draw from all of SO(3), or face a target."""

    YAW = 0
    ANY = 1
    FACE_TO = 2


class Measure(IntEnum):
    """Quantities to compute for each candidate: the lowest point (`LOWEST`), or also the bounds (`WHOLE`)."""

    NOTHING = 0
    LOWEST = 1
    WHOLE = 2


FRAME_SUPPORT = -1
"""Value of `rel_frame` for the heading of the support."""
FRAME_WORLD = -2
"""Value of `rel_frame` for the world's axes."""
OWN_WIDTH = -1.0
"""Value of `rel_width` for the shorter edge of the placed object's bounds."""
FREE = 2.0
"""Second value of `rel_beside` for spans that only have to contain each other."""


vec7 = wp.types.vector(length=7, dtype=float)


@wp.struct
class Program:
    """The placement program of a scene, with objects in placement order."""

    # Sizes and options.
    nobject: int
    ngiven: int  # number of objects that a redraw leaves in place. They come first.
    ngroup: int
    attempts: int
    restarts: int
    restart_rate: float  # fraction of restarts that fail to place all objects
    visual: bool  # leaves are faces and round pieces. If false, leaves are convex pieces.

    # Bodies and joints for forward kinematics, as in mjModel.
    body_parent: wp.array[int]
    body_pos: wp.array[wp.vec3]
    body_quat: wp.array[wp.vec4]
    body_jntadr: wp.array[int]
    body_jntnum: wp.array[int]
    jnt_slide: wp.array[bool]  # true for a slide, false for a hinge
    jnt_pos: wp.array[wp.vec3]
    jnt_axis: wp.array[wp.vec3]
    jnt_qposadr: wp.array[int]
    jnt_qpos0: wp.array[float]

    # Draws of joint positions: uniform in [low, high], one value of a list, or by the norm of a vector of joints.
    draw_qposadr: wp.array[int]
    draw_range: wp.array2d[wp.vec2]  # by world
    draw_choiceadr: wp.array[int]
    draw_choicenum: wp.array[int]
    choice: wp.array[float]  # the values of lists, and home, norm, low and high of draws by a norm

    # Joints that follow drawn joints by equalities, see `Coupling`: origin, offset and a1 to a4. Double precision,
    # because MuJoCo multiplies a violation by a thousand and more.
    follow_driveradr: wp.array[int]  # qpos address of the followed joint
    follow_qposadr: wp.array[int]
    follow_coef: wp.array2d[wp.float64]

    # Objects: identity, and addresses of their state.
    obj_stream: wp.array[int]  # of random numbers
    obj_upright: wp.array[float]  # cosine of the greatest lean of its support
    obj_kind: wp.array[int]  # an ObjectKind
    obj_slot: wp.array[int]
    obj_column: wp.array[int]  # of its pivot pose and bounds: its slot, or for a variant the column of the whole object
    obj_body: wp.array[int]  # the root
    obj_adr: wp.array[int]  # of its qpos (free), or its mocap body (fixture, marker)
    obj_bodyadr: wp.array[int]
    obj_bodynum: wp.array[int]
    obj_drawadr: wp.array[int]
    obj_drawnum: wp.array[int]
    obj_followadr: wp.array[int]
    obj_follownum: wp.array[int]
    body_list: wp.array[int]

    # Objects: orientation, and the stable poses to draw from, each at heading 0.
    obj_orientation: wp.array[int]  # an OrientationType
    obj_target: wp.array[int]  # column of the object that it faces
    obj_yaw: wp.array2d[wp.vec2]  # interval, by world
    obj_with: wp.array[int]  # column whose heading is the origin of the yaw, or -1 for the heading of the support
    obj_stableadr: wp.array[int]
    obj_stablenum: wp.array[int]
    obj_measured: wp.array[int]  # a Measure
    stable_quat: wp.array[wp.vec4]
    stable_pivot: wp.array[wp.vec3]  # in the root's frame
    stable_bounds: wp.array[wp.vec4]  # low x, low y, high x, high y around the pivot
    stable_cdf: wp.array[float]
    stable_triadr: wp.array[int]  # of the pose's region
    stable_trinum: wp.array[int]

    # Objects: support, and the region to draw from.
    obj_ground: wp.array[int]  # body of the support, or -1
    obj_gap: wp.array[float]  # height over the support
    obj_box_lower: wp.array2d[wp.vec3]  # by world, of a region in space
    obj_box_upper: wp.array2d[wp.vec3]  # by world
    obj_cutnum: wp.array[int]  # number of pieces that relations make of each triangle, 0 if all worlds share the region
    obj_erosion: wp.array[float]  # distance from the outline, as a fraction of the shorter edge of the drawn bounds
    obj_cover: wp.array[int]  # a Cover
    obj_overheadadr: wp.array[int]
    obj_overheadnum: wp.array[int]
    obj_footprint: wp.array[bool]  # the whole footprint has to lie on the support
    obj_shadowadr: wp.array[int]
    obj_shadownum: wp.array[int]
    obj_effort: wp.array[float]  # usual number of candidates until it is placed
    obj_retry_if_empty: wp.array[bool]  # another draw of its bounds or yaw may open a region that was empty
    overhead_list: wp.array[int]  # obstacles that may cover its points: pieces, or colliders if `visual`
    shadow_list: wp.array[int]  # pieces whose shadows are its footprint

    # Heaps: settled poses of their objects, relative to the body of the container.
    obj_heap: wp.array[wp.vec3i]  # address and number of its poses, and the stream of its heap, or -1, 0, 0
    heap_pose: wp.array[vec7]  # position, then orientation

    # Relations: unlimited distances are 1e30.
    obj_reladr: wp.array[int]
    obj_relnum: wp.array[int]
    rel_type: wp.array[int]  # a RelationType
    rel_anchoradr: wp.array[int]
    rel_anchornum: wp.array[int]
    rel_anchor: wp.array[int]  # columns. For `beside`, the slots of the anchor's variants follow.
    rel_frame: wp.array[int]  # column whose heading rotates the direction, or FRAME_*
    rel_heading: wp.array[float]
    rel_half_angle: wp.array[float]
    rel_low: wp.array2d[float]  # by world
    rel_high: wp.array2d[float]  # by world
    rel_bounds: wp.array[bool]  # distances are between bounds, otherwise between pivots
    rel_width: wp.array[float]  # or OWN_WIDTH
    rel_beside: wp.array[wp.vec2]  # gap, and which ends are in line: 1 left of the direction, -1 right, 0 middles, FREE
    # For `beside`, of the object, then of each entry in rel_anchor: bounds, or low x above high x for drawn bounds, and
    # the site: xy from the pivot at heading 0, including the gap, and the angle from the first variant's site.
    rel_root: wp.array2d[wp.vec4]
    rel_sites: wp.array2d[wp.vec3]
    rel_piecenum: wp.array[int]
    rel_sideadr: wp.array[int]  # of the sides of its pieces, counted from the first side of its object

    # Groups: slots of their members, the least and greatest number of present members, and, if members differ in
    # weight, the weights in the splits 'train' and 'eval'.
    group: wp.array2d[wp.vec4i]  # by world: address and number in group_slot, least and greatest number of members
    group_slot: wp.array[int]
    group_uniform: wp.array2d[bool]  # by world
    group_weight: wp.array2d[wp.vec2]  # by world, of each entry of group_slot
    start_weight: wp.array2d[float]  # by world, of each kind of start

    # Support surfaces: regions as triangles, and outlines as edges.
    tri_surface: wp.array[int]
    tri_a: wp.array[wp.vec2]
    tri_b: wp.array[wp.vec2]
    tri_c: wp.array[wp.vec2]
    tri_cdf: wp.array[float]  # fraction of the region's area up to and including this triangle
    surface_height: wp.array[float]
    surface_edgeadr: wp.array[int]
    surface_edgenum: wp.array[int]
    surface_winding: wp.array[int]  # of a convex outline: 1 counter-clockwise, -1 clockwise. 0 if it is not convex.
    edge_a: wp.array[wp.vec2]
    edge_b: wp.array[wp.vec2]

    # Convex pieces in the frames of their bodies.
    obj_pieceadr: wp.array[int]
    obj_piecenum: wp.array[int]
    obj_lownum: wp.array[int]  # number of its first pieces that can have its lowest point if only that is measured
    piece_list: wp.array[int]
    piece_type: wp.array[int]  # a PieceType
    piece_body: wp.array[int]
    piece_pos: wp.array[wp.vec3]
    piece_quat: wp.array[wp.vec4]
    piece_size: wp.array[wp.vec3]
    piece_radius: wp.array[float]  # of the enclosing sphere around the origin of its frame
    piece_vertadr: wp.array[int]  # of the vertices of a hull, in the frame of the piece
    piece_vertnum: wp.array[int]
    inner_center: wp.array[wp.vec3]  # a box inside each piece, in its frame
    inner_half: wp.array[wp.vec3]  # zeros if a piece has no such box
    vert: wp.array[wp.vec3]
    face_vertadr: int  # of the corners of all faces in `vert`, if `visual` and there are round pieces

    # Colliders: a binary tree of boxes in the frame of the body.
    collider_body: wp.array[int]
    collider_root: wp.array[int]  # node
    collider_plane: wp.array[int]  # the piece that is a plane, or -1
    collider_mesh: wp.array[wp.uint64]
    collider_depth: wp.array[float]  # upper bound of the distance from the surface to a point inside
    collider_pointadr: wp.array[int]
    collider_pointnum: wp.array[int]
    node_center: wp.array[wp.vec3]
    node_half: wp.array[wp.vec3]
    node_child: wp.array[int]  # the left child, followed by the right one, or ~leaf: a piece, or a face if `visual`
    face_a: wp.array[wp.vec3]
    face_b: wp.array[wp.vec3]
    face_c: wp.array[wp.vec3]
    point: wp.array[wp.vec3]  # one point of each closed component, for containment

    # Pairs of colliders to keep apart, and the broad-phase pairs, which are tested first.
    obj_pairadr: wp.array[int]
    obj_pairnum: wp.array[int]
    obj_broadadr: wp.array[int]
    obj_broadnum: wp.array[int]
    pair_a: wp.array[int]
    pair_b: wp.array[int]
    # Body of a, body of b, bits (OWN_A, OWN_B), and the piece of b if b is a plane, or -1.
    pair_bodies: wp.array[wp.vec4i]
    pair_margin: wp.array2d[float]  # by world: least allowed distance, negative for geoms that overlap at home
    pair_touch: wp.array[float]  # least allowed distance if the pair is an object and its support
    pair_directionadr: wp.array[int]
    pair_directionnum: wp.array[int]
    direction: wp.array[wp.vec3]  # separating directions out of a: half in the frame of a's body, half in b's
    broad_pair: wp.array[wp.vec3i]  # pair, node of a, node of b

    # The start pose of a world before its draws.
    home_qpos: wp.array[float]
    home_pivot_pose: wp.array[wp.vec4]  # of each slot and of each object with variants: x, y, z of the pivot, heading
    home_bounds: wp.array[wp.vec4]

    # Soundness of a finished layout: greatest |qpos|, greatest sum of |coordinates| of a mocap body, and the addresses
    # of the quaternions of free and ball joints.
    bound_qpos: wp.array[float]
    bound_mocap: wp.array[float]
    quat_qposadr: wp.array[int]


WORLD_FIELDS = (
    *("draw_range", "rel_low", "rel_high", "group", "group_uniform", "group_weight", "start_weight"),
    *("obj_yaw", "obj_box_lower", "obj_box_upper", "pair_margin"),
)
"""Fields of `Program` that may differ between worlds. A single row for all worlds has the stride SHARED."""
SHARED = 0
"""The stride [bytes] between rows of an array whose single row serves all worlds."""


def fill_struct(declared: Any, instance: Any, arrays: Mapping[str, np.ndarray], device: str) -> Any:
    """Copy NumPy arrays into the fields of a struct instance, and return the instance.

    `declared` is the struct. It gives the types of its fields.
    """
    for name, values in arrays.items():
        field = declared.vars[name].type
        shared = declared is Program and name in WORLD_FIELDS
        values = np.ascontiguousarray(values[None] if shared else values)
        array = wp.array(values, dtype=field.dtype, ndim=field.ndim, device=device)
        if shared and array.size:
            strides, owner = (SHARED, array.strides[1]), array
            array = wp.array(ptr=array.ptr, dtype=array.dtype, shape=array.shape, strides=strides, device=device)
            array._ref = owner
        setattr(instance, name, array)
    return instance


def allocate(declared: Any, instance: Any, shapes: Mapping[str, Any], device: Any) -> Any:
    """Set fields of a struct instance to arrays of zeros, and return the instance.

    `declared` is the struct. It gives the types of its fields. A key of `shapes` names a field, or several fields
    separated by spaces, and its value is the shape of each of these fields.
    """
    for names, shape in shapes.items():
        for name in names.split():
            setattr(instance, name, wp.zeros(shape, dtype=declared.vars[name].type.dtype, device=device))
    return instance


def repeat(declared: Any, instance: Any, count: int, rows: Mapping[str, np.ndarray], device: str) -> None:
    """Set fields of a struct instance to arrays, each with `count` copies of one row.

    `declared` is the struct. It gives the types of its fields. `rows` maps the name of each field to its row.
    """
    arrays = {name: np.tile(row, (count, *[1] * row.ndim)) for name, row in rows.items()}
    fill_struct(declared, instance, arrays, device)


def copied(declared: Any, instance: Any) -> Any:
    """Return a copy of a struct instance. The copy shares the arrays of the instance."""
    other = declared()
    other.assign(instance)
    return other
