"""Steps of plain mujoco_warp Models whose fields have the values that a scene draws, one kind of field at a time.

    python -m benchmarks.field_steps --num-envs 4096 --device cuda:0

The values are those of `benchmarks.fields`, drawn once. Each Model comes from `mjw.put_model` and has rows of some of
these fields, so what its steps take more than those of a Model with one row for all worlds is the physics of the drawn
values. Prints for each the median microseconds of a step of four substeps from a state that was reached before, the
ratio of rates, and iterations of the solver, rows of constraints and contacts; on a GPU also the kernels whose times
differ most between the first two Models.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from benchmarks.fields import DRAWS
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.model_fields import owner
from sceniris_gym.sim.randomizer import ResetRandomizer

_SUBSTEPS = 4
_KERNELS = 10
_UPRIGHT = "drawn, gravity along z"
_KINDS = {
    "one row": (),
    "drawn": ("",),
    _UPRIGHT: ("",),
    "drawn but gravity": ("body", "dof", "geom", "actuator", "tendon", "cam", "light", "mat"),
    "gravity": ("gravity",),
    "masses": ("body", "dof_invweight0"),
    "friction": ("geom_friction",),
    "solref": ("geom_solref",),
    "arm": ("dof_damping", "dof_armature", "actuator"),
}
"""Beginnings of the names of the fields that have rows; of one kind, drawn gravity has no tilt."""


class Steps:
    """Steps of a Model with rows of some fields.

    Args:
        mjm: The model.
        batch: Worlds of it in which fields were drawn.
        names: The fields.
        upright: Take the tilt out of gravity.
        state: The state of their resets.
        settle: Steps before the state that all measured steps begin in.
    """

    def __init__(
        self,
        mjm: mujoco.MjModel,
        batch: Batch,
        names: list[str],
        upright: bool,
        state: dict[str, wp.array],
        settle: int,
    ) -> None:
        self._m, d = mjw.put_model(mjm), batch.data
        for name in names:
            values = wp.clone(getattr(owner(batch.model, name), name))
            values._is_batched = True
            if name == "gravity" and upright:
                values.assign(values.numpy() * [0.0, 0.0, 1.0])
            setattr(owner(self._m, name), name, values)
        self.data = mjw.make_data(mjm, d.nworld, nconmax=d.naconmax // d.nworld, njmax=d.njmax)
        for name, values in state.items():
            wp.copy(getattr(self.data, name), values)
        for _ in range(settle):
            self._launch()
        self._start = {name: wp.clone(getattr(self.data, name)) for name in ResetRandomizer.STATE_FIELDS}
        self._graph, self.times = None, []
        if batch.device.is_cuda:
            with wp.ScopedCapture() as capture:
                self._launch()
            self._graph = capture.graph

    def measure(self, steps: int) -> None:
        """Add the mean time [us] of a step."""
        wp.synchronize_device(self.data.qpos.device)
        begin = time.perf_counter()
        for _ in range(steps):
            self._restart()
            if self._graph is None:
                self._launch()
            else:
                wp.capture_launch(self._graph)
        wp.synchronize_device(self.data.qpos.device)
        self.times.append(1e6 * (time.perf_counter() - begin) / steps)

    def kernels(self) -> Counter[str]:
        """Return the time [us] of each kernel in a step."""
        self._restart()
        wp.synchronize_device(self.data.qpos.device)
        wp.timing_begin(cuda_filter=wp.TIMING_KERNEL)
        self._launch()
        found: Counter[str] = Counter()
        for result in wp.timing_end():
            found[result.name.removeprefix("forward kernel ")] += 1e3 * result.elapsed
        return found

    def _launch(self) -> None:
        for _ in range(_SUBSTEPS):
            mjw.step(self._m, self.data)

    def _restart(self) -> None:
        for name, values in self._start.items():
            wp.copy(getattr(self.data, name), values)


def main() -> None:
    """Measure all in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=4096)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=60)
    parser.add_argument("--settle", type=int, default=20)
    parser.add_argument("--device", default=None)
    words = parser.parse_args()
    wp.config.quiet = True
    compiled = compile_scene({"base": "tabletop_lift", **DRAWS}, words.device)
    batch = Batch(compiled.scene, words.num_envs, compiled.device)
    ResetRandomizer.of_batch(batch, compiled, prefetch=False).reset()
    state = {name: wp.clone(getattr(batch.data, name)) for name in ResetRandomizer.STATE_FIELDS}
    rows = [name for name in batch.fields.rows if name != "rest"]
    with wp.ScopedDevice(batch.device):
        each = {}
        for kind, begins in _KINDS.items():
            names = [name for name in rows if name.startswith(begins)]
            each[kind] = Steps(compiled.sim_mjm, batch, names, kind == _UPRIGHT, state, words.settle)
        for _ in range(words.rounds):
            for steps in each.values():
                steps.measure(words.steps)
        plain = float(np.median(each["one row"].times))
        for kind, steps in each.items():
            found, counts = float(np.median(steps.times)), steps.data.solver_niter.numpy()
            print(f"{kind}: {found:.1f} us, rate {plain / found:.3f}", end=", ")
            print(f"iterations {counts.mean():.3f}, at most {counts.max()}", end=", ")
            print(f"rows {steps.data.nefc.numpy().mean():.1f}, contacts {steps.data.nacon.numpy()[0]}", flush=True)
        if batch.device.is_cuda:
            for steps in each.values():  # loads what only direct launches need
                steps.kernels()
            one, drawn = each["one row"].kernels(), each["drawn"].kernels()
            for name in sorted(one | drawn, key=lambda name: -abs(drawn[name] - one[name]))[:_KERNELS]:
                print(f"{name}: {one[name]:.1f} us, drawn {drawn[name]:.1f} us")


if __name__ == "__main__":
    main()
