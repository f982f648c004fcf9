"""Pace of the viewer's page once it is there: another seed, physics of one world, and memory over many seeds.

python -m benchmarks.viewer_pace mid --worlds 64

Prints a line of JSON. No browser looks at the page: what one draws is not counted.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from pathlib import Path

from sceniris_gym.viewer.deck import Where
from sceniris_gym.viewer.scene_file import SceneFile
from sceniris_gym.viewer.server import close_server, open_server
from sceniris_gym.viewer.view import SceneView

_PHYSICS = 5.0  # s of physics that is played


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def seed_changes(view: SceneView, num: int) -> list[float]:
    """Show so many seeds one after another; gives how long each took [ms]."""
    took = []
    for seed in range(num):
        begun = time.perf_counter()
        view.go(view.where._replace(seed=seed))
        took.append(1e3 * (time.perf_counter() - begun))
    return took


def frames(view: SceneView) -> float:
    """Play physics, and return how many pictures of it are sent in a second."""
    view.play(True)
    sent, end = 0, time.perf_counter() + _PHYSICS
    while time.perf_counter() < end:
        view.tick()
        sent += 1
    view.play(False)
    return sent / _PHYSICS


def main() -> None:
    """Print the figures of a scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--port", type=int, default=8099)
    words = parser.parse_args()
    found: dict[str, float] = {}
    server = open_server("127.0.0.1", words.port)
    view = SceneView(server, SceneFile(words.scene, {}), Where(), words.worlds)
    view.load()
    seed_changes(view, 20)
    found["seed_change_ms"] = statistics.median(seed_changes(view, 100))
    view.show_worlds(1)
    seed_changes(view, 100)
    before = resident()
    found["seed_change_one_world_ms"] = statistics.median(seed_changes(view, words.seeds))
    found["memory_mb"] = resident() - before
    found["frames_per_second"] = frames(view)
    close_server(server)
    print(json.dumps({name: round(value, 2) for name, value in found.items()}))


if __name__ == "__main__":
    main()
