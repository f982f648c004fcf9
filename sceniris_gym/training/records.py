"""The files that a run leaves in its folder; read without torch."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from sceniris_gym.errors import ArgumentError
from sceniris_gym.training.settings import Settings

CONFIG, LOG, MODEL, JUDGED, TEACHER = "config.json", "log.jsonl", "model.pt", "judged.json", "teacher.pt"


def read_config(folder: Path) -> tuple[str, Settings]:
    """Return the task and the settings of the run in a folder that has a model.

    Raises:
        ArgumentError: It is no such folder; the message says what is missing.
    """
    for name in (CONFIG, MODEL):
        if not (folder / name).is_file():
            raise ArgumentError(
                f"{folder}: should be the folder of a run that 'sceniris-gym train TASK --out {folder}' made, "
                f"but has no {name}."
            )
    try:
        told = json.loads((folder / CONFIG).read_text())
        return told["options"]["task"], Settings(**told["settings"])
    except (ValueError, KeyError, TypeError) as error:
        raise ArgumentError(f"{folder / CONFIG}: should be as 'sceniris-gym train' writes it: {error}.") from None


def scene_of_run(folder: Path) -> str | None:
    """Return the hash of the scene of the run in a folder; None for one of version 0.1.0, which wrote none."""
    return json.loads((folder / CONFIG).read_text()).get("scene", {}).get("hash")


def evaluations(folder: Path) -> list[dict[str, Any]]:
    """Return the lines of the evaluations in the log of the run in a folder, in their order."""
    lines = [json.loads(line) for line in (folder / LOG).read_text().splitlines()]
    return [line for line in lines if line["kind"] == "eval"]


def without_layouts(found: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return what judging found by the kind of layouts, without the verdict on each layout."""
    return {name: {key: value for key, value in one.items() if key != "each"} for name, one in found.items()}


def share(one: dict[str, Any]) -> str:
    """Return the share of successes that judging found, with its interval, as text."""
    return "{:.1%} ({:.1%} to {:.1%})".format(one["success"], *one["interval"])


def success_interval(successes: int, number: int) -> tuple[float, float]:
    """Return the ends of the 95% Wilson interval of a share: 1.96 standard deviations to either side (Wilson 1927)."""
    from scipy.stats import binomtest  # takes a second to import

    if number == 0:
        return 0.0, 1.0
    interval = binomtest(successes, number).proportion_ci(math.erf(1.96 / math.sqrt(2.0)), "wilson")
    return float(interval.low), float(interval.high)
