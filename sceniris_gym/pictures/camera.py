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
_AWAY = wp.vec3(1e9, 1e9, 1e9)  # m; from there every ray misses the boxes around a world at once


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


def picture_context(mjm: mujoco.MjModel, nworld: int, shots: Mapping[str, Shot], **options: Any) -> Any:
    """Return mujoco_warp's context for pictures of cameras in the model's order; with shadows by default."""
    flags = {"rgb": "render_rgb", "depth": "render_depth", "segmentation": "render_seg"}
    wanted = {flag: [kind in shot.data for shot in shots.values()] for kind, flag in flags.items()}
    sizes = [shot.size for shot in shots.values()]
    options = {"use_shadows": True, "enabled_geom_groups": list(VISIBLE_GROUPS), **options}
    return render_context(mjm, nworld, list(shots), cam_res=sizes, **wanted, **options)


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
        nworld: Number of worlds in pictures, from the first one on; None is all.
        where: Beginning of an error message.
        shadows: Draw shadows.
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
        *,
        nworld: int | None = None,
        where: str = "render",
        shadows: bool = True,
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
            options = {"background_color": BACKGROUND, "use_shadows": shadows, "use_precomputed_rays": same}
            self.context = picture_context(mjm, self.nworld, shots, **options)
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
