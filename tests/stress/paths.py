"""Walk the paths of many layouts in MuJoCo C, and count those on which the arm touches something.

    python -m tests.stress.paths drawer_pick shelf --layouts 25000 --points 2000 --processes 16 --device cuda:0

The device makes layouts whose targets have `reachable: path`. MuJoCo C then tests each path at points that are evenly
spaced along it. Only the hand may touch the target, on the last piece. Prints a line of JSON for each scene: how many
of the layouts that `clear` accepts have a path, how many paths have no, one and two vias, and how many touch something.
The status is 1 if a path does.
"""

from __future__ import annotations

import json
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import tyro

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.device import Cause
from tests.layout.reaching.test_paths import CUPBOARD
from tests.layout.walked import PathRow, Walker, opened, rows_of

_SHELF: dict[str, Any] = {
    "floor": {"size": [2.4, 2.0]},
    "robot": {"asset": "panda", "base": [0, 0, 0.4]},
    "objects": {
        "shelf": {
            "asset": "shelf",
            "kind": "fixture",
            "on": "floor",
            "region": {"box": [[0.6, -0.1], [0.7, 0.1]]},
            "orientation": {"yaw": [-100, -80]},
        },
        "can": {"asset": "can", "inside": "shelf", "ratio_on_support": 1, "reachable": "path"},
        **{f"bottle_{n}": {"asset": "bottle", "inside": "shelf", "ratio_on_support": 1} for n in range(3)},
    },
}
_OWN = {"shelf": _SHELF, "cupboard": CUPBOARD}
_CHUNK = 50
"""Paths that a process walks at a time."""


@dataclass(frozen=True)
class Options:
    """Options of the walk.

    Attributes:
        scenes: names of shipped scenes, or `shelf` and `cupboard`
        layouts: number of layouts of each scene
        nworld: number of layouts that the device makes at a time
        points: points on each path
        processes: number of processes that walk
        seed: seed of the layouts
        device: "cpu" or "cuda:0"
    """

    scenes: Annotated[tuple[str, ...], tyro.conf.Positional]
    layouts: int = 1000
    nworld: int = 4096
    points: int = 2000
    processes: int = 2
    seed: int = 0
    device: str = "cpu"


def scene_of(name: str) -> Any:
    """Return a scene whose targets have paths."""
    if name in _OWN:
        return _OWN[name]
    config = SceneConfig.load(name)
    targets = {config.owners.get(target, target) for target, words in config.objects.items() if words.reachable}
    return {"base": name, "objects": {target: {"reachable": "path"} for target in targets}}


_walker: Walker
_points: int


def _begin(walker: Walker, points: int) -> None:
    global _walker, _points
    _walker, _points = walker, points


def _walk(rows: list[PathRow]) -> int:
    """Return how many paths touch something. Points are in proportion to the lengths of the pieces."""
    touching = 0
    for row in rows:
        lengths = np.abs(np.diff(row.corners, axis=0)).max(axis=1)
        points = 1 + np.ceil(_points * lengths / lengths.sum()).astype(int)
        touching += bool(_walker.hit(row, points.tolist()))
    return touching


def measure(name: str, options: Options) -> dict[str, Any]:
    """Make and walk the layouts of a scene, and return its line."""
    compiled = compile_scene(scene_of(name), options.device)
    generator = LayoutGenerator(compiled, min(options.nworld, options.layouts), seed=options.seed)
    rows: list[PathRow] = []
    layouts, rejected, began = 0, 0, time.monotonic()
    while layouts < options.layouts:
        generator.generate()
        valid = generator.layouts.status.cpu().numpy() == LayoutStatus.VALID
        layouts += int(valid.sum())
        rows += opened(compiled, [row for row in rows_of(compiled, generator.layouts) if valid[row.world]])
        rejected += int(generator.layouts.rejections.cpu().numpy()[:, Cause.NO_PATH].sum())
    made, began = time.monotonic() - began, time.monotonic()
    corners = np.array([row.corners for row in rows])
    bent = [int((corners[:, 1 + n] != corners[:, 3]).any(axis=1).sum()) for n in (0, 1)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.processes, context, _begin, (Walker(compiled), options.points)) as pool:
        touching = sum(pool.map(_walk, [rows[at : at + _CHUNK] for at in range(0, len(rows), _CHUNK)]))
    line = {"scene": name, "layouts": layouts, "no_path": rejected, "accepted": layouts / (layouts + rejected)}
    line |= {"paths": len(rows), "vias": [len(rows) - bent[0], bent[0] - bent[1], bent[1]], "touching": touching}
    return line | {"seconds_made": round(made, 1), "seconds_walked": round(time.monotonic() - began, 1)}


def main(options: Options) -> int:
    """Walk the paths of all scenes, and return the status."""
    touching = 0
    for name in options.scenes:
        line = measure(name, options)
        print(json.dumps(line), flush=True)
        touching += line["touching"]
    return int(touching > 0)


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Options, description=__doc__)))
