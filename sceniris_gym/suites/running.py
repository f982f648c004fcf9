"""Runs the cases of a suite, and appends a row for each to a file that a killed run can resume."""

import fcntl
import json
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.files import as_json, check_writable
from sceniris_gym.progress import tell
from sceniris_gym.suites.suite import Case, Suite, read_lines
from sceniris_gym.training.policies import fitted, policy_of
from sceniris_gym.training.task_scenes import make_env
from sceniris_gym.vector.evaluation import EpisodeResult, episodes
from sceniris_gym.vector.vector_env import SceneVectorEnv

Film = Callable[[list[Case], SceneVectorEnv], AbstractContextManager[Callable[[Tensor], object]]]
"""Takes the cases of a batch and the environment. The context yields the `film` of `episodes`."""


def run(source: Path, policy: str, out: Path, *, trust: bool = False, **options: Any) -> list[dict[str, Any]]:
    """Run each case once that has no row in `out` yet, and return the rows of all cases.

    Args:
        source: File of the suite.
        policy: Name of the policy, see `policy_of`.
        out: File of rows. Its first line names the suite and the policy.
        trust: See `policy_of`. Also import the suite's MODULE:ID.
        options: `num_envs` and `device`, see `played`.

    Raises:
        ArgumentError: `out` has rows of another suite or policy, or another process writes to `out`. The policy cannot
            be read, or has other observations.
        ScenirisError: The scene changed, or cannot be compiled.
    """
    suite = read_suite(source, trust=trust)
    head = {"rows": len(suite.cases), "of": suite.digest, "policy": policy, **asdict(suite.head)}
    check_writable(out)
    with out.open("ab+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise ArgumentError(f"{out}: another process writes to this file. Wait, or give another --out.") from None
        file.seek(0)
        end = file.read().rfind(b"\n") + 1
        file.truncate(end)  # a killed run may leave a part of a line
        before, rows = read_rows(out) if end else (head, [])
        differ = [key for key, value in json.loads(as_json(head)).items() if before.get(key) != value]
        if rows and differ:
            cure = "Give another --out, or the same suite and policy."
            raise ArgumentError(f"{out}: has rows of another {differ[-1]}. {cure}")
        if not rows:
            file.truncate(0)  # of a run that failed at its first step
            file.write((as_json(head | {"file": str(source)}) + "\n").encode())
        done = {row["case"] for row in rows}
        rest = [case for case in suite.cases if case.case not in done]
        for cases, results in played(suite, rest, policy, trust=trust, **options) if rest else ():
            lines = (as_json(asdict(c) | asdict(result)) for c, result in zip(cases, results, strict=True))
            file.write("".join(f"{line}\n" for line in lines).encode())
            file.flush()
            os.fsync(file.fileno())
    return read_rows(out)[1]


def read_suite(path: Path, *, trust: bool) -> Suite:
    """Read a suite to run it.

    Raises:
        ArgumentError: The file cannot be read, or its task is Python code and `trust` is False.
    """
    suite = Suite.read(path)
    if ":" in suite.head.task and not trust:
        raise ArgumentError(f"{path}: its task {suite.head.task} is Python code. If you trust it, give --trust.")
    return suite


def played(
    suite: Suite,
    cases: list[Case],
    policy: str,
    num_envs: int = 1024,
    device: str | None = None,
    *,
    trust: bool = False,
    film: Film = lambda *_: nullcontext(lambda _: None),
    **words: Any,
) -> Iterator[tuple[list[Case], list[EpisodeResult]]]:
    """Yield the cases and the results of each batch of at most `num_envs` worlds.

    Worlds that have finished wait for the others without a new episode. `words` are more arguments of the environment.
    """
    compiled, done = suite.compiled(device), 0
    for split in dict.fromkeys(case.split for case in cases):
        some = [case for case in cases if case.split == split]
        given = {"split": split, "params": suite.head.params, "autoreset_mode": "Disabled", "curriculum": None, **words}
        envs = make_env(suite.head.task, min(num_envs, len(some)), compiled, **given)
        acts = fitted(policy_of(policy, str(envs.device), trust=trust), policy, envs)
        for first in range(0, len(some), envs.num_envs):
            batch = some[first : first + envs.num_envs]
            with film(batch, envs) as add:
                (results,) = episodes(acts, envs, [case.id for case in batch], add)
            yield batch, results
            tell("cases", done := done + len(batch), len(cases))
        envs.close()


def read_rows(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return the first line of a file of rows, and the rows in the order of the cases.

    Raises:
        ArgumentError: The file has another form, or two rows of one case.
    """
    head, *rows = read_lines(path, "rows")
    needed = {"case", "id", "axis", "grade", "success", "success_once", "fallback"}
    if len({row.get("case") for row in rows}) < len(rows) or any(needed - row.keys() for row in rows):
        raise ArgumentError(f"{path}: should have one row for each case, with {', '.join(sorted(needed))}.")
    return head, sorted(rows, key=lambda row: row["case"])


def failures(path: Path, split: str | None) -> tuple[list[str], list[str]]:
    """Return the changes of the scene in a file of rows, and the layout ids of cases without success.

    If `split` is None, it is the split of the first id.

    Raises:
        ArgumentError: The file has another form, or no such id.
    """
    head, rows = read_rows(path)
    ids = [row["id"] for row in rows if not row["success"]]
    ids = [name for name in ids if name.split(":")[1] == (split or ids[0].split(":")[1])]
    if not ids:
        raise ArgumentError(f"{path}: has no failed case.")
    return head["changes"], ids
