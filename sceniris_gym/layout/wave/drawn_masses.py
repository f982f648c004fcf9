"""`DrawnMasses`: masses and centres of mass that differ between worlds, for the test of standing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import warp as wp

from sceniris_gym.layout.field_drawer import FieldDrawer
from sceniris_gym.layout.knobs import KnobTable
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import copied, fill_struct
from sceniris_gym.program.device_statics import Statics

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_ARRAYS = {"body_mass": "body_weight", "body_ipos": "body_center"}


@wp.kernel
def _read_masses(
    mask: wp.array[wp.bool],
    bodies: wp.array[int],
    share: wp.array[float],
    mass: wp.array2d[float],
    center: wp.array2d[wp.vec3],
    # Out:
    weight_out: wp.array2d[float],
    center_out: wp.array2d[wp.vec3],
):
    worldid, body = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    weight_out[worldid, body] = share[body] * mass[worldid % mass.shape[0], bodies[body]]
    center_out[worldid, body] = center[worldid % center.shape[0], bodies[body]]


class DrawnMasses:
    """Masses and centres of mass of each world: drawn as resets will draw them for the same layouts, or read.

    Args:
        compiled: The scene.
        nworld: Number of worlds.
        knobs: The knobs of the worlds.
        given: `body_mass` and `body_ipos` of the Model of the worlds, whoever wrote these; None draws them.

    Attributes:
        statics: How objects stand, with a row of these for each world if they differ; None if nothing can fall.
    """

    def __init__(
        self, compiled: CompiledScene, nworld: int, knobs: KnobTable, given: tuple[wp.array, wp.array] | None = None
    ) -> None:
        self._drawer, self._given = None, None
        self.statics = nominal = compiled.statics
        # inertias decide nothing here
        draws = [replace(d, word=replace(d.word, follow=())) for d in compiled.scene.draws if d.word.field in _ARRAYS]
        if nominal is None or (max(a.shape[0] for a in given) == 1 if given else not draws):
            return
        self.statics = copied(Statics, nominal)
        rows = {name: np.repeat(getattr(nominal, name).numpy(), nworld, axis=0) for name in _ARRAYS.values()}
        fill_struct(Statics, self.statics, rows, compiled.device)
        if given is not None:
            mass, weight = compiled.mjm.body_mass, nominal.body_weight.numpy()[0]
            share = np.divide(weight, mass, out=np.zeros(len(mass)), where=mass > 0.0)
            with wp.ScopedDevice(compiled.device):
                self._given = [wp.array(compiled.scene.sim_bodies, dtype=int), wp.array(share, dtype=float), *given]
            return
        arrays = {field: getattr(self.statics, name) for field, name in _ARRAYS.items()}
        values = {field: getattr(nominal, name) for field, name in _ARRAYS.items()}
        self._drawer = FieldDrawer(tuple(draws), arrays, values, nworld)
        self._drawer.use_knobs(knobs)

    def launch(self, mask: wp.array | None, layouts: LayoutsView) -> None:
        """Find them for the layouts that are being made in the masked worlds, in all of them if there is no mask."""
        if self._given is not None and self.statics is not None:
            out = [self.statics.body_weight, self.statics.body_center]
            wp.launch(_read_masses, out[0].shape, inputs=[mask, *self._given], outputs=out, device=out[0].device)
        elif self._drawer is not None:
            key = layouts.draw_seed, layouts.draw_episode, layouts.draw_stream
            self._drawer.launch(mask, *key, knob=layouts.next_knob)
