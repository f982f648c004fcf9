"""The `demo` command: resets 64 worlds of a scene three times, reports figures, and draws 16 of the worlds."""

import time
from collections.abc import Mapping
from pathlib import Path

from sceniris_gym.commands.bench import median_time
from sceniris_gym.commands.check import table_of_rejections
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.pictures.layout_picture import captioned, save
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

SCENE = "mid"
WORLDS, RESETS, SHOWN = 64, 3, 16


def demo(out: Path, device: str | None) -> dict:
    """Run the demo and return its figures.

    Args:
        out: PNG to write.
        device: Warp's name of the device. None takes "cuda:0" if available, otherwise "cpu".
    """
    start = time.perf_counter()
    compiled = compile_scene(SCENE, device)
    batch, generator = Batch(compiled.scene, WORLDS, compiled.device), LayoutGenerator(compiled, WORLDS)
    randomizer = ResetRandomizer(compiled, batch.model, batch.data, layout_source=generator)
    tables = []
    for _ in range(RESETS):
        randomizer.reset()
        tables.append(generator.table())
    ready = time.perf_counter() - start
    made, shown = LayoutTable.concatenate(tables), tables[-1][:SHOWN]
    captions = [
        f"world {i}: seed {shown.seed[i]}, episode {shown.episode[i]}, {LayoutStatus(shown.status[i]).name.lower()}"
        for i in range(SHOWN)
    ]
    save(captioned(compiled.mjm, shown, captions, device=compiled.device), out)
    return {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "first_id": compiled.layout_id(shown.seed[0], shown.episode[0]),
        "device": compiled.device,
        "worlds": WORLDS,
        "resets": RESETS,
        "ready_s": ready,
        "valid": float(made.valid.mean()),
        "first_pass_valid": float(made.first_pass_valid.mean()),
        "attempts_per_layout": float(made.attempts.mean()),
        "rejections": generator.rejection_counts(),
        "layouts_per_s": WORLDS / median_time(generator.generate, compiled.device),
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
