"""All units of a folder of furniture: they move freely, a scene with each is audited, and an arm reaches its handle.

python -m tests.stress.furniture --num 64 --seed 0        # about 3 s a unit
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import sceniris_gym
from sceniris_gym import compile_scene
from sceniris_gym.commands.audit import judge_rows, make_rows
from tests.builders.unit_scenes import layouts_of, reach_of, words_of
from tests.builders.units import DEEPEST, deepest, load, opened

LAYOUTS = 64


def faults_of(path: Path) -> list[str]:
    """Return the faults of a unit: parts that touch, warnings, and what the audit of layouts around it finds."""
    model, _ = load(path)
    apart, where = deepest(model, opened(model))
    found = [f"{apart:.6f} m: {where}"] if apart < DEEPEST else []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        compiled = compile_scene(words_of(path), "cpu", cache=False)
        rows = make_rows(compiled, LAYOUTS, LAYOUTS, 0)
        report = judge_rows(compiled, rows)
        if model.njnt and (n := int((layouts_of(reach_of(path), LAYOUTS).status.numpy() != 1).sum())):
            found.append(f"{n} of {LAYOUTS} handles out of reach")
    found += [f"{name} moved in {n} layouts" for name, n in report["moved"].items() if n]
    found += [f"audit: {report}"] if not report["ok"] else []
    return found + [f"{type(warning.message).__name__}: {warning.message}" for warning in caught]


def main() -> None:
    """Judge all units. The exit status is 1 if one has a fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--num", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        for unit in sceniris_gym.furniture(folder, given.num, given.seed)["units"]:
            found = faults_of(Path(folder) / unit["file"])
            faults += bool(found)
            print(unit["file"], "; ".join(found) or "ok", flush=True)
    print(f"{faults} of {given.num} units have faults")
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
