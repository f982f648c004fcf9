"""`ResetWriter`: writes rows of layouts into the masked worlds, and draws the physics that belong to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco_warp as mjw
import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.contacts import ContactList
from sceniris_gym.sim.model_fields import ModelFields
from sceniris_gym.sim.rest import RestMap, close_grippers
from sceniris_gym.sim.variants import VariantWriter
from sceniris_gym.sim.versions import keyframe_plastic
from sceniris_gym.sim.write import StateWriter, poses_of


@dataclass(frozen=True)
class Simulation:
    """The worlds of a scene, and what belongs to all that is written into them.

    Attributes:
        compiled: The scene.
        model: Its model.
        data: Data of the worlds; its arrays are used in place.
        split: The split of the layouts.
        rest: Controls and activations at rest.
        refresh: Launches that follow, and bring up to date what is computed from the state.
        origins: Origins of the worlds [m], shape (nworld,), vec3; None adds nothing.
        variants: The writer of variants, None in a scene without.
    """

    compiled: CompiledScene
    model: mjw.Model
    data: mjw.Data
    split: str
    rest: RestMap
    refresh: Callable[[], None]
    origins: wp.array | None = None
    variants: VariantWriter | None = None


class ResetWriter:
    """Writer of all that a reset changes in the masked worlds.

    Args:
        simulation: The worlds.
        fields: The fields of the model that have a row for each world.
        mask: The worlds to write into, shape (nworld,), bool; read at every launch.
        whole: Reset worlds as a whole, rather than the objects and robots of the scene alone.
        count: A count of each world that begins at 0 again, shape (nworld,), int32.

    Attributes:
        variants: The writer of variants, None in a scene without.
        variant: The variant of each object that is present, as `VariantWriter.variant`.
    """

    def __init__(
        self, simulation: Simulation, fields: ModelFields, mask: wp.array, *, whole: bool, count: wp.array
    ) -> None:
        self._simulation, self._fields, self._mask, self._whole = simulation, fields, mask, whole
        compiled, d, self.variants = simulation.compiled, simulation.data, simulation.variants
        self._has_starts = bool(compiled.config.start)
        scene, mjm = compiled.scene.sim, compiled.sim_mjm
        with wp.ScopedDevice(d.qpos.device):
            self._nacon = wp.zeros_like(d.nacon)
            self.variant = wp.zeros((d.nworld, 0), dtype=int) if self.variants is None else self.variants.variant
        plastic = keyframe_plastic(mjm, scene.keyframe) if whole and scene.keyframe >= 0 else None
        bodies = None if whole else [body for name in scene.bodies for body in scene.subtree(name)]
        self._contacts = ContactList(d, mask)
        close_grippers(simulation.rest, compiled)
        words = {"bodies": bodies, "origins": simulation.origins, "plastic": plastic, "count": count}
        self._writer = StateWriter(mjm, d, mask, simulation.rest, **words)

    def launch(self, layouts: LayoutsView, rows: wp.array | None = None) -> None:
        """Write layouts into the masked worlds.

        Args:
            layouts: The layouts, with their knobs; without these they have those of the scene file.
            rows: Row of `layouts` for every masked world, shape (nworld,), int32; None gives world i row i.
        """
        m, d, poses, pose_rows = self._simulation.model, self._simulation.data, poses_of(layouts), rows
        if self.variants is not None:
            poses, pose_rows = self.variants.launch(poses, self._mask, layouts.present, rows), None
        self._fields.launch_draw(self._mask, layouts, rows)
        self._contacts.launch_drop()
        if self._whole:
            # reset_data zeroes the contact count of all worlds when it resets world 0
            wp.copy(self._nacon, d.nacon)
            mjw.reset_data(m, d, reset=self._mask)
            wp.copy(d.nacon, self._nacon)
        self._writer.launch(poses, pose_rows, layouts.start if self._has_starts else None, rows)
        self._fields.launch_wait()
        self._simulation.refresh()
