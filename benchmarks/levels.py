"""Measure levels and params: decisions and updates, changes of params, and the steps of trainings with and without
them.

    python -m benchmarks.levels buffer
    python -m benchmarks.levels params clutter_extract
    python -m benchmarks.levels steps TabletopReach-v0
    python -m benchmarks.levels resets TabletopReach-v0
    python -m benchmarks.levels table FOLDER FOLDER

`buffer` times decisions and updates of 4,096 worlds with 10^6 levels, launched one by one and as a graph, and a refresh
of all weights. `params` times a change of all params of a scene in all worlds, alike or each in its own way, and the
next layouts after it. `steps` times steps of random actions by turns, with levels and without, `resets` the kernels of
resets. `table` prints the successes of trained policies by the number of things in a layout, out of `judged.json` of
their folders. Each prints lines of JSON.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
import warp as wp

from benchmarks.timing import spread, wait
from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import view_of
from sceniris_gym.levels import LevelReplay
from sceniris_gym.levels.buffer import Episodes, create_buffer, launch_choose, launch_update
from sceniris_gym.levels.refresh import launch_refresh
from sceniris_gym.training.task_scenes import make_env, scene_of
from sceniris_gym.vector.vector_env import SceneVectorEnv

_ROUNDS = 21


def _times(work: Callable[[], object], device: str, repeats: int = 1) -> dict[str, float]:
    """Return the wall-clock time of work [us] with the device idle before and after, as `spread` has it."""
    times = []
    for _ in range(_ROUNDS):
        wp.synchronize_device(device)
        start = time.perf_counter()
        for _ in range(repeats):
            work()
        wp.synchronize_device(device)
        times.append(1e6 * (time.perf_counter() - start) / repeats)
    return spread(times, 1)


def buffer(device: str = "cuda:0", num_envs: int = 4096, capacity: int = 1_000_000) -> None:
    """Time decisions and updates.

    Args:
        device: cuda:0, or cpu without the graph
        num_envs: worlds
        capacity: levels in the buffer
    """
    replay, rng = LevelReplay("learnability", capacity=capacity), np.random.default_rng(0)
    with wp.ScopedDevice(device):
        params = {"next_param": np.zeros((num_envs, 4)), "default_param": np.zeros(4)}
        made = create_buffer(replay, view_of(num_envs, device, params))
        for name in ("seed", "episode"):
            getattr(made, name).assign(rng.integers(0, 1 << 31, capacity))
        made.value.assign(rng.random(capacity))
        made.age.zero_()
        launch_refresh(made, replay)
        seed, episode = wp.zeros(num_envs, dtype=wp.uint64), wp.zeros(num_envs, dtype=int)
        outcome, param = wp.array(rng.random(num_envs), dtype=float), wp.zeros((num_envs, 4), dtype=float)
        mask = wp.full(num_envs, True, dtype=wp.bool)

        def both() -> None:
            launch_choose(made, mask, 7, replay.replay_prob)
            launch_update(made, Episodes(made.level, seed, episode, outcome, param))

        both()
        found = {"launched_us": _times(both, device, 20)}
        if wp.get_device(device).is_cuda:
            with wp.ScopedCapture() as capture:
                both()
            found["graph_us"] = _times(lambda: wp.capture_launch(capture.graph), device, 20)
        launch_refresh(made, replay)
        found["refresh_us"] = _times(lambda: launch_refresh(made, replay), device)
    print(json.dumps({"num_envs": num_envs, "levels": capacity, **found}))


def params(scene: tyro.conf.Positional[str], device: str = "cuda:0", num_envs: int = 4096) -> None:
    """Time a change of all params in all worlds, and the layouts that follow.

    Args:
        scene: a scene
        device: cuda:0, or cpu
        num_envs: worlds
    """
    compiled = compile_scene(scene, device)
    plain, generator = LayoutGenerator(compiled, num_envs), LayoutGenerator(compiled, num_envs, params="*")
    table = generator.layouts.params
    rows = {name: values[0] for name, values in table.named(table.default[None]).items()}
    each = {name: np.tile(values, (num_envs, 1)) for name, values in rows.items()}
    one = dict([next(iter(rows.items()))])
    for source in (plain, generator):
        source.generate()
    names = ("qpos", "mocap_pos", "present")
    plain_bits, bits = ([getattr(g.layouts, n).cpu().numpy().tobytes() for n in names] for g in (plain, generator))
    found = {
        "change_of_one_us": _times(lambda: generator.set_params(one), device),
        "change_of_all_us": _times(lambda: generator.set_params(rows), device),
        "change_of_all_by_world_us": _times(lambda: generator.set_params(each), device),
        "layouts_us": _times(plain.generate, device),
        "layouts_with_params_us": _times(generator.generate, device),
        "equal_bits": plain_bits == bits,
    }
    print(json.dumps({"scene": scene, "num_envs": num_envs, "params": len(rows), **found}))


def _switch(envs: SceneVectorEnv) -> Callable[[bool], None]:
    """Return a function that switches the levels of an environment on or off, with the worlds that wait in between."""
    randomizer: Any = envs.randomizer
    sampler, on = randomizer.levels, randomizer._reset_graph
    wait(envs)
    randomizer._mask.zero_()
    sampler.launch_choose = lambda mask: None  # while it is captured
    off = LaunchSequence(randomizer._launch_reset, randomizer.device)
    off.replay()
    del sampler.launch_choose
    wait(envs)

    def switch(is_on: bool) -> None:
        randomizer._reset_graph = on if is_on else off
        for name, other in (("after_reset", lambda: None), ("launch_finish", lambda *_: None)):
            vars(sampler).pop(name, None)
            if not is_on:
                setattr(sampler, name, other)

    return switch


def steps(
    task: tyro.conf.Positional[str],
    device: str = "cuda:0",
    num_envs: int = 4096,
    seconds: float = 60.0,
    episode: int = 100,
    warm: int = 120,
) -> None:
    """Time steps with random actions, with levels and without, by turns.

    Two environments of one kind differ by up to 3%, whichever comes first. So levels are switched on and off in one and
    the same environment: one with levels alone, and one with all params, too. A turn is 20 steps.

    Args:
        task: id of a task of this package
        device: cuda:0, or cpu
        num_envs: worlds
        seconds: time of all turns together
        episode: control steps of an episode
        warm: steps before the first turn, in which layouts are missed that were not made ahead
    """
    compiled, random = compile_scene(scene_of(task, reachable=True), device), torch.Generator().manual_seed(0)
    words: dict[str, dict[str, Any]] = {"levels": {}, "levels_and_params": {"params": "*"}}
    words = {name: {"curriculum": LevelReplay(), "max_episode_steps": episode, **more} for name, more in words.items()}
    made = {name: make_env(task, num_envs, compiled, **more) for name, more in words.items()}
    shape = (20, *made["levels"].action_space.shape)  # pyrefly: ignore[not-iterable]
    actions = (2.0 * torch.rand(shape, generator=random) - 1.0).to(made["levels"].device)
    begun, switches = torch.randint(episode, (num_envs,), generator=random), {}
    for name, envs in made.items():
        envs.reset(seed=0)
        envs.state.elapsed.copy_(begun)
        switches[name] = _switch(envs)
        for k in range(warm):
            envs.step(actions[k % len(actions)])
    times: dict[tuple[str, bool], list[float]] = {(name, is_on): [] for name in made for is_on in (True, False)}
    began = time.perf_counter()
    while time.perf_counter() - began < seconds:
        for (name, is_on), spent in list(times.items())[:: 1 if len(times["levels", True]) % 2 else -1]:
            switches[name](is_on)
            wait(made[name])
            start = time.perf_counter()
            for action in actions:
                made[name].step(action)
            wait(made[name])
            spent.append(time.perf_counter() - start)
    found: dict[str, Any] = {}
    for name in made:
        on, off = (np.array(times[name, is_on]) for is_on in (True, False))
        rows = np.random.default_rng(0).integers(len(on), size=(4000, len(on)))
        ends = np.quantile(off[rows].sum(axis=1) / on[rows].sum(axis=1), [0.025, 0.975]).round(4).tolist()
        rate = round(num_envs * on.size * len(actions) / on.sum())
        found[name] = {"steps_per_second": rate, "of_without": round(off.sum() / on.sum(), 4), "interval": ends}
    print(json.dumps({"task": task, "num_envs": num_envs, "turns": len(times["levels", True]), **found}))


def resets(task: tyro.conf.Positional[str], device: str = "cuda:0", num_envs: int = 4096) -> None:
    """Time the kernels of a reset of 1% of the worlds, one by one: without levels, with them, and with all params, too.

    Layouts are made ahead, as in a training; that is not part of it.

    Args:
        task: id of a task of this package
        device: a GPU
        num_envs: worlds
    """
    compiled = compile_scene(scene_of(task, reachable=True), device)
    replay: dict[str, Any] = {"curriculum": LevelReplay()}
    words = {"plain": {}, "levels": replay, "levels_and_params": {**replay, "params": "*"}}
    found: dict[str, dict[str, float]] = {}
    for name, more in words.items():
        envs: Any = make_env(task, num_envs, compiled, **more)
        randomizer, each = envs.randomizer, found.setdefault(name, {})
        envs.reset(seed=0)
        number = torch.arange(num_envs, device=envs.device) // (num_envs // 100 + 1)
        for turn in range(_ROUNDS):
            ended = number == turn  # other worlds each time, whose layouts are ready
            wait(envs)
            wp.copy(randomizer._mask, wp.from_torch(ended))
            wp.timing_begin()
            randomizer._launch_reset()
            for one in wp.timing_end():
                each[one.name] = each.get(one.name, 0.0) + (1e3 * one.elapsed / (_ROUNDS - 1) if turn else 0.0)
    total = {name: round(sum(each.values()), 1) for name, each in found.items()}
    more = {kernel: round(us - found["plain"].get(kernel, 0.0), 1) for kernel, us in found["levels_and_params"].items()}
    largest = dict(sorted(more.items(), key=lambda item: -item[1])[:8])
    print(json.dumps({"task": task, "num_envs": num_envs, "reset_us": total, "more_us": largest}))


def table(folders: tyro.conf.Positional[tuple[Path, ...]]) -> None:
    """Print the successes of policies by the number of things.

    Args:
        folders: folders of runs of `sceniris-gym train`
    """
    for folder in folders:
        judged = json.loads((folder / "judged.json").read_text())
        each = judged["valid"]["each"]
        success, things = np.array(each["success"]), np.array(each["things"])
        shares = {int(n): [round(float(success[things == n].mean()), 4), int((things == n).sum())] for n in set(things)}
        overall = {"success": judged["valid"]["success"], "interval": judged["valid"]["interval"]}
        print(json.dumps({"run": folder.name, "env_steps": judged["env_steps"], **overall, "by_things": shares}))


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({f.__name__: f for f in (buffer, params, steps, resets, table)})
