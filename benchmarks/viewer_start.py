"""How long `sceniris-gym view` takes: to its address, to the first message that a page gets, and until worlds are sent.

python -m benchmarks.viewer_start mid --worlds 64

A client that speaks viser's protocol stands for the browser, whose own drawing is not counted. Prints a line of JSON
for each start, in seconds from before the process was started.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from importlib.metadata import version

from websockets.sync.client import connect

_WORLDS = b"BatchedGlb"
"""What the message that shows meshes in many places is called."""


def start(scene: str, worlds: int) -> dict[str, float]:
    """Start the page, connect to it, and wait until the worlds are there."""
    command = [sys.executable, "-m", "sceniris_gym", "view", scene, "--worlds", str(worlds)]
    begun = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        times = {"address": time.perf_counter() - begun}
        page = address.rstrip("/").replace("http", "ws")
        with connect(page, subprotocols=[f"viser-v{version('viser')}"], max_size=None) as socket:  # type: ignore[list-item]
            received = socket.recv(timeout=60)
            times["first_message"] = time.perf_counter() - begun
            while _WORLDS not in received:  # type: ignore[operator]
                received = socket.recv(timeout=60)
            times["worlds"] = time.perf_counter() - begun
        process.terminate()
    return {name: round(seconds, 2) for name, seconds in times.items()}


def main() -> None:
    """Print a line for each start."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=4)
    words = parser.parse_args()
    for _ in range(words.repeats):
        print(json.dumps(start(words.scene, words.worlds)), flush=True)


if __name__ == "__main__":
    main()
