"""`FrameCamera`: pictures of the first worlds of a batch, by mujoco_warp's ray caster without a window or OpenGL."""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.scene.assemble import MARK_GROUP
from sceniris_gym.sim.versions import render_context

VISIBLE_GROUPS = (0, 1, 2, MARK_GROUP)
"""Geom groups in pictures: those that MuJoCo's viewer shows, and markers."""

BACKGROUND = (0.93, 0.95, 0.97, 1.0)


def picture_context(mjm: mujoco.MjModel, nworld: int, camera: str, size: tuple[int, int], **options: Any) -> Any:
    """Return mujoco_warp's context for pictures of `size` (width and height in pixels) by one camera, with shadows.

    Raises:
        UnknownNameError: The model has no such camera.
    """
    cameras = [mjm.camera(i).name for i in range(mjm.ncam)]
    if camera not in cameras:
        raise UnknownNameError("camera", camera, "render", filter(None, cameras))
    options |= {"render_rgb": True, "render_depth": False, "render_seg": False, "use_shadows": True}
    return render_context(mjm, nworld, camera, cam_res=size, enabled_geom_groups=list(VISIBLE_GROUPS), **options)


class FrameCamera:
    """Takes pictures of the first worlds of a batch, on a CPU or a GPU. It has its own Data and changes no other.

    Args:
        mjm: The model on the host.
        model: The same model on the device.
        nworld: Number of worlds in pictures.
        width: Width of a picture [pixels].
        height: Height of a picture [pixels].
        camera: Name of the camera.

    Raises:
        UnknownNameError: The scene has no such camera.
    """

    def __init__(
        self, mjm: mujoco.MjModel, model: mjw.Model, nworld: int, width: int, height: int, camera: str = "overview"
    ) -> None:
        self.model, self.nworld, self.width, self.height = model, nworld, width, height
        self.device: wp.Device = model.qpos0.device
        with wp.ScopedDevice(self.device):
            self.data = mjw.make_data(mjm, nworld, nconmax=1, njmax=1)
            # rays are found once for all worlds, unless their fields of view differ
            rays = {} if model.cam_fovy.shape[0] == 1 else {"use_precomputed_rays": False}
            self.context = picture_context(mjm, nworld, camera, (width, height), background_color=BACKGROUND, **rays)

    def take(self, source: mjw.Data) -> np.ndarray:
        """Return pictures of the first worlds of `source`, (nworld, height, width, 3) uint8. Waits for the device."""
        m, d = self.model, self.data
        with wp.ScopedDevice(self.device):
            wp.copy(d.qpos, source.qpos[: self.nworld])
            if m.nmocap:  # an empty array cannot be sliced
                wp.copy(d.mocap_pos, source.mocap_pos[: self.nworld])
                wp.copy(d.mocap_quat, source.mocap_quat[: self.nworld])
            for stage in (mjw.kinematics, mjw.com_pos, mjw.camlight):  # a tracking camera follows centres of mass
                stage(m, d)
            mjw.refit_bvh(m, d, self.context)
            mjw.render(m, d, self.context)
        packed = self.context.rgb_data.numpy().reshape(self.nworld, self.height, self.width)
        return np.stack([(packed >> shift) & 0xFF for shift in (16, 8, 0)], axis=-1).astype(np.uint8)
