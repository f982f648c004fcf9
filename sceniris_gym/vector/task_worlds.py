"""`TaskWorlds`: the worlds of a task, with their physics, layouts and episodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
import warp as wp
from torch import Tensor

from sceniris_gym.layout.columns import NEXT
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.snapshot import check_snapshot, live_tensors, put
from sceniris_gym.vector.state import State
from sceniris_gym.vector.statistics import EpisodeStatistics, Outcome, finite_rows
from sceniris_gym.vector.task import Task, check_outcome


class TaskWorlds:
    """The worlds of a task. Its methods launch on the device and do not wait for it.

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
        """Give the task its state, and the model the fields that the task writes to."""
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
        """Return the results of the step that `action` took, in episodes of at most `most` steps."""
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

    @property
    def source(self) -> tuple[str, ...]:
        """Hash of the scene, split and params of the layouts."""
        return self.randomizer.compiled.hash, self.randomizer.split, *self.randomizer.layouts.params.names

    def live(self, **memory: Any) -> dict[str, Tensor]:
        """Return all tensors whose rows a snapshot may copy, including the tensors of an additional `memory`."""
        rows, redrawer = self.randomizer.pipeline.rows, self.randomizer.redrawer
        chosen = {name: wp.to_torch(array) for name, array in (rows or {}).items()}
        redraws = wp.to_torch(redrawer.number), wp.to_torch(redrawer.status)
        memory = {"task": self._task, "redraws": redraws, "chooser": chosen, **memory}
        return live_tensors(self.state, self.randomizer.layouts, memory, NEXT if rows is None else ())

    def restore(self, snapshot: Any, live: Mapping[str, Tensor], mask: Tensor | None) -> Tensor:
        """Write a snapshot into its own worlds, or into the worlds of a mask, as `put` does. Return their mask."""
        check_snapshot(snapshot, self.source, live, self.randomizer.layouts)
        due = put(snapshot, live, mask)
        if self.randomizer.compiled.config.variants:  # writing the variants resets model fields, so `put` runs again
            self.randomizer._launch_variants(wp.from_torch(due, dtype=wp.bool))
            put(snapshot, live, mask)
        self.batch.update()
        self.statistics.start(due)
        return due

    def layout_info(self) -> dict[str, dict[str, Any]]:
        """Return `info["layout"]`: the present layouts, in the form of the reset option `layouts`."""
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
            layout["level"] = torch.where(layout["fallback"], -2, sampler.level)
        return {"layout": layout}
