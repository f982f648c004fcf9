"""The World: a scene with everything a reset needs on its device, pre-cached and frozen."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.scene import supports
from sceniris_gym.scene.boxes import build_tree
from sceniris_gym.scene.config import ObjectConfig, SceneConfig
from sceniris_gym.scene.device import ObjectKind, PieceType, Program, Roof
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.pieces import Piece
from sceniris_gym.scene.program import Plan, build_plan, collider_pairs, roof_rule

# Boxes are grown by this much [m] so that rounding to float32 cannot lose a leaf.
_GROW = 1.0e-6


@dataclass(frozen=True)
class World:
    """A frozen scene on one device; it has no batch dimension.

    Attributes:
        scene: The model and its names.
        device: Warp's name of the device, e.g. "cuda:0".
        placed: Names in placement order: objects whose pose or joints are drawn, and "robot" if its joints are.
        plan: The placement program on the host.
        program: The same on the device.
        home_qpos: Start pose, shape (nq,).
        home_xpos, home_xquat: Poses of all bodies at the start, shapes (nbody, 3) and (nbody, 4) wxyz.
        depth: Levels of the deepest pair of box trees, which bounds the stack of the collision test.
        keep: Device arrays and meshes that `program` points to.
    """

    scene: SceneModel
    device: str
    placed: tuple[str, ...]
    plan: Plan
    program: Program
    home_qpos: np.ndarray
    home_xpos: np.ndarray
    home_xquat: np.ndarray
    depth: int
    keep: tuple = field(repr=False)

    @property
    def config(self) -> SceneConfig:
        """The scene as it was written."""
        return self.scene.config

    @property
    def mjm(self) -> mujoco.MjModel:
        """The compiled model."""
        return self.scene.mjm

    @property
    def hash(self) -> str:
        """Names the scene in layout ids."""
        return self.scene.hash

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of all objects of the scene file, in its order."""
        return tuple(self.config.objects)

    @property
    def bank_size(self) -> int:
        """Number of valid layouts in the bank."""
        return int(self.program.bank_qpos.shape[0])


@dataclass
class _Colliders:
    """Colliders and their box trees while they are collected."""

    body: list[int] = field(default_factory=list)
    root: list[int] = field(default_factory=list)
    plane: list[int] = field(default_factory=list)
    mesh: list[int] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    center: list[np.ndarray] = field(default_factory=list)
    half: list[np.ndarray] = field(default_factory=list)
    child: list[np.ndarray] = field(default_factory=list)
    faces: list[np.ndarray] = field(default_factory=list)
    depth: list[int] = field(default_factory=list)
    keep: list = field(default_factory=list)
    nodes: int = 0
    leaves: int = 0


def load_world(scene: SceneModel, device: str) -> World:
    """Take a scene to a device. The World's bank is empty; `layout.build_world` fills it."""
    plan = build_plan(scene)
    colliders = _collect(plan, scene.config.geometry == "visual", device)
    arrays = _objects(scene, plan, colliders) | _bodies(scene) | _pieces(plan.pieces) | _trees(colliders)
    mocap = max(scene.mjm.nmocap, 1)
    arrays |= {
        "home_qpos": scene.home_qpos,
        "bank_qpos": np.zeros((0, scene.mjm.nq)),
        "bank_mocap_pos": np.zeros((0, mocap, 3)),
        "bank_mocap_quat": np.zeros((0, mocap, 4)),
    }
    program = Program()
    program.nobject = len(plan.objects)
    program.attempts = scene.config.attempts
    program.restarts = scene.config.restarts
    fill_program(program, arrays, device)
    depth = sum(sorted(colliders.depth)[-2:])
    return World(
        scene=scene,
        device=device,
        placed=tuple(o.name for o in plan.objects),
        plan=plan,
        program=program,
        home_qpos=scene.home_qpos.astype(np.float32),
        home_xpos=plan.home.xpos.astype(np.float32),
        home_xquat=plan.home.xquat.astype(np.float32),
        depth=depth,
        keep=tuple(colliders.keep),
    )


def fill_program(program: Program, arrays: dict[str, np.ndarray], device: str) -> None:
    """Set fields of a program from numpy arrays, in the types that its fields are declared with."""
    for name, values in arrays.items():
        declared = Program.vars[name].type
        setattr(
            program,
            name,
            wp.array(np.ascontiguousarray(values), dtype=declared.dtype, ndim=declared.ndim, device=device),
        )


def _collect(plan: Plan, visual: bool, device: str) -> _Colliders:
    """One collider for each body's solid pieces, and one for each plane; pieces are numbered as in the plan."""
    c = _Colliders()
    by_body: dict[int, list[int]] = {}
    for i, p in enumerate(plan.pieces):
        by_body.setdefault(p.body, []).append(i)
    for body, ids in by_body.items():
        for i in [i for i in ids if plan.pieces[i].type == PieceType.PLANE]:
            _add_tree(c, body, np.zeros((1, 3)), np.zeros((1, 3)), plane=i, mesh=0)
            c.points.append(np.zeros((0, 3)))
        solid = [i for i in ids if plan.pieces[i].type != PieceType.PLANE]
        if not solid:
            continue
        if visual:
            meshes = [plan.pieces[i].mesh for i in solid]
            triangles = np.concatenate([m.triangles for m in meshes if m is not None])
            mesh = wp.Mesh(
                points=wp.array(triangles.reshape(-1, 3), dtype=wp.vec3, device=device),
                indices=wp.array(np.arange(3 * len(triangles)), dtype=int, device=device),
                support_winding_number=True,
            )
            c.keep.append(mesh)
            _add_tree(c, body, triangles.min(axis=1), triangles.max(axis=1), plane=-1, mesh=mesh.id)
            c.faces.append(triangles)
            parts = [part for m in meshes if m is not None for part in m.split(only_watertight=False)]
            c.points.append(np.array([part.vertices[0] for part in parts]))
        else:
            bounds = [plan.pieces[i].bounds() for i in solid]
            lower, upper = np.array([b[0] for b in bounds]), np.array([b[1] for b in bounds])
            _add_tree(c, body, lower, upper, plane=-1, mesh=0, first=solid[0])
            c.points.append(np.zeros((0, 3)))
    return c


def _add_tree(
    c: _Colliders, body: int, lower: np.ndarray, upper: np.ndarray, *, plane: int, mesh: int, first: int | None = None
) -> None:
    """Append a collider. Its leaves are numbered from `first`, or after all faces so far."""
    tree = build_tree(lower - _GROW, upper + _GROW)
    leaf = c.leaves if first is None else first
    c.body.append(body)
    c.root.append(c.nodes)
    c.plane.append(plane)
    c.mesh.append(mesh)
    c.center.append(tree.center)
    c.half.append(tree.half)
    c.child.append(np.where(tree.child < 0, ~(~tree.child + leaf), tree.child + c.nodes))
    c.depth.append(tree.depth)
    c.nodes += len(tree.child)
    if first is None and plane < 0:
        c.leaves += len(lower)


def _trees(c: _Colliders) -> dict[str, np.ndarray]:
    faces = np.concatenate([*c.faces, np.zeros((0, 3, 3))])
    points, adr, num = _ranges(c.points)
    return {
        "collider_body": np.array(c.body, int),
        "collider_root": np.array(c.root, int),
        "collider_plane": np.array(c.plane, int),
        "collider_mesh": np.array(c.mesh, np.uint64),
        "collider_pointadr": adr,
        "collider_pointnum": num,
        "node_center": np.concatenate([*c.center, np.zeros((0, 3))]),
        "node_half": np.concatenate([*c.half, np.zeros((0, 3))]),
        "node_child": np.concatenate([*c.child, np.zeros(0, int)]),
        "face_a": faces[:, 0],
        "face_b": faces[:, 1],
        "face_c": faces[:, 2],
        "point": np.reshape(points, (-1, 3)),
    }


def _pieces(pieces: list[Piece]) -> dict[str, np.ndarray]:
    vert, adr, num = _ranges([p.vertices for p in pieces])
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


def _objects(scene: SceneModel, plan: Plan, c: _Colliders) -> dict[str, np.ndarray]:
    objects = plan.objects
    draws, drawadr, drawnum = _ranges([o.draws for o in objects])
    choice, choiceadr, choicenum = _ranges([d.choice for d in draws])
    bodies, bodyadr, bodynum = _ranges([o.bodies for o in objects])
    own = [[i for i, p in enumerate(plan.pieces) if p.body in o.bodies] for o in objects]
    own_pieces, pieceadr, piecenum = _ranges(own)
    cover = [p.body if p.type != PieceType.PLANE else -1 for p in plan.pieces]  # a plane is no roof
    if scene.config.geometry == "visual":
        cover = [body if plane < 0 else -1 for body, plane in zip(c.body, c.plane, strict=True)]
    roofs = [_roofs(scene, o.config, cover) for o in objects]
    roof_list, roofadr, roofnum = _ranges(roofs)
    pairs, pairadr, pairnum = _ranges([_planes_last(p, c.plane) for p in collider_pairs(scene, plan, c.body)])
    boxes = [_box(o.config) for o in objects]
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
        "obj_quat": np.reshape([o.quat for o in objects], (-1, 4)),
        "obj_yaw": np.reshape([o.config.yaw if o.config else (0, 0) for o in objects], (-1, 2)),
        "obj_pivot": np.reshape([o.pivot for o in objects], (-1, 3)),
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
        "obj_roofadr": roofadr,
        "obj_roofnum": roofnum,
        "obj_pairadr": pairadr,
        "obj_pairnum": pairnum,
        "body_list": np.array(bodies, int),
        "piece_list": np.array(own_pieces, int),
        "roof_list": np.array(roof_list, int),
        "pair_a": np.array([p[0] for p in pairs], int),
        "pair_b": np.array([p[1] for p in pairs], int),
        "pair_margin": np.array([p[2] for p in pairs], float),
    } | _regions(plan)


def _regions(plan: Plan) -> dict[str, np.ndarray]:
    surfaces, _, _ = _ranges([o.surfaces for o in plan.objects])
    side, edgeadr, edgenum = _ranges([supports.edges(s.outline) for s in surfaces])
    triangles, owners, cdf, counts = [], [], [], []
    number = 0
    for o in plan.objects:
        parts = [supports.triangulate(s.region) for s in o.surfaces]
        corners = np.concatenate([*parts, np.zeros((0, 3, 2))])
        share = np.cumsum(supports.areas(corners))
        triangles.append(corners)
        owners += [number + i for i, part in enumerate(parts) for _ in part]
        cdf.append(share / share[-1] if len(share) else share)
        counts.append(len(corners))
        number += len(o.surfaces)
    corners = np.concatenate([*triangles, np.zeros((0, 3, 2))])
    side = np.reshape(side, (-1, 2, 2))
    return {
        "obj_triadr": np.concatenate([[0], np.cumsum(counts)[:-1]]) if counts else np.zeros(0, int),
        "obj_trinum": np.array(counts, int),
        "tri_surface": np.array(owners, int),
        "tri_a": corners[:, 0],
        "tri_b": corners[:, 1],
        "tri_c": corners[:, 2],
        "tri_cdf": np.concatenate([*cdf, np.zeros(0)]),
        "surface_body": np.array([s.body for s in surfaces], int),
        "surface_height": np.array([s.height for s in surfaces]),
        "surface_edgeadr": edgeadr,
        "surface_edgenum": edgenum,
        "edge_a": side[:, 0],
        "edge_b": side[:, 1],
    }


def _roofs(scene: SceneModel, config: ObjectConfig | None, bodies: list[int]) -> list[int]:
    """Which of the entries of `bodies` belong to the parent object: any of its bodies may be the roof."""
    if roof_rule(config) == Roof.EITHER:
        return []
    assert config is not None
    assert config.support is not None
    parent = scene.subtree(config.support.parent.split("/")[0])
    return [i for i, body in enumerate(bodies) if body in parent]


def _planes_last(pairs: list[tuple[int, int, float]], planes: list[int]) -> list[tuple[int, int, float]]:
    """The same pairs as the collision test takes them, a plane only in the second place; two planes never meet."""
    turned = [(b, a, margin) if planes[a] >= 0 else (a, b, margin) for a, b, margin in pairs]
    return [p for p in turned if planes[p[0]] < 0]


def _address(mjm: mujoco.MjModel, body: int, kind: ObjectKind) -> int:
    if kind == ObjectKind.FREE:
        return int(mjm.jnt_qposadr[mjm.body_jntadr[body]])
    return int(mjm.body_mocapid[body])


def _box(config: ObjectConfig | None) -> tuple:
    """Corners of the box in space that an object is drawn in; an empty one for all others."""
    box = config.region.box if config is not None and config.region is not None and config.region.is_3d else None
    return box if box is not None else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def _ranges(lists) -> tuple[list, np.ndarray, np.ndarray]:
    """Many lists as one, with the address and the length of each."""
    num = np.array([len(x) for x in lists], int)
    adr = np.concatenate([[0], np.cumsum(num)[:-1]]) if len(num) else np.zeros(0, int)
    return [x for part in lists for x in part], adr, num
