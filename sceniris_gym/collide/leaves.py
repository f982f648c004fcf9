"""The narrow phase: distance tests of two leaves of box trees.

With `geometry: physics`, a leaf is a convex piece. With `geometry: visual`, it is a triangle or a round piece. The
second leaf of a pair may also be a plane. A candidate is rejected if any pair of leaves is too close, so the order of
the pairs does not matter.
"""

import warp as wp

from sceniris_gym.collide.box_pairs import inner_boxes_within, near_parts_separated
from sceniris_gym.collide.convex import Shape, least_extent, piece_shape
from sceniris_gym.collide.triangles import triangles_separated
from sceniris_gym.device.transforms import Pose, apply, compose, pose_of, relative, rot_vec_quat
from sceniris_gym.geometry.colliders import PIECE_LEAF
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import OWN_A, OWN_B, ObjectKind, Program

# Added to every margin [m]. It exceeds the rounding of float32 poses and vertices within a few metres, and is below the
# permitted error of a rejection, 10 um.
SKIN = 5.0e-6


@wp.struct
class PairPoses:
    """World poses of the bodies of colliders a and b of a pair, and the pose of b's body in the frame of a's body."""

    a: Pose
    b: Pose
    rel: Pose


@wp.struct
class OverPlane:
    """A plane seen from a body: the plane's normal in the body's frame, and the body origin's height [m] over it."""

    normal: wp.vec3
    height: float


@wp.struct
class Leaf:
    """A convex leaf of a box tree: its shape, and the pose of the shape's frame in the frame of the body.

    The shape lies within `radius` [m] of the origin of its frame.
    """

    shape: Shape
    pose: Pose
    radius: float


@wp.func
def pair_poses(
    program: Program,
    pair: int,
    own_pos: wp.array[wp.vec3],
    own_quat: wp.array[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> PairPoses:
    """Return the poses of the two bodies of a pair of colliders.

    The poses of the tested candidate's bodies come from `own_pos` and `own_quat`. The poses of all other bodies come
    from `body_pos` and `body_quat`. All four arrays are in the world frame, and indexed by body.
    """
    bodies = program.pair_bodies[pair]
    a = bodies[0]
    b = bodies[1]
    own = bodies[2]
    p = PairPoses()  # pyrefly: ignore[missing-argument]
    if (own & OWN_A) != 0:
        p.a = pose_of(own_pos[a], own_quat[a])
    else:
        p.a = pose_of(body_pos[a], body_quat[a])
    if (own & OWN_B) != 0:
        p.b = pose_of(own_pos[b], own_quat[b])
    else:
        p.b = pose_of(body_pos[b], body_quat[b])
    p.rel = relative(p.a, p.b)
    return p


@wp.func
def margin_of(program: Program, worldid: int, pair: int, support_body: int) -> float:
    """Return the least allowed distance [m] of a pair of colliders, negative if the pair may penetrate.

    If the second body of the pair is `support_body`, the clearance does not apply.
    """
    margin = program.pair_margin[worldid, pair]
    if program.pair_bodies[pair][1] == support_body:
        margin = program.pair_touch[pair]
    return margin + wp.static(SKIN)


@wp.func
def support_of(program: Program, obj: int) -> int:
    """Return the body on which an object stands, or -1 if there is none. Clearances do not apply to this body."""
    if program.obj_kind[obj] == ObjectKind.STATIC:
        return -1
    return program.obj_ground[obj]


@wp.func
def piece_pose(program: Program, piece: int) -> Pose:
    """Return the pose of a piece's frame in its body's frame."""
    return pose_of(program.piece_pos[piece], program.piece_quat[piece])


@wp.func
def piece_origin(program: Program, piece: int, body_pos: wp.array[wp.vec3], body_quat: wp.array[wp.vec4]) -> wp.vec3:
    """Return the origin of a piece's frame in the world. A sphere of `piece_radius` around it encloses the piece."""
    body = program.piece_body[piece]
    return body_pos[body] + rot_vec_quat(program.piece_pos[piece], body_quat[body])


@wp.func
def lowest(program: Program, piece: int, in_body: wp.vec3) -> float:
    """Return the least coordinate [m] of a convex piece along the unit vector `in_body`.

    The vector and the coordinate are in the frame of the piece's body.
    """
    return least_extent(program.vert, piece_shape(program, piece), piece_pose(program, piece), in_body)


@wp.func
def over_plane(program: Program, pose: Pose, plane_pose: Pose, plane: int) -> OverPlane:
    """Return a plane as seen from a body.

    `pose` is the world pose of this body. `plane_pose` is the world pose of the body of the plane, and `plane` is the
    number of the plane's piece.
    """
    up = compose(plane_pose, piece_pose(program, plane))
    axis = wp.vec3(up.rot[0, 2], up.rot[1, 2], up.rot[2, 2])
    return OverPlane(wp.transpose(pose.rot) * axis, wp.dot(axis, pose.pos - up.pos))


@wp.func
def _piece_leaf(program: Program, piece: int) -> Leaf:
    """Return a convex piece as a `Leaf`."""
    pose = piece_pose(program, piece)
    return Leaf(shape=piece_shape(program, piece), pose=pose, radius=program.piece_radius[piece])


@wp.func
def _piece_of(program: Program, leaf: int) -> int:
    """Return the number of a leaf's convex piece, or -1 if the leaf is a triangle."""
    if not program.visual:
        return leaf
    return wp.max(leaf - PIECE_LEAF, -1)


@wp.func
def _leaf(program: Program, leaf: int) -> Leaf:
    """Return a leaf by its number: a convex piece, or the hull of a triangle's corners.

    For a triangle, the `radius` of the result is 1e30, because it is not computed.
    """
    piece = _piece_of(program, leaf)
    if piece >= 0:
        return _piece_leaf(program, piece)
    hull = Shape(kind=PieceType.HULL, size=wp.vec3(0.0), vertadr=program.face_vertadr + 3 * leaf, vertnum=3, radius=0.0)
    return Leaf(shape=hull, pose=Pose(wp.vec3(0.0), wp.identity(n=3, dtype=float)), radius=1.0e30)


@wp.func
def _separated(program: Program, pair: int, a: Leaf, b: Leaf, rel: Pose, margin: float) -> bool:
    """Test whether two leaves are further apart than `margin` [m].

    `rel` is the pose of b's body in the frame of a's body. If `margin` is negative, say -d, the leaves may penetrate by
    the depth d. After the test at the given poses, they are then also tested with b moved by d along each separating
    direction of the pair. The result is True if one of these tests finds the leaves apart.
    """
    frame = relative(a.pose, compose(rel, b.pose))
    here = frame.pos
    num = wp.where(margin < 0.0, program.pair_directionnum[pair], 0)
    for i in range(1 + num):
        if i > 0:
            direction = program.direction[program.pair_directionadr[pair] + i - 1]
            if 2 * i > num:
                direction = rel.rot * direction
            frame.pos = here - margin * (wp.transpose(a.pose.rot) * direction)
        if near_parts_separated(program.vert, a.shape, b.shape, a.radius, b.radius, frame, wp.max(margin, 0.0)):
            return True
    return False


@wp.func
def _leaves_separated(program: Program, pair: int, a: int, b: int, rel: Pose, margin: float) -> bool:
    """Test whether two leaves (convex pieces or triangles) are further apart than `margin` [m].

    `rel` is the pose of b's body in the frame of a's body.
    """
    if _piece_of(program, a) < 0 and _piece_of(program, b) < 0:
        b0, b1, b2 = apply(rel, program.face_a[b]), apply(rel, program.face_b[b]), apply(rel, program.face_c[b])
        return triangles_separated(program.face_a[a], program.face_b[a], program.face_c[a], b0, b1, b2, margin)
    return _separated(program, pair, _leaf(program, a), _leaf(program, b), rel, margin)


@wp.func
def _lowest_of_leaf(program: Program, leaf: int, in_body: wp.vec3) -> float:
    """Return the least coordinate [m] of a leaf along the unit vector `in_body`.

    The vector and the coordinate are in the frame of the leaf's body.
    """
    piece = _piece_of(program, leaf)
    if piece >= 0:
        return lowest(program, piece, in_body)
    return wp.min(
        wp.min(wp.dot(in_body, program.face_a[leaf]), wp.dot(in_body, program.face_b[leaf])),
        wp.dot(in_body, program.face_c[leaf]),
    )


@wp.func
def inner_boxes_touch(program: Program, entry: wp.vec3i, poses: PairPoses, margin: float) -> bool:
    """Return True if inner boxes prove that the two pieces of an entry are at most `margin` [m] apart.

    An entry is (pair, node of a, node of b). An inner box lies inside its convex piece. Triangles and planes have no
    inner box. If the entry has one of these, or if `margin` is negative, the result is False.
    """
    if program.visual or margin < 0.0 or program.pair_bodies[entry[0]][3] >= 0:
        return False
    a = ~program.node_child[entry[1]]
    b = ~program.node_child[entry[2]]
    return inner_boxes_within(program, a, b, poses.rel, margin)


@wp.func
def pieces_touch(program: Program, entry: wp.vec3i, poses: PairPoses, margin: float) -> bool:
    """Test whether the leaves of an entry (pair, node of a, node of b) are at most `margin` [m] apart.

    Leaf a is a convex piece, and leaf b is a convex piece or a plane.
    """
    a = ~program.node_child[entry[1]]
    plane = program.pair_bodies[entry[0]][3]
    if plane >= 0:
        over = over_plane(program, poses.a, poses.b, plane)
        return over.height + lowest(program, a, over.normal) <= margin
    b = ~program.node_child[entry[2]]
    return not _separated(program, entry[0], _piece_leaf(program, a), _piece_leaf(program, b), poses.rel, margin)


@wp.func
def leaves_touch(program: Program, entry: wp.vec3i, poses: PairPoses, margin: float) -> bool:
    """Test whether the leaves of an entry (pair, node of a, node of b) are at most `margin` [m] apart.

    Leaf a is a convex piece or a triangle, and leaf b is a convex piece, a triangle or a plane.
    """
    a = ~program.node_child[entry[1]]
    plane = program.pair_bodies[entry[0]][3]
    if plane >= 0:
        over = over_plane(program, poses.a, poses.b, plane)
        return over.height + _lowest_of_leaf(program, a, over.normal) <= margin
    b = ~program.node_child[entry[2]]
    return not _leaves_separated(program, entry[0], a, b, poses.rel, margin)
