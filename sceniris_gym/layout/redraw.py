"""`Redraw`: new places for some objects of a scene, while all else stays where it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import warp as wp

from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.device.random import SPLITS
from sceniris_gym.layout.given import State, anchors_of, launch_read_anchors, launch_read_state, tree_of
from sceniris_gym.layout.layouts import Layouts, LayoutsView, Status
from sceniris_gym.program.compiled import CompiledScene

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _finish(
    mask: wp.array[bool],
    # State in:
    seed: wp.array[wp.uint64],
    episode: wp.array[int],
    present: wp.array2d[int],
    qpos: wp.array2d[float],
    mocap_pos: wp.array2d[wp.vec3],
    mocap_quat: wp.array2d[wp.quat],
    # Layouts in: status
    # Layouts out: seed, episode, qpos, mocap_pos, mocap_quat, status, present
    layouts: LayoutsView,
    # Out:
    placed_out: wp.array[bool],
):
    worldid = wp.tid()
    placed_out[worldid] = False
    if mask:
        if not mask[worldid]:
            return
    layouts.seed[worldid] = seed[worldid]
    layouts.episode[worldid] = episode[worldid]
    if layouts.status[worldid] == Status.VALID:
        placed_out[worldid] = True
        return
    layouts.status[worldid] = Status.KEPT
    for i in range(layouts.present.shape[1]):
        layouts.present[worldid, i] = present[worldid, i]
    for i in range(layouts.qpos.shape[1]):
        layouts.qpos[worldid, i] = qpos[worldid, i]
    for i in range(mocap_pos.shape[1]):
        layouts.mocap_pos[worldid, i] = mocap_pos[worldid, i]
        layouts.mocap_quat[worldid, i] = mocap_quat[worldid, i]


class Redraw(StaysHere):
    """A search for new places of some objects among everything else, which it reads from a state.

    A redraw is a pure function of scene, split, seed, episode, number of the redraw and state. Everything but the named
    objects is an obstacle, a support if it is level, and an anchor of relations. Absent objects stay absent.

    Args:
        compiled: The scene.
        objects: The objects, as from `chosen_objects`.
        split: "train" or "eval".
        layouts: Layouts of the part of the scene that places these objects alone; see `part_of`.
        make: Launches that make them for the masked worlds, after others that fill their rows.

    Attributes:
        bodies: Ids of the bodies of the objects.
        layouts: The worlds after their latest redraw. `status` is VALID, or KEPT where nothing fitted.
        placed: The worlds of the latest redraw in which all objects have new places, shape (nworld,), bool.
    """

    def __init__(
        self,
        compiled: CompiledScene,
        objects: Sequence[str],
        split: str,
        layouts: Layouts,
        make: Callable[[wp.array | None, Callable[[], None]], None],
    ) -> None:
        self.bodies = [body for name in objects for body in compiled.scene.subtree(name)]
        self.layouts, self._make = layouts, make
        self._program, self._split, self._device = layouts.compiled.program, SPLITS[split], compiled.device
        self._tree, self._anchors = tree_of(compiled, self.bodies), anchors_of(compiled, objects)
        slots = [compiled.slots.index(name) for name in objects]
        with wp.ScopedDevice(self._device):
            self._slots, self.placed = wp.array(slots, dtype=int), wp.zeros(layouts.nworld, dtype=wp.bool)

    def launch(
        self,
        state: State,
        mask: wp.array | None,
        *,
        number: wp.array | None = None,
        origins: wp.array | None = None,
        adds: bool = False,
    ) -> None:
        """Redraw the objects in the masked worlds.

        Args:
            state: What all else is read from.
            mask: Which worlds, shape (nworld,), bool; all if None.
            number: Redraws of each world since its reset, without this one, shape (nworld,), int32; None for number 0.
            origins: Origins of the worlds [m], shape (nworld,), vec3, which the state has and layouts do not.
            adds: Make the objects present that are not.
        """
        view, added = self.layouts.view, self._slots if adds else None

        def prepare() -> None:
            launch_read_state(self._tree, state, mask, self._split, view, number, origins, added)
            if self._anchors is not None:
                launch_read_anchors(self._program, self._anchors, mask, view)

        self._make(mask, prepare)
        wp.launch(_finish, view.seed.shape[0], [mask, *state, view], [self.placed], device=self._device)
