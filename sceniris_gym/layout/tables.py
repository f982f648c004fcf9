"""Layouts of a LayoutGenerator as a LayoutTable on the host, in any number, or by seed on the device."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import warp as wp

from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.sequence import launching
from sceniris_gym.errors import check_type
from sceniris_gym.layout.columns import columns, row_types
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.masks import as_count
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable
from sceniris_gym.scene.poses import body_poses, product, rotated

CHUNK = 4096  # layouts made in one batch


def read_table(generator: LayoutGenerator, nrow: int | None = None) -> LayoutTable:
    """Copy the first `nrow` layouts of a LayoutGenerator to the host, or all layouts by default.

    Raises:
        ArgumentTypeError: Not a LayoutGenerator.
        ArgumentError: `nrow` is not an integer of at least 0.
    """
    check_type(generator, LayoutGenerator, "read_table: generator")
    nrow = nrow if nrow is None else as_count(nrow, "read_table: nrow", 0)
    layouts = generator.layouts
    types = row_types(generator.compiled, nvalue=layouts.param.shape[1])

    def read(name: str) -> np.ndarray:
        dtype, shape = types[name]  # astype also copies: on a CPU, `numpy()` is a view that the next reset overwrites
        return getattr(layouts, name).numpy()[(slice(nrow), *map(slice, shape))].astype(dtype)

    rows = {name: read(name) for name in columns()}
    table = LayoutTable(
        **rows,
        valid=rows["status"] == LayoutStatus.VALID,
        grasp_pose=COLUMNS["grasp_pose"].blanks(0),
        scene=generator.compiled.hash,
        split=generator.split,
        params=layouts.params.names,
    )
    return replace(table, grasp_pose=grasp_poses(generator.compiled, table, table.grasp))


@dataclass(frozen=True)
class RejectedCandidates:
    """The recorded rejected candidates of a LayoutGenerator.

    Attributes:
        objects: Index in placement order of each candidate's object, shape (n,).
        causes: `Cause` of each rejection, shape (n,).
        states: State of the layout with each candidate, one row per candidate. All objects are marked as present.
    """

    objects: np.ndarray
    causes: np.ndarray
    states: LayoutTable


def read_rejected(generator: LayoutGenerator) -> RejectedCandidates:
    """Copy the rejected candidates of a LayoutGenerator made with `rejected` to the host."""
    view, nmocap = generator.layouts.view, generator.compiled.mjm.nmocap
    objects = view.rejected_object.numpy()
    count = min(int(view.rejected_count.numpy()[0]), len(objects))
    qpos, pos, quat = (
        a.numpy()[:count].copy() for a in (view.rejected_qpos, view.rejected_mocap_pos, view.rejected_mocap_quat)
    )
    present = np.ones((count, len(generator.compiled.slots)), bool)
    states = LayoutTable.from_states(qpos, pos[:, :nmocap], quat[:, :nmocap], present)
    return RejectedCandidates(objects[:count].copy(), view.rejected_cause.numpy()[:count].copy(), states)


def grasp_poses(compiled: CompiledScene, table: LayoutTable, grasp: np.ndarray) -> np.ndarray:
    """Return the TCP poses of grasps in the world frame, shape (nrow, nreach, 7), float32.

    Position [m] and orientation (wxyz), NaN for rows without a grasp.

    Args:
        compiled: The compiled scene.
        table: The layouts.
        grasp: Index of the grasp of each reachable object, -1 without a grasp, shape (nrow, nreach).
    """
    poses = np.full((*grasp.shape, 7), np.nan, np.float32)
    if compiled.reaching is None:
        return poses
    for k, target in enumerate(compiled.reaching.targets):
        grasps, chosen = target.grasp_set.grasps, grasp[:, k]
        bodies, places = np.array([g.body for g in grasps]), np.array([g.pos for g in grasps])
        rotations = np.array([g.quat for g in grasps])
        for body in np.unique(bodies):
            rows = np.flatnonzero((chosen >= 0) & (bodies[chosen] == body))
            states = (column[rows] for column in (table.qpos, table.mocap_pos, table.mocap_quat))
            pos, quat = body_poses(compiled.mjm, int(body), *states)
            poses[rows, k, :3] = pos + rotated(places[chosen[rows]], quat)
            poses[rows, k, 3:] = product(quat, rotations[chosen[rows]])
    return poses


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
        yield read_table(generator, len(part))


PARTS = ("qpos", "mocap_pos", "mocap_quat", "status")
"""The columns that `RequestedLayouts` writes."""


class RequestedLayouts(StaysHere):
    """Layouts by their seeds and episodes. Unlike a generator's, they do not depend on earlier calls.

    Args:
        compiled: The scene.
        nworld: Number of layouts per call.
        split: "train" or "eval". The splits share no layouts.

    Raises:
        ScenirisError: As in `LayoutGenerator`.
    """

    _SEND = "the CompiledScene, and make new ones there"

    @launching
    def __init__(self, compiled: CompiledScene, nworld: int, split: str = "train") -> None:
        self._generator = LayoutGenerator(compiled, nworld, split=split)
        self._parts = [getattr(self._generator.layouts, name) for name in PARTS]
        self._start = [wp.clone(part) for part in self._parts]
        self._generator.generate(wp.zeros(nworld, dtype=wp.bool, device=compiled.device))  # records its graph
        wp.synchronize_device(compiled.device)  # later launches use other streams, which do not wait for this stream

    @launching
    def launch(self, seed: wp.array, episode: wp.array, mask: wp.array, *outputs: wp.array) -> None:
        """Write layouts into the masked rows and the start pose into the other rows, on the current stream.

        Args:
            seed: The low and the high 32 bits of each seed, shape (nworld, 2), uint32.
            episode: Episodes from 0 on, shape (nworld,), int32.
            mask: Rows that get a layout, shape (nworld,), bool.
            *outputs: Four arrays. (1) Joint positions [m, rad], quaternions wxyz, shape (nworld, nq). (2) Positions of
                mocap bodies [m], shape (nworld, nmocap), vec3. (3) Orientations of mocap bodies, wxyz inside `wp.quat`,
                shape (nworld, nmocap). (4) `LayoutStatus` of each layout, NONE for the start pose, shape (nworld,),
                int32.
        """
        generator = self._generator
        seeds = wp.array(ptr=seed.ptr, dtype=wp.uint64, shape=generator.nworld, device=mask.device)
        generator.launch_reseed(seeds, None, episode)
        for part, start in zip(self._parts, self._start, strict=True):
            wp.copy(part, start)
        generator.generate(mask)
        for part, output in zip(self._parts, outputs, strict=True):
            if output.size > 0:  # layouts have an unused mocap body in models without
                wp.copy(output, part)
