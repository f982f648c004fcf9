"""Make any number of layouts as a LayoutTable on the host, or make layouts by seed and episode on the device."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import warp as wp

from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.sequence import launching
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import column_of
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable

CHUNK = 4096  # layouts made in one batch


class RejectedCandidates(NamedTuple):
    """The recorded rejected candidates of a LayoutGenerator.

    Attributes:
        objects: Index in placement order of each candidate's object, shape (n,).
        causes: `Cause` of each rejection, shape (n,).
        states: State of the layout with the rejected candidate in its place, one row per candidate. All objects are
            marked as present.
    """

    objects: np.ndarray
    causes: np.ndarray
    states: LayoutTable


def read_rejected(generator: LayoutGenerator) -> RejectedCandidates:
    """Copy the recorded rejected candidates of a LayoutGenerator to the host."""
    view, nmocap = generator.layouts.view, generator.compiled.mjm.nmocap
    count = min(int(view.rejected_count.numpy()[0]), len(view.rejected_object))
    names = ("object", "cause", "qpos", "mocap_pos", "mocap_quat")
    objects, causes, qpos, pos, quat = (getattr(view, f"rejected_{name}").numpy()[:count].copy() for name in names)
    present = np.ones((count, len(generator.compiled.slots)), bool)
    states = LayoutTable.from_states(qpos, pos[:, :nmocap], quat[:, :nmocap], present)
    return RejectedCandidates(objects, causes, states)


def make_table(compiled: CompiledScene, n: int, seed: int, *, split: str = "train", chunk: int = CHUNK) -> LayoutTable:
    """Make n layouts. Row i is episode 0 of seed + i, independent of `n` and `chunk`.

    Args:
        compiled: The compiled scene.
        n: Number of layouts.
        seed: Seed of the first row.
        split: "train" or "eval".
        chunk: Number of layouts in one batch.

    Raises:
        ArgumentError: The seed is not a 64-bit integer.
    """
    generator = LayoutGenerator(compiled, min(chunk, n), split=split)
    return LayoutTable.concatenate(list(make_tables(generator, as_seeds(seed, n))))


def make_tables(generator: LayoutGenerator, seeds: np.ndarray) -> Iterator[LayoutTable]:
    """Yield tables with episode 0 of each seed, shape (n,), uint64. Each table has up to one row per world."""
    nworld = generator.nworld
    for start in range(0, len(seeds), nworld):
        part = seeds[start : start + nworld]
        generator.reseed(seed=np.resize(part, nworld))
        generator.generate(wp.array(np.arange(nworld) < len(part), dtype=bool, device=generator.compiled.device))
        yield generator.table(len(part))


PARTS = ("qpos", "mocap_pos", "mocap_quat", "status")
"""The columns that `RequestedLayouts` writes."""


class RequestedLayouts(StaysHere):
    """Makes layouts with given seeds and episodes. Unlike with a generator, earlier calls do not affect the layouts.

    Args:
        compiled: The scene.
        nworld: Number of layouts per call.
        split: "train" or "eval". The splits share no layouts.

    Raises:
        ScenirisError: As in `LayoutGenerator`.
    """

    _SEND = "its CompiledScene to the other process, and construct a new object there"

    @launching
    def __init__(self, compiled: CompiledScene, nworld: int, split: str = "train") -> None:
        self._generator = LayoutGenerator(compiled, nworld, split=split)
        self._parts = [column_of(self._generator.layouts, name) for name in PARTS]
        self._start = [wp.clone(part) for part in self._parts]
        self._generator.generate(wp.zeros(nworld, dtype=wp.bool, device=compiled.device))  # records its graph
        wp.synchronize_device(compiled.device)  # later launches use other streams, which do not wait for this stream

    @launching
    def launch(self, seed: wp.array, episode: wp.array, mask: wp.array, *outputs: wp.array) -> None:
        """Write layouts into the masked rows and the home pose into the other rows, on the current stream.

        Args:
            seed: The low and the high 32 bits of each seed, shape (nworld, 2), uint32.
            episode: Episodes from 0 on, shape (nworld,), int32.
            mask: Rows that get a layout, shape (nworld,), bool.
            *outputs: Four arrays. (1) Joint positions [m, rad], quaternions wxyz, shape (nworld, nq). (2) Positions of
                mocap bodies [m], shape (nworld, nmocap), vec3. (3) Orientations of mocap bodies, wxyz inside `wp.quat`,
                shape (nworld, nmocap). (4) `LayoutStatus` of each layout, NONE for the home pose, shape (nworld,),
                int32.
        """
        generator = self._generator
        seeds = wp.array(ptr=seed.ptr, dtype=wp.uint64, shape=generator.nworld, device=mask.device)
        generator.launch_reseed(seeds, None, episode)
        for part, start in zip(self._parts, self._start, strict=True):
            wp.copy(part, start)
        generator.generate(mask)
        for part, output in zip(self._parts, outputs, strict=True):
            if output.size > 0:  # layouts of a model without mocap bodies have an unused one
                wp.copy(output, part)
