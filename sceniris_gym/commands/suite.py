"""The `suite` commands: make cases of a task, run a policy on them, compare two policies, and film cases."""

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sceniris_gym.config.loader import shipped
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.files import check_new
from sceniris_gym.suites.comparing import compare, plot, shares
from sceniris_gym.suites.making import make
from sceniris_gym.suites.running import played, read_rows, read_suite, run
from sceniris_gym.suites.suite import Case
from sceniris_gym.training.settings import share
from sceniris_gym.training.video import COLUMNS, PICTURES, filming
from sceniris_gym.vector.vector_env import SceneVectorEnv


def make_suite(task: str, axes: str, out: Path, **options: Any) -> dict[str, Any]:
    """Make a suite, write it, and return the number of cases by axis and grade, and of refused edits by cause."""
    check_new(out, "suite make")
    suite, refused = make(task, tuple(dict.fromkeys(axes.split(","))) if axes else (), **options)
    suite.write(out)
    found = {"suite": str(out), "hash": suite.head.hash, "cases": len(suite.cases)}
    tags, grades = (tag for c in suite.cases for tag in c.tags), (f"{c.axis} {c.grade}" for c in suite.cases)
    return found | {"tags": dict(Counter(tags)), "by_grade": dict(Counter(grades)), "refused": dict(refused)}


def run_suite(suite: str, policy: str, out: Path, **options: Any) -> dict[str, Any]:
    """Run a suite, given by its path or the name of a shipped suite, and return shares of success."""
    if "." not in suite:
        check_names("suite", [suite], "suite run", files := shipped("envs", ".jsonl"))
        suite = str(files[suite])
    rows = run(Path(suite), policy, out, **options)
    return {"rows": str(out), "fallback": sum(row["fallback"] for row in rows), "parts": shares(rows)}


def compare_suites(first: Path, second: Path, measure: str, picture: Path | None) -> dict[str, Any]:
    """Compare the rows of two policies, and draw their shares if there is a `picture`."""
    found = {"a": str(first), "b": str(second), "parts": compare(first, second, measure)}
    if picture is not None:
        plot({str(path): shares(read_rows(path)[1], measure) for path in (first, second)}, picture)
    return found


def film_suite(rows: Path, out: Path, *, failed: bool, **options: Any) -> dict[str, Any]:
    """Play cases again, and write MP4s with up to 16 worlds each, captioned with case, axis, grade and id.

    Raises:
        ArgumentError: The suite of the rows changed, or no row is left.
        UnknownNameError: The scene has no overview camera.
    """
    head, done = read_rows(rows)
    suite, files = read_suite(Path(head["file"]), trust=options["trust"]), []
    ends = {row["case"]: "success" if row["success"] else "failure" for row in done}
    some = [suite.cases[row["case"]] for row in done if suite.digest == head["of"] and not (failed and row["success"])]
    if not some:
        why = "has no such case" if suite.digest == head["of"] else f"{head['file']} changed since. Run it again"
        raise ArgumentError(f"{rows}: {why}.")

    @contextmanager
    def film(cases: list[Case], envs: SceneVectorEnv) -> Iterator[Any]:
        cameras = [envs.compiled.mjm.camera(i).name for i in range(envs.compiled.mjm.ncam)]
        check_names("camera", [PICTURES.camera], "suite film", cameras)
        files.append(str(out / f"film-{len(files):04}.mp4"))
        captions = [
            f"case {c.case}, {c.axis} {c.grade}: {ends[c.case]}\n{':'.join(c.id.split(':')[:4])}" for c in cases
        ]
        with filming(Path(files[-1]), envs, captions) as add:
            yield add

    options |= {"render_mode": "rgb_array", "render_config": PICTURES, "num_envs": COLUMNS**2, "film": film}
    for _ in played(suite, some, head["policy"], **options):
        pass
    return {"cases": len(some), "files": files}


def report(found: Mapping[str, Any]) -> str:
    """Return shares of success, or differences of two policies, as text."""
    lines = [f"{key}: {found[key]}" for key in ("rows", "fallback", "a", "b") if key in found]
    for one in found["parts"]:
        name = f"{one['axis']} {one['grade'] or ''}"
        if "p" in one:
            low, high = one["interval"]
            needed = f", {one['needed']:,} cases needed" if one["needed"] else ""
            text = f"{one['a']:.1%} {one['b']:.1%}, b - a {one['difference']:+.1%} ({low:+.1%} to {high:+.1%})"
            text += f", p {one['p']:.2g}{needed}"
        else:
            text = share(one)
        lines.append(f"{name:<16}{text}, {one['cases']:,} cases")
    return "\n".join(lines)
