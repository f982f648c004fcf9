"""Moves generated furniture as variants of one object, and compares each piece with a model of only this piece.

    python -m tests.stress.unit_motion --units 64 --worlds 800 --device cuda:0

Every world draws one of the units with open joints. All joints are pushed for half a second. No bit of their positions
may differ from a model that has only this unit. With `--things`, two things are on or in the unit, and the greatest
difference of all positions counts [m or rad]. Contacts, rows of constraints and sums have a fixed order.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import tyro

import sceniris_gym
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
THINGS = ("can", "tin")


@dataclass(frozen=True)
class Options:
    """Options of the comparison.

    Attributes:
        units: number of generated units
        worlds: number of worlds
        steps: physics steps
        seed: seed of the layouts
        things: put two things on or in the unit
        device: "cpu" or "cuda:0"
    """

    units: int = 64
    worlds: int = 800
    steps: int = 250
    seed: int = 0
    things: bool = False
    device: str = "cpu"


def scene_of(asset: Any, *, things: Mapping[str, Any] | None, moves: bool = True) -> dict[str, Any]:
    """Return a scene of a unit, and of things at a place. `moves` tells whether the unit has joints."""
    unit = {"asset": asset, "kind": "fixture", "on": "floor", "region": {"box": [[-0.2, 0.0], [0.2, 0.3]]}}
    unit |= {"orientation": {"yaw": [-30, 30]}, **({"joints": {"*": {"fraction": [0.2, 0.6]}}} if moves else {})}
    placed = {} if things is None else {name: {"asset": name, **things} for name in THINGS}
    return {"bank": 4, "floor": {"size": [8, 8]}, "objects": {"unit": unit, **placed}}


def batch_of(scene: SceneModel, options: Options) -> Batch:
    """Return worlds whose steps are the same in every run, also on a GPU."""
    batch = Batch(scene, options.worlds, options.device)
    batch.model.opt.deterministic = int(mjw.DeterminismType.ALL)
    return batch


def run(batch: Batch, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Step worlds, and return qpos and qvel."""
    for _ in range(steps):
        batch.step()
    return batch.data.qpos.numpy(), batch.data.qvel.numpy()


class Comparison:
    """The units of all worlds, before and after the steps."""

    def __init__(self, compiled: CompiledScene, options: Options) -> None:
        self.compiled, self.options = compiled, options
        batch = batch_of(compiled.scene, options)
        randomizer = ResetRandomizer.of_batch(batch, compiled, seed=options.seed)
        randomizer.reset()
        self.variant, self.sim = randomizer.variants.cpu().numpy()[:, 0], compiled.sim_mjm
        qvel = np.zeros((options.worlds, self.sim.nv), np.float32)
        for world, number in enumerate(self.variant):
            for joint in self.joints(number).values():
                slides = self.sim.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
                qvel[world, self.sim.jnt_dofadr[joint]] = 0.3 if slides else 0.6
        batch.data.qvel.assign(qvel)
        self.start = {
            name: getattr(batch.data, name).numpy().copy() for name in ("qpos", "qvel", "mocap_pos", "mocap_quat")
        }
        self.qpos, self.qvel = run(batch, options.steps)
        at_limit = mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS  # of the solver: nothing is dropped
        overflow = int(np.bitwise_or.reduce(batch.data.overflow.numpy())) & ~int(at_limit)
        assert overflow == 0, overflow

    def joints(self, number: int) -> dict[str, int]:
        """Return the shared joint that simulates each joint of a variant, by the joint's own name."""
        scene = self.compiled.scene
        found = scene.joints(self.compiled.config.variants["unit"][number])
        return {name: scene.sim_joint(joint) for name, joint in found.items()}

    def unused(self) -> bool:
        """Return whether all joints that a world lacks are at exactly 0."""
        own = [joint for joint in range(self.sim.njnt) if self.sim.joint(joint).name.startswith("unit/")]
        for world, number in enumerate(self.variant):
            lacks = [joint for joint in own if joint not in self.joints(number).values()]
            if (
                self.qpos[world, self.sim.jnt_qposadr[lacks]].any()
                or self.qvel[world, self.sim.jnt_dofadr[lacks]].any()
            ):
                return False
        return True

    def differences(self, number: int, file: str) -> tuple[int, float]:
        """Return how many joint positions differ from a variant's own model, and the greatest difference of positions.

        On a GPU, a block sums over all joints of the shared model in another order. Contacts enlarge differences.
        """
        things = {"on": "floor", "region": {"box": [[-1.0, -2.4], [1.0, -2.0]]}} if self.options.things else None
        scene = build_model(scene_of(file, things=things, moves=bool(self.joints(number))))
        own, batch = scene.mjm, batch_of(scene, self.options)
        pairs = [(scene.joints("unit")[name], joint) for name, joint in self.joints(number).items()]
        if self.options.things:
            pairs += [(own.joint(f"{name}/free").id, self.sim.joint(f"{name}/free").id) for name in THINGS]
        state = {name: getattr(batch.data, name).numpy().copy() for name in self.start}
        places = []
        for joint, shared in pairs:
            nq, nv = (7, 6) if own.jnt_type[joint] == FREE else (1, 1)
            for word, width, to, of in (
                ("qpos", nq, own.jnt_qposadr[joint], self.sim.jnt_qposadr[shared]),
                ("qvel", nv, own.jnt_dofadr[joint], self.sim.jnt_dofadr[shared]),
            ):
                state[word][:, to : to + width] = self.start[word][:, of : of + width]
            to, of = own.jnt_qposadr[joint], self.sim.jnt_qposadr[shared]
            places.append((slice(to, to + nq), slice(of, of + nq)))
        to, of = (m.body_mocapid[m.body("unit").id] for m in (own, self.sim))
        for word in ("mocap_pos", "mocap_quat"):
            state[word][:, to] = self.start[word][:, of]
        for word, values in state.items():
            getattr(batch.data, word).assign(values)
        theirs, rows = run(batch, self.options.steps)[0], self.variant == number
        words, far = 0, 0.0
        for to, of in places:
            one, other = self.qpos[rows][:, of], theirs[rows][:, to]
            words += int((one != other).sum()) if one.shape[1] == 1 else 0
            far = max(far, float(np.abs(one - other).max()))
        return words, far


def main(options: Options) -> dict[str, Any]:
    """Compare all units, print a line, and return its content."""
    with tempfile.TemporaryDirectory() as folder:
        sceniris_gym.furniture(Path(folder) / "units", n=options.units, seed=0)
        things = {"in": {"any": "unit"}, "ratio_on_support": 1} if options.things else None
        compiled = compile_scene(scene_of(f"{folder}/units/*.xml", things=things), options.device, cache=False)
        found = Comparison(compiled, options)
        members = compiled.config.variants["unit"]
        drawn = sorted(set(found.variant.tolist()))
        each = [found.differences(k, f"{folder}/units/{members[k].partition('/')[2]}.xml") for k in drawn]
    words, far = zip(*each, strict=True)
    line = {"units": len(members), "drawn": len(drawn), "worlds": options.worlds, "steps": options.steps}
    line |= {"differing_words": sum(words), "largest": max(far), "unused_at_zero": found.unused()}
    print(json.dumps(line), flush=True)
    return line


if __name__ == "__main__":
    told = main(tyro.cli(Options, description=__doc__))
    sys.exit(not told["unused_at_zero"] or (told["differing_words"] > 0 and not tyro.cli(Options).things))
