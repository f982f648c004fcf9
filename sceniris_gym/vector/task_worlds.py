"""`TaskWorlds`: the worlds of a task, with their physics, layouts and episodes, and the memory of the task."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.layout.layouts import Layouts, LayoutStatus
from sceniris_gym.levels.curriculum import FROM_BANK
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.state import State
from sceniris_gym.vector.statistics import EpisodeStatistics, Outcome, finite_rows
from sceniris_gym.vector.task import Task, check_outcome
from sceniris_gym.vector.variants import VariantView

_FOREIGN = ("torch", "warp", "mujoco", "mujoco_warp", "numpy", "gymnasium")
"""Packages whose objects are not searched for the memory of a task."""


def versions(live: Mapping[str, Tensor]) -> dict[str, tuple[Tensor, int]]:
    """Return each tensor with its version, which torch increments at each write. `written` compares these versions."""
    return {name: (tensor, tensor._version) for name, tensor in live.items()}


def written(live: Mapping[str, Tensor], made: Mapping[str, tuple[Tensor, int]]) -> dict[str, Tensor]:
    """Return the tensors that were written to or replaced since `versions` returned `made`. A restore skips the rest.

    Unchanged tensors, such as indices and tables, do not belong to an episode, even if they have a row for each world.
    """
    kept = [name for name, (tensor, version) in made.items() if live.get(name) is tensor and tensor._version == version]
    return {name: tensor for name, tensor in live.items() if name not in kept}


def memory_rows(memory: Mapping[str, Any], num_envs: int) -> dict[str, Tensor]:
    """Return by name all tensors with `num_envs` rows that `memory` contains, directly or in nested attributes."""
    return dict(pair for name, value in memory.items() for pair in _memory(value, num_envs, name, set()))


def _memory(value: Any, num_envs: int, path: str, seen: set[int]) -> Iterator[tuple[str, Tensor]]:
    if id(value) in seen or isinstance(value, State | VariantView | Layouts | type | ModuleType | FunctionType):
        return
    seen.add(id(value))
    if isinstance(value, Tensor):
        if value.ndim and value.shape[0] == num_envs and (value.stride(0) or num_envs == 1):  # not an expanded one
            yield path, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _memory(item, num_envs, f"{path}.{key}", seen)
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _memory(item, num_envs, f"{path}.{i}", seen)
    elif hasattr(value, "__dict__") and type(value).__module__.partition(".")[0] not in _FOREIGN:
        yield from _memory(vars(value), num_envs, path, seen)


class TaskWorlds:
    """The worlds of a task. Methods launch on the device and do not wait for the device.

    Args:
        task: The task.
        batch: The physics.
        randomizer: Resets worlds to layouts.

    Attributes:
        state: The worlds as the task reads them.
        statistics: Sums over finished episodes.
    """

    def __init__(self, task: Task, batch: Batch, randomizer: ResetRandomizer) -> None:
        self.batch, self.randomizer = batch, randomizer
        self.state = State(batch, randomizer.layouts, randomizer.split, randomizer.variants)
        self.statistics = EpisodeStatistics(batch.nworld, self.state.device)
        self._task, self._is_checked = task, False

    def bind(self) -> None:
        """Bind the task to the worlds, and give a row per world to each model field that the task writes to."""
        for name in self._task.model_fields:
            self.batch.fields.ask(name, where="Task.model_fields")
        self._task.bind(self.state)
        self.batch.fields.close()
        self.batch.update()

    def reset(self, mask: Tensor) -> None:
        """Reset the masked worlds. The mask is on the device, and the task may overwrite it in `on_reset`."""
        self.randomizer.launch_reset(wp.from_torch(mask, dtype=wp.bool))
        self.state.elapsed.masked_fill_(mask, 0)
        self.statistics.start(mask)
        self._task.on_reset(self.state, mask)
        if self.batch.fields.asked:
            self.randomizer.refresh()

    def judge(self, action: Tensor, most: int | None) -> Outcome:
        """Return the results of the step with this action. An episode has at most `most` steps, or no limit if None."""
        s, task = self.state, self._task
        terms, success, terminated = task.reward(s, action), task.success(s), task.terminated(s)
        if not self._is_checked:
            check_outcome(task, terms, success, terminated, s.num_envs)
            self._is_checked = True
        gained = torch.stack(list(terms.values())).float()
        truncated = torch.zeros_like(success) if most is None else s.elapsed >= most
        # a copy, because the task may overwrite its success tensor in a reset
        outcome = Outcome(tuple(terms), gained, success.clone(), torch.zeros_like(success), terminated, truncated)
        return outcome.breaking(~(s.finite & finite_rows([gained.T])))

    def count(self, outcome: Outcome) -> None:
        """Add a step to the statistics, and pass the results of finished episodes to the curriculum."""
        self.statistics.add(outcome, self.state.elapsed)
        if (pipeline := self.randomizer.pipeline).hears:
            pipeline.launch_finish(wp.from_torch(outcome.success.float()), wp.from_torch(self.statistics.finished))

    def live(self, **memory: Any) -> dict[str, Tensor]:
        """Return all tensors whose rows a snapshot may copy, including tensors inside the objects in `memory`."""
        rows = self.randomizer._live | {"elapsed": self.state.elapsed}
        return rows | memory_rows({"task": self._task, **memory}, self.batch.nworld)

    def restore(self, snapshot: Any, live: Mapping[str, Tensor], worlds: np.ndarray | None) -> Tensor:
        """Write a snapshot into its original worlds, or into `worlds` in order. Return a mask of these worlds."""
        due = self.randomizer._put_back(snapshot, live, worlds, "options['state']")
        self.batch.update()
        self.statistics.start(due)
        return due

    def layout_info(self) -> dict[str, Any]:
        """Return `info["layout"]`: the present layouts, in the form of the reset option `layouts`.

        If the task has an instruction, also return `info["language"]`: the instruction of each world.
        """
        s, sampler = self.state, self.randomizer.levels
        layout: dict[str, Any] = {
            "seed": s.seed.clone(),
            "episode": s.episode.clone(),
            "fallback": s.layout_status == LayoutStatus.FALLBACK,
        }
        if self.randomizer.compiled.config.start:
            layout["start"] = s.start.clone()
        if self.randomizer.layouts.params.params:
            layout["params"] = self.randomizer.layouts.params.named(s.layout_param.clone())
        if s.variants.names:
            layout["variants"] = {name: s.variant(name) for name in s.variants.names}
        if self.randomizer.redrawer.prepared:
            layout["redraws"] = self.randomizer.redraw_count.clone()
            layout["redraw_failed"] = self.randomizer.redraw_status == LayoutStatus.KEPT
        if sampler is not None:
            layout["level"] = torch.where(layout["fallback"], FROM_BANK, sampler.level)
        language = self._task.language
        return {"layout": layout} | ({"language": [language] * s.num_envs} if language else {})
