"""Measure levels and knobs: decisions and updates, changes of knobs, and the steps of trainings with and without them.

    python -m benchmarks.levels buffer
    python -m benchmarks.levels knobs clutter_extract
    python -m benchmarks.levels steps TabletopReach-v0
    python -m benchmarks.levels table FOLDER FOLDER

`buffer` times decisions and updates of 4,096 worlds with 10^6 levels, launched one by one and as a graph, and a refresh
of all weights. `knobs` times a change of all knobs of a scene in all worlds, alike or each in its own way, and the next
layouts after it. `steps` lets environments with and without levels and knobs take turns of the same random actions.
`table` prints the successes of trained policies by the number of things in a layout, out of `judged.json` of their
folders. Each prints lines of JSON.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import tyro
import warp as wp

from benchmarks.timing import spread, wait
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.levels import Levels
from sceniris_gym.levels.buffer import Episodes, create_buffer, launch_choose, launch_update
from sceniris_gym.levels.weights import launch_refresh
from sceniris_gym.program.device import allocate
from sceniris_gym.training.task_scenes import make_env, scene_of

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
    levels, rng = Levels("learnability", capacity=capacity), np.random.default_rng(0)
    with wp.ScopedDevice(device):
        layouts = LayoutsView()
        allocate(LayoutsView, layouts, num_envs, "next_seed next_episode")
        allocate(LayoutsView, layouts, (num_envs, 4), "next_knob")
        made = create_buffer(levels, layouts)
        for name in ("seed", "episode"):
            getattr(made, name).assign(rng.integers(0, 1 << 31, capacity))
        made.value.assign(rng.random(capacity))
        made.age.zero_()
        launch_refresh(made, levels)
        seed, episode = wp.zeros(num_envs, dtype=wp.uint64), wp.zeros(num_envs, dtype=int)
        outcome, knob = wp.array(rng.random(num_envs), dtype=float), wp.zeros((num_envs, 4), dtype=float)
        mask = wp.full(num_envs, True, dtype=wp.bool)

        def both() -> None:
            launch_choose(made, mask, 7, levels.replay)
            launch_update(made, Episodes(made.level, seed, episode, outcome, knob))

        both()
        found = {"launched_us": _times(both, device, 20)}
        if wp.get_device(device).is_cuda:
            with wp.ScopedCapture() as capture:
                both()
            found["graph_us"] = _times(lambda: wp.capture_launch(capture.graph), device, 20)
        launch_refresh(made, levels)
        found["refresh_us"] = _times(lambda: launch_refresh(made, levels), device)
    print(json.dumps({"num_envs": num_envs, "levels": capacity, **found}))


def knobs(scene: tyro.conf.Positional[str], device: str = "cuda:0", num_envs: int = 4096) -> None:
    """Time a change of all knobs in all worlds, and the layouts that follow.

    Args:
        scene: a scene
        device: cuda:0, or cpu
        num_envs: worlds
    """
    compiled = compile_scene(scene, device)
    plain, generator = LayoutGenerator(compiled, num_envs), LayoutGenerator(compiled, num_envs, knobs="*")
    table = generator.layouts.knobs
    rows = {name: values[0] for name, values in table.named(table.default[None]).items()}
    each = {name: np.tile(values, (num_envs, 1)) for name, values in rows.items()}
    one = dict([next(iter(rows.items()))])
    for source in (plain, generator):
        source.generate()
    names = ("qpos", "mocap_pos", "present")
    plain_bits, bits = ([getattr(g.layouts, n).numpy().tobytes() for n in names] for g in (plain, generator))
    found = {
        "change_of_one_us": _times(lambda: generator.set_knobs(one), device),
        "change_of_all_us": _times(lambda: generator.set_knobs(rows), device),
        "change_of_all_by_world_us": _times(lambda: generator.set_knobs(each), device),
        "layouts_us": _times(plain.generate, device),
        "layouts_with_knobs_us": _times(generator.generate, device),
        "equal_bits": plain_bits == bits,
    }
    print(json.dumps({"scene": scene, "num_envs": num_envs, "knobs": len(rows), **found}))


def steps(
    task: tyro.conf.Positional[str], device: str = "cuda:0", num_envs: int = 4096, rounds: int = 5, episode: int = 100
) -> None:
    """Time steps with random actions: plain, a second time plain, with levels, and with levels and all knobs.

    The second plain environment tells how far two of the same differ. `fresh_levels` replays none, so that its layouts
    are as those without levels. Turns go forwards and backwards.

    Args:
        task: id of a task of this package
        device: cuda:0, or cpu
        num_envs: worlds
        rounds: turns of each environment that count; one before them does not
        episode: control steps of an episode, and of a turn
    """
    compiled = compile_scene(scene_of(task, reachable=True), device)
    both = {"levels": Levels(), "knobs": "*"}
    words = {"plain": {}, "plain_again": {}, "fresh_levels": {"levels": Levels(replay=0.0)}}
    words |= {"levels": {"levels": Levels()}, "levels_and_knobs": both}
    made = {name: make_env(task, num_envs, compiled, max_episode_steps=episode, **w) for name, w in words.items()}
    random = torch.Generator().manual_seed(0)
    begun = torch.randint(episode, (num_envs,), generator=random)
    shape = (episode, *made["plain"].action_space.shape)  # type: ignore[misc]
    actions = (2.0 * torch.rand(shape, generator=random) - 1.0).to(made["plain"].device)
    seconds: dict[str, list[float]] = {name: [] for name in made}
    for envs in made.values():
        envs.reset(seed=0)
        envs.state.elapsed.copy_(begun)
    for turn in range(rounds + 1):
        for name, envs in list(made.items())[:: 1 if turn % 2 else -1]:
            wait(envs)
            start = time.perf_counter()
            for action in actions:
                envs.step(action)
            wait(envs)
            seconds[name].append(time.perf_counter() - start)
    rates = {name: num_envs * episode / np.array(times[1:]) for name, times in seconds.items()}
    found = {
        "steps_per_second": {name: spread(rate, 0) for name, rate in rates.items()},
        "of_plain": {name: spread(rate / rates["plain"]) for name, rate in rates.items() if name != "plain"},
    }
    print(json.dumps({"task": task, "num_envs": num_envs, **found}))


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
    tyro.extras.subcommand_cli_from_dict({f.__name__: f for f in (buffer, knobs, steps, table)})
