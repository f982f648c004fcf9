"""`DrawnMasses`: masses and centres of mass of a scene's draws, for the test of standing."""

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

_ARRAYS = {"body_mass": "body_weight", "body_ipos": "body_center"}


class DrawnMasses:
    """Draws masses and centres of mass by the words of a scene, as resets will draw them for the same layouts.

    Args:
        compiled: The scene.
        nworld: Number of worlds.
        split: "train" or "eval".
        knobs: The knobs of the worlds.

    Attributes:
        statics: How objects stand, with a row of these for each world if any are drawn; None if nothing can fall.
    """

    def __init__(self, compiled: CompiledScene, nworld: int, split: str, knobs: KnobTable) -> None:
        self.statics, self._split, self._drawer = compiled.statics, split, None
        nominal = compiled.statics
        # inertias decide nothing here
        draws = [replace(d, word=replace(d.word, follow=())) for d in compiled.scene.draws if d.word.field in _ARRAYS]
        if nominal is None or not draws:
            return
        self.statics = copied(Statics, nominal)
        rows = {name: np.repeat(getattr(nominal, name).numpy(), nworld, axis=0) for name in _ARRAYS.values()}
        fill_struct(Statics, self.statics, rows, compiled.device)
        arrays = {field: getattr(self.statics, name) for field, name in _ARRAYS.items()}
        values = {field: getattr(nominal, name) for field, name in _ARRAYS.items()}
        self._drawer = FieldDrawer(tuple(draws), arrays, values, nworld)
        self._drawer.use_knobs(knobs)

    def launch(self, mask: wp.array | None, layouts: LayoutsView) -> None:
        """Draw them for the layouts that are being made in the masked worlds, in all of them if there is no mask."""
        if self._drawer is not None:
            pending = layouts.pending_seed, layouts.pending_episode
            self._drawer.launch(mask, *pending, self._split, knob=layouts.next_knob)
