"""The suite: all experiments of the paper, each as far as this device goes, and the peers that are asked for."""

from __future__ import annotations

import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import warp as wp

from benchmarks.paper import scenes, synthesizer
from benchmarks.paper.cold import cold
from benchmarks.paper.extent import LARGEST, PRESSURE, SIZES, Bench, Extent
from benchmarks.paper.figures import Experiment, reported
from benchmarks.paper.judge import colliding
from benchmarks.paper.peers import Peer, ratio_row, synthesizer_rows, uniform_row
from benchmarks.paper.rows import Row
from benchmarks.paper.warm import Warm, shares, warm
from sceniris_gym.commands.bench import faces
from sceniris_gym.layout.compile import device_name
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene

_EMPTY_SIZES = (1024, LARGEST, PRESSURE)
_PACKAGES = ("warp-lang", "mujoco", "numpy", "python-fcl")


def run(
    device: str | None,
    quick: bool,
    peers: Sequence[Peer],
    tell: Callable[[Row], object] = lambda _: None,
) -> dict:
    """Measure everything.

    Args:
        device: Warp's name of the device; None takes "cuda:0" if there is one, else "cpu".
        quick: Smaller batches and fewer fresh processes.
        peers: What is measured beside it on the same meshes.
        tell: Called with each row when it is there.

    Returns:
        `rows`, each a `Row`; what was measured, on what device and with which versions; `seconds`, how long it took.

    Raises:
        UnknownNameError: There is no such device.
        MissingExtraError: A peer is not installed.
    """
    wp.init()
    start = time.perf_counter()
    if "scene_synthesizer" in peers:
        synthesizer.check_installed()
    name = device_name(device)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(name, Extent.of(name, quick), scenes.compiled_scene(scenes.MID, name), Path(folder))
        for row in _rows(bench, peers):
            rows.append(row)
            tell(row)
    return {
        "suite": "paper",
        "quick": quick,
        "peers": list(peers),
        **_where(bench),
        "seconds": time.perf_counter() - start,
        "rows": rows,
    }


def _where(bench: Bench) -> dict:
    """Return what was measured on what."""
    device = wp.get_device(bench.device)
    return {
        "date": time.strftime("%Y-%m-%d"),
        "device": device.name if device.is_cuda else "cpu",
        "cores": len(os.sched_getaffinity(0)),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "versions": {package: version(package) for package in _PACKAGES},
        "extent": asdict(bench.extent),
        "faces": faces(bench.mid),
        "hash": bench.mid.hash,
    }


def _rows(bench: Bench, peers: Sequence[Peer]) -> Iterator[Row]:
    """Measure row after row."""
    warm_rows = list(_warm_rows(bench, Experiment.WARM, bench.mid))
    yield from warm_rows
    kept, empty = _cold_rows(bench)
    yield from (*empty, *kept)
    yield from _first_pass(bench)
    yield _memory(bench, kept)
    yield _judged(bench)
    yield from _warm_rows(bench, Experiment.PHYSICS, scenes.compiled_scene(scenes.PHYSICS, bench.device))
    worlds = bench.extent.within(LARGEST)
    yield Row(
        Experiment.SHARES,
        worlds,
        shares(bench.mid, worlds),
        note="kernels launched one by one; the paper draws its own parts, with no numbers",
    )
    yield from _reach(bench)
    yield from _harder(bench)
    made = list(synthesizer_rows(bench)) if "scene_synthesizer" in peers else []
    yield from made or [_left_out(Experiment.SYNTHESIZER, "run with --peer scene_synthesizer")]
    yield uniform_row(bench) if "uniform" in peers else _left_out(Experiment.UNIFORM, "run with --peer uniform")
    yield ratio_row(worlds, warm_rows, kept, made)
    yield _left_out(Experiment.PICTURES, "the paper gives no figure; `sceniris-gym check table_top` makes its scene")
    yield _left_out(
        Experiment.ORIGINAL,
        "it needs cuRobo 0.7 and its own meshes, which no extra of this package installs; figures of it stand beside "
        "the rows, measured elsewhere on one H200",
    )


def _left_out(experiment: Experiment, why: str) -> Row:
    return Row(experiment, missing=why, reported=reported(experiment))


def _figures(found: Warm, worlds: int) -> dict[str, float]:
    return {"seconds": found.seconds, "valid_per_s": worlds * found.valid / found.seconds, "valid": found.valid}


def _warm_rows(bench: Bench, experiment: Experiment, compiled: CompiledScene) -> Iterator[Row]:
    for worlds in SIZES:
        told = reported(experiment, worlds)
        if worlds > bench.extent.largest:
            yield Row(experiment, worlds, missing=bench.extent.reason, reported=told)
        else:
            yield Row(experiment, worlds, _figures(warm(compiled, worlds, bench.extent.rounds), worlds), reported=told)


def _cold_rows(bench: Bench) -> tuple[list[Row], list[Row]]:
    """Return the rows with a kept kernel cache, and those with an empty one, which leave it filled."""
    extent, kept, empty = bench.extent, [], []
    wanted = {4, 1024, extent.largest} if extent.quick else set(SIZES)
    for worlds in SIZES:
        told = reported(Experiment.EMPTY, worlds)
        if worlds not in _EMPTY_SIZES:
            why = "compiling takes as long for any number"
            empty.append(Row(Experiment.EMPTY, worlds, missing=why, reported=told))
        elif worlds > extent.largest or (extent.quick and worlds > 1024):
            empty.append(Row(Experiment.EMPTY, worlds, missing=extent.reason, reported=told))
        else:
            found = _cold(bench, scenes.MID, worlds, f"mid_{worlds}")
            empty.append(Row(Experiment.EMPTY, worlds, found, reported=told))
    for worlds in SIZES:
        told = reported(Experiment.KEPT, worlds)
        if worlds > extent.largest or worlds not in wanted:
            kept.append(Row(Experiment.KEPT, worlds, missing=extent.reason, reported=told))
        else:
            found = _cold(bench, scenes.MID, worlds, f"mid_{_EMPTY_SIZES[0]}")
            kept.append(Row(Experiment.KEPT, worlds, found, reported=told))
    return kept, empty


def _cold(bench: Bench, scene: scenes.Scene, worlds: int, cache: str) -> dict[str, float]:
    """Return the figures of a fresh process with the cache of this name."""
    found = cold(scene, worlds, bench.device, bench.folder / cache)
    return {"cold_s": found["cold_s"], "valid_per_s": worlds * found["valid"] / found["cold_s"], **found}


def _first_pass(bench: Bench) -> Iterator[Row]:
    """The share of layouts that ten attempts an object are enough for, as the paper counts validity."""
    compiled = scenes.compiled_scene(scenes.without_restarts(scenes.MID), bench.device)
    for worlds in sorted({bench.extent.within(LARGEST), PRESSURE}):
        told = reported(Experiment.FIRST_PASS, worlds)
        if worlds > bench.extent.largest:
            yield Row(Experiment.FIRST_PASS, worlds, missing=bench.extent.reason, reported=told)
        else:
            found = _figures(warm(compiled, worlds, bench.extent.rounds), worlds)
            yield Row(Experiment.FIRST_PASS, worlds, found, reported=told)


def _memory(bench: Bench, kept: Sequence[Row]) -> Row:
    """The memory of the largest of the fresh processes."""
    row = max((row for row in kept if row.measured), key=lambda row: row.worlds)
    what = "Warp's pool" if wp.get_device(bench.device).is_cuda else "the whole process, on the host"
    found = {"peak_bytes": row.measured["peak_bytes"]}
    note = what if row.worlds == PRESSURE else f"{what}; 524,288 scenes: {bench.extent.reason}"
    return Row(Experiment.MEMORY, row.worlds, found, reported=reported(Experiment.MEMORY), note=note)


def _judged(bench: Bench) -> Row:
    table = make_table(bench.mid, bench.extent.judged, seed=0)
    table = table[table.valid]
    found = {"colliding": colliding(bench.mid, table), "judged": len(table)}
    return Row(Experiment.JUDGED, 0, found, reported=reported(Experiment.JUDGED), note="FCL on the same meshes")


def _reach(bench: Bench) -> Iterator[Row]:
    """The same scene with an arm in it, which has to reach the apple and the cabinet, or not."""
    worlds, times = bench.extent.within(LARGEST), []
    for level, scene in (("off", scenes.ARM), ("on", scenes.ARM_REACHES)):
        found = warm(scenes.compiled_scene(scene, bench.device), worlds, bench.extent.rounds)
        times.append(found.ns_per_candidate)
        figures = _figures(found, worlds) | {"ns_per_candidate": found.ns_per_candidate}
        if level == "off":
            yield Row(Experiment.REACH, worlds, figures, level=level, note="a Panda beside the floor")
        else:
            figures["relative"] = times[1] / times[0]
            note = "tier `map`; what the arm does not reach is drawn again"
            yield Row(Experiment.REACH, worlds, figures, level=level, reported=reported(Experiment.REACH), note=note)


def _harder(bench: Bench) -> Iterator[Row]:
    """Hard and Hard+, warm and cold."""
    worlds = bench.extent.within(LARGEST)
    for level, scene in scenes.LEVELS.items():
        found = warm(scenes.compiled_scene(scene, bench.device), worlds, bench.extent.rounds)
        told = reported(Experiment.HARDER, level=level)
        yield Row(Experiment.HARDER, worlds, _figures(found, worlds), level=level, reported=told)
    for experiment in (Experiment.HARDER_EMPTY, Experiment.HARDER_KEPT):
        for level, scene in scenes.LEVELS.items():
            found = {} if bench.extent.quick else _cold(bench, scene, worlds, level)
            why = bench.extent.reason if bench.extent.quick else ""
            yield Row(experiment, worlds, found, why, level, reported(experiment, level=level))


def progress(row: Row) -> None:
    """Say on stderr which row is there."""
    print(f"{row.experiment} {row.level} {row.worlds or ''}".rstrip(), file=sys.stderr, flush=True)
