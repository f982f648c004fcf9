"""Uses gone wrong: options, params, snapshots, levels, redraws, ids, tables, problem files and folders of runs.

Each begins as a use that is right, of which one part is replaced by anything.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.config.fields import short
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.levels import ADR, LevelReplay
from sceniris_gym.scene.layout_table import COLUMNS
from sceniris_gym.training.settings import CONFIG, MODEL, read_config
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.fuzz.calls import changed, compiled, generator, some_array
from tests.fuzz.values import number, value
from tests.importers.libero.problems import KITCHEN, STACK

NUM_ENVS = 4
PARAMS = {
    "objects.shelf.joints.slide": [0.02, 0.05],
    "groups.some.count": 1,
    "objects.pear.region": [[-0.1, -0.05], [0.1, 0.05]],
    "objects.apple.clearance": 0.01,
}


class _Watch(Task):
    """A task that looks on."""

    action_size = 1

    def success(self, s: State) -> Tensor:
        """Count no world."""
        return torch.zeros(s.num_envs, dtype=torch.bool)

    def apply(self, s: State, action: Tensor) -> None:
        """Move nothing."""

    def observe(self, s: State) -> Observation:
        """Show where two objects are."""
        return {"policy": {name: s.pose(name) for name in ("apple", "pear")}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Reward a drawn number."""
        return {"drawn": s.random("drawn")}


@functools.cache
def _envs(*, levels: bool) -> SceneVectorEnv:
    adr = ADR({"objects.shelf.joints.slide": [0.02, 0.03]})
    replay = LevelReplay("custom", capacity=32, refresh_interval=2, adr=adr)
    words: dict[str, Any] = {"curriculum": replay} if levels else {}
    return SceneVectorEnv(_Watch, NUM_ENVS, scene=compiled(), params="*", max_episode_steps=2, **words)


def wrong_use(draws: np.random.Generator, folder: Path) -> str | None:
    """Use an environment or a file, one part of which is anything; return an impossibility in what follows, or None."""
    envs = _envs(levels=draws.random() < 0.5)
    envs.reset(seed=0)
    envs.set_attr("max_episode_steps", 2)
    uses = (_options, _params, _snapshot, _levels, _redraw, _id, _table, _names, _problem, _run)
    uses[int(draws.integers(len(uses)))](envs, draws, folder)
    for _ in range(3):
        observation, *_, info = envs.step(torch.zeros(NUM_ENVS, 1))
    layouts = envs.randomizer.layouts
    if not observation["policy"].isfinite().all() or info["broken"].any():
        return "an observation that is not finite"
    if (layouts.status.cpu().numpy() == 0).any() or not np.isfinite(layouts.qpos.cpu().numpy()).all():
        return "a world without a layout"
    ids = envs.layout_ids()
    again = envs.reset(options={"layouts": ids})[1]
    if not bool((again["layout"]["fallback"] == info["layout"]["fallback"]).all()):
        return f"ids {ids} that make other layouts"
    return None


def _options(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    info = envs.reset(seed=1)[1]
    named = {"seed": info["layout"]["seed"], "episode": info["layout"]["episode"], "params": info["layout"]["params"]}
    mask = np.array([True, False] * 2)
    right: list[dict[str, Any]] = [
        {"reset_mask": mask, "params": dict(PARAMS)},
        {"reset_mask": torch.from_numpy(mask), "layouts": named},
        {"layouts": envs.layout_ids()},
        {"state": envs.snapshot()},
    ]
    seed = [None, 3, [1, 2, 3, None]][int(draws.integers(3))]
    envs.reset(seed=spoiled(seed, draws) if draws.random() < 0.2 else None, options=_chosen(right, draws))


def _params(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    name = list(PARAMS)[int(draws.integers(len(PARAMS)))]
    given: list[Any] = [name, PARAMS[name], np.array([True, False] * 2)]
    part = int(draws.integers(5))
    if part < 3:
        given[part] = spoiled(given[part], draws)
    elif part == 3:
        given[1] = [spoiled(PARAMS[name], draws) for _ in range(NUM_ENVS)]
    width = envs.randomizer.layouts.param.shape[1]
    if part == 4:
        rows = spoiled(np.zeros((NUM_ENVS, width), np.float32), draws)
        envs.randomizer.pipeline.reseed(layouts={"seed": 0, "episode": 0, "params": {name: rows}})
    else:
        envs.set_param(*given)


def _snapshot(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    kept = envs.snapshot()
    if draws.random() < 0.8:
        name = list(kept.rows)[int(draws.integers(len(kept.rows)))]
        kept = replace(kept, rows={**kept.rows, name: spoiled_tensor(kept.rows[name], draws)})
    else:
        kept = replace(kept, worlds=spoiled_tensor(kept.worlds, draws))
    envs.reset(options={"state": kept})


def _levels(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    envs = _envs(levels=True)
    envs.reset(seed=0)
    levels = envs.randomizer.levels
    assert levels is not None
    n = int(draws.integers(1, 9))
    layouts: dict[str, Any] = {"level": np.full(n, -1), "seed": np.arange(n), "episode": np.zeros(n, int)}
    name, scores = [*layouts, "scores"][int(draws.integers(4))], np.full(n, 0.5)
    match int(draws.integers(4)):
        case 0:
            levels.restore(spoiled(levels.state(), draws))
        case 1:
            wrong = some_array(draws) if draws.random() < 0.5 else spoiled(layouts.get(name, scores), draws)
            layouts |= {"params": spoiled(dict(PARAMS), draws)} if draws.random() < 0.3 else {}
            worlds = some_array(draws) if draws.random() < 0.3 else None
            levels.update(*((layouts, wrong) if name == "scores" else (layouts | {name: wrong}, scores)), worlds)
        case 2:
            levels.insert(spoiled(layouts, draws), scores)
        case _:
            levels.insert(layouts, scores)
            levels.sample(value(draws), value(draws) if draws.random() < 0.5 else 0)
    for _ in range(4):
        envs.reset()


def _redraw(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    names: Any = ["apple", "plum"] if draws.random() < 0.5 else "pear"
    mask: Any = np.array([True, False] * 2)
    names, mask = (names, some_array(draws)) if draws.random() < 0.4 else (spoiled(names, draws), mask)
    envs.redraw(names, mask)


def _id(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    envs.set_param("objects.shelf.joints.slide", [0.02, 0.05])
    envs.reset(seed=int(draws.integers(9)))
    text = changed(envs.layout_ids()[0].encode(), draws).decode("latin-1")
    LayoutId.parse(text)
    envs.reset(options={"layouts": text})


def _table(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    generator().generate()
    table = generator().table()
    name = list(COLUMNS)[int(draws.integers(len(COLUMNS)))]
    table = replace(table, **{name: spoiled_array(getattr(table, name), draws)})
    if draws.random() < 0.5:
        envs.randomizer.write(table, spoiled([0, 1, 2, -1], draws) if draws.random() < 0.2 else [0, 1, 2, -1])
    else:
        stored = SceneVectorEnv(_Watch, 2, scene=compiled(), layout_source=lambda c, n: StoredLayouts(c, table, n))
        stored.reset(seed=0)
        stored.step(torch.zeros(2, 1))
        stored.layout_ids()


def _names(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    wrong = value(draws)
    calls: list[Callable[[], Any]] = [
        lambda: envs.randomizer.random("a", wrong),
        lambda: envs.randomizer.random(wrong, 2),
        lambda: envs.state.uniform(wrong) if not isinstance(wrong, int) or wrong < 10**4 else None,
        lambda: envs.snapshot(some_array(draws)),
        lambda: envs.set_attr("max_episode_steps", wrong),
        lambda: envs.set_attr("task", wrong),
        lambda: envs.layout_ids(wrong),
        lambda: envs.step(some_array(draws)),
        lambda: envs.randomizer.reset(wrong),
        lambda: envs.randomizer.reset(layouts={"seed": wrong, "episode": value(draws)}),
        lambda: SceneVectorEnv(_Watch, 2, scene=compiled(), params=wrong),
        lambda: SceneVectorEnv(
            _Watch, 2, scene=compiled(), sim_config={"nconmax": wrong if not isinstance(wrong, int) else -1}
        ),
        lambda: SceneVectorEnv(_Watch, 2, scene=compiled(), layout_source=wrong),
        lambda: SceneVectorEnv(_Watch, 2, scene=compiled(), curriculum=wrong),
        lambda: LevelReplay("custom", capacity=wrong, refresh_interval=value(draws)),
        lambda: ADR(wrong, delta=value(draws)),
    ]
    calls[int(draws.integers(len(calls)))]()


def _problem(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    path = folder / "problem.bddl"
    path.write_bytes(changed((KITCHEN if draws.random() < 0.5 else STACK).encode(), draws))
    read_bddl(path)


def _run(envs: SceneVectorEnv, draws: np.random.Generator, folder: Path) -> None:
    told = {"options": {"task": "TabletopReach-v0"}, "settings": {"steps": 4, "hidden": [8], "epochs": 1}}
    (folder / MODEL).touch()
    try:
        text = json.dumps(spoiled(told, draws)).encode()
    except (TypeError, ValueError, RecursionError):  # JSON has no such value
        return
    (folder / CONFIG).write_bytes(changed(text, draws) if draws.random() < 0.5 else text)
    read_config(folder)


def _chosen(right: list[Any], draws: np.random.Generator) -> Any:
    return spoiled(right[int(draws.integers(len(right)))], draws)


def spoiled(given: Any, draws: np.random.Generator) -> Any:
    """The same with one part of it replaced, left out, or put in."""
    if draws.random() < 0.15:
        return value(draws)
    match given:
        case Mapping() if given:
            key = list(given)[int(draws.integers(len(given)))]
            found = dict(given)
            match int(draws.integers(8)):
                case 0:
                    del found[key]
                case 1:
                    found[short(value(draws))[:50]] = found[key]
                case _:
                    found[key] = spoiled(found[key], draws)
            return found
        case list() if given:
            i = int(draws.integers(len(given)))
            return [spoiled(part, draws) if k == i else part for k, part in enumerate(given)]
        case np.ndarray():
            return spoiled_array(given, draws)
        case Tensor():
            return spoiled_tensor(given, draws)
        case str() if given and draws.random() < 0.5:
            i = int(draws.integers(len(given)))
            return given[:i] + "xX/.*"[int(draws.integers(5))] + given[i + 1 :]
    return number(draws) if isinstance(given, int | float) else value(draws)


def spoiled_array(given: np.ndarray, draws: np.random.Generator) -> Any:
    """An array with another number in it, or of another shape or type."""
    found = given.copy()
    match int(draws.integers(8)):
        case 0:
            return found[:-1] if found.ndim else found[None]
        case 1:
            return found[..., None]
        case 2:
            return found.astype([np.float64, np.int64, np.int8, bool, object][int(draws.integers(5))])
        case 3:
            return found.tolist()
        case 4:
            return some_array(draws)
    if found.size and found.dtype.kind in "iufb":
        limits = np.iinfo(found.dtype) if found.dtype.kind in "iu" else np.finfo(np.float32)
        choices = [-1, 0, 1, 2, 5, 64, 10**6, limits.max, limits.min, np.nan, np.inf]
        wanted = choices[int(draws.integers(len(choices)))]
        with np.errstate(all="ignore"):
            new = np.array(wanted).astype(found.dtype)
        found.flat[slice(None) if draws.random() < 0.3 else int(draws.integers(found.size))] = new
    return found


def spoiled_tensor(given: Tensor, draws: np.random.Generator) -> Any:
    """The same for a tensor; it stays one."""
    found = spoiled_array(given.numpy(), draws)
    if isinstance(found, wp.array):
        found = found.numpy()
    return found if isinstance(found, Tensor) else _as_tensor(found, given)


def _as_tensor(found: Any, given: Tensor) -> Tensor:
    try:
        return torch.as_tensor(np.ascontiguousarray(found))
    except (TypeError, ValueError, RuntimeError):
        return given[:0]
