"""Of the layouts that `reachable: path` rejects and `clear` accepts, the share that RRT-Connect solves.

    python -m tests.stress.no_path clutter_extract drawer_pick shelf cupboard --rejected 40 --seconds 5

A line for each scene: the layouts that `clear` accepts, those of them without a path, how many of these are judged, and
how many RRT-Connect solves in the seconds of one core, for the margins of the package and without margins. It goes from
the start to any of up to eight pre-grasps from which the way to the grasp is free, too. The joints of these grasps, the
collisions and the search are by MuJoCo C and `tests/oracle/rrt_connect.py`. `goals` counts layouts that have such a
pre-grasp, since no search helps the others. `tight` counts layouts in whose grasp the hand is nearer to other objects
than its margin, which `clear` does not know.
"""

from __future__ import annotations

import argparse
import copy
import json
from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.walked import open_fingers
from tests.oracle.rrt_connect import Arm, connect
from tests.stress.paths import scene_of

MARGINS = ((0.003, 0.0005), (0.0, 0.0))
"""Least distances [m] of the robot on the way to the pre-grasp, and of the hand from there on."""
_COLUMNS = ("qpos", "mocap_pos", "mocap_quat", "grasp", "grasp_qpos", "pregrasp_qpos")
_BATCH, _GOALS, _TRIALS, _BACK, _NEAR = 64, 8, 8, 0.08, 0.8


def with_tier(name: str, tier: str) -> dict[str, Any]:
    """Return a scene of `tests.stress.paths` whose target has a tier. No layout gets a second try."""
    scene = copy.deepcopy(scene_of(name))
    for words in scene["objects"].values():
        words |= {"reachable": tier} if "reachable" in words else {}
    return {**scene, "restarts": 0, "bank": 1}


class Rejected:
    """The layouts of a scene, by both tiers.

    Args:
        name: The scene.
        device: Warp's name of the device.
    """

    def __init__(self, name: str, device: str = "cpu") -> None:
        compiled = [compile_scene(with_tier(name, tier), device) for tier in ("clear", "path")]
        self.compiled: CompiledScene = compiled[0]
        self._generators = [LayoutGenerator(one, _BATCH) for one in compiled]
        self.clear = self.without = 0

    def rows(self) -> Iterator[dict[str, np.ndarray]]:
        """Yield the state of each layout that `clear` accepts and that has no path, without end."""
        while True:
            for generator in self._generators:
                generator.generate()
            clear, path = (generator.layouts for generator in self._generators)
            ours = clear.status.cpu().numpy() == LayoutStatus.VALID
            theirs = path.status.cpu().numpy() != LayoutStatus.VALID
            self.clear += int(ours.sum())
            self.without += int((ours & theirs).sum())
            assert not (~ours & ~theirs).any()  # what has a path is clear
            for world in np.flatnonzero(ours & theirs):
                yield {name: getattr(clear, name)[world].cpu().numpy().astype(float) for name in _COLUMNS}


def arm_of(compiled: CompiledScene, row: dict[str, np.ndarray]) -> Arm:
    """Return the arm in a layout."""
    assert compiled.reaching is not None
    one, scene, mjm = compiled.reaching.arms[0], compiled.scene, copy.copy(compiled.mjm)
    robot = scene.subtree("robot")
    last = int(mjm.jnt_bodyid[np.flatnonzero(mjm.jnt_qposadr == one.arm.qposadr[-1])[0]])
    hand = [body for body in robot if last in _chain(mjm, body)]
    mocap = row["mocap_pos"][: mjm.nmocap], row["mocap_quat"][: mjm.nmocap]
    target = scene.subtree(compiled.reaching.names[0])
    return Arm(mjm, row["qpos"], mocap, scene.home_qpos, robot, hand, target, one.arm.qposadr, one.arm.tcp_site)


def _chain(mjm: mujoco.MjModel, body: int) -> Iterator[int]:
    while body:
        yield body
        body = int(mjm.body_parentid[body])


def _open_fingers(compiled: CompiledScene, arm: Arm, opening: float) -> None:
    assert compiled.reaching is not None
    open_fingers(compiled, compiled.reaching.arms[0], opening, arm.data.qpos)


def goals_of(
    compiled: CompiledScene, row: dict[str, np.ndarray], arm: Arm, margins: tuple[float, float]
) -> dict[float, list[np.ndarray]]:
    """Return opening of the fingers -> pre-grasps from which the way to the grasp is free.

    For the grasp that `clear` accepts, its joints are tried first.
    """
    assert compiled.reaching is not None
    found, rng = dict[float, list[np.ndarray]](), np.random.default_rng(0)
    start, number = arm.data.qpos[arm.adr].copy(), len(arm.adr)
    for i, grasp in enumerate(compiled.reaching.targets[0].grasp_set.grasps):
        arm.pose(start)
        body = arm.data.xmat[grasp.body].reshape(3, 3)
        mat, pos = np.zeros(9), arm.data.xpos[grasp.body] + body @ grasp.pos
        mujoco.mju_quat2Mat(mat, grasp.quat)
        mat = body @ mat.reshape(3, 3)
        _open_fingers(compiled, arm, grasp.opening)
        for trial in range(_TRIALS):
            first = row["grasp_qpos"][0, :number] if i == row["grasp"][0] else start
            at = arm.solve(pos, mat, rng.uniform(arm.low, arm.high) if trial else first)
            before = None if at is None else arm.solve(pos - _BACK * mat[:, 2], mat, at)
            if at is None or before is None or np.abs(at - before).max() > _NEAR:
                continue
            if arm.is_free(before, margins[0]) and arm.edge(before, at, *margins):
                found.setdefault(grasp.opening, []).append(before)
                if sum(map(len, found.values())) == _GOALS:
                    return found
                break
    return found


def is_solved(compiled: CompiledScene, row: dict[str, np.ndarray], margin: int, seconds: float) -> bool | None:
    """Return whether RRT-Connect finds a way, and None if there is no goal for it."""
    margins = MARGINS[margin]
    arm = arm_of(compiled, row)
    start = arm.data.qpos[arm.adr].copy()
    goals = goals_of(compiled, row, arm, margins)
    if not goals or not arm.is_free(start, margins[0]):
        return None
    for opening, some in goals.items():
        _open_fingers(compiled, arm, opening)
        way = connect(
            start,
            np.array(some),
            lambda a, b: arm.edge(a, b, margins[0]),
            arm.low,
            arm.high,
            seconds * len(some) / sum(map(len, goals.values())),
        )
        if way is not None:
            return True
    return False


def is_tight(compiled: CompiledScene, row: dict[str, np.ndarray]) -> bool:
    """Return whether the hand is within its margin in the grasp that `clear` accepts."""
    assert compiled.reaching is not None
    arm = arm_of(compiled, row)
    _open_fingers(compiled, arm, compiled.reaching.targets[0].grasp_set.grasps[int(row["grasp"][0])].opening)
    return not arm.is_free(row["grasp_qpos"][0, : len(arm.adr)], 0.0, MARGINS[0][1])


def measure(name: str, rejected: int, seconds: float, most: int, device: str = "cpu") -> dict[str, Any]:
    """Return the counts of a scene."""
    scene, counts, tight, judged = Rejected(name, device), np.zeros((2, 2), int), 0, 0
    for judged, row in enumerate(scene.rows(), 1):
        tight += is_tight(scene.compiled, row)
        for margin in range(len(MARGINS)):
            solved = is_solved(scene.compiled, row, margin, seconds)
            counts[margin] += [solved is not None, bool(solved)]
        if judged >= rejected or scene.clear >= most:
            break
    (goals, solved), (loose_goals, loose) = counts.tolist()
    return {
        "scene": name,
        "clear": scene.clear,
        "no_path": scene.without,
        "judged": judged,
        "tight": tight,
        "goals": goals,
        "solved": solved,
        "goals_without_margins": loose_goals,
        "solved_without_margins": loose,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--rejected", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--most", type=int, default=10_000, help="layouts of `clear` at most")
    parser.add_argument("--device", default="cpu")
    words = parser.parse_args(arguments)
    for name in words.scenes:
        print(json.dumps(measure(name, words.rejected, words.seconds, words.most, words.device)), flush=True)


if __name__ == "__main__":
    main()
