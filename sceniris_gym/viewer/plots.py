"""Live plots of rewards, success and observations of the first world."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import viser

_KEPT = 300  # last steps that the plots show
_COLOURS = ("#266ebe", "#28965a", "#8250aa", "#b4781e", "#1496a0", "#aa3c78", "#5a7828", "#555b63")
_MOST = len(_COLOURS)  # curves in a plot of the observation, at most one per colour
_DASHES = (6, 4)  # pixels of line and gap, for reward terms that reuse a colour
_SIDE = 64  # pixels left of a plot, wide enough for the label '-0.001'
_STEPS = (1, 2, 5, 10, 20, 50, 100)  # possible numbers of steps between two labels
_Shapes = Sequence[tuple[str, tuple[int, ...]]]
_NOTHING = np.full(2, np.nan)  # an empty curve, because a line needs two steps


class Part(NamedTuple):
    """A part of the observation that fits into one plot.

    Attributes:
        name: Name of the array in the task's observation. If the part is only a row of the array, or a piece of a row,
            the name also has the index, such as "cubes[2]".
        first: Index of the part's first component in the flat observation.
        labels: A label for each component, such as "[0]".
    """

    name: str
    first: int
    labels: tuple[str, ...]


class Plots:
    """Plots of the last steps: reward terms, success, and one part of the observation.

    Args:
        server: The viser server of the page.
        shapes: Names and shapes of the arrays in the observation, in order.
        on_choice: Called without arguments when a user selects another part.
    """

    def __init__(self, server: viser.ViserServer, shapes: _Shapes, on_choice: Callable[[], None]) -> None:
        self._gui = server.gui
        self._parts = {part.name: part for part in parts_of(shapes)}
        # number, reward terms, success and observation of each step
        self._steps: deque[tuple[int, dict[str, float], float, np.ndarray]] = deque(maxlen=_KEPT)
        self._charts: dict[str, tuple[tuple[str, ...], Any]] = {}
        self._folders: dict[str, Any] = {}
        for chart, title in (("rewards", "Reward terms"), ("success", "Success"), ("seen", "Observation")):
            with self._gui.add_folder(title):
                if chart == "seen":
                    self._chosen = self._gui.add_dropdown("part", tuple(self._parts))
                    self._chosen.on_update(lambda _: on_choice())
                self._folders[chart] = self._gui.add_folder(None)

    def add(self, rewards: Mapping[str, float], success: float, observation: np.ndarray) -> None:
        """Add a step: reward terms by name, success as 0 or 1, and the flat observation."""
        number = self._steps[-1][0] + 1 if self._steps else 1
        self._steps.append((number, dict(rewards), success, np.array(observation, float)))

    def clear(self) -> None:
        """Remove all steps, because a new episode starts."""
        self._steps.clear()
        self.draw()

    def draw(self) -> None:
        """Update the plots."""
        names = tuple(self._steps[-1][1]) if self._steps else self._charts.get("rewards", ((), None))[0]
        if not names:
            return  # the first step reports the names of the reward terms
        self._draw("rewards", names, [[rewards[name] for _, rewards, *_ in self._steps] for name in names])
        self._draw("success", ("success",), [[success for *_, success, _ in self._steps]])
        part = self._parts[self._chosen.value]
        components = range(part.first, part.first + len(part.labels))
        self._draw("seen", part.labels, [[seen[i] for *_, seen in self._steps] for i in components])

    def _draw(self, chart: str, names: tuple[str, ...], values: list[list[float]]) -> None:
        data = tuple(np.array(numbers, float) for numbers in ([number for number, *_ in self._steps], *values))
        if len(self._steps) < 2:
            data = (np.arange(2.0), *[_NOTHING] * len(names))
        kept = self._charts.get(chart)
        if kept is not None and kept[0] == names:
            kept[1].data = data
            return
        if kept is not None:
            kept[1].remove()
        series: list[Any] = [{"label": "step"}]
        for i, name in enumerate(names):
            dash = _DASHES if i >= _MOST else ()
            series.append({"label": name, "width": 1.5, "stroke": _COLOURS[i % _MOST], "dash": dash})
        of_success = chart == "success"
        scales: Any = {"x": {"time": False}, "y": {"range": (-0.1, 1.1)} if of_success else {}}
        ticks = {"show": False}
        axes: Any = ({"incrs": _STEPS, "space": 40, "ticks": ticks}, {"size": _SIDE, "ticks": ticks})
        looks: Any = {"scales": scales, "axes": axes, "padding": (12, 16, 0, 0), "height": 120 if of_success else 200}
        with self._folders[chart]:
            handle = self._gui.add_uplot(data, tuple(series), legend={"show": not of_success}, **looks)
        self._charts[chart] = names, handle


def parts_of(shapes: _Shapes) -> list[Part]:
    """Cut an observation into parts with at most 8 components: the rows of its arrays, and pieces of longer rows."""
    parts, first = [], 0
    for name, shape in shapes:
        width = shape[-1] if shape else 1
        for row in np.ndindex(*shape[:-1]):
            for begin in range(0, width, _MOST):
                end = min(begin + _MOST, width)
                index = [*map(str, row), *([f"{begin}:{end}"] if width > _MOST else [])]
                labels = tuple(f"[{i}]" for i in range(begin, end))
                parts.append(Part(f"{name}[{', '.join(index)}]" if index else name, first, labels))
                first += len(labels)
    return parts
