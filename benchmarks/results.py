"""The page RESULTS.md, made of the latest run on a GPU and the latest on a CPU, each beside the run before it.

    python -m benchmarks.results FOLDER    keep what run.sh left in FOLDER as a run, and write the page
    python -m benchmarks.results           write the page anew

Runs are kept in `benchmarks/runs`, one file each.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.figures import Figure, Run, sections

HERE = Path(__file__).parent
PAGE = HERE / "RESULTS.md"
_HEAD = """# Results

Each column is one run of `benchmarks/run.sh` on one commit and one machine. Rates count fresh valid layouts only, and
are medians of wall-clock times with the device idle before and after. Code that does not import the generator checks
accuracy: FCL and winding numbers for collisions, MuJoCo C for penetration and settling, NumPy and shapely for supports
and relations, exact inverse kinematics for reach. Brackets show the value of the run before, if it differs. Figures
that a run did not measure are left out. Long measurements, and measurements that need other packages, were made
separately: [trainings](TRAININGS.md), and [imports, other models and long runs](OTHER_RESULTS.md).

"""


def keep(folder: Path) -> Path:
    """Join what `run.sh` left in a folder into a file of `benchmarks/runs`.

    Raises:
        SystemExit: the folder has no run, or the run is of sources that no commit holds
    """
    lines = {
        path.stem: [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("{")]
        for path in sorted(folder.glob("*.jsonl"))
    }
    if "about" not in lines:
        raise SystemExit(f"{folder} has no about.jsonl. Give the folder that benchmarks/run.sh wrote.")
    about = lines["about"][0]
    if about["commit"].endswith("dirty"):
        raise SystemExit(f"{folder} was measured with changes that are in no commit. Commit them, and run it again.")
    where = "cpu" if about["device"] == "cpu" else about["card"].replace(" ", "_").lower()
    file = HERE / "runs" / f"{about['date'][:10]}_{where}_{about['commit']}.json"
    file.write_text(json.dumps(lines, indent=0) + "\n", encoding="utf-8")
    return file


def runs(folder: Path) -> list[Run]:
    """Return the runs of a folder, latest first."""
    found = [Run(json.loads(file.read_text(encoding="utf-8")), file.stem) for file in folder.glob("*.json")]
    return sorted(found, key=lambda run: run.about["date"], reverse=True)


def page(kept: Sequence[Run]) -> str:
    """Return the text of the page."""
    on_gpu = [run for run in kept if run.about["device"] != "cpu"]
    on_cpu = [run for run in kept if run.about["device"] == "cpu"]
    columns = [column for column in (on_gpu, on_cpu) if column]
    text = _HEAD + "".join(f"- {_machine(column)}\n" for column in columns)
    names = " | ".join(_short(column[0]) for column in columns)
    for title, figures in sections().items():
        if rows := "".join(_row(figure, columns) for figure in figures):
            text += f"\n## {title}\n\n| figure | target | {names} | command |\n{'|---' * (len(columns) + 3)}|\n{rows}"
    return text


def _short(run: Run) -> str:
    return "CPU" if run.about["device"] == "cpu" else run.about["card"].removeprefix("NVIDIA ")


def _machine(column: Sequence[Run]) -> str:
    about = column[0].about
    where = f"{about['processor']}, {about['cores']} cores"
    if "card" in about:
        where = f"{about['card']}, driver {about['driver']}. {where}"
    versions = ", ".join(f"{name} {number}" for name, number in about["versions"].items())
    before = f" The run before: {column[1].name}." if len(column) > 1 else ""
    return (
        f"**{_short(column[0])}**: commit {about['commit']}, {about['date']}. {where}. Python {about['python']}, "
        f"{versions}.{before}"
    )


def _row(figure: Figure, columns: Sequence[Sequence[Run]]) -> str:
    """Return the row of a figure; nothing if no run has it."""
    values = [_value(figure, column[0]) for column in columns]
    if not any(values):
        return ""
    old = [_value(figure, column[1]) if len(column) > 1 else "" for column in columns]
    cells = [f"{new} ({was})" if was not in ("", new) else new for new, was in zip(values, old, strict=True)]
    measured = next(column[0] for column, value in zip(columns, values, strict=True) if value)
    command = figure.command.replace("DEVICE", measured.about["device"])
    return f"| {figure.what} | {figure.target} | {' | '.join(cells)} | `{command}` |\n"


def _value(figure: Figure, run: Run) -> str:
    try:
        return figure.value(run)
    except LookupError:
        return ""


def main(folders: Sequence[str]) -> None:
    """Keep the runs, and write the page."""
    for folder in folders:
        print(keep(Path(folder)))
    PAGE.write_text(page(runs(HERE / "runs")), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
