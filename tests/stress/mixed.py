"""Random scenes of all that may meet, and given ones: every world, valid or from the bank, is judged by MuJoCo C.

python -m tests.stress.mixed --scenes 1000 --layouts 32 --seed 7 --processes 64 --device cuda:0 -o report.json
python -m tests.stress.mixed --shipped --layouts 20000 --processes 64 --device cuda:0
python -m tests.stress.mixed --pairs --layouts 4096 --processes 2
python -m tests.stress.mixed --scene drawers.yaml --layouts 20000
python -m tests.stress.mixed --show 17 --out FOLDER

Scene i, from `--first` on, is a function of its number; world k has the seed `--seed` * 2^32 + k. Each process compiles
scenes, makes layouts of them on the device, and judges them by MuJoCo C on a core, each in the model that a reset has
drawn for its world (`tests/oracle/world_judge.py`). A random scene in which anything falls, slips or is inside of
something is tried again with `--again` layouts. An error of the package counts as a refusal, any other as a failure.

The exit status is 1 if a figure is missed: deep contacts, failures, or more than `MOST` of the worlds that moved or of
the held things that slipped, over all random scenes, `MOST_AGAIN` in one that is tried again, `MOST` in a given one.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.generators.mixed_scenes import make
from tests.generators.mixed_things import SHIPPED
from tests.stress.hostile import pattern
from tests.stress.workers import try_all

MOST = 1e-3
"""Share of worlds in which something may move, and of held things that may slip."""
MOST_AGAIN = 5e-3
"""The same of a random scene that is tried again because something fell."""
FAULTS = ("moved", "deep", "slipped")
STATUS = {1: "valid", 2: "fallback"}
MOST_SECONDS = 900.0
"""What a scene may take [s]: on a new machine all processes compile kernels at once."""
_CHUNK = 256  # worlds that are made and judged at once
_KEPT = 6  # verdicts on faulty worlds of a scene that are kept of each status
_README = Path(__file__).parents[2] / "README.md"


@dataclass
class Outcome:
    """Outcome of a scene, or of a part of its worlds.

    Attributes:
        name: The number of a random scene, or the name of a given one.
        features: What it mixes.
        refused: The error of the package, empty if layouts were made.
        failed: Any other error, a crash or a hang.
        worlds: Number of worlds by status, and of those that hold something as "held".
        faults: Number of worlds by status and fault, such as "valid moved".
        worst: The greatest motion [m], depth [m] and slip [m].
        verdicts: Some of the verdicts on faulty worlds.
    """

    name: str
    features: list[str] = field(default_factory=list)
    refused: str = ""
    failed: str = ""
    worlds: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    worst: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    verdicts: list[dict[str, Any]] = field(default_factory=list)

    def add(self, part: Outcome) -> None:
        """Add other worlds of the same scene."""
        self.refused, self.failed = self.refused or part.refused, self.failed or part.failed
        self.features = self.features or part.features
        self.worlds += part.worlds
        self.faults += part.faults
        self.worst = np.maximum(self.worst, part.worst).tolist()
        self.keep(part.verdicts)

    def keep(self, verdicts: list[dict[str, Any]]) -> None:
        """Keep verdicts, as far as there are few of their status."""
        for verdict in verdicts:
            if sum(v["status"] == verdict["status"] for v in self.verdicts) < _KEPT:
                self.verdicts.append(verdict)

    @property
    def judged(self) -> int:
        """The number of worlds."""
        return sum(self.worlds[name] for name in STATUS.values())

    def count(self, fault: str) -> int:
        """Return the number of worlds with a fault."""
        return sum(self.faults[f"{name} {fault}"] for name in STATUS.values())

    def share(self, fault: str) -> float:
        """Return the share of the worlds with a fault, of slips that of the worlds that hold something."""
        return self.count(fault) / max(self.worlds["held"] if fault == "slipped" else self.judged, 1)

    def misses(self, most: float) -> bool:
        """Return whether more worlds are faulty than may be."""
        return bool(self.failed or self.count("deep")) or max(self.share("moved"), self.share("slipped")) > most


@dataclass(frozen=True)
class Task:
    """Some worlds of a scene: its name, its words unless it is a random one, and the seeds of their layouts."""

    name: str
    words: Any
    seed: int
    count: int


def try_worlds(task: Task, device: str | None = "cpu") -> Outcome:
    """Compile the scene of a task, make its layouts, and judge them."""
    from sceniris_gym.errors import ScenirisError
    from sceniris_gym.layout.compile import compile_scene
    from tests.oracle.world_judge import WorldJudge

    outcome = Outcome(task.name)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        words = task.words
        if words is None:
            scene = make(int(task.name))
            words, outcome.features = scene.write(Path(folder)), sorted(scene.features)
        try:
            compiled = compile_scene(words, device, cache=task.words is not None)
        except ScenirisError as error:
            outcome.refused = f"{type(error).__name__}: {error}".replace(folder, "FOLDER")
            return outcome
        seeds = np.arange(task.count, dtype=np.uint64) + np.uint64(task.seed)
        for verdict in WorldJudge(compiled, seeds).judge():
            status = STATUS.get(verdict.status, "none")
            outcome.worlds.update([status, *(["held"] if verdict.slip == verdict.slip else [])])
            outcome.faults.update(f"{status} {fault}" for fault in verdict.faults)
            worst = verdict.moved, verdict.deep, np.nan_to_num(verdict.slip)
            outcome.worst = np.maximum(outcome.worst, worst).tolist()
            if verdict.faults:
                outcome.keep([asdict(verdict)])
    return outcome


def _lost(task: Task, reason: str) -> Outcome:
    return Outcome(task.name, failed=reason)


def try_scenes(
    scenes: Mapping[str, Any], layouts: int, seed: int, processes: int, device: str | None
) -> dict[str, Outcome]:
    """Judge so many worlds of each of some scenes; outcomes by name, in the order of the scenes."""
    found = {name: Outcome(name) for name in scenes}
    for chunks in (range(0, min(layouts, _CHUNK), _CHUNK), range(_CHUNK, layouts, _CHUNK)):
        there = [name for name, outcome in found.items() if not outcome.refused and not outcome.failed]
        starts = [(name, first) for name in there for first in chunks]
        tasks = [Task(name, scenes[name], (seed << 32) + k, min(_CHUNK, layouts - k)) for name, k in starts]
        for i, part in enumerate(try_all(partial(try_worlds, device=device), tasks, processes, _lost, MOST_SECONDS), 1):
            found[part.name].add(part)
            if i % 50 == 0:
                print(f"{i} of {len(tasks)}", file=sys.stderr, flush=True)
    return found


def shipped_scenes() -> dict[str, Any]:
    """Return the shipped scenes and README's, by name."""
    from ruamel.yaml import YAML

    from sceniris_gym.config.loader import shipped

    text = _README.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    return {name: name for name in shipped("envs", ".yaml")} | {"README.md": YAML(typ="safe").load(text)}


def pairs() -> dict[str, Any]:
    """Return a scene for each shipped thing on each other and on itself; those without room are refused."""
    floor = {"size": [1.0, 1.0]}
    return {
        f"{above} on {below}": {
            "floor": floor,
            "objects": {"below": {"asset": below, "on": "floor"}, "above": {"asset": above, "on": "below"}},
        }
        for below in SHIPPED
        for above in SHIPPED
    }


def total(outcomes: Sequence[Outcome], name: str = "all") -> Outcome:
    """Return the sum of outcomes, without their errors."""
    found = Outcome(name)
    for outcome in outcomes:
        found.worlds += outcome.worlds
        found.faults += outcome.faults
        found.worst = np.maximum(found.worst, outcome.worst).tolist()
    return found


def _row(outcome: Outcome, scenes: int, refused: int) -> str:
    valid, fallback = (outcome.worlds[name] for name in STATUS.values())
    counts = (f"{outcome.faults['valid ' + f]:6} {outcome.faults['fallback ' + f]:6}" for f in FAULTS)
    shares = f"{outcome.share('moved'):8.3%} {outcome.share('slipped'):8.3%}"
    return f"{outcome.name:18} {scenes:6} {refused:7} {valid:7} {fallback:8}  {'  '.join(counts)}  {shares}"


def report(outcomes: Mapping[str, Outcome], again: Mapping[str, Outcome]) -> Iterator[str]:
    """Yield a line for each feature, for each scene with a fault, and for each reason of refusals."""
    words = "".join(f"  {fault:>6} of bank" for fault in FAULTS)
    yield f"{'':18} scenes refused   valid fallback{words}     moved  slipped"
    everything = list(outcomes.values())
    for feature in (*sorted({f for o in everything for f in o.features}), None):
        mine = [o for o in everything if feature is None or feature in o.features]
        yield _row(total(mine, feature or "all"), len(mine), sum(bool(o.refused) for o in mine))
    for outcome in everything:
        if outcome.faults:
            moved, deep, slip = outcome.worst
            far = f"moved {moved:.3f} m, deep {1e3 * deep:.2f} mm, slip {1e3 * slip:.1f} mm"
            counts = f"{dict(outcome.faults)} of {dict(outcome.worlds)}"
            yield f"{outcome.name}: {counts}: {far}: {', '.join(outcome.features)}"
    for outcome in again.values():
        shares = ", ".join(f"{fault} {outcome.share(fault):.3%}" for fault in FAULTS)
        yield f"again {outcome.name}: {outcome.judged} worlds, {shares}"
    for kind in ("failed", "refused"):
        grouped: dict[str, list[str]] = {}
        for outcome in everything:
            if reason := getattr(outcome, kind):
                grouped.setdefault(pattern(reason), []).append(outcome.name)
        for reason, names in sorted(grouped.items(), key=lambda item: -len(item[1])):
            yield f"{kind} {len(names)}: {reason}  scenes {' '.join(names[:6])}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="number of the first random scene")
    parser.add_argument("--without", nargs="+", default=[], help="leave out random scenes with one of these features")
    parser.add_argument("--scene", nargs="+", default=[], help="given scenes instead: names or files")
    parser.add_argument("--shipped", action="store_true", help="the shipped scenes and README's instead")
    parser.add_argument("--pairs", action="store_true", help="one shipped thing on another instead")
    parser.add_argument("--layouts", type=int, default=32)
    parser.add_argument("--again", type=int, default=2000, help="layouts of a random scene with a fault, 0 for none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--show", type=int, default=None, metavar="NUMBER")
    parser.add_argument("-o", "--out", type=Path, default=None, help="the report as JSON; a folder for --show")
    options = parser.parse_args(arguments)
    if options.show is not None:
        folder = options.out or Path(f"mixed_{options.show}")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.yaml").write_text(json.dumps(make(options.show).write(folder.resolve()), indent=1))
        print(f"{folder}/scene.yaml: {', '.join(sorted(make(options.show).features))}")
        return 0
    given = {name: name for name in options.scene}
    given |= shipped_scenes() if options.shipped else {}
    given |= pairs() if options.pairs else {}
    numbers = range(options.first, options.first + options.scenes)
    left = [n for n in numbers if make(n).features.isdisjoint(options.without)] if options.without else numbers
    how = {"seed": options.seed, "processes": options.processes, "device": options.device}
    outcomes = try_scenes(given or {str(number): None for number in left}, options.layouts, **how)
    faulty = {} if given or not options.again else {name: None for name, o in outcomes.items() if o.faults}
    again = try_scenes(faulty, options.again, **{**how, "seed": options.seed + 1})
    print("\n".join(report(outcomes, again)))
    if options.out is not None:
        parts = {"outcomes": outcomes, "again": again}
        report_of = {part: {name: vars(o) for name, o in found.items()} for part, found in parts.items()}
        options.out.write_text(json.dumps({"arguments": {**vars(options), "out": None}, **report_of}, indent=1))
    judged = [(o, MOST) for o in outcomes.values()] if given else [(total(list(outcomes.values())), MOST)]
    judged += [(o, MOST_AGAIN) for o in again.values()]
    failed = any(o.failed for o in (*outcomes.values(), *again.values()))
    missed = [outcome.name for outcome, most in judged if outcome.misses(most)]
    print(f"missed by: {', '.join(missed)}" if missed else "every figure is reached" if not failed else "failures")
    return int(bool(missed) or failed)


if __name__ == "__main__":
    sys.exit(main())
