"""Hostile models: random MJCF with everything that MuJoCo has is placed without a conflict, or refused by name.

python -m tests.stress.hostile --models 2000 --layouts 64 --seed 0 --jobs 16 [--out hostile.jsonl]
python -m tests.stress.hostile --show 17 --out FOLDER

Model i has the seed `--seed` + i. MuJoCo C alone judges the layouts (`tests/oracle/hostile_judge.py`). A model is

- placed: its layouts are served; whatever is wrong with them is a conflict;
- refused: by an error of sceniris_gym.errors that names an element of the model or of the scene;
- failed: by any other exception, by an error that names nothing, by a crash, or by taking too long.

Models run in processes of their own. Failing ones go to a file of JSON lines; `--show` writes one to a folder. The exit
status is 1 if there is a conflict or a failure.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

from tests.generators.hostile_features import FEATURES, wanted_features
from tests.generators.hostile_models import HostileModel, make
from tests.stress.workers import try_all


@dataclass
class Outcome:
    """Outcome of one model.

    Attributes:
        seed: Its seed.
        verdict: 'placed', 'refused' or 'failed'.
        features: What it has.
        reason: The error, or the first conflicts in words.
        conflicts: Layouts with a conflict, by kind.
        seconds: What it took.
    """

    seed: int
    verdict: str
    features: list[str] = field(default_factory=list)
    reason: str = ""
    conflicts: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def is_wrong(self) -> bool:
        """Return whether this should not have happened."""
        return self.verdict == "failed" or bool(self.conflicts)


def try_model(seed: int, layouts: int, device: str | None = "cpu") -> Outcome:
    """Make a model, compile its scene, and judge its layouts."""
    start = time.perf_counter()
    model = make(seed)
    with tempfile.TemporaryDirectory() as folder:
        verdict, reason, conflicts = _verdict(model, Path(folder), layouts, device)
    return Outcome(seed, verdict, sorted(model.features), reason, conflicts, time.perf_counter() - start)


def names_of(model: HostileModel) -> set[str]:
    """Names of everything in a model and in its scene that an error could mean."""
    elements = [e for text in model.files.values() for e in fromstring(text).iter()]
    found = {str(e.get(word)) for e in elements for word in ("name", "joint", "body") if e.get(word)}
    return (found | set(model.scene["objects"]) | {"robot"}) - {"home"}


def _verdict(model: HostileModel, folder: Path, layouts: int, device: str | None) -> tuple[str, str, dict[str, int]]:
    from sceniris_gym.errors import ScenirisError
    from tests.oracle.hostile_judge import Judge
    from tests.stress.hostile_serving import serve

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mjm, served = serve(model.write(folder), layouts, device)
    except ScenirisError as error:
        words = set(re.findall(r"[\w/]+", str(error)))
        words |= {part for word in words for part in word.split("/")}
        text = f"{type(error).__name__}: {error}".replace(str(folder), "FOLDER")
        return ("refused" if words & names_of(model) else "failed"), text, {}
    except Exception as error:  # whatever it is, it is the finding
        where = error.__traceback__
        while where is not None and where.tb_next is not None:
            where = where.tb_next
        at = "" if where is None else f" at {Path(where.tb_frame.f_code.co_filename).name}:{where.tb_lineno}"
        return "failed", f"foreign {type(error).__name__}: {error}{at}", {}
    found = Judge(mjm, model.things, model.home).judge(served)
    rows = {kind: len({c.row for c in found if c.kind == kind}) for kind in sorted({c.kind for c in found})}
    first = {c.kind: f"{c.kind} of {c.who} {c.value:.3g} in layout {c.row}" for c in reversed(found)}
    return "placed", "; ".join(first[kind] for kind in rows), rows


def _lost(seed: int, reason: str) -> Outcome:
    """Return the outcome of a model whose process died; making it may be what hangs, so it is not made."""
    return Outcome(seed, "failed", sorted(wanted_features(seed)), reason)


def pattern(reason: str) -> str:
    """An error without its names and numbers, so that equal ones can be counted."""
    text = re.sub(r"'[^']*'|\"[^\"]*\"", "'...'", reason)
    text = re.sub(r"\bobjects\.\w+|\bobj\d\w*|\bthing\d\w*", "...", text)
    return re.sub(r"-?\d+(\.\d+)?(e-?\d+)?", "#", text)[:160]


def report(outcomes: list[Outcome]) -> list[str]:
    """A table with a line for each feature, the reasons of refusals and failures, and the totals."""
    lines = [f"{'feature':20} {'models':>7} {'placed':>7} {'refused':>8} {'failed':>7}  conflicts (models by kind)"]
    for feature in (*FEATURES, None):
        mine = [o for o in outcomes if feature is None or feature in o.features]
        count = Counter(o.verdict for o in mine)
        kinds = Counter(kind for o in mine for kind in o.conflicts)
        words = ", ".join(f"{kind} {number}" for kind, number in kinds.most_common())
        numbers = f"{len(mine):7} {count['placed']:7} {count['refused']:8} {count['failed']:7}"
        lines.append(f"{feature or 'all models':20} {numbers}  {words}")
    for verdict in ("refused", "failed"):
        grouped: dict[str, list[int]] = {}
        for outcome in outcomes:
            if outcome.verdict == verdict:
                grouped.setdefault(pattern(outcome.reason), []).append(outcome.seed)
        for reason, seeds in sorted(grouped.items(), key=lambda item: -len(item[1])):
            lines.append(f"{verdict} {len(seeds)}: {reason}  seeds {' '.join(map(str, sorted(seeds)[:6]))}")
    wrong, refused = sum(o.is_wrong for o in outcomes), sum(o.verdict == "refused" for o in outcomes)
    placed = sum(o.verdict == "placed" for o in outcomes) / max(len(outcomes), 1)
    lines.append(f"{len(outcomes)} models, {placed:.1%} placed, {refused} refused, {wrong} with a conflict or failure")
    return lines


def show(seed: int, folder: Path) -> None:
    """Write the files of a model and its scene to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    model = make(seed)
    scene: dict[str, Any] = model.write(folder.resolve())
    (folder / "scene.yaml").write_text(json.dumps(scene, indent=1))  # JSON is YAML
    print(f"{folder}/scene.yaml: {', '.join(sorted(model.features))}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--models", type=int, default=2000)
    parser.add_argument("--layouts", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--out", type=Path, default=None, help="failing models as JSON lines; a folder for --show")
    parser.add_argument("--show", type=int, default=None, metavar="SEED")
    options = parser.parse_args(arguments)
    if options.show is not None:
        show(options.show, options.out or Path(f"hostile_{options.show}"))
        return 0
    out = options.out or Path("hostile.jsonl")
    outcomes = []
    with out.open("w") as file:
        seeds = range(options.seed, options.seed + options.models)
        attempt = partial(try_model, layouts=options.layouts, device=options.device)
        for outcome in try_all(attempt, seeds, options.jobs, _lost):
            outcomes.append(outcome)
            if outcome.is_wrong:
                file.write(json.dumps(asdict(outcome)) + "\n")
                file.flush()
            if len(outcomes) % 50 == 0:
                print(f"{len(outcomes)} of {options.models}", file=sys.stderr, flush=True)
    print("\n".join(report(outcomes)))
    return int(any(outcome.is_wrong for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
