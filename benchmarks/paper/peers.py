"""The rows of peers: other ways to place the same meshes, measured in the same run."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from typing import Literal

from benchmarks.paper import synthesizer
from benchmarks.paper.extent import LARGEST, Bench
from benchmarks.paper.figures import Experiment, reported
from benchmarks.paper.judge import colliding
from benchmarks.paper.rows import Row
from benchmarks.paper.warm import warm
from sceniris_gym.layout.tables import make_table
from sceniris_gym.training.layout_sources import unchecked

Peer = Literal["scene_synthesizer", "uniform"]


def synthesizer_rows(bench: Bench) -> Iterator[Row]:
    """Scene Synthesizer in one process, and in one for each core."""
    told = reported(Experiment.SYNTHESIZER)
    cores = len(os.sched_getaffinity(0))
    for processes in sorted({1, cores}):
        found, table = synthesizer.measure(bench.mid, bench.extent.seconds, processes)
        table = table[slice(0, bench.extent.judged)]
        if len(table):
            found |= {"colliding": colliding(bench.mid, table), "judged": len(table)}
        level = "one process" if processes == 1 else "one a core"
        many, alone = processes == cores, processes == 1
        some = tuple(f for f in told if (many if "ten" in f.unit else alone))
        yield Row(Experiment.SYNTHESIZER, 0, found, level=level, reported=some, note="meshes loaded once, its own gaps")


def uniform_row(bench: Bench) -> Row:
    """The same candidates, none of which is tested for collisions."""
    compiled = unchecked(bench.mid)
    worlds = bench.extent.within(LARGEST)
    found = warm(compiled, worlds, bench.extent.rounds)
    table = make_table(compiled, bench.extent.judged, seed=0)
    share = colliding(bench.mid, table)
    figures = {
        "seconds": found.seconds,
        "valid_per_s": worlds * (1.0 - share) / found.seconds,
        "colliding": share,
        "judged": len(table),
    }
    note = "valid: those that FCL finds without a collision, which no one would know"
    return Row(Experiment.UNIFORM, worlds, figures, reported=reported(Experiment.UNIFORM), note=note)


def ratio_row(worlds: int, warm_rows: Sequence[Row], kept: Sequence[Row], made: Sequence[Row]) -> Row:
    """Return the ratio of valid layouts a second to Scene Synthesizer's, with one process of it on each core."""
    told = reported(Experiment.RATIO)
    if not made:
        return Row(Experiment.RATIO, worlds, missing="run with --peer scene_synthesizer", reported=told)
    peer = made[-1].measured["valid_per_s"]
    if not peer:
        return Row(Experiment.RATIO, worlds, missing="Scene Synthesizer made no valid scene", reported=told)
    rates = [
        max(row.measured["valid_per_s"] for row in rows if row.measured and row.worlds == worlds)
        for rows in (warm_rows, kept)
    ]
    figures = {"valid_ratio_warm": rates[0] / peer, "valid_ratio_cold": rates[1] / peer}
    return Row(Experiment.RATIO, worlds, figures, reported=told, note="its own rate is taken warm, so in its favour")
