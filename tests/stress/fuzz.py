"""Bad scenes, models, maps, files and calls, as many as wanted: what of them ends in anything but words or layouts.

python -m tests.stress.fuzz --n 20000 [--first 0] [--jobs 2] [--uses]

Case i is a function of i alone; `tests/fuzz/` makes and judges it. With `--uses` cases are wrong uses of environments,
snapshots, levels, tables, problem files and runs. Cases run in processes of their own, so that a crash
is found as well. The exit status is 1 if there is a traceback, a hang, nonsense that was accepted, or a crash.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path

from tqdm import tqdm

_CASES = 2000  # of a process
_LIMIT = 600.0  # seconds of a process


def main() -> None:
    """Run the cases, and print how they ended as one line of JSON; findings go to stderr."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--uses", action="store_true")
    words = parser.parse_args()
    counts: Counter[str] = Counter()
    starts = range(words.first, words.first + words.n, _CASES)
    with ThreadPoolExecutor(words.jobs) as pool, tqdm(total=words.n, file=sys.stderr) as bar:
        for found, bad in pool.map(
            lambda s: _in_a_process(s, min(_CASES, words.first + words.n - s), words.uses), starts
        ):
            counts += found
            bar.update(sum(found.values()))
            for text in bad:
                bar.write(text, file=sys.stderr)
    wrong = sum(counts[name] for name in ("traceback", "hang", "nonsense", "crash"))
    print(json.dumps({"cases": sum(counts.values()), **counts, "wrong": wrong}))
    sys.exit(int(wrong > 0))


def _in_a_process(first: int, number: int, uses: bool) -> tuple[Counter[str], list[str]]:
    """Run some cases; where the process dies, the case that it was at is a crash, and the rest run in another one."""
    counts: Counter[str] = Counter()
    bad: list[str] = []
    at, end = first, first + number
    while at < end:
        ours, theirs = multiprocessing.get_context("spawn").Pipe()
        process = multiprocessing.get_context("spawn").Process(target=_run, args=(theirs, at, end, uses), daemon=True)
        process.start()
        theirs.close()
        try:
            while at < end:
                if not ours.poll(_LIMIT):
                    counts["hang"] += 1
                    bad.append(f"case {at}: hang: no answer in {_LIMIT:.0f} s")
                    at += 1
                    break
                what, text = ours.recv()
                counts[what] += 1
                bad += text
                at += 1
        except EOFError:
            process.join(10.0)
            counts["crash"] += 1
            bad.append(f"case {at}: crash: exit status {process.exitcode}")
            at += 1
        process.kill()
        process.join()
    return counts, bad


def _run(pipe: Connection, first: int, end: int, uses: bool) -> None:
    import warp as wp

    from tests.fuzz.judge import fuzz

    wp.config.log_level = wp.LOG_ERROR
    with tempfile.TemporaryDirectory() as folder:
        for case in range(first, end):
            found = fuzz(case, 1, Path(folder), uses=uses)
            pipe.send((next(iter(found.counts)), found.bad))


if __name__ == "__main__":
    main()
