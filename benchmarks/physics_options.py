"""Time of a control step with other options of the physics, or as one CUDA graph.

    python -m benchmarks.physics_options --task TabletopReach-v0 --num-envs 1024 4096

An environment of each variant takes turns with one of the task as it is: the same random actions from the same seeds,
and episodes that begin at random points, so that resets are spread over the steps. A line of JSON for each variant and
number of worlds is printed as soon as it is known: ms a control step, and the ratio of the two in the same round, each
as median, least and greatest of the rounds. The first turns do not count. A variant is skipped, with the reason, where
contacts or rows do not fit into Data. MuJoCo-Warp says so on stdout too, as often as it happens.

`whole` is the environment's step, torch and Warp together, as one graph; the next layouts are still made ahead beside
it. Variants that compile kernels on a GPU come last; "seconds" includes that.
"""

from __future__ import annotations

import gc
import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np
import torch
import tyro
import warp as wp
from mujoco_warp import BroadphaseFilter, BroadphaseType
from torch import Tensor

from benchmarks.timing import captured, spread, wait
from sceniris_gym.errors import ContactBudgetError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.training.task_scenes import SEED_SPACING, make_env, scene_of
from sceniris_gym.vector.task import FRICTION_PYRAMIDS
from sceniris_gym.vector.vector_env import SceneVectorEnv

_SEED = 13 * 16 * SEED_SPACING

Step = Callable[[Tensor], Any]


@dataclass(frozen=True)
class Options:
    """Options of the measurement.

    Attributes:
        task: id without its namespace
        num_envs: numbers of worlds
        only: names of variants; all if there are none
        rounds: turns that are counted
        steps: control steps of a turn
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    task: str = "TabletopReach-v0"
    num_envs: tuple[int, ...] = (1024, 4096)
    only: tuple[str, ...] = ()
    rounds: int = 5
    steps: int = 20
    device: str | None = None


@dataclass(frozen=True)
class Variant:
    """Differences of an environment from that of the task as it is.

    Attributes:
        physics: fields of `opt` of the mujoco_warp Model
        model: fields of MjOption
        contacts, rows: factors of nconmax and njmax
        whole: whether a step is one graph
        compiles: whether it has kernels of its own, as they are made for such an option
    """

    physics: Mapping[str, Any] = field(default_factory=dict)
    model: Mapping[str, Any] = field(default_factory=dict)
    contacts: float = 1.0
    rows: float = 1.0
    whole: bool = False
    compiles: bool = True

    @contextmanager
    def environment(self, task: str, base: SceneVectorEnv) -> Iterator[SceneVectorEnv]:
        """Make an environment like `base` but for this, which has not taken a step."""
        data, option = base.batch.data, base.compiled.mjm.opt
        room = {
            "nconmax": max(1, round(self.contacts * data.naconmax / data.nworld)),
            "njmax": max(1, round(self.rows * data.njmax)),
        }
        before = {name: getattr(option, name) for name in self.model}
        try:
            for name, value in self.model.items():
                setattr(option, name, value)
            envs = make_env(task, base.num_envs, base.compiled, sim_config=room)
        finally:
            for name, value in before.items():
                setattr(option, name, value)
        for name, value in self.physics.items():
            setattr(envs.batch.model.opt, name, value)
        yield envs
        envs.close()


_PLANE_AND_SPHERE = BroadphaseFilter.PLANE | BroadphaseFilter.SPHERE

VARIANTS: dict[str, Variant] = {
    "as it is": Variant(compiles=False),  # how far two that are alike differ; its line searches end after LINE_SEARCH
    "whole": Variant(whole=True, compiles=False),
    "iterations 5": Variant({"iterations": 5}, compiles=False),
    "iterations 10": Variant({"iterations": 10}, compiles=False),
    "iterations 40": Variant({"iterations": 40}, compiles=False),
    "contacts / 2": Variant(contacts=0.5, compiles=False),
    "contacts x 2": Variant(contacts=2.0, compiles=False),
    # one kernel or two each: that of the broad phase, of the line search, or of the product of Jacobians where they
    # are dense
    "filter: spheres": Variant({"broadphase_filter": _PLANE_AND_SPHERE}, contacts=3.0),  # which pass more pairs
    "filter: spheres, level boxes": Variant({"broadphase_filter": _PLANE_AND_SPHERE | BroadphaseFilter.AABB}),
    "filter: all": Variant({"broadphase_filter": _PLANE_AND_SPHERE | BroadphaseFilter.AABB | BroadphaseFilter.OBB}),
    "sweep, sorted by tiles": Variant({"broadphase": BroadphaseType.SAP_TILE}),
    "sweep, sorted by segments": Variant({"broadphase": BroadphaseType.SAP_SEGMENTED}),
    "rows / 2": Variant(rows=0.5),
    "rows x 2": Variant(rows=2.0),
    "line search 10": Variant({"ls_iterations": 10}),
    "line search 50": Variant({"ls_iterations": 50}),
    # most kernels of constraints and of the solver
    "dense": Variant(model={"jacobian": mujoco.mjtJacobian.mjJAC_DENSE}),
    "pyramids": Variant(model=FRICTION_PYRAMIDS),
    "without contacts": Variant(model={"disableflags": int(mujoco.mjtDisableBit.mjDSBL_CONTACT)}),
}


def whole_step(envs: SceneVectorEnv, action: Tensor) -> Step:
    """Record the step as one graph, and return it; the action is for the steps before, which compile and load."""
    envs.reset(seed=_SEED)
    for _ in range(3):
        envs.step(action)
    action = action.clone()
    replay, pipeline, device = captured(lambda: envs.step(action)), envs.randomizer.pipeline, envs.device
    assert pipeline.ahead is not None

    def step(given: Tensor) -> None:
        action.copy_(given)
        with wp.ScopedStream(wp.stream_from_torch(torch.cuda.current_stream(device)), sync_enter=False):
            replay()
            pipeline.after_reset()

    return step


def turn(envs: SceneVectorEnv, step: Step, actions: Tensor) -> float:
    """Return the mean time of a step with each of the actions [ms]."""
    wait(envs)
    start = time.perf_counter()
    for action in actions:
        step(action)
    wait(envs)
    return 1e3 * (time.perf_counter() - start) / len(actions)


def begin(envs: SceneVectorEnv) -> None:
    """Reset an environment, and spread the ends of its episodes."""
    envs.reset(seed=_SEED)
    begun = torch.randint(envs.max_episode_steps or 1, (envs.num_envs,), generator=torch.Generator().manual_seed(0))
    envs.state.elapsed.copy_(begun)


def compare(variant: Variant, base: SceneVectorEnv, envs: SceneVectorEnv, options: Options) -> dict[str, Any]:
    """Let both take turns, and return what is known of them then."""
    random = torch.Generator().manual_seed(1)
    shape = (options.rounds + 1, options.steps, *base.action_space.shape)  # pyrefly: ignore[not-iterable]
    actions = (2.0 * torch.rand(shape, generator=random) - 1.0).to(base.device)
    steps: dict[str, Step] = {"as it is": base.step, "variant": envs.step}
    if variant.whole:
        steps["variant"] = whole_step(envs, actions[0, 0])
    both = {"as it is": base, "variant": envs}
    for one in both.values():
        begin(one)
    times: dict[str, list[float]] = {name: [] for name in both}
    for chosen in actions:
        for name, one in both.items():
            times[name].append(turn(one, steps[name], chosen))
        if why := dropped(envs):  # what is left out takes no time
            return {"skipped": why}
    counted = {name: np.array(values[1:]) for name, values in times.items()}
    return {
        "ms": spread(counted["variant"]),
        "ms_as_it_is": spread(counted["as it is"]),
        "ratio": spread(counted["variant"] / counted["as it is"]),
    }


def dropped(envs: SceneVectorEnv) -> str | None:
    """Return what was too small for contacts or rows, if anything was."""
    try:
        envs.randomizer.check_budget()
    except ContactBudgetError as error:
        return str(error)
    return None


def measure(name: str, base: SceneVectorEnv, options: Options) -> dict[str, Any]:
    """Measure a variant, or say why it cannot be."""
    variant = VARIANTS[name]
    if variant.whole and base.device.type == "cpu":
        return {"skipped": "torch is captured on a GPU alone"}
    try:
        with variant.environment(options.task, base) as envs:
            return compare(variant, base, envs, options)
    except (ContactBudgetError, RuntimeError) as error:  # the variants that follow are still worth knowing
        return {"skipped": f"{type(error).__name__}: {error}"}
    finally:
        gc.collect()  # two environments have room, all of them together may have none


def main(options: Options) -> None:
    """Print a line for each variant and number of worlds.

    Raises:
        SystemExit: there is no such variant
    """
    names = options.only or tuple(VARIANTS)
    if unknown := sorted(set(names) - set(VARIANTS)):
        raise SystemExit(f"unknown variants {', '.join(unknown)}. Valid: {', '.join(VARIANTS)}.")
    compiled = compile_scene(scene_of(options.task, reachable=True), options.device)
    bases = {num_envs: make_env(options.task, num_envs, compiled) for num_envs in options.num_envs}
    asked = {"task": options.task, "device": compiled.device, "rounds": options.rounds, "steps": options.steps}
    with torch.inference_mode():
        for name in sorted(names, key=lambda name: VARIANTS[name].compiles):
            for num_envs, base in bases.items():
                start = time.perf_counter()
                found = measure(name, base, options)
                line = {"variant": name, "num_envs": num_envs, **found, "compiles": VARIANTS[name].compiles}
                print(json.dumps(line | {"seconds": round(time.perf_counter() - start, 1)} | asked), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))
