"""The kernel that places a whole layout: one thread block per world.

All lanes of a block draw the same candidate; lane 0 poses it, and after a barrier all of them share the tests. Every
branch around a barrier depends only on what is the same on all lanes, so that the block takes it as one.
"""

from itertools import product
from typing import Any

import warp as wp

from sceniris_gym.layout.bank import fall_back, fall_back_reaching
from sceniris_gym.layout.blocks import block_any, block_sync
from sceniris_gym.layout.collision import COLLIDES, LEAF_CAPACITY, NODE_CAPACITY
from sceniris_gym.layout.grasps import first_on_map
from sceniris_gym.layout.groups import draw_groups, parking_place
from sceniris_gym.layout.kinematics import draw_joints, follow_joints, pose_bodies
from sceniris_gym.layout.layouts import LayoutsView, Status
from sceniris_gym.layout.measure import measure, see
from sceniris_gym.layout.orientations import DrawnVariant, draw_turn, facing
from sceniris_gym.layout.points import draw_in_triangle, draw_related, draw_triangle, draw_unrelated
from sceniris_gym.layout.random import STREAM_BITS, uniforms
from sceniris_gym.layout.regions import overhangs, roof_physics, roof_visual
from sceniris_gym.layout.transforms import apply, pose_of, quat_mat, quat_z
from sceniris_gym.program.device import Cause, Measure, ObjectKind, OrientationType, Program, Roof
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.quaternions import mul_quat

wp.set_module_options({"enable_backward": False})

# Left alone the kernel takes all 255 registers of a lane, and a multiprocessor then holds 8 worlds; with half of them
# and a few spills it holds 16, which makes 1.2 times the layouts on an H200.
_MAX_REGISTERS = 128

_ROOF_OF = {"physics": roof_physics, "visual": roof_visual, "visual_round": roof_visual}

_STATIC = wp.constant(int(ObjectKind.STATIC))
_FREE = wp.constant(int(ObjectKind.FREE))
_ANY = wp.constant(int(OrientationType.ANY))
_FACE_TO = wp.constant(int(OrientationType.FACE_TO))
_WHOLE = wp.constant(int(Measure.WHOLE))
_EITHER = wp.constant(int(Roof.EITHER))
_COVERED = wp.constant(int(Roof.COVERED))
_VALID = wp.constant(int(Status.VALID))
_NONE = wp.constant(int(Cause.NONE))
_ROOF = wp.constant(int(Cause.ROOF))
_FOOTPRINT = wp.constant(int(Cause.FOOTPRINT))
_EMPTY = wp.constant(int(Cause.EMPTY))
_REGION = wp.constant(int(Cause.REGION))
_UNREACHABLE = wp.constant(int(Cause.UNREACHABLE))
_COLLISION = wp.constant(int(Cause.COLLISION))
_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))


@wp.struct
class Candidate:
    """A drawn pose: the point of the support under its pivot [m], its heading [rad], the body under it (-1: none)."""

    turn: DrawnVariant
    heading: float
    point: wp.vec3
    gap: float
    surface: int
    ground: int
    cause: int


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
def _within_reach(
    program: Program, reach: Reach, layouts: LayoutsView, worldid: int, lane: int, obj: int, variant: int
) -> bool:
    """Whether the map lets a grasp of the posed object through, which is kept; true for what need not be reachable."""
    column = reach.obj_reach[obj]
    if column < 0:
        return True
    body_pos = layouts.body_pos[worldid]
    body_quat = layouts.body_quat[worldid]
    grasp = first_on_map(program, reach, lane, column, variant, body_pos, body_quat)
    if lane == 0:
        layouts.variant[worldid, column] = variant
        layouts.grasp[worldid, column] = grasp
    return grasp >= 0


def _make_place(geometry: str, related: bool, reach_by: str) -> wp.Kernel:
    """The kernel for one kind of geometry, with or without relations and reach: what is not used costs registers."""
    reaching = reach_by != ""
    staged = reach_by == "stages"
    collides, roof = COLLIDES[geometry], _ROOF_OF[geometry]
    draw_spot = draw_related if related else draw_unrelated

    @wp.func
    def draw_pose(
        program: Program,
        layouts: LayoutsView,
        worldid: int,
        lane: int,
        obj: int,
        stream: wp.uint32,
        trial: int,
    ) -> Candidate:
        """Joints and orientation first, then the point, which may depend on them."""
        seed = layouts.seed[worldid]
        episode = layouts.episode[worldid]
        body_pos = layouts.body_pos[worldid]
        body_quat = layouts.body_quat[worldid]
        place = layouts.place[worldid]
        u = uniforms(seed, episode, stream, trial, 0)
        c = Candidate()
        c.cause = _NONE
        c.surface = int(-1)
        c.ground = program.obj_ground[obj]
        w = wp.vec4(0.0)
        if program.obj_orientation[obj] == _ANY or program.obj_variantnum[obj] > 1:
            w = uniforms(seed, episode, stream, trial, 1)
        c.turn = draw_turn(program, obj, u, w)
        if program.obj_measured[obj] != 0:
            c.turn = measure(program, obj, lane, c.turn, layouts.qpos[worldid], body_pos, body_quat)

        box = program.obj_box_upper[obj] - program.obj_box_lower[obj]
        c.point = program.obj_box_lower[obj] + wp.cw_mul(wp.vec3(u[1], u[2], u[3]), box)
        c.heading = c.turn.yaw
        if c.ground >= 0 or program.obj_cutnum[obj] > 0:
            frame = pose_of(wp.vec3(0.0), wp.vec4(1.0, 0.0, 0.0, 0.0))
            if c.ground >= 0:
                frame = pose_of(body_pos[c.ground], body_quat[c.ground])
                c.gap = program.obj_gap[obj]
            support_heading = wp.atan2(frame.rot[1, 0], frame.rot[0, 0])
            if program.obj_orientation[obj] != _ANY:
                c.heading += support_heading
            if program.obj_cutnum[obj] > 0:
                spot = draw_spot(program, layouts, worldid, lane, obj, c.turn, frame, support_heading, stream, trial)
                c.cause = spot.cause
                if c.ground >= 0:
                    c.surface = spot.surface
                    c.point = spot.at
                else:
                    c.point = wp.vec3(spot.at[0], spot.at[1], c.point[2])
            elif program.variant_trinum[c.turn.variant] == 0:
                c.cause = _EMPTY
            else:
                tri = draw_triangle(program, c.turn.variant, u[1])
                at = draw_in_triangle(program, tri, u[2], u[3])
                c.surface = program.tri_surface[tri]
                c.point = apply(frame, wp.vec3(at[0], at[1], program.surface_height[c.surface]))
        if program.obj_orientation[obj] == _FACE_TO:
            target = program.obj_target[obj]
            if layouts.present[worldid, target] != 0:
                at = wp.vec2(place[target][0], place[target][1])
                c.heading = c.turn.yaw + facing(wp.vec2(c.point[0], c.point[1]), at)
        return c

    @wp.func
    def _pose_object(program: Program, layouts: LayoutsView, worldid: int, obj: int, c: Candidate):
        """Pose the object with its pivot over the candidate's point, and write its root's pose. One lane's work."""
        body_pos = layouts.body_pos[worldid]
        body_quat = layouts.body_quat[worldid]
        qpos = layouts.qpos[worldid]
        root = program.obj_body[obj]
        slot = program.obj_slot[obj]
        pivot = c.point + wp.vec3(0.0, 0.0, c.gap)
        quat = wp.normalize(mul_quat(quat_z(c.heading), c.turn.quat))
        pos = pivot - quat_mat(quat) * c.turn.pivot
        body_pos[root] = pos
        body_quat[root] = quat
        pose_bodies(program, obj, 1, qpos, body_pos, body_quat)
        layouts.place[worldid, slot] = wp.vec4(pivot[0], pivot[1], pivot[2], c.heading)
        layouts.bounds[worldid, slot] = c.turn.bounds
        adr = program.obj_adr[obj]
        if program.obj_kind[obj] == _FREE:
            for i in range(3):
                qpos[adr + i] = pos[i]
            for i in range(4):
                qpos[adr + 3 + i] = quat[i]
        else:
            layouts.mocap_pos[worldid, adr] = pos
            layouts.mocap_quat[worldid, adr] = wp.quat(quat[0], quat[1], quat[2], quat[3])

    @wp.func
    def _put_away(program: Program, layouts: LayoutsView, worldid: int, obj: int):
        """Park an absent object, its joints at home. One lane's work."""
        for i in range(program.obj_drawnum[obj]):
            adr = program.draw_qposadr[program.obj_drawadr[obj] + i]
            layouts.qpos[worldid, adr] = program.home_qpos[adr]
        follow_joints(program, obj, layouts.qpos[worldid])
        variant = program.obj_variantadr[obj]
        c = Candidate()
        c.turn.quat = program.variant_quat[variant]
        c.turn.pivot = program.variant_pivot[variant]
        c.turn.bounds = program.variant_bounds[variant]
        c.point = parking_place(program.obj_slot[obj])
        c.gap = program.obj_gap[obj]
        _pose_object(program, layouts, worldid, obj, c)

    @wp.func
    def under_its_roof(
        program: Program,
        obj: int,
        lane: int,
        point: wp.vec3,
        body_pos: wp.array(dtype=wp.vec3),
        body_quat: wp.array(dtype=wp.vec4),
    ) -> bool:
        """Is the point covered or open, as the object is to be?"""
        rule = program.obj_roof[obj]
        if rule == _EITHER:
            return True
        over = int(0)
        for i in range(lane, program.obj_roofnum[obj], wp.block_dim()):
            if roof(program, program.roof_list[program.obj_roofadr[obj] + i], point, body_pos, body_quat):
                over = 1
        return (block_any(over) != 0) == (rule == _COVERED)

    @wp.func
    def attempt(
        program: Program,
        reach: Reach,
        layouts: LayoutsView,
        nodes: Any,
        leaves: Any,
        worldid: int,
        lane: int,
        obj: int,
        stream: wp.uint32,
        trial: int,
    ) -> int:
        """Draw one candidate, pose it and test it, the cheapest test first. Returns why it was rejected, or NONE."""
        body_pos = layouts.body_pos[worldid]
        body_quat = layouts.body_quat[worldid]
        if lane == 0:
            draw_joints(
                program, obj, layouts.seed[worldid], layouts.episode[worldid], stream, trial, layouts.qpos[worldid]
            )
        c = Candidate()
        c.ground = int(-1)
        c.surface = int(-1)
        if program.obj_kind[obj] == _STATIC:
            if lane == 0:
                pose_bodies(program, obj, 0, layouts.qpos[worldid], body_pos, body_quat)
            if program.obj_measured[obj] == _WHOLE:
                block_sync()
                slot = program.obj_slot[obj]
                seen = see(program, obj, lane, layouts.place[worldid, slot], body_pos, body_quat)
                if lane == 0:
                    layouts.bounds[worldid, slot] = seen
        else:
            c = draw_pose(program, layouts, worldid, lane, obj, stream, trial)
            if c.cause != _NONE:
                return c.cause
            if wp.static(not reaching):
                if not under_its_roof(program, obj, lane, c.point, body_pos, body_quat):
                    return _ROOF
            if lane == 0:
                _pose_object(program, layouts, worldid, obj, c)
        block_sync()
        if wp.static(reaching):  # a map answers sooner than roofs do
            if not _within_reach(program, reach, layouts, worldid, lane, obj, c.turn.variant):
                return _UNREACHABLE
            if not under_its_roof(program, obj, lane, c.point, body_pos, body_quat):
                return _ROOF
        if program.obj_footprint[obj] != 0 and c.surface >= 0:
            if overhangs(program, obj, lane, c.surface, body_pos, body_quat):
                return _FOOTPRINT
        if collides(program, nodes, leaves, lane, obj, c.ground, body_pos, body_quat):
            return _COLLISION
        return _NONE

    def place(
        program: Program,
        reach: Reach,
        split: wp.uint32,
        mask: wp.array(dtype=bool),
        # Layouts in and out:
        layouts: LayoutsView,
    ):
        worldid, lane = wp.tid()
        if mask:
            if not mask[worldid]:
                return
        if wp.static(staged):
            if layouts.restart[worldid] < 0:
                return
        nodes = wp.tile_stack(capacity=wp.static(NODE_CAPACITY[geometry]), dtype=wp.vec3i)
        leaves = wp.tile_stack(capacity=wp.static(LEAF_CAPACITY), dtype=wp.vec3i)
        if program.ngroup > 0:
            if lane == 0:
                draw_groups(program, layouts.seed[worldid], layouts.episode[worldid], split, layouts.present[worldid])
            block_sync()
        total = int(0)
        restart = int(0)
        if wp.static(staged):
            restart = layouts.restart[worldid]
        status = int(0)
        while restart <= program.restarts and status == 0:
            obj = int(0)
            status = _VALID
            while obj < program.nobject and status == _VALID:
                stream = (split << _STREAM_BITS) + wp.uint32(program.obj_stream[obj])
                trial = restart * program.attempts
                last = trial + program.attempts
                cause = int(-1)
                if layouts.present[worldid, program.obj_slot[obj]] == 0:
                    cause = _NONE
                    if lane == 0:
                        _put_away(program, layouts, worldid, obj)
                        if wp.static(reaching):
                            if reach.obj_reach[obj] >= 0:
                                layouts.grasp[worldid, reach.obj_reach[obj]] = -1
                    block_sync()
                while trial < last and cause != _NONE:
                    cause = attempt(program, reach, layouts, nodes, leaves, worldid, lane, obj, stream, trial)
                    if cause != _NONE and lane == 0:
                        wp.atomic_add(layouts.rejections, obj, cause, 1)
                        if cause == _COLLISION and layouts.rejected_object.shape[0] > 0:
                            _record(program, layouts, worldid, obj)
                    trial += 1
                    total += 1
                    # what no draw of the object itself can open, only a new start can
                    if cause >= _EMPTY and cause <= _REGION and program.obj_insists[obj] == 0:
                        trial = last
                if cause != _NONE:
                    status = int(0)
                obj += 1
            restart += 1
        if lane == 0:
            if wp.static(staged):
                layouts.attempts[worldid] += total
                layouts.restart[worldid] = wp.where(status == _VALID, restart, -1)
            else:
                layouts.attempts[worldid] = total
            layouts.first_pass_valid[worldid] = wp.where(restart == 1, status, 0)
            if status != _VALID:
                if wp.static(reaching):
                    status = fall_back_reaching(program, reach, layouts, worldid, split)
                else:
                    status = fall_back(program, layouts, worldid, split)
            layouts.status[worldid] = status

    name = f"place_{geometry}" + "_related" * related + f"_{reach_by}" * reaching
    place.__name__ = place.__qualname__ = name
    options = {"enable_backward": False, "grid_stride": False, "cuda_max_registers": _MAX_REGISTERS}
    return wp.Kernel(place, key=name, module=wp.get_module(f"{__name__}.{name}"), options=options)


PLACE = {
    (geometry, related, reach_by): _make_place(geometry, related, reach_by)
    for geometry, related, reach_by in product(COLLIDES, (False, True), ("", "map", "stages"))
}
"""The kernel for a scene, by the leaves of its colliders, by whether any of its regions differs between worlds, and
by what decides whether things are reachable: nothing, the arm's map, or later stages too, which may ask for another
start."""
