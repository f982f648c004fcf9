"""The `demo` command: resets 64 worlds of a scene three times, prints figures, and draws 16 of the worlds."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import warp as wp

from sceniris_gym.commands.check import table_of_rejections
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import Status
from sceniris_gym.pictures.render import captioned, save
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

SCENE = "mid"
WORLDS, RESETS, SHOWN = 64, 3, 16
_REPEATS = 20  # timed runs of the LayoutGenerator


def demo(out: Path, device: str | None) -> dict:
    """Run the demo and return its figures.

    Args:
        out: Where to write the picture.
        device: Warp's name of the device; None takes "cuda:0" if there is one, else "cpu".
    """
    start = time.perf_counter()
    compiled = compile_scene(SCENE, device)
    batch = Batch(compiled.scene, WORLDS, compiled.device)
    randomizer = ResetRandomizer(compiled, batch.model, batch.data)
    layouts = randomizer.layouts
    made = Counter()
    for _ in range(RESETS):
        randomizer.reset()
        made["valid"] += int((layouts.status.numpy() == Status.VALID).sum())
        made["first_pass_valid"] += int(layouts.first_pass_valid.numpy().sum())
        made["attempts"] += int(layouts.attempts.numpy().sum())
    ready = time.perf_counter() - start
    counts = randomizer.rejection_counts()
    first_id = compiled.layout_id(layouts.seed.numpy()[0], layouts.episode.numpy()[0])
    captions = [_caption(randomizer, i) for i in range(SHOWN)]
    save(captioned(compiled.mjm, _states(batch, compiled, SHOWN), captions, device=compiled.device), out)
    total = WORLDS * RESETS
    return {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "first_id": first_id,
        "device": compiled.device,
        "worlds": WORLDS,
        "resets": RESETS,
        "ready_s": ready,
        "valid": made["valid"] / total,
        "first_pass_valid": made["first_pass_valid"] / total,
        "attempts_per_layout": made["attempts"] / total,
        "rejections": counts,
        "layouts_per_s": WORLDS / _warm(randomizer, compiled.device),
        "shown": SHOWN,
        "picture": str(out),
    }


def report(figures: Mapping) -> str:
    """Return the figures of the demo as text."""
    lines = [
        f"{figures['worlds']} worlds of the scene '{figures['scene']}' were reset {figures['resets']} times on "
        f"{figures['device']} ({figures['ready_s']:.1f} s including setup)",
        f"{figures['valid']:.1%} valid, {figures['first_pass_valid']:.1%} on the first pass, "
        f"{figures['attempts_per_layout']:.2f} candidates per layout",
        table_of_rejections(figures["rejections"]),
        f"warm: {figures['layouts_per_s']:,.0f} layouts/s, {figures['worlds']} at a time",
        f"{figures['picture']} shows {figures['shown']} of the worlds; world 0 is {figures['first_id']}",
    ]
    return "\n".join(lines)


def _states(batch: Batch, compiled: CompiledScene, nrow: int) -> LayoutTable:
    """Return the states of the first worlds of the simulation."""
    data, nmocap = batch.data, compiled.mjm.nmocap
    return LayoutTable.from_states(
        data.qpos.numpy()[:nrow],
        data.mocap_pos.numpy()[:nrow, :nmocap],
        data.mocap_quat.numpy()[:nrow, :nmocap],
        present=np.ones((nrow, len(compiled.slots)), bool),
    )


def _caption(randomizer: ResetRandomizer, i: int) -> str:
    layouts = randomizer.layouts
    status = Status(int(layouts.status.numpy()[i])).name.lower()
    return f"world {i}: seed {layouts.seed.numpy()[i]}, episode {layouts.episode.numpy()[i]}, {status}"


def _warm(randomizer: ResetRandomizer, device: str) -> float:
    """Return the median time [s] to make the layouts of all worlds."""
    times = []
    for _ in range(_REPEATS):
        wp.synchronize_device(device)
        start = time.perf_counter()
        randomizer.layout_source.launch_generate(None)
        wp.synchronize_device(device)
        times.append(time.perf_counter() - start)
    return float(np.median(times))
