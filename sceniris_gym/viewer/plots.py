"""Live plots of what a policy sees and is rewarded for, in the first world."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import viser

_KEPT = 300  # steps
_COLOURS = ("#266ebe", "#28965a", "#8250aa", "#b4781e", "#1496a0", "#aa3c78", "#5a7828", "#555b63")


class Plots:
    """Plots of the last steps: reward terms, success, and one part of the observation.

    Args:
        server: The page.
        parts: Names and sizes of what the observation consists of, in order.
    """

    def __init__(self, server: viser.ViserServer, parts: list[tuple[str, int]]) -> None:
        self._gui, self._parts = server.gui, parts
        self._steps: deque[int] = deque(maxlen=_KEPT)
        self._rewards: deque[dict[str, float]] = deque(maxlen=_KEPT)
        self._seen: deque[np.ndarray] = deque(maxlen=_KEPT)
        self._charts: dict[str, tuple[tuple[str, ...], Any]] = {}
        with self._gui.add_folder("Rewards and success"):
            self._of_rewards = self._gui.add_folder(None)
        with self._gui.add_folder("Observation"):
            self._chosen = self._gui.add_dropdown("part", tuple(name for name, _ in parts))
            self._of_seen = self._gui.add_folder(None)

    def add(self, rewards: Mapping[str, float], observation: np.ndarray) -> None:
        """Add a step: reward terms and success by name, and the flat observation."""
        self._steps.append(self._steps[-1] + 1 if self._steps else 0)
        self._rewards.append(dict(rewards))
        self._seen.append(np.array(observation, float))

    def clear(self) -> None:
        """Begin anew, as with an episode."""
        for kept in (self._steps, self._rewards, self._seen):
            kept.clear()

    def draw(self) -> None:
        """Bring the plots up to date."""
        if len(self._steps) < 2:
            return
        names = tuple(self._rewards[-1])
        self._draw("rewards", self._of_rewards, names, [[step[n] for step in self._rewards] for n in names])
        name = self._chosen.value
        index = [part for part, _ in self._parts].index(name)
        first = sum(size for _, size in self._parts[:index])
        size = self._parts[index][1]
        values = np.array(self._seen)[:, first : first + size].T
        self._draw("seen", self._of_seen, tuple(f"{name}[{i}]" for i in range(size)), list(values))

    def _draw(self, chart: str, folder: Any, names: tuple[str, ...], values: list) -> None:
        data = (np.array(self._steps, float), *(np.asarray(v, float) for v in values))
        kept = self._charts.get(chart)
        if kept is not None and kept[0] == names:
            kept[1].data = data
            return
        if kept is not None:
            kept[1].remove()
        series: Any = (
            {"label": "step"},
            *({"label": name, "stroke": _COLOURS[i % len(_COLOURS)], "width": 1.5} for i, name in enumerate(names)),
        )
        scales: Any = {"x": {"time": False}}
        with folder:
            handle = self._gui.add_uplot(data, series, scales=scales, legend={"show": len(names) <= 8}, height=200)
        self._charts[chart] = names, handle
