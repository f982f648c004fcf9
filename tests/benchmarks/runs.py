"""Folders of training runs, as far as tables and archives read them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sceniris_gym.training.settings import success_interval

NEAREST = [50] * 8 + [60] * 8 + [70] * 8 + [80] * 6 + [None] * 10


def write_run(folder: Path, name: str, success: float | None, sources: str = "a", **options: Any) -> None:
    """Write what a training run leaves: 40 layouts judged, half of them with 5 things, half with 9."""
    run = folder / name
    run.mkdir()
    told = {"options": {"task": "ClutterExtract-v0", "seed": 0, **options}, "sources": {"hash": sources}}
    (run / "config.json").write_text(json.dumps(told))
    line: dict[str, Any] = {"kind": "train", "seconds": 9.0, "env_steps": 3_000_000}
    if success is not None:
        hits = round(40 * success)
        told_of = {"success": success, "layouts": 40, "interval": success_interval(hits, 40)}
        judged = dict.fromkeys(("valid", "unfiltered"), told_of)
        each = {"success": [1] * hits + [0] * (40 - hits), "things": [5, 9] * 20, "nearest": NEAREST}
        (run / "judged.json").write_text(json.dumps({"valid": {"each": each}}))
        line |= {"kind": "eval", **judged}
    (run / "log.jsonl").write_text(json.dumps(line) + "\n")
