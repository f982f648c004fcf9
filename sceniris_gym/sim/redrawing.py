"""`Redrawer`: moves objects to new places in the middle of episodes, in the simulation's Data."""

import copy
from collections.abc import Sequence
from functools import partial

import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.device.tensors import TensorView
from sceniris_gym.errors import ArgumentError, as_names
from sceniris_gym.layout.generate import make_redraw
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.layout.masks import fill_mask
from sceniris_gym.layout.redraw import RedrawCounts
from sceniris_gym.program.device import copied
from sceniris_gym.program.part import chosen_objects
from sceniris_gym.sim.reset_writer import Simulation
from sceniris_gym.sim.variants import VariantReader
from sceniris_gym.sim.versions import sleeps
from sceniris_gym.sim.write import StateWriter, poses_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def _wake(mask: wp.array[wp.bool], trees: wp.array[int], tree_awake_out: wp.array2d[int]):
    worldid, i = wp.tid()
    if mask[worldid]:
        tree_awake_out[worldid, trees[i]] = 1  # the next step also wakes the trees that sleep together with this tree


class Redrawer:
    """Moves objects to new valid places in the masked worlds. All other state stays bitwise unchanged.

    Args:
        simulation: The worlds.
        layouts: The latest layouts of the worlds.
        alone: If true, a redraw updates only the world poses of the redrawn bodies. If false, it calls
            `simulation.refresh`.
        graph: If true, the launches are captured into a graph, which later redraws replay.

    Attributes:
        mask: The worlds of the latest redraw, shape (nworld,), bool. Passing it to `launch` avoids a copy.
        counts: Warp arrays with the same values and memory as the tensors `number`, `status` and `kept`.
        number: Redraws of each world since its reset, shape (nworld,), int32.
        status: `LayoutStatus` of each world's latest redraw, VALID or KEPT, or NONE before the first redraw, shape
            (nworld,), int32.
        kept: Running count of redraws that found no place, shape (1,), int32.
        prepared: The LaunchSequence of each tuple of object names that a caller has passed to `launch`.
    """

    number, status, kept = (TensorView(lambda redrawer, name: getattr(redrawer.counts, name)) for _ in range(3))

    def __init__(self, simulation: Simulation, layouts: Layouts, *, alone: bool = False, graph: bool) -> None:
        self._simulation, self._layouts, self._alone, self._graph = simulation, layouts, alone, graph
        self._where = f"{simulation.compiled.config.where}: redraw"  # reading a config attribute takes 10 us
        self.prepared: dict[tuple[str, ...], LaunchSequence] = {}
        nworld, self._device = simulation.data.nworld, simulation.data.qpos.device
        self.mask = wp.zeros(nworld, dtype=wp.bool, device=self._device)
        self.counts = RedrawCounts.zeros(nworld, self._device)

    def launch(self, objects: str | Sequence[str], mask: wp.array | None) -> None:
        """Redraw objects in the masked worlds. The first call for a set of objects prepares their search.

        Args:
            objects: One name or several.
            mask: Selected worlds, on the device, shape (nworld,), bool. None selects all.

        Raises:
            ArgumentTypeError, UnknownNameError: As `chosen_objects`.
            ArgumentError: As `chosen_objects`, or the first call for these objects is inside a capture.
        """
        key = as_names(objects, f"{self._where}: objects")
        if key not in self.prepared:
            names = chosen_objects(self._simulation.compiled, key, self._where)
            if self._device.is_capturing:
                cure = "redraw these objects once before the capture, because the first call prepares their search."
                raise ArgumentError(f"{self._where}: {cure}")
            self.prepared[key] = self._prepare(names)
        fill_mask(mask, self.mask)
        self.prepared[key].replay()

    def _prepare(self, names: tuple[str, ...]) -> LaunchSequence:
        """Return the launches that draw new places of the objects, write the poses, and count the redraw."""
        simulation, device = self._simulation, self._device
        compiled, d, variants = simulation.compiled, simulation.data, simulation.variants
        masses, mjm = (simulation.model.body_mass, simulation.model.body_ipos), compiled.sim_mjm
        redraw = make_redraw(compiled, names, d.nworld, simulation.split, masses)
        found, state, reader = redraw.layouts, copied(LayoutsView, self._layouts.view), None
        if variants is None:
            state.qpos, state.mocap_pos, state.mocap_quat = d.qpos, d.mocap_pos, d.mocap_quat
        else:
            reader = VariantReader(d, variants, self._layouts.view)
            state = reader.state
        bodies = np.unique(compiled.scene.sim_bodies[redraw.bodies])
        writer = StateWriter(mjm, d, redraw.placed, simulation.rest, bodies=bodies.tolist(), origins=simulation.origins)
        moved = np.unique(mjm.body_treeid[bodies]) if sleeps(simulation.model) else np.zeros(0, int)
        trees = wp.array(moved[moved >= 0], dtype=int, ndim=1, device=device)
        refresh = simulation.refresh
        if self._alone:
            refresh = partial(mjw.kinematics, *_views_of(simulation.model, d, bodies))

        def launches() -> None:
            if reader is not None:
                reader.launch(self.mask)
            redraw.launch(state, self.mask, self.counts, simulation.origins)
            poses = poses_of(found.view)
            writer.launch(poses if variants is None else variants.launch(poses, redraw.placed))
            if trees.shape[0] > 0:
                wp.launch(_wake, (d.nworld, trees.shape[0]), [self.mask, trees], [d.tree_awake], device=device)
            refresh()

        return LaunchSequence(launches, device, graph=self._graph)


def _views_of(m: mjw.Model, d: mjw.Data, bodies: np.ndarray) -> tuple[mjw.Model, mjw.Data]:
    """Return views of a Model and its Data that limit `mjw.kinematics` to `bodies`, with their geoms and sites.

    The views cover one range of consecutive geom ids and one range of consecutive site ids. They therefore also include
    geoms and sites of other bodies whose ids lie inside these ranges.
    """
    part, data, device = copy.copy(m), copy.copy(d), d.qpos.device
    branches = np.split(m.body_branches.numpy(), m.body_branch_start.numpy()[1:-1])
    branches = [branch for branch in branches if np.isin(branch, bodies).any()]
    part.nbranch = len(branches)
    part.body_branches = wp.array(np.concatenate(branches), dtype=int, device=device)
    part.body_branch_start = wp.array(np.cumsum([0, *map(len, branches)]), dtype=int, device=device)
    for kind in ("geom", "site"):
        ids = np.flatnonzero(np.isin(getattr(m, f"{kind}_bodyid").numpy(), bodies))
        setattr(part, f"n{kind}", int(np.ptp(ids)) + 1 if len(ids) else 0)
        if len(ids):
            chosen = slice(int(ids[0]), int(ids[-1]) + 1)
            setattr(part, f"{kind}_bodyid", getattr(m, f"{kind}_bodyid")[chosen])
            for view, name in ((part, "pos"), (part, "quat"), (data, "xpos"), (data, "xmat")):
                setattr(view, f"{kind}_{name}", getattr(view, f"{kind}_{name}")[:, chosen])
    return part, data
