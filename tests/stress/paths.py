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

import mujoco
import numpy as np
import tyro

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause
from tests.layout.reaching.test_paths import CUPBOARD

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
"""Layouts that a process walks at a time."""


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


class Walker:
    """MuJoCo C's model of a scene with an arm, and the bodies that may touch."""

    def __init__(self, compiled: CompiledScene) -> None:
        self.mjm, self.data = compiled.mjm, mujoco.MjData(compiled.mjm)
        assert compiled.reaching is not None
        (reached,) = compiled.reaching.arms
        mjm, robot = self.mjm, compiled.scene.subtree(next(iter(compiled.config.all_robots)))
        self.own = np.isin(np.arange(mjm.nbody), robot)
        self.joints = reached.arm.qposadr
        of_robot = [j for j in range(mjm.njnt) if self.own[mjm.jnt_bodyid[j]]]
        self.slides = mjm.jnt_qposadr[[j for j in of_robot if mjm.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE]]
        self.widest = reached.gripper.opening
        targets = compiled.reaching.targets
        self.targets = [np.isin(np.arange(mjm.nbody), compiled.scene.subtree(each.name)) for each in targets]
        self.openings = [np.array([grasp.opening for grasp in each.grasp_set.grasps]) for each in targets]

    def touches(self, row: dict[str, np.ndarray], column: int, points: int) -> bool:
        """Return whether the arm touches something on the path of a row to a target.

        Args:
            row: qpos, mocap_pos, mocap_quat, grasp and the corners of each target, shape (ntarget, 5, njoint).
            column: The target.
            points: Number of points, in proportion to the lengths of the pieces.
        """
        mjm, data, corners, target = self.mjm, self.data, row["corners"][column], self.targets[column]
        lengths = np.abs(np.diff(corners, axis=0)).max(axis=1)
        for name in ("qpos", "mocap_pos", "mocap_quat"):
            getattr(data, name)[:] = row[name][: len(getattr(data, name))]
        # two fingers on slides open each by half of the width that `clear` opens them to
        data.qpos[self.slides] = 0.5 * min(self.openings[column][row["grasp"][column]] + 0.01, self.widest)
        for piece, length in enumerate(lengths):
            for share in np.linspace(0.0, 1.0, 1 + int(np.ceil(points * length / lengths.sum()))):
                data.qpos[self.joints] = (1.0 - share) * corners[piece] + share * corners[piece + 1]
                mujoco.mj_kinematics(mjm, data)
                mujoco.mj_comPos(mjm, data)
                mujoco.mj_collision(mjm, data)
                pairs = mjm.geom_bodyid[data.contact.geom[data.contact.dist < 0.0]]
                mine = self.own[pairs].any(axis=1)
                if piece == len(lengths) - 1:
                    mine &= ~target[pairs].any(axis=1)
                if mine.any():
                    return True
        return False


_walker: Walker
_points: int


def _begin(walker: Walker, points: int) -> None:
    global _walker, _points
    _walker, _points = walker, points


def _walk(rows: list[dict[str, np.ndarray]]) -> tuple[int, int]:
    """Return how many paths touch something, and how many were walked."""
    with_path = [(row, c) for row in rows for c in range(len(row["corners"])) if np.isfinite(row["corners"][c]).all()]
    return sum(_walker.touches(row, column, _points) for row, column in with_path), len(with_path)


def rows_of(generator: LayoutGenerator, njoint: int) -> list[dict[str, np.ndarray]]:
    """Return the valid layouts of a generator, with the corners of their paths."""
    names = ("qpos", "mocap_pos", "mocap_quat", "grasp", "path", "pregrasp_qpos", "grasp_qpos", "status")
    made = {name: getattr(generator.layouts, name).cpu().numpy() for name in names}
    path = made["path"].reshape(*made["path"].shape[:2], 3, -1)
    ends = np.stack([made["pregrasp_qpos"], made["grasp_qpos"]], axis=2)
    corners = np.concatenate([path, ends], axis=2)[..., :njoint]
    kept = {**{name: made[name] for name in names[:4]}, "corners": corners}
    valid = np.flatnonzero(made["status"] == LayoutStatus.VALID)
    return [{name: values[row] for name, values in kept.items()} for row in valid]


def measure(name: str, options: Options) -> dict[str, Any]:
    """Make and walk the layouts of a scene, and return its line."""
    compiled = compile_scene(scene_of(name), options.device)
    assert compiled.reaching is not None
    njoint = len(compiled.reaching.arms[0].arm.joints)
    generator = LayoutGenerator(compiled, min(options.nworld, options.layouts), seed=options.seed)
    rows: list[dict[str, np.ndarray]] = []
    rejected, began = 0, time.monotonic()
    while len(rows) < options.layouts:
        generator.generate()
        rows += rows_of(generator, njoint)
        rejected += int(generator.layouts.rejections.cpu().numpy()[:, Cause.NO_PATH].sum())
    made, began = time.monotonic() - began, time.monotonic()
    corners = np.concatenate([row["corners"] for row in rows])
    corners = corners[np.isfinite(corners).all(axis=(1, 2))]
    bent = [int((corners[:, 1 + n] != corners[:, 3]).any(axis=1).sum()) for n in (0, 1)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.processes, context, _begin, (Walker(compiled), options.points)) as pool:
        counts = list(pool.map(_walk, [rows[at : at + _CHUNK] for at in range(0, len(rows), _CHUNK)]))
    touching, walked = (sum(column) for column in zip(*counts, strict=True))
    line = {"scene": name, "layouts": len(rows), "no_path": rejected, "accepted": len(rows) / (len(rows) + rejected)}
    line |= {"paths": walked, "vias": [walked - bent[0], bent[0] - bent[1], bent[1]], "touching": touching}
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
