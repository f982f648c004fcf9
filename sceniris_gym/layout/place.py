"""The kernel that places a whole layout: one thread block per world.

Lane 0 draws and poses a candidate, the barrier inside `block_first` shows it to the others, and all lanes together test it
for collision. Every branch around a barrier depends on broadcast values only, so that the block takes it as one.
"""

import warp as wp

from sceniris_gym.layout.collision import (
    STACK_CAPACITY,
    block_first,
    collides_physics,
    collides_visual,
    lowest,
    piece_pose,
)
from sceniris_gym.layout.kinematics import draw_joints, pose_bodies
from sceniris_gym.layout.layouts import LayoutsView, Status
from sceniris_gym.layout.random import BANK_STREAM, STREAM_BITS, philox, uniforms
from sceniris_gym.layout.regions import draw_in_triangle, draw_triangle, piece_on_surface, roof_physics, roof_visual
from sceniris_gym.layout.transforms import apply, compose, mul_quat, pose_of, quat_mat, quat_z, relative
from sceniris_gym.scene.device import Cause, ObjectKind, Program, Roof

wp.set_module_options({"enable_backward": False})

_STATIC = wp.constant(int(ObjectKind.STATIC))
_FREE = wp.constant(int(ObjectKind.FREE))
_EITHER = wp.constant(int(Roof.EITHER))
_OPEN = wp.constant(int(Roof.OPEN))
_VALID = wp.constant(int(Status.VALID))
_FALLBACK = wp.constant(int(Status.FALLBACK))
_NONE = wp.constant(int(Cause.NONE))
_ROOF = wp.constant(int(Cause.ROOF))
_FOOTPRINT = wp.constant(int(Cause.FOOTPRINT))
_COLLISION = wp.constant(int(Cause.COLLISION))
_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))
_BANK_STREAM = wp.constant(wp.uint32(BANK_STREAM))


@wp.func
def _bottom(program: Program, obj: int, body_pos: wp.array(dtype=wp.vec3), body_quat: wp.array(dtype=wp.vec4)) -> float:
    """Height of the object's lowest point [m], world frame, in the joint state that its bodies are posed in."""
    low = float(1.0e30)
    for i in range(program.obj_piecenum[obj]):
        piece = program.piece_list[program.obj_pieceadr[obj] + i]
        body = program.piece_body[piece]
        down = wp.transpose(quat_mat(body_quat[body])) * wp.vec3(0.0, 0.0, 1.0)
        low = wp.min(low, body_pos[body][2] + lowest(program, piece, down))
    return low


@wp.func
def _on_surface(
    program: Program, obj: int, surface: int, body_pos: wp.array(dtype=wp.vec3), body_quat: wp.array(dtype=wp.vec4)
) -> bool:
    """Does the whole footprint of the posed object lie on the surface?"""
    ground = program.surface_body[surface]
    frame = pose_of(body_pos[ground], body_quat[ground])
    for i in range(program.obj_piecenum[obj]):
        piece = program.piece_list[program.obj_pieceadr[obj] + i]
        body = program.piece_body[piece]
        rel = relative(frame, compose(pose_of(body_pos[body], body_quat[body]), piece_pose(program, piece)))
        if not piece_on_surface(program, piece, surface, rel):
            return False
    return True


@wp.func
def _pose_root(
    program: Program,
    obj: int,
    pivot: wp.vec3,
    quat: wp.vec4,
    qpos: wp.array(dtype=float),
    body_pos: wp.array(dtype=wp.vec3),
    body_quat: wp.array(dtype=wp.vec4),
) -> wp.vec3:
    """Pose the object with its pivot at `pivot` and return its root's position, all in the world frame.

    The pivot is the centre of the bounds in the home state, at the height of the lowest point in the drawn joint state.
    """
    root = program.obj_body[obj]
    pos = pivot - quat_mat(quat) * program.obj_pivot[obj]
    body_pos[root] = pos
    body_quat[root] = quat
    pose_bodies(program, obj, 1, qpos, body_pos, body_quat)
    if program.obj_drawnum[obj] > 0:
        pos += wp.vec3(0.0, 0.0, pivot[2] - _bottom(program, obj, body_pos, body_quat))
        body_pos[root] = pos
        pose_bodies(program, obj, 1, qpos, body_pos, body_quat)
    return pos


@wp.func
def _record(program: Program, layouts: LayoutsView, worldid: int, obj: int):
    """Keep a candidate that was rejected for collision, as long as there is room for it."""
    slot = wp.atomic_add(layouts.rejected_count, 0, 1)
    if slot < layouts.rejected_object.shape[0]:
        layouts.rejected_object[slot] = obj
        for i in range(layouts.qpos.shape[1]):
            layouts.rejected_qpos[slot, i] = layouts.qpos[worldid, i]
        for i in range(layouts.mocap_pos.shape[1]):
            layouts.rejected_mocap_pos[slot, i] = layouts.mocap_pos[worldid, i]
            layouts.rejected_mocap_quat[slot, i] = layouts.mocap_quat[worldid, i]


@wp.func
def _fall_back(program: Program, layouts: LayoutsView, worldid: int, split: wp.uint32) -> int:
    """Take the world's entry of the bank; a World whose bank is still being made has none."""
    num = program.bank_qpos.shape[0]
    if num == 0:
        return 0
    stream = (split << _STREAM_BITS) + _BANK_STREAM
    words = philox(
        layouts.seed[worldid], wp.vec4ui(wp.uint32(layouts.episode[worldid]), stream, wp.uint32(0), wp.uint32(0))
    )
    row = int(words[0] % wp.uint32(num))
    for i in range(layouts.qpos.shape[1]):
        layouts.qpos[worldid, i] = program.bank_qpos[row, i]
    for i in range(program.bank_mocap_pos.shape[1]):
        layouts.mocap_pos[worldid, i] = program.bank_mocap_pos[row, i]
        q = program.bank_mocap_quat[row, i]
        layouts.mocap_quat[worldid, i] = wp.quat(q[0], q[1], q[2], q[3])
    return _FALLBACK


def _make_place(collides: wp.Function, roof: wp.Function, name: str) -> wp.Kernel:
    """The kernel for one kind of geometry."""

    @wp.func
    def covered(
        program: Program,
        obj: int,
        point: wp.vec3,
        body_pos: wp.array(dtype=wp.vec3),
        body_quat: wp.array(dtype=wp.vec4),
    ) -> bool:
        for i in range(program.obj_roofnum[obj]):
            if roof(program, program.roof_list[program.obj_roofadr[obj] + i], point, body_pos, body_quat):
                return True
        return False

    @wp.func
    def propose(program: Program, layouts: LayoutsView, worldid: int, obj: int, stream: wp.uint32, trial: int) -> int:
        """Draw a candidate and pose it. Returns the body it stands on (-1: none), or -1 - cause if it is rejected."""
        seed = layouts.seed[worldid]
        episode = layouts.episode[worldid]
        qpos = layouts.qpos[worldid]
        body_pos = layouts.body_pos[worldid]
        body_quat = layouts.body_quat[worldid]
        draw_joints(program, obj, seed, episode, stream, trial, qpos)
        if program.obj_kind[obj] == _STATIC:
            pose_bodies(program, obj, 0, qpos, body_pos, body_quat)
            return -1

        u = uniforms(seed, episode, stream, trial, 0)
        yaw = program.obj_yaw[obj][0] + u[0] * (program.obj_yaw[obj][1] - program.obj_yaw[obj][0])
        box = program.obj_box_upper[obj] - program.obj_box_lower[obj]
        pivot = program.obj_box_lower[obj] + wp.cw_mul(wp.vec3(u[1], u[2], u[3]), box)
        surface = int(-1)
        ground = int(-1)
        if program.obj_trinum[obj] > 0:
            tri = draw_triangle(program, obj, u[1])
            point = draw_in_triangle(program, tri, u[2], u[3])
            surface = program.tri_surface[tri]
            ground = program.surface_body[surface]
            frame = pose_of(body_pos[ground], body_quat[ground])
            yaw += wp.atan2(frame.rot[1, 0], frame.rot[0, 0])
            pivot = apply(frame, wp.vec3(point[0], point[1], program.surface_height[surface]))
            if program.obj_roof[obj] != _EITHER:
                is_open = not covered(program, obj, pivot, body_pos, body_quat)
                if is_open != (program.obj_roof[obj] == _OPEN):
                    return -1 - _ROOF
            pivot += wp.vec3(0.0, 0.0, program.obj_gap[obj])

        quat = wp.normalize(mul_quat(quat_z(yaw), program.obj_quat[obj]))
        pos = _pose_root(program, obj, pivot, quat, qpos, body_pos, body_quat)
        adr = program.obj_adr[obj]
        if program.obj_kind[obj] == _FREE:
            for i in range(3):
                qpos[adr + i] = pos[i]
            for i in range(4):
                qpos[adr + 3 + i] = quat[i]
        else:
            layouts.mocap_pos[worldid, adr] = pos
            layouts.mocap_quat[worldid, adr] = wp.quat(quat[0], quat[1], quat[2], quat[3])
        if program.obj_footprint[obj] != 0 and surface >= 0:
            if not _on_surface(program, obj, surface, body_pos, body_quat):
                return -1 - _FOOTPRINT
        return ground

    def place(
        program: Program,
        split: wp.uint32,
        mask: wp.array(dtype=bool),
        # Layouts in and out:
        layouts: LayoutsView,
    ):
        worldid, lane = wp.tid()
        if mask:
            if not mask[worldid]:
                return
        stack = wp.tile_stack(capacity=wp.static(STACK_CAPACITY), dtype=wp.vec3i)
        total = int(0)
        restart = int(0)
        status = int(0)
        while restart <= program.restarts and status == 0:
            obj = int(0)
            status = _VALID
            while obj < program.nobject and status == _VALID:
                stream = (split << _STREAM_BITS) + wp.uint32(program.obj_stream[obj])
                attempt = int(0)
                cause = int(-1)
                while attempt < program.attempts and cause != _NONE:
                    ground = int(0)
                    if lane == 0:
                        trial = restart * program.attempts + attempt
                        ground = propose(program, layouts, worldid, obj, stream, trial)
                    ground = block_first(ground)
                    cause = wp.max(-1 - ground, 0)
                    if cause == _NONE:
                        if collides(
                            program, stack, lane, obj, ground, layouts.body_pos[worldid], layouts.body_quat[worldid]
                        ):
                            cause = _COLLISION
                    if cause != _NONE and lane == 0:
                        wp.atomic_add(layouts.rejections, obj, cause, 1)
                        if cause == _COLLISION and layouts.rejected_object.shape[0] > 0:
                            _record(program, layouts, worldid, obj)
                    attempt += 1
                total += attempt
                if cause != _NONE:
                    status = int(0)
                obj += 1
            restart += 1
        if lane == 0:
            layouts.attempts[worldid] = total
            layouts.first_pass_valid[worldid] = wp.where(restart == 1, status, 0)
            if status != _VALID:
                status = _fall_back(program, layouts, worldid, split)
            layouts.status[worldid] = status

    place.__name__ = place.__qualname__ = name
    return wp.Kernel(place, key=name, module=wp.get_module(f"{__name__}.{name}"), options={"enable_backward": False})


place_physics = _make_place(collides_physics, roof_physics, "place_physics")
place_visual = _make_place(collides_visual, roof_visual, "place_visual")
