"""Presence in many layouts: one line per form, against an enumeration with exact fractions and the audit.

python -m tests.stress.presence --layouts 100000 [--device cuda:0] [--forms towers supports]

The exit status is 1 if the audit finds a fault, if a layout has objects that the words exclude, or if the sets of
objects are less likely than 0.001 by a chi-square test.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from tests.layout.present import FLOOR, forms, pvalue
from tests.layout.related import Shapes

_LEAST = 0.001


def main(given: Sequence[str] | None = None) -> int:
    """Judge the forms, and print a line of JSON for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layouts", type=int, default=100_000)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seed", type=int, default=5000)
    parser.add_argument("--forms", nargs="*")
    options = parser.parse_args(given)
    status = 0
    with tempfile.TemporaryDirectory() as folder:
        written = forms(Shapes(Path(folder)))
        for form in options.forms or written:
            compiled = compile_scene({"floor": FLOOR, **written[form]}, options.device)
            table = make_table(compiled, options.layouts, options.seed)
            report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table)
            faults = len(report.conflicts) + len(report.misplaced) + report.relation_violations
            p = pvalue(compiled, written[form], table.present)
            print(json.dumps({"form": form, "layouts": len(table), "faults": faults, "p": p}), flush=True)
            status |= faults > 0 or p < _LEAST
    return int(status)


if __name__ == "__main__":
    raise SystemExit(main())
