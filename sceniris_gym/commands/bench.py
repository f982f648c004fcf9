"""The `bench` command: measures how fast layouts are made and worlds are reset."""

import resource
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import warp as wp

from sceniris_gym.audit.geometry import solids_of
from sceniris_gym.commands.narrowing import narrow
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator, generator_memory
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave.search import suited_size
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

REPEATS = 20
_WARM_UP = 3
_NARROWED = 4096  # greatest number of layouts for the measure of `reachable`
_PARTIAL = 50  # a partial reset resets one in 50 worlds


def bench(config: SceneConfig, num_envs: int, device: str | None, seed: int, picture: Path | None = None) -> dict:
    """Measure how fast layouts of a scene are made and worlds are reset, and return the figures.

    The memory that the worlds take is printed to stderr before it is allocated.

    Times are wall-clock times, with the device idle before and after. Warm times are medians of 20 replays of a
    captured graph. Rates and fractions refer to the layouts of these 20 replays.

    Args:
        config: The scene.
        num_envs: Number of worlds.
        device: Warp's name of the device. None takes "cuda:0" if available, otherwise "cpu".
        seed: Seed of the first world.
        picture: PNG to write, or None. It shows the places of objects, with and without `reachable`.

    Raises:
        MemoryLimitError: The worlds do not fit into the memory of the device.
    """
    start = time.perf_counter()
    compiled = compile_scene(config, device, cache=False)
    compiling = time.perf_counter() - start
    makes = generator_memory(compiled, suited_size(compiled, num_envs))
    batch = Batch(compiled.scene, num_envs, compiled.device, beside=[makes])
    print(f"{batch.memory}.", file=sys.stderr, flush=True)
    start = time.perf_counter()
    generator = LayoutGenerator(compiled, num_envs, seed=seed)
    generator.generate()
    wp.synchronize_device(compiled.device)
    cold = compiling + time.perf_counter() - start

    view, counted = generator.layouts.view, []
    columns = (view.status, view.attempts, view.first_pass_valid)

    def count() -> None:
        counted.append([column.numpy().copy() for column in columns])

    graph = LaunchSequence(generator.generate, wp.get_device(compiled.device))
    warm = median_time(graph.replay, compiled.device, count)
    status, candidates, first_pass = np.swapaxes(counted, 0, 1)
    valid = status == LayoutStatus.VALID
    return {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "device": wp.get_device(compiled.device).name,
        "num_envs": num_envs,
        "geometry": compiled.config.geometry,
        "faces": faces(compiled),
        "attempts": compiled.attempts,
        "restarts": compiled.config.restarts,
        "cold_s": cold,
        "warm_s": warm,
        "first_pass_valid": float(first_pass.mean()),
        "valid": float(valid.mean()),
        "fallbacks": int((status == LayoutStatus.FALLBACK).sum()),
        "valid_per_s": float(valid.sum() / REPEATS / warm),
        "candidates_per_layout": float(candidates.mean()),
        "ns_per_candidate": float(1e9 * REPEATS * warm / candidates.sum()),
        **_resets(compiled, batch, generator),
        "peak_bytes": peak_bytes(compiled.device),
        **narrow(compiled, min(num_envs, _NARROWED), seed, picture),
    }


def faces(compiled: CompiledScene) -> dict[str, int]:
    """Count the triangles of each object in the scene's `geometry`. If it is `physics`, count faces of convex hulls."""
    scene, total = compiled.scene, dict.fromkeys(compiled.scene.bodies, 0)
    for solid in solids_of(scene.mjm, compiled.config.geometry):
        if (owner := scene.owners.get(int(scene.mjm.geom_bodyid[solid.geom]))) is not None:
            total[owner] += len(solid.faces)
    return total


def peak_bytes(device: str) -> int:
    """Return the peak memory in use [bytes]: of Warp's pool on a GPU, of the process on a CPU."""
    where = wp.get_device(device)
    if where.is_cuda:
        return int(wp.get_mempool_used_mem_high(where))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # kibibytes on Linux


def _resets(compiled: CompiledScene, batch: Batch, generator: LayoutGenerator) -> dict[str, float]:
    """Return the time [us] to reset all worlds and to reset 2% of them, with new layouts and kinematics."""
    randomizer = ResetRandomizer(compiled, batch.model, batch.data, layout_source=generator)
    times = {}
    for name, every in (("full_reset_us", 1), ("partial_reset_us", _PARTIAL)):
        mask = wp.array(np.arange(generator.nworld) % every == 0, dtype=bool, device=compiled.device)
        times[name] = 1e6 * median_time(partial(randomizer.reset, mask), compiled.device)
    return times


def median_time(work: Callable[[], object], device: str, after: Callable[[], object] = lambda: None) -> float:
    """Return the median time [s] of 20 runs of `work`, after 3 warm-up runs. Each of the 20 is followed by `after`."""
    times = []
    for i in range(_WARM_UP + REPEATS):
        wp.synchronize_device(device)
        start = time.perf_counter()
        work()
        wp.synchronize_device(device)
        if i >= _WARM_UP:
            times.append(time.perf_counter() - start)
            after()
    return statistics.median(times)
