"""Sources, versions and machine of a run, as a line of JSON.

python -m benchmarks.machine cuda:0 COMMIT
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("warp-lang", "mujoco", "mujoco-warp", "torch", "gymnasium", "python-fcl")


def processor() -> str:
    """Return the processor's name, or its architecture where Linux does not tell."""
    told = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").is_file() else ""
    named = [line.partition(":")[2].strip() for line in told.splitlines() if line.startswith("model name")]
    return named[0] if named else platform.machine()


def main(device: str, commit: str) -> None:
    """Print the line."""
    about = {
        "commit": commit,
        "date": time.strftime("%Y-%m-%d %H:%M"),
        "device": device,
        "processor": processor(),
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }
    if device != "cpu":
        query = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
        cards = subprocess.run(query, check=True, capture_output=True, text=True).stdout.splitlines()
        card, driver = cards[0].split(", ")
        about |= {"card": card, "driver": driver}
    print(json.dumps(about))


if __name__ == "__main__":
    main(*sys.argv[1:])
