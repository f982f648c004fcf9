"""`Cameras`: pictures of a batch by mujoco_warp's ray caster, on the device, without a window or OpenGL."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.pictures.thin_meshes import thin
from sceniris_gym.scene.assemble import MARK_GROUP
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.versions import render_context

wp.set_module_options({"enable_backward": False})

VISIBLE_GROUPS = (0, 1, 2, MARK_GROUP)
"""Geom groups in pictures: those that MuJoCo's viewer shows, and markers."""

BACKGROUND = (0.93, 0.95, 0.97, 1.0)

CHANNELS: dict[str, tuple[int, type]] = {"rgb": (3, wp.uint8), "depth": (1, wp.float32), "segmentation": (1, wp.int32)}
"""Kinds of pictures, each with its number of channels and the type of a value."""

_TRACKING = (mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM, mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODYCOM)
_HIDDEN_GROUP = 5
_AWAY = wp.vec3(1e9, 1e9, 1e9)  # m; from there every ray misses the boxes around a world at once


@dataclass(frozen=True)
class Looks:
    """Looks of pictures, the same for all that are rendered together.

    Attributes:
        shadows: Draw shadows.
        thin: Draw meshes with fewer faces, and faces as flat ones, for small pictures.
    """

    shadows: bool = False
    thin: bool = False


@dataclass(frozen=True)
class Shot:
    """A camera's pictures.

    Attributes:
        size: Width and height [pixels].
        data: Kinds of pictures, keys of CHANNELS.
    """

    size: tuple[int, int]
    data: tuple[str, ...] = ("rgb",)


def in_model_order(mjm: mujoco.MjModel, shots: Mapping[str, Shot], where: str) -> dict[str, Shot]:
    """Return pictures to take in the order in which the model has their cameras.

    Raises:
        UnknownNameError: The model has no such camera; the message begins with `where`.
    """
    cameras = [mjm.camera(i).name for i in range(mjm.ncam)]
    for name in shots:
        if name not in cameras:
            raise UnknownNameError("camera", name, where, filter(None, cameras))
    return {name: shots[name] for name in cameras if name in shots}


def picture_context(mjm: mujoco.MjModel, nworld: int, shots: Mapping[str, Shot], looks: Looks, **options: Any) -> Any:
    """Return mujoco_warp's context for pictures of cameras in the model's order."""
    flags = {"rgb": "render_rgb", "depth": "render_depth", "segmentation": "render_seg"}
    wanted = {flag: [kind in shot.data for shot in shots.values()] for kind, flag in flags.items()}
    sizes = [shot.size for shot in shots.values()]
    given = {"cam_res": sizes, "enabled_geom_groups": list(VISIBLE_GROUPS)}
    given |= {"use_shadows": looks.shadows, "enable_vertex_normals": not looks.thin}
    context = render_context(drawn_once(mjm), nworld, list(shots), **given, **wanted, **options)
    if looks.thin:
        _use_thin_meshes(context, mjm)
    return context


def _use_thin_meshes(context: Any, mjm: mujoco.MjModel) -> None:
    """Exchange meshes for thinner ones, but for those whose faces have texture coordinates."""
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


def drawn_once(mjm: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model in which no body is drawn twice: a copy with shapes for collisions in a hidden group.

    A geom that collides is hidden if its body also has geoms for looks alone, in another group that is visible. Geoms
    of the world are all drawn, as a floor is none of the things on it.
    """
    visible = np.isin(mjm.geom_group, VISIBLE_GROUPS) & (mjm.geom_rgba[:, 3] > 0.0)
    collides = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    looks = set(zip(mjm.geom_bodyid[visible & ~collides], mjm.geom_group[visible & ~collides], strict=True))
    bodies = {body for body, _ in looks}
    hidden = [
        geom
        for geom in np.flatnonzero(visible & collides)
        if (body := int(mjm.geom_bodyid[geom])) in bodies - {0} and (body, mjm.geom_group[geom]) not in looks
    ]
    if not hidden:
        return mjm
    mjm = copy.copy(mjm)
    mjm.geom_group[hidden] = _HIDDEN_GROUP
    return mjm


@wp.kernel
def _turn_away(
    # In:
    mask: wp.array[wp.bool],
    # Out:
    cam_xpos_out: wp.array2d[wp.vec3],
):
    worldid, camid = wp.tid()
    if not mask[worldid]:
        cam_xpos_out[worldid, camid] = _AWAY


@wp.kernel
def _write_rgb(
    # In:
    mask: wp.array[wp.bool],
    packed: wp.array2d[wp.uint32],
    first: int,
    # Out:
    rgb_out: wp.array3d[wp.uint8],
):
    worldid, pixelid = wp.tid()
    if mask[worldid]:
        value = packed[worldid, first + pixelid]
        rgb_out[worldid, pixelid, 0] = wp.uint8((value >> wp.uint32(16)) & wp.uint32(255))
        rgb_out[worldid, pixelid, 1] = wp.uint8((value >> wp.uint32(8)) & wp.uint32(255))
        rgb_out[worldid, pixelid, 2] = wp.uint8(value & wp.uint32(255))


@wp.kernel
def _write_depth(
    # In:
    mask: wp.array[wp.bool],
    depth: wp.array2d[float],
    first: int,
    # Out:
    depth_out: wp.array3d[float],
):
    worldid, pixelid = wp.tid()
    if mask[worldid]:
        depth_out[worldid, pixelid, 0] = depth[worldid, first + pixelid]


@wp.kernel
def _write_segmentation(
    # In:
    mask: wp.array[wp.bool],
    seen: wp.array2d[wp.vec2i],
    first: int,
    owner: wp.array[int],
    geom_type: int,
    # Out:
    segmentation_out: wp.array3d[int],
):
    worldid, pixelid = wp.tid()
    if mask[worldid]:
        what = seen[worldid, first + pixelid]
        number = int(0)
        if what[1] == geom_type:
            number = owner[what[0]]
        segmentation_out[worldid, pixelid, 0] = number


class Cameras:
    """Cameras that take pictures of the worlds of a Data, which they do not change.

    Poses of bodies and geoms are read as they are in `data`, so run `mjw.kinematics` after a change of `qpos`. All
    cameras are rendered together. Models that differ from world to world are drawn as they are in each.

    Args:
        scene: The scene.
        model: Its model on the device.
        data: The worlds.
        shots: The pictures to take, by the names of cameras.
        looks: Their looks.
        nworld: Number of worlds in pictures, from the first one on; None is all.
        where: Beginning of an error message.
        graph: Capture the launches into a graph and replay it.

    Attributes:
        images: Latest pictures by camera and kind: rgb uint8, depth float32 [m, along the camera's axis; 0 where
            nothing is], segmentation int32 [index into `names`]. Shape (nworld, height, width, channels).
        mask: Worlds that `launch` takes pictures of, shape (nworld,), bool; at first all.
        names: Names of the values of segmentation: objects and robots, after "" for everything else.
        launch: Takes the pictures; the images of other worlds stay. Does not wait for the device.

    Raises:
        UnknownNameError: The scene has no such camera.
    """

    def __init__(
        self,
        scene: SceneModel,
        model: mjw.Model,
        data: mjw.Data,
        shots: Mapping[str, Shot],
        looks: Looks,
        *,
        nworld: int | None = None,
        where: str = "render",
        graph: bool = True,
    ) -> None:
        mjm, device = scene.mjm, model.qpos0.device
        self.model, self.nworld = model, nworld or data.nworld
        shots = in_model_order(mjm, shots, where)
        self.names = ("", *scene.bodies)
        numbers = {name: i for i, name in enumerate(self.names)}
        owner = [numbers[scene.owners.get(int(body), "")] for body in mjm.geom_bodyid]
        self._tracks = bool(np.isin([*mjm.cam_mode, *mjm.light_mode], _TRACKING).any())
        same = all(len(field) == 1 for field in (model.cam_fovy, model.cam_intrinsic))
        with wp.ScopedDevice(device):
            self._seen = _view(data, self.nworld, self._tracks)
            options = {"background_color": BACKGROUND, "use_precomputed_rays": same}
            self.context = picture_context(mjm, self.nworld, shots, looks, **options)
            self.mask = wp.full(self.nworld, value=True, dtype=wp.bool)
            self._owner = wp.array(owner, dtype=int)
            self._flat = {
                name: {
                    kind: wp.zeros((self.nworld, shot.size[0] * shot.size[1], CHANNELS[kind][0]), CHANNELS[kind][1])
                    for kind in shot.data
                }
                for name, shot in shots.items()
            }
        self.images = {
            name: {
                kind: flat.reshape((self.nworld, shot.size[1], shot.size[0], flat.shape[2]))
                for kind, flat in self._flat[name].items()
            }
            for name, shot in shots.items()
        }
        starts = (self.context.rgb_adr, self.context.depth_adr, self.context.seg_adr)
        self._starts = dict(zip(CHANNELS, (array.numpy().tolist() for array in starts), strict=True))
        self.launch = LaunchSequence(self._launch, device, graph=graph)

    def _launch(self) -> None:
        m, d, context = self.model, self._seen, self.context
        if self._tracks:
            mjw.com_pos(m, d)
        mjw.camlight(m, d)
        wp.launch(_turn_away, dim=(self.nworld, d.cam_xpos.shape[1]), inputs=[self.mask], outputs=[d.cam_xpos])
        mjw.refit_bvh(m, d, context)
        mjw.render(m, d, context)
        geom = int(mujoco.mjtObj.mjOBJ_GEOM)
        for i, of_camera in enumerate(self._flat.values()):
            for kind, out in of_camera.items():
                kernel, source, more = {
                    "rgb": (_write_rgb, context.rgb_data, []),
                    "depth": (_write_depth, context.depth_data, []),
                    "segmentation": (_write_segmentation, context.seg_data, [self._owner, geom]),
                }[kind]
                inputs = [self.mask, source, self._starts[kind][i], *more]
                wp.launch(kernel, dim=out.shape[:2], inputs=inputs, outputs=[out])


def _view(data: mjw.Data, nworld: int, tracks: bool) -> mjw.Data:
    """Return the first worlds of a Data, with arrays of their own for all that taking pictures computes."""
    view = copy.copy(data)
    view.nworld = nworld
    own = ("cam_xpos", "cam_xmat", "light_xpos", "light_xdir", *(("subtree_com", "cinert", "cdof") if tracks else ()))
    for name in own:
        setattr(view, name, wp.clone(getattr(data, name)))
    return view
