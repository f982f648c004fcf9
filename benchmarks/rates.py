"""Rates of a run that are slower than the best ones so far, which rates.txt has.

    python -m benchmarks.rates FOLDER/rates.jsonl
    python -m benchmarks.rates FOLDER/rates.jsonl --update COMMIT

The first prints a line for each time that is more than 2% above the best time. The second also writes the times that
are better than the best ones, or new, to rates.txt.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

BEST = Path(__file__).with_name("rates.txt")
SLOWER = 1.02
"""A time counts as slower if it is more than this many times the best one: two runs of a commit differ by about 1%."""
TIMES = {"all": "ms", "2%": "ms_of_2_percent"}
"""Shares of the worlds that get layouts, and the key of the time [ms] in a line of `benchmarks.generator_rates`."""

Best = dict[tuple[str, int, str], tuple[float, str]]
"""The best time [ms] and its commit, by scene, number of worlds, and share."""


def read_best(text: str) -> Best:
    """Return the best times of a file such as rates.txt. Lines that begin with # are comments."""
    rows = (line.split() for line in text.splitlines() if line and not line.startswith("#"))
    return {(scene, int(worlds), share): (float(ms), commit) for scene, worlds, share, ms, commit in rows}


def measured(lines: Iterable[Mapping]) -> Iterator[tuple[tuple[str, int, str], float]]:
    """Yield the keys of `Best` and the times [ms] of lines of `benchmarks.generator_rates`."""
    for line in lines:
        for share, key in TIMES.items():
            yield (line["scene"], line["num_envs"], share), line[key]


def slower(best: Best, lines: Iterable[Mapping]) -> list[str]:
    """Return a text for each time that is more than 2% above the best one."""
    found = []
    for key, ms in measured(lines):
        least, commit = best.get(key, (ms, ""))
        if ms > SLOWER * least:
            scene, worlds, share = key
            what = f"{scene}, {share} of {worlds:,} worlds"
            found.append(f"slower: {what}: {ms} ms, +{ms / least - 1.0:.1%} of {least} ms ({commit})")
    return found


def better(best: Best, lines: Iterable[Mapping], commit: str) -> Best:
    """Return the best times with the ones of this commit, where they are lower or new."""
    return best | {key: (ms, commit) for key, ms in measured(lines) if key not in best or ms < best[key][0]}


def main() -> None:
    """Print what is slower, and update rates.txt if asked to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rates", type=Path)
    parser.add_argument("--update", metavar="COMMIT")
    words = parser.parse_args()
    text = BEST.read_text()
    best, lines = read_best(text), [json.loads(line) for line in words.rates.read_text().splitlines()]
    print(*slower(best, lines), sep="\n")
    if words.update:
        head = [line for line in text.splitlines() if line.startswith("#")]
        rows = sorted(better(best, lines, words.update).items())
        BEST.write_text("\n".join([*head, *(" ".join(map(str, (*key, *value))) for key, value in rows)]) + "\n")


if __name__ == "__main__":
    main()
