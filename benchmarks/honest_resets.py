"""Count resets that start in contact with anything but the support, or that explode.

    python -m benchmarks.honest_resets --layouts 100000 --out results/honest.jsonl

Compares, for each task, layouts from the generator with uniform placement without checks. A reset explodes when an
object, or a point of a door or drawer, moves faster than 1 m/s within 0.1 s while the arm is held in its start pose.
Contacts and motion are those of MuJoCo-Warp; a contact that it had no room for is an error. Prints a line of JSON for
each task and kind of placement. Lines that the file has already are not measured again, and a file that was made with
other options is refused.
"""

from __future__ import annotations

import itertools
import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import tyro

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.registration import ENVS
from sceniris_gym.scene.model import SceneModel, subtree
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.versions import OverflowType
from sceniris_gym.training.layout_sources import unchecked
from sceniris_gym.training.task_scenes import SEED_SPACING, scene_of

FASTEST = 1.0
"""Speed of an object above which a reset counts as exploded [m/s]."""

WATCHED = 0.1
"""How long a reset is watched [s]."""

LOST = OverflowType.HFIELD | OverflowType.EPA_HORIZON | OverflowType.NJMAX_NNZ
"""Overflows that lose a contact or its effect, besides those that `check_budget` reports."""


@dataclass(frozen=True)
class Options:
    """Options of a count.

    Attributes:
        layouts: number of layouts of each kind, rounded up to whole batches
        num_envs: worlds in a batch
        tasks: ids without their namespace; all tasks of this package if empty
        out: file for the results
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
        nconmax: room for contacts of each world
        njmax: room for constraint rows of each world
        seed: number of the experiment; its layout seeds start at 16 * 2^20 times it
    """

    layouts: int = 100_000
    num_envs: int = 4096
    tasks: tuple[str, ...] = ()
    out: Path = Path("results/honest.jsonl")
    device: str | None = None
    nconmax: int = 320
    njmax: int = 4096  # of 3,000 uniform kitchens, one in which something explodes took 1,527 rows
    seed: int = 9


class Judge:
    """Checks resets of one CompiledScene with MuJoCo-Warp."""

    def __init__(self, compiled: CompiledScene, layout_source: LayoutSource, options: Options) -> None:
        self.batch = Batch(
            compiled.scene, options.num_envs, compiled.device, nconmax=options.nconmax, njmax=options.njmax, substeps=1
        )
        mjm = self.batch.scene.mjm  # the variants of an object share one body here
        self.randomizer = ResetRandomizer(compiled, self.batch.model, self.batch.data, layout_source=layout_source)
        self.supports = supports(self.batch.scene)
        free = mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        self.velocities = mjm.jnt_dofadr[free][:, None] + np.arange(3)
        self.levers = levers(self.batch.scene)
        self.steps = round(WATCHED / mjm.opt.timestep)

    def look(self, seed: int) -> tuple[Counter, Counter]:
        """Reset all worlds; count the outcomes, and in how many worlds each pair of bodies touched.

        Raises:
            ContactBudgetError: there was no room for a contact or its constraint rows; names the option to increase
            RuntimeError: a contact was lost in another way
        """
        self.randomizer.reseed(seed=np.uint64(seed) + np.arange(self.batch.nworld, dtype=np.uint64))
        self.randomizer.reset()
        in_contact, pairs = self._touching()
        fallback = self.randomizer.layouts.status.cpu().numpy() == LayoutStatus.FALLBACK
        fastest = np.zeros(self.batch.nworld)
        for _ in range(self.steps):
            self.batch.step()
            fastest = np.maximum(fastest, self.speeds(self.batch.data.qvel.numpy()))
        self._check_room()
        exploded = fastest > FASTEST
        return Counter(
            layouts=self.batch.nworld,
            in_contact=int(in_contact.sum()),
            exploded=int(exploded.sum()),
            either=int((in_contact | exploded).sum()),
            fallback=int(fallback.sum()),
        ), pairs

    def speeds(self, qvel: np.ndarray) -> np.ndarray:
        """Return the greatest speed in each world for velocities (nworld, nv) [m/s]; infinity for NaN."""
        free = np.linalg.norm(qvel[:, self.velocities], axis=2)
        jointed = np.abs(qvel[:, list(self.levers)]) * list(self.levers.values())
        return np.nan_to_num(np.hstack([free, jointed]).max(axis=1, initial=0.0), nan=np.inf)

    def _touching(self) -> tuple[np.ndarray, Counter]:
        """Return a mask of worlds where bodies touch that do not carry each other, and the number of worlds by pair."""
        d, mjm = self.batch.data, self.batch.scene.mjm
        self._check_room()
        number = int(d.nacon.numpy()[0])
        bodies = np.sort(mjm.geom_bodyid[d.contact.geom.numpy()[:number]], axis=1)
        rows = np.unique(np.column_stack([d.contact.worldid.numpy()[:number], bodies]), axis=0)
        in_contact, pairs = np.zeros(self.batch.nworld, bool), Counter()
        for pair in np.unique(rows[:, 1:], axis=0):
            first, second = (mjm.body(int(body)).name for body in pair)
            if self.supports.get(first) != second and self.supports.get(second) != first:
                worlds = rows[(rows[:, 1:] == pair).all(axis=1), 0]
                in_contact[worlds] = True
                pairs[f"{first} + {second}"] = len(worlds)
        return in_contact, pairs

    def _check_room(self) -> None:
        """Raise if a contact was lost now or since the reset."""
        self.randomizer.check_budget()
        lost = OverflowType(int(np.bitwise_or.reduce(self.batch.data.overflow.numpy()))) & LOST
        if lost:
            raise RuntimeError(f"MuJoCo-Warp lost contacts that it had no room for: {lost.name}.")


def supports(scene: SceneModel) -> dict[str, str]:
    """Return the body that each object stands on; `world` for the floor."""
    parents = {name: part.support.parent for name, part in scene.config.objects.items() if part.support is not None}
    return {name: "world" if parent == "floor" else parent for name, parent in parents.items()}


def levers(scene: SceneModel) -> dict[int, float]:
    """Return the speed of the fastest point at unit velocity of each joint of an object, by address in qvel.

    It is 1 for a slide [m/s per m/s]. For a hinge it is the distance from its axis to the farthest corner of the geoms
    that it rotates, in the model's start pose [m/s per rad/s].
    """
    mjm, robot = scene.mjm, scene.config.robot
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    found = {}
    for joint in range(mjm.njnt):
        kind, name = mjm.jnt_type[joint], mjm.joint(joint).name
        held = robot is not None and name.startswith(f"{robot.name}/")
        if kind == mujoco.mjtJoint.mjJNT_SLIDE and not held:
            found[int(mjm.jnt_dofadr[joint])] = 1.0
        elif kind == mujoco.mjtJoint.mjJNT_HINGE and not held:
            corners = _corners(mjm, data, int(mjm.jnt_bodyid[joint]))
            away = np.cross(corners - data.xanchor[joint], data.xaxis[joint])
            found[int(mjm.jnt_dofadr[joint])] = float(np.linalg.norm(away, axis=1).max())
    return found


def _corners(mjm: mujoco.MjModel, data: mujoco.MjData, body: int) -> np.ndarray:
    """Return the corners of the boxes around the geoms of a body and its descendants [m], world frame, shape (n, 3)."""
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    boxes = []
    for geom in np.flatnonzero(np.isin(mjm.geom_bodyid, subtree(mjm, body))):
        center, half = np.split(mjm.geom_aabb[geom], 2)
        boxes.append(data.geom_xpos[geom] + (center + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T)
    return np.concatenate(boxes)


def count(task: str, placement: str, options: Options) -> dict[str, Any]:
    """Return the counts for a task and a kind of placement ("fresh" or "uniform")."""
    compiled = compile_scene(scene_of(task, reachable=placement == "fresh"), options.device)
    drawn = compiled if placement == "fresh" else unchecked(compiled)
    judge = Judge(compiled, LayoutGenerator(drawn, options.num_envs), options)
    counts, pairs = Counter(), Counter()
    seed = options.seed * 16 * SEED_SPACING
    while counts["layouts"] < options.layouts:
        some, touching = judge.look(seed + counts["layouts"])
        counts += some
        pairs += touching
    counts = {name: counts[name] for name in ("layouts", "in_contact", "exploded", "either", "fallback")}
    asked = asked_of(options)
    return {"task": task, "placement": placement, "asked": asked, **counts, "pairs": dict(pairs.most_common(5))}


def asked_of(options: Options) -> dict[str, int]:
    """Return the options that a result depends on; room for contacts is none, as too little of it is an error."""
    return {name: getattr(options, name) for name in ("layouts", "num_envs", "seed")}


def answers(file: Path) -> list[dict[str, Any]]:
    """Return the lines of a file of results, after removing one that was cut off when a run was stopped."""
    text = file.read_text() if file.exists() else ""
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        file.write_text(whole)
    return [json.loads(line) for line in whole.splitlines()]


def main(options: Options) -> None:
    """Count what the file lacks.

    Raises:
        SystemExit: the file has results for other options
    """
    options.out.parent.mkdir(parents=True, exist_ok=True)
    asked = asked_of(options)
    lines = answers(options.out)
    if any(line.get("asked") != asked for line in lines):
        raise SystemExit(f"{options.out} is about other options than {asked}. Remove it, or give another --out.")
    done = {(line["task"], line["placement"]) for line in lines}
    for task in options.tasks or [name.split("/")[1] for name in ENVS]:
        for placement in ("fresh", "uniform"):
            if (task, placement) in done:
                continue
            line = json.dumps(count(task, placement, options))
            print(line, flush=True)
            with options.out.open("a") as file:
                file.write(line + "\n")


if __name__ == "__main__":
    main(tyro.cli(Options))
