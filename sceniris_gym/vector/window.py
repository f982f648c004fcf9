"""The page of `render_mode="human"`, imported by its name: the viewer imports the environments."""

from __future__ import annotations

import importlib
from typing import Any, Protocol

import numpy as np

from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.batch import Batch

_VIEWER = "sceniris_gym.viewer.window"


class Window(Protocol):
    """Interface of the page for an environment; see `sceniris_gym.viewer.window`."""

    num: int

    def show(
        self, xpos: np.ndarray, xmat: np.ndarray, mocap_quat: np.ndarray, present: np.ndarray, seconds: float = 0.0
    ) -> None:
        """Show the worlds."""
        ...

    def close(self) -> None:
        """Close the page."""
        ...


def open_window(scene: SceneModel, num: int) -> Window:
    """Open a page that shows the first worlds of a batch.

    Raises:
        MissingExtraError: The extra `viewer` is not installed.
    """
    viewer: Any = importlib.import_module(_VIEWER)
    return viewer.Window(scene, num)


def show(window: Window, batch: Batch, layouts: Layouts, seconds: float) -> None:
    """Show the present state of a batch on the page. Waits for the device."""
    data, num = batch.data, window.num
    mocap = data.mocap_quat.numpy()[:num] if data.mocap_quat.size else np.zeros((num, 0, 4))
    window.show(data.xpos.numpy()[:num], data.xmat.numpy()[:num], mocap, layouts.present.numpy()[:num], seconds)
