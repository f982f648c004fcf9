"""mujoco_warp's context for pictures: the cameras, the geoms, meshes with fewer faces, and the order of rays."""

import copy
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.errors import check_names
from sceniris_gym.scene.overview import VISIBLE_GROUPS, picture_groups
from sceniris_gym.sim.versions import render_context

CHANNELS: dict[str, tuple[int, type]] = {"rgb": (3, wp.uint8), "depth": (1, wp.float32), "segmentation": (1, wp.int32)}
"""Kind of picture -> number of channels, and type of a value."""

BACKGROUND = (0.93, 0.95, 0.97, 1.0)
_TILE = (8, 4)  # pixels of the 32 threads of a warp, because rays of neighbouring pixels mostly hit the same faces
LEAST_FACES = 100
"""Meshes with fewer faces are not thinned."""
_GRIDS = (8, 12, 16, 24, 32)  # cells along the longest edge, coarse grids first
_SAME = 0.1  # greatest relative change of area and of volume, because a larger change loses thin parts
_SMALLER = 0.6  # a thinner mesh has at most this fraction of the faces


@dataclass(frozen=True)
class Looks:
    """Appearance of all pictures that are rendered together.

    Attributes:
        shadows: Draw shadows.
        thin: Draw meshes with fewer faces and flat shading, for small pictures.
    """

    shadows: bool = False
    thin: bool = False


@dataclass(frozen=True)
class Shot:
    """The size and the kinds of pictures that a camera takes.

    Attributes:
        size: Width and height [pixels].
        data: Kinds of pictures: "rgb", "depth" or "segmentation", the keys of CHANNELS.
    """

    size: tuple[int, int]
    data: tuple[str, ...] = ("rgb",)

    @property
    def memory(self) -> tuple[int, int]:
        """Bytes for all worlds together, to sort the rays, and bytes for each world, whose values are written twice."""
        pixels = self.size[0] * self.size[1]
        return 48 * pixels, 7 * pixels * len(self.data)


def in_model_order(mjm: mujoco.MjModel, shots: Mapping[str, Shot], where: str) -> dict[str, Shot]:
    """Return `shots`, which has a camera's name as each key, in the order of the cameras in the model.

    Raises:
        UnknownNameError: The model has no such camera. The message begins with `where`.
    """
    cameras = [mjm.camera(i).name for i in range(mjm.ncam)]
    check_names("camera", shots, where, cameras)
    return {name: shots[name] for name in cameras if name in shots}


def picture_context(
    mjm: mujoco.MjModel, nworld: int, shots: Mapping[str, Shot], looks: Looks, differ: Collection[str], **options: Any
) -> Any:
    """Return mujoco_warp's render context. `shots` are in the model's order, `differ` is as in `may_be_inside`."""
    flags = {"rgb": "render_rgb", "depth": "render_depth", "segmentation": "render_seg"}
    wanted = {flag: [kind in shot.data for shot in shots.values()] for kind, flag in flags.items()}
    given = {"cam_res": [shot.size for shot in shots.values()], "enabled_geom_groups": list(VISIBLE_GROUPS)}
    given |= {"use_shadows": looks.shadows, "enable_vertex_normals": not looks.thin}
    # A test of every hit for the back of a face takes nearly half of the time, and only a camera inside sees backs.
    given["enable_backface_culling"] = any(may_be_inside(mjm, mjm.camera(name).id, differ) for name in shots)
    context = render_context(drawn_once(mjm), nworld, list(shots), **(given | options), **wanted)
    if looks.thin:
        _use_thin_meshes(context, mjm)
    return context


def _use_thin_meshes(context: Any, mjm: mujoco.MjModel) -> None:
    """Replace all meshes without texture coordinates by meshes with fewer faces."""
    ids = context.mesh_bvh_id.numpy()
    for i in np.flatnonzero(mjm.mesh_texcoordadr < 0):
        vertices = mjm.mesh_vert[mjm.mesh_vertadr[i] :][: mjm.mesh_vertnum[i]]
        fewer = thin(vertices.astype(float), mjm.mesh_face[mjm.mesh_faceadr[i] :][: mjm.mesh_facenum[i]])
        if fewer is not None:
            points, faces = wp.array(fewer[0], dtype=wp.vec3), wp.array(fewer[1].ravel(), dtype=int)
            mesh = wp.Mesh(points, faces, bvh_constructor="cubql", bvh_leaf_size=2)
            ids[i] = mesh.id
            context.mesh_registry[mesh.id] = mesh
    context.mesh_bvh_id.assign(ids)


def may_be_inside(mjm: mujoco.MjModel, camera: int, differ: Collection[str] = ()) -> bool:
    """Return True if a camera may be inside a visible geom, so that its rays may meet the backs of faces.

    The test covers the geoms of the camera's body tree and geoms that are fixed to the camera. The camera may be inside
    a geom if it is in the geom's bounding box, at `qpos0` or in a keyframe. It may also be inside if its tree has a
    visible geom, and its place relative to the tree differs between worlds. This is the case if `cam_pos` has a row per
    world, or if the tree is a single body and sizes of geoms differ between worlds, as for an object with variants.

    Args:
        mjm: The model.
        camera: The camera.
        differ: Fields of the model that have a row for each world.
    """
    d, body = mujoco.MjData(mjm), mjm.cam_bodyid[camera]
    solid = np.isin(picture_groups(mjm), VISIBLE_GROUPS) & (mjm.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    own, beside = ((of == of[body])[mjm.geom_bodyid] & solid for of in (mjm.body_rootid, mjm.body_weldid))
    moves = "cam_pos" in differ or ("geom_size" in differ and (mjm.body_rootid == body).sum() == 1)
    if moves and body and own.any():
        return True
    geoms = np.flatnonzero(own | beside)
    centre, half = mjm.geom_aabb[geoms].reshape(-1, 2, 3).transpose(1, 0, 2)
    for key in range(-1, mjm.nkey):
        mujoco.mj_resetDataKeyframe(mjm, d, key) if key >= 0 else mujoco.mj_resetData(mjm, d)
        mujoco.mj_kinematics(mjm, d)
        mujoco.mj_comPos(mjm, d)
        mujoco.mj_camlight(mjm, d)
        at = np.einsum("gij,gi->gj", d.geom_xmat[geoms].reshape(-1, 3, 3), d.cam_xpos[camera] - d.geom_xpos[geoms])
        if (np.abs(at - centre) <= half).all(axis=1).any():
            return True
    return False


def drawn_once(mjm: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of the model in which a body's collision geoms are hidden if the body also has visual geoms."""
    drawn = copy.copy(mjm)
    drawn.geom_group[:] = picture_groups(mjm)
    drawn.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # objects overlap in qpos0, which exhausts memory
    return drawn


def tile_rays(context: Any, shots: Mapping[str, Shot]) -> list[np.ndarray]:
    """Sort rays so that neighbouring threads take the pixels of a tile, not of a row.

    Args:
        context: A context with precomputed rays, which are sorted in place.
        shots: The pictures.

    Returns:
        The pixel of each ray of each camera, numbered row by row.
    """
    arrays = [getattr(context, name) for name in ("ray", "ray_offset") if hasattr(context, name)]  # 3.11 has only ray
    rays, first, pixels = [array.numpy() for array in arrays], 0, []
    for width, height in (shot.size for shot in shots.values()):
        y, x = np.divmod(np.arange(width * height), width)
        pixels.append(np.lexsort((x, y, x // _TILE[0], y // _TILE[1])))
        for values in rays:
            values[first : first + width * height] = values[first + pixels[-1]]
        first += width * height
    for array, values in zip(arrays, rays, strict=True):
        array.assign(values)
    return pixels


def thin(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return a mesh of nearly the same shape with fewer faces.

    All vertices in a cell of a grid are merged (Rossignac and Borrel 1993). The grid is the coarsest one that nearly
    keeps the area and the volume of the mesh.

    Args:
        vertices: Vertices [m], shape (n, 3).
        faces: Indices of vertices, shape (m, 3).

    Returns:
        Vertices and faces of the new mesh. None if the mesh already has few faces, or if no grid keeps its shape.
    """
    if len(faces) < LEAST_FACES:
        return None
    measures = _area_and_volume(vertices, faces)
    for cells in _GRIDS:
        fewer_vertices, fewer_faces = _clustered(vertices, faces, cells)
        changed = np.abs(_area_and_volume(fewer_vertices, fewer_faces) - measures)
        if (changed < _SAME * np.abs(measures)).all() and len(fewer_faces) < _SMALLER * len(faces):
            return fewer_vertices, fewer_faces
    return None


def _clustered(vertices: np.ndarray, faces: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Merge the vertices of each cell into their mean, and drop faces that become lines."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max() / cells
    _, cluster = np.unique(((vertices - low) / size + 1e-6).astype(int), axis=0, return_inverse=True)
    cluster = cluster.ravel()
    means = np.stack([np.bincount(cluster, axis) for axis in vertices.T], axis=1) / np.bincount(cluster)[:, None]
    left = cluster[faces]
    left = left[(left != np.roll(left, 1, axis=1)).all(axis=1)]
    _, first = np.unique(np.sort(left, axis=1), axis=0, return_index=True)
    return means, left[np.sort(first)]


def _area_and_volume(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the area [m^2] of a surface and the volume [m^3] that it encloses, shape (2,)."""
    a, b, c = vertices[faces.T]
    across = np.cross(b - a, c - a) / 2.0
    return np.array([np.linalg.norm(across, axis=1).sum(), (a * across).sum() / 3.0])
