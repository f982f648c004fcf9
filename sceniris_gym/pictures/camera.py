"""`Cameras`: pictures of a batch from mujoco_warp's ray caster, on the device, without a window or OpenGL."""

import copy
import math
from collections.abc import Collection, Mapping

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.loading import on_missing
from sceniris_gym.device.sequence import LaunchSequence, compile_missing
from sceniris_gym.pictures.context import BACKGROUND, CHANNELS, Looks, Shot, in_model_order, picture_context, tile_rays
from sceniris_gym.program.checks.simulation import check_memory
from sceniris_gym.scene.model import SceneModel

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_TRACKING = (mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM, mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODYCOM)
_AWAY = wp.vec3(1e9, 1e9, 1e9)  # m, a ray from here misses the root box of its world, so that it costs no time


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
    pixel: wp.array[int],
    packed: wp.array2d[wp.uint32],
    first: int,
    # Out:
    rgb_out: wp.array3d[wp.uint8],
):
    worldid, rayid = wp.tid()
    if mask[worldid]:
        value = packed[worldid, first + rayid]
        rgb_out[worldid, pixel[rayid], 0] = wp.uint8((value >> wp.uint32(16)) & wp.uint32(255))
        rgb_out[worldid, pixel[rayid], 1] = wp.uint8((value >> wp.uint32(8)) & wp.uint32(255))
        rgb_out[worldid, pixel[rayid], 2] = wp.uint8(value & wp.uint32(255))


@wp.kernel
def _write_depth(
    # In:
    mask: wp.array[wp.bool],
    pixel: wp.array[int],
    depth: wp.array2d[float],
    first: int,
    # Out:
    depth_out: wp.array3d[float],
):
    worldid, rayid = wp.tid()
    if mask[worldid]:
        depth_out[worldid, pixel[rayid], 0] = depth[worldid, first + rayid]


@wp.kernel
def _write_segmentation(
    # In:
    mask: wp.array[wp.bool],
    pixel: wp.array[int],
    seen: wp.array2d[wp.vec2i],
    first: int,
    owner: wp.array[int],
    geom_type: int,
    # Out:
    segmentation_out: wp.array3d[int],
):
    worldid, rayid = wp.tid()
    if mask[worldid]:
        what = seen[worldid, first + rayid]
        number = int(0)
        if what[1] == geom_type:
            number = owner[what[0]]
        segmentation_out[worldid, pixel[rayid], 0] = number


class Cameras:
    """Cameras that take pictures of the worlds of a Data. They do not change the Data.

    Cameras read the poses of bodies and geoms in `data`, so run `mjw.kinematics` after a change of `qpos`. All cameras
    are rendered together. If model fields differ between worlds, each picture uses the values of its world.

    Args:
        scene: The scene.
        model: The scene's model on the device.
        data: The worlds.
        shots: The pictures to take, by camera.
        looks: Appearance of the pictures.
        nworld: Number of worlds to picture, starting with the first world. None: all worlds.
        differ: Names of model fields with a row per world. With one world, shapes do not show which fields these are.
        where: Beginning of error messages.
        graph: Capture the launches into a graph and replay it.

    Attributes:
        images: Latest pictures by camera and kind: rgb uint8, depth float32 [m, along the camera's axis, 0 for the
            background], segmentation int32 [index into `names`]. Shape (nworld, height, width, channels).
        mask: Worlds to picture at the next `launch`, shape (nworld,), bool. Initially all are True.
        names: Name of each segmentation value. Value 0 has the name "": the background, and geoms that belong to no
            object or robot. The other names are objects and robots.
        launch: Function that takes the pictures of the worlds in `mask`. Images of other worlds do not change. It does
            not wait for the device.

    Raises:
        UnknownNameError: The scene has no such camera.
        MemoryLimitError: The pictures do not fit into memory.
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
        differ: Collection[str] = (),
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
        needed = sum(fixed + self.nworld * world for fixed, world in (shot.memory for shot in shots.values()))
        check_memory(f"{where}: {self.nworld} pictures", needed, str(device), "Use smaller pictures, or fewer worlds.")
        same = not {"cam_fovy", "cam_intrinsic"} & {*differ}
        with wp.ScopedDevice(device):
            self._seen = _view(data, self.nworld, self._tracks)
            options = {"background_color": BACKGROUND, "use_precomputed_rays": same}
            self.context = picture_context(mjm, self.nworld, shots, looks, differ, **options)
            orders = (
                tile_rays(self.context, shots) if same else [np.arange(math.prod(shot.size)) for shot in shots.values()]
            )
            self._pixels = [wp.array(order, dtype=int) for order in orders]
            self.mask = wp.full(self.nworld, value=True, dtype=wp.bool)
            self._owner = wp.array(owner, dtype=int)
            self.images = {name: _images(self.nworld, shot) for name, shot in shots.items()}
        starts = (self.context.rgb_adr, self.context.depth_adr, self.context.seg_adr)
        self._starts = dict(zip(CHANNELS, (array.numpy().tolist() for array in starts), strict=True))
        with wp.ScopedDevice(device), on_missing(lambda _: compile_missing(self._launch, device)):
            self._launch()  # makes a kernel for this scene, which a capture does not permit
        self.launch = LaunchSequence(self._launch, device, graph=graph).replay

    def _launch(self) -> None:
        m, d, context = self.model, self._seen, self.context
        if self._tracks:
            mjw.com_pos(m, d)
        mjw.camlight(m, d)
        wp.launch(_turn_away, dim=(self.nworld, d.cam_xpos.shape[1]), inputs=[self.mask], outputs=[d.cam_xpos])
        mjw.refit_bvh(m, d, context)
        mjw.render(m, d, context)
        geom = int(mujoco.mjtObj.mjOBJ_GEOM)
        for i, of_camera in enumerate(self.images.values()):
            for kind, image in of_camera.items():
                out = image.reshape((self.nworld, image.shape[1] * image.shape[2], image.shape[3]))
                kernel, source, more = {
                    "rgb": (_write_rgb, context.rgb_data, []),
                    "depth": (_write_depth, context.depth_data, []),
                    "segmentation": (_write_segmentation, context.seg_data, [self._owner, geom]),
                }[kind]
                inputs = [self.mask, self._pixels[i], source, self._starts[kind][i], *more]
                wp.launch(kernel, dim=out.shape[:2], inputs=inputs, outputs=[out])


def _images(nworld: int, shot: Shot) -> dict[str, wp.array]:
    """Return the pictures of a camera by kind, all zeros."""
    width, height = shot.size
    return {kind: wp.zeros((nworld, height, width, CHANNELS[kind][0]), CHANNELS[kind][1]) for kind in shot.data}


def _view(data: mjw.Data, nworld: int, tracks: bool) -> mjw.Data:
    """Return a view of the first `nworld` worlds of a Data. The arrays that rendering changes are copies."""
    view = copy.copy(data)
    view.nworld = nworld
    own = ("cam_xpos", "cam_xmat", "light_xpos", "light_xdir", *(("subtree_com", "cinert", "cdof") if tracks else ()))
    for name in own:
        setattr(view, name, wp.clone(getattr(data, name)))
    return view
