"""`Rendering`: shows the worlds of an environment in pictures, or on a web page in the browser."""

from importlib.metadata import entry_points
from typing import Any

import mujoco_warp as mjw
import numpy as np

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, MissingExtraError
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.pictures.camera import Cameras
from sceniris_gym.pictures.context import Looks, Shot
from sceniris_gym.sim.batch import Batch
from sceniris_gym.vector.settings import RenderConfig, as_size

RENDER_MODES = ["rgb_array", "human"]
"""Values of `render_mode`, in addition to None."""
PAGES = "sceniris_gym.pages"
"""The group of entry points that open the page of mode "human". This package's viewer registers one."""
_LOOKS = Looks(shadows=True)


class Rendering:
    """Takes pictures of the first worlds of a batch, or shows these worlds on a web page.

    Camera and page are made on first use.

    Args:
        mode: "rgb_array", "human" or None.
        num_envs: Number of worlds.
        config: Size, camera and number of worlds of the pictures.

    Raises:
        ArgumentError: `mode` has another value.
    """

    def __init__(self, mode: str | None, num_envs: int, config: RenderConfig) -> None:
        if mode not in (None, *RENDER_MODES):
            raise ArgumentError(f"render_mode should be one of {short(RENDER_MODES)} or None, got {short(mode)}.")
        self.mode, self.camera = mode, config.camera
        self.size = as_size(config.size, "render_config: size")
        self.worlds = min(config.num_envs or num_envs, num_envs)
        self._camera: Cameras | None = None
        self._window: Any = None

    def pictures(self, batch: Batch) -> tuple[np.ndarray, ...]:
        """Return a picture of each world, (height, width, 3) uint8. Waits for the device."""
        if self._camera is None:
            shots = {self.camera: Shot(self.size)}
            more: Any = {"nworld": self.worlds, "differ": (*batch.fields.rows, *batch.fields.varied)}
            self._camera = Cameras(batch.scene, batch.model, batch.data, shots, _LOOKS, **more)
        mjw.kinematics(batch.model, batch.data)  # a user may have written positions since the last step
        self._camera.launch()
        return tuple(self._camera.images[self.camera]["rgb"].numpy())

    def show(self, batch: Batch, layouts: Layouts, seconds: float) -> None:
        """Update the page in mode "human". In other modes, this method has no effect. Waits for the device.

        Args:
            batch: The worlds.
            layouts: The layouts of the worlds.
            seconds: Simulated time since the last call [s].

        Raises:
            MissingExtraError: The mode is "human", and the package that opens the page is not installed.
        """
        if self.mode != "human":
            return
        if self._window is None:
            self._window = _page()(batch.full_scene, self.worlds)
        self._window.show(batch, layouts, seconds)

    def close(self) -> None:
        """Release the camera, and close the page."""
        self._camera = None
        if self._window is not None:
            self._window.close()
            self._window = None


def _page() -> Any:
    found = tuple(entry_points(group=PAGES, name="human"))
    if not found:
        raise MissingExtraError("the viewer of this package", "viewer")
    return found[0].load()
