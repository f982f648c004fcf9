"""Random stacks of foreign things, judged by MuJoCo C: nothing in a layout should move by 1 cm in half a second.

python -m tests.stress.standing --scenes 300 --layouts 32 --seed 0 --device cpu --jobs 2
python -m tests.stress.standing --table --layouts 2000
python -m tests.stress.standing --show 17 --out FOLDER

Scene i has the seed `--seed` + i. Candidates that were rejected because they would fall are replayed too, as they
stood, without what had not been placed yet; ideally none of them stands. `--table` has a scene for each way in which a
thing falls. The exit status is 1 if more than `MOST_MOVED` of the layouts move, of the table if any row does. Scenes
with more than stacks, and the shipped ones, are tried by `tests.stress.mixed`.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from tests.generators.stack_models import StackScene, make
from tests.generators.stack_table import table
from tests.oracle.stack_judge import STILL, StackJudge

MOST_MOVED = 1e-3
"""Share of layouts in which something may move."""
_RECORDED = 4000
"""Rejected candidates of all causes that are kept."""


@dataclass
class Outcome:
    """Outcome of one scene.

    Attributes:
        name: Its seed, or its name in the table.
        features: What it has.
        refused: The error; empty if layouts were made.
        layouts: Number of layouts.
        moved: Row of a layout in which something moves -> greatest motion [m].
        rejected: Number of candidates that were replayed after having been rejected as falling.
        stand: How many of them stand.
    """

    name: str
    features: frozenset[str]
    refused: str = ""
    layouts: int = 0
    moved: dict[int, float] | None = None
    rejected: int = 0
    stand: int = 0


def try_scene(
    name: str, scene: StackScene, layouts: int, replayed: int, device: str | None = "cpu", seed: int = 0
) -> Outcome:
    """Make layouts of a scene, and replay them and up to `replayed` candidates that were rejected as falling."""
    from sceniris_gym.errors import ScenirisError
    from sceniris_gym.layout.compile import compile_scene
    from sceniris_gym.layout.generate import LayoutGenerator
    from sceniris_gym.layout.tables import read_rejected
    from sceniris_gym.program.device import Cause

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        words = scene.write(Path(folder))
        try:
            compiled = compile_scene(words, device, cache=False)
        except ScenirisError as error:
            return Outcome(name, scene.features, f"{type(error).__name__}: {error}".replace(folder, "FOLDER"))
        generator = LayoutGenerator._recording(compiled, layouts, seed=seed, rejected=_RECORDED, every_cause=True)
        generator.generate()
    made, judge = generator.table(), StackJudge(compiled.mjm)
    moved = {}
    for row in range(layouts):
        far = judge.moves(made.qpos[row], made.mocap_pos[row], made.mocap_quat[row]).max(initial=0.0)
        if far > STILL:
            moved[row] = float(far)
    rejected, root = read_rejected(generator), compiled.scene.bodies
    falling = np.flatnonzero(rejected.causes == Cause.__members__.get("FALLS", -1))[:replayed]
    stand = 0
    for k in falling:
        later = [root[thing] for thing in compiled.placed[int(rejected.objects[k]) + 1 :] if thing in root]
        states = rejected.states
        far = judge.moves(states.qpos[k], states.mocap_pos[k], states.mocap_quat[k], away=later)
        stand += bool(far.max(initial=0.0) <= STILL)
    return Outcome(name, scene.features, "", layouts, moved, len(falling), stand)


def try_seed(seed: int, layouts: int, replayed: int, device: str | None = "cpu") -> Outcome:
    """Make the scene of a seed, and try it."""
    return try_scene(str(seed), make(seed), layouts, replayed, device)


def report(outcomes: Sequence[Outcome]) -> list[str]:
    """Return a line for each feature, the refusals, and the totals."""
    lines = [f"{'feature':10} {'scenes':>7} {'refused':>8} {'layouts':>8} {'moved':>6} {'share':>8}  rejected, stand"]
    for feature in (*sorted({f for o in outcomes for f in o.features}), None):
        mine = [o for o in outcomes if feature is None or feature in o.features]
        layouts, rejected = sum(o.layouts for o in mine), sum(o.rejected for o in mine)
        moved, stand = sum(len(o.moved or {}) for o in mine), sum(o.stand for o in mine)
        refused = sum(bool(o.refused) for o in mine)
        lines.append(
            f"{feature or 'all':10} {len(mine):7} {refused:8} {layouts:8} {moved:6} {moved / max(layouts, 1):8.3%}  "
            f"{rejected}, {stand / max(rejected, 1):.1%}"
        )
    lines += [f"refused {o.name}: {o.refused[:200]}" for o in outcomes if o.refused]
    seeds = ", ".join(f"{o.name} ({len(o.moved)}, {max(o.moved.values()):.3f} m)" for o in outcomes if o.moved)
    return [*lines, f"scenes with a layout that moves: {seeds or 'none'}"]


def _show(seed: int, folder: Path) -> None:
    """Write the files of a scene to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = make(seed)
    (folder / "scene.yaml").write_text(json.dumps(scene.write(folder.resolve()), indent=1))  # JSON is YAML
    print(f"{folder}/scene.yaml: {', '.join(sorted(scene.features))}")


def _try_table(layouts: int, only: str, device: str) -> int:
    """Print a line for each scene of the table; return 1 if something moves in more layouts than may."""
    wrong = 0
    for name, scene in table().items():
        if only not in name:
            continue
        outcome = try_scene(name, scene, layouts, layouts, device)
        moved = len(outcome.moved or {})
        wrong += moved > MOST_MOVED * layouts
        words = outcome.refused or (
            f"{moved} of {outcome.layouts} moved ({moved / layouts:.2%}); "
            f"of {outcome.rejected} rejected {outcome.stand} stand"
        )
        print(f"{name:36} {words[:300]}", flush=True)
    return int(wrong > 0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--layouts", type=int, default=32)
    parser.add_argument("--replayed", type=int, default=32, help="rejected candidates that are replayed of each scene")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--only", default="", help="rows of the table whose name has this in it")
    parser.add_argument("--out", type=Path, default=None, help="a folder for --show")
    parser.add_argument("--show", type=int, default=None, metavar="SEED")
    options = parser.parse_args(arguments)
    if options.show is not None:
        _show(options.show, options.out or Path(f"stack_{options.show}"))
        return 0
    if options.table:
        return _try_table(options.layouts, options.only, options.device)
    seeds = range(options.seed, options.seed + options.scenes)
    attempt = partial(try_seed, layouts=options.layouts, replayed=options.replayed, device=options.device)
    outcomes = []
    with ProcessPoolExecutor(options.jobs, multiprocessing.get_context("spawn")) as pool:
        for outcome in pool.map(attempt, seeds, chunksize=4):
            outcomes.append(outcome)
            if len(outcomes) % 50 == 0:
                print(f"{len(outcomes)} of {options.scenes}", file=sys.stderr, flush=True)
    print("\n".join(report(outcomes)))
    moved = sum(len(o.moved or {}) for o in outcomes)
    return int(moved > MOST_MOVED * sum(o.layouts for o in outcomes))


if __name__ == "__main__":
    sys.exit(main())
