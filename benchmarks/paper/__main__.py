"""The experiments of the Sceniris paper, row by row, beside the paper's own figures and those of peers.

python -m benchmarks.paper --peer scene_synthesizer --peer uniform -o results/
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from benchmarks.paper import report, suite
from sceniris_gym.errors import ScenirisError


def main(
    device: str | None = None,
    quick: Annotated[
        bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="only what takes minutes on a CPU")
    ] = False,
    peer: Annotated[
        tyro.conf.UseAppendAction[tuple[Literal["scene_synthesizer", "uniform"], ...]],
        tyro.conf.arg(help="measure this too, on the same meshes"),
    ] = (),
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"], help="folder for paper.json and paper.png")] = None,
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="print one line of JSON")] = False,
) -> None:
    """Measure the experiments of the Sceniris paper; print them, and write them as JSON and as a picture."""
    if out is not None:
        report.check(out)
    found = suite.run(device, quick, peer, suite.progress)
    if out is not None:
        report.write(found, out)
    print(report.as_json(found) if json else report.as_text(found))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except ScenirisError as error:
        sys.exit(f"benchmarks.paper: {error}")
