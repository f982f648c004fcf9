"""`Window`: the page that shows the worlds of an environment for `render_mode="human"`."""

from __future__ import annotations

import sys
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.program.plan import slot_names
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.batch import Batch
from sceniris_gym.viewer.server import MOST_SHOWN, address, close_server, open_server
from sceniris_gym.viewer.worlds import Worlds

if TYPE_CHECKING:
    import viser


class Window:
    """Shows the first worlds of a batch, at most 64, and keeps to real time.

    Args:
        scene: The scene, with all variants, of which those that are absent are hidden.
        num: How many worlds there are.
        server: The page; None opens one, and says on stderr where it is.

    Raises:
        MissingExtraError: viser or mjviser is not installed.
    """

    def __init__(self, scene: SceneModel, num: int, server: viser.ViserServer | None = None) -> None:
        self.num = min(num, MOST_SHOWN)
        self.server = open_server() if server is None else server
        if server is None:
            print(f"sceniris_gym: the environment is shown at {address(self.server)}", file=sys.stderr, flush=True)
        self._worlds = Worlds(self.server, scene, self.num)
        self._worlds.aim()
        self._simulated = scene.sim_bodies
        mocap = np.flatnonzero(scene.mjm.body_mocapid >= 0)
        self._mocap = np.zeros(len(mocap), int)
        self._mocap[scene.mjm.body_mocapid[mocap]] = scene.sim.mjm.body_mocapid[scene.sim_bodies[mocap]]
        self._bodies = [scene.subtree(name) for name in slot_names(scene.config)]
        self._due = time.monotonic()

    def show(self, batch: Batch, layouts: Layouts, seconds: float) -> None:
        """Show the worlds as they are now, and wait until `seconds` have passed since they were shown last.

        Args:
            batch: The worlds. This waits for their device.
            layouts: Their layouts, which tell the objects that are present.
            seconds: Time that has passed in the worlds [s].
        """
        data = batch.data
        arrays = (data.xpos, data.xmat, data.mocap_quat, layouts.present)
        xpos, xmat, mocap_quat, present = (array.numpy() for array in arrays)
        xpos, xmat = xpos[:, self._simulated], xmat[:, self._simulated]
        mocap_quat = mocap_quat[:, self._mocap]
        for i in range(self.num):
            absent = [body for slot in np.flatnonzero(present[i] == 0) for body in self._bodies[slot]]
            self._worlds.put(i, SimpleNamespace(xpos=xpos[i], xmat=xmat[i], mocap_quat=mocap_quat[i]), absent)
        self._worlds.send()
        now = time.monotonic()
        self._due = max(self._due + seconds, now - seconds)  # a slow machine does not catch up
        time.sleep(max(self._due - now, 0.0))

    def close(self) -> None:
        """Close the page."""
        close_server(self.server)
