"""Ids of layouts, valid and from the bank, with and without params: each makes the same layout again to the bit.

python -m tests.stress.ids --ids 10000 --seed 7 --processes 64 --device cuda:0 -o report.json
python -m tests.stress.ids --ids 512 --scene drawer_open_pick

Scenes are those of `tests.stress.mixed`, numbered from `--first` on, and each has `WORLDS` worlds. In every other scene
the worlds have all params that the scene can have, half of them with numbers of their own. The ids of their second
episodes go back, in another order of worlds, through

- replay: the command's function, with the numbers that it says are drawn;
- randomizer: `ResetRandomizer.pipeline.reseed` with the parts of the id, and model fields with a row for each world;
- options: `reset(options={"layouts": ids})` of an environment, likewise;
- generator: the way of adapters, whose environments write the layouts of a LayoutGenerator.

An id that is not made, or not taken, with an error of the package counts as refused. The exit status is 1 if any bit
differs, anything else is raised, or fewer ids than wanted came back by any way.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.generators.mixed_scenes import make
from tests.stress.id_ways import BACK, WORLDS, Rows, Served
from tests.stress.mixed import MOST_SECONDS, STATUS
from tests.stress.workers import try_all


@dataclass
class Outcome:
    """Outcome of the worlds of a scene.

    Attributes:
        name: The scene.
        params: Whether the worlds have params.
        refused: Why there are no ids: the scene or the params are refused, or the ids cannot be told.
        failed: Any other error, a crash or a hang.
        counts: Number of ids by way, status and result, such as "replay fallback equal".
        first: By way and status, the first id that differs, the world, and the names of what differs.
        errors: By way the first error of the package.
    """

    name: str
    params: bool = False
    refused: str = ""
    failed: str = ""
    counts: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """A scene, by its words or as a random one, and the seed of its worlds."""

    name: str
    words: Any
    seed: int
    params: bool


def differing(served: Rows, world: int, found: Rows, row: int) -> list[str]:
    """Return the names of what differs in a row from what a world was served, in any bit."""
    names = []
    for name, rows in found.items():
        wanted = served[name][world].ravel()
        mine = rows[row].ravel().astype(wanted.dtype)
        if mine.tobytes() != wanted[: mine.size].tobytes():
            names.append(name)
    return names


def try_ids(task: Task, device: str | None = "cpu") -> Outcome:
    """Serve the worlds of a scene, and send their ids back."""
    from sceniris_gym.errors import ScenirisError
    from sceniris_gym.layout.compile import compile_scene

    outcome = Outcome(task.name, task.params)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        words = make(int(task.name)).write(Path(folder)) if task.words is None else task.words
        try:
            served = Served(compile_scene(words, device), task.seed, params=task.params)
        except ScenirisError as error:
            outcome.refused = f"{type(error).__name__}: {error}".replace(folder, "FOLDER")
            return outcome
        order = np.random.default_rng(task.seed).permutation(WORLDS)
        for way, back in BACK.items():
            try:
                found = back(served, order)
            except ScenirisError as error:
                outcome.errors[way] = f"{type(error).__name__}: {error}"
                outcome.counts.update(f"{way} {status} refused" for status in served.status)
                continue
            for row, world in enumerate(order.tolist()):
                names = differing(served.rows, world, found, row)
                outcome.counts.update([f"{way} {served.status[world]} {'differs' if names else 'equal'}"])
                if names:
                    told = f"{served.ids[world]} of world {world}: {', '.join(names)}"
                    outcome.first.setdefault(f"{way} {served.status[world]}", told)
    return outcome


def _lost(task: Task, reason: str) -> Outcome:
    return Outcome(task.name, task.params, failed=reason)


def total(outcomes: Sequence[Outcome]) -> Counter[str]:
    """Return the sum of the counts."""
    return sum((outcome.counts for outcome in outcomes), Counter[str]())


def report(outcomes: Sequence[Outcome]) -> list[str]:
    """Return a line for each way and status, with and without params, and the first of what is wrong."""
    lines = [f"{'':34} {'equal':>8} {'refused':>8} {'differs':>8}"]
    for params in (False, True):
        counts = total([o for o in outcomes if o.params == params])
        for way in BACK:
            for status in STATUS.values():
                numbers = " ".join(f"{counts[f'{way} {status} {word}']:8}" for word in ("equal", "refused", "differs"))
                lines.append(f"{way:12} {status:10} {'params' if params else '':10} {numbers}")
    for outcome in outcomes:
        told = {**outcome.first, **outcome.errors, **({"failed": outcome.failed} if outcome.failed else {})}
        lines += [f"{outcome.name}: {key}: {words[:200]}" for key, words in told.items()]
    refused = Counter(o.refused.partition(":")[0] for o in outcomes if o.refused)
    return [*lines, f"scenes {len(outcomes)}, refused {dict(refused)}"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ids", type=int, default=10_000, help="ids that should come back by each way")
    parser.add_argument("--first", type=int, default=0, help="number of the first random scene")
    parser.add_argument("--scene", nargs="+", default=[], help="given scenes instead: names or files")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("-o", "--out", type=Path, default=None, help="the report as JSON")
    options = parser.parse_args(arguments)
    attempt, outcomes = partial(try_ids, device=options.device), list[Outcome]()
    made, turn = 0, 0
    while made < options.ids:
        count = max(-(-(options.ids - made) // WORLDS), options.processes)
        numbers = range(turn, turn + count)
        named = [(n, options.scene[n % len(options.scene)]) if options.scene else (n, None) for n in numbers]
        tasks = [
            Task(words or str(options.first + n), words, (options.seed << 32) + n * WORLDS, n % 2 == 1)
            for n, words in named
        ]
        found = list(try_all(attempt, tasks, options.processes, _lost, MOST_SECONDS))
        if not any(o.counts for o in found):
            break
        outcomes += found
        turn += count
        counts = total(outcomes)
        made = min(sum(n for key, n in counts.items() if key.startswith(way)) for way in BACK)
        wrong = sum(n for key, n in counts.items() if key.endswith("differs"))
        print(f"{made} of {options.ids}, {wrong} times another layout", file=sys.stderr, flush=True)
    print("\n".join(report(outcomes)))
    if options.out is not None:
        options.out.write_text(json.dumps([vars(outcome) for outcome in outcomes], indent=1))
    differs = sum(n for key, n in total(outcomes).items() if key.endswith("differs"))
    failed = sum(bool(outcome.failed) for outcome in outcomes)
    print(f"{made} ids by each way, {differs} times another layout, {failed} failures")
    return int(bool(differs or failed or made < options.ids))


if __name__ == "__main__":
    sys.exit(main())
