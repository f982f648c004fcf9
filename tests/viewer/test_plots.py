"""Live plots: the last steps, one line for each term and for each component."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.viewer.plots import Plots
from tests.viewer.pages import page

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")


def test_plots_show_the_last_steps():
    """Reward terms by name, and the components of the chosen part; a new episode begins anew."""
    with page() as server:
        plots = Plots(server, [("qpos", 2), ("way", 3)])
        plots.add({"near": 0.0}, np.zeros(5))
        plots.draw()  # a single step is no line
        for i in range(1, 400):
            plots.add({"near": 0.1 * i, "success": 0.0}, i * np.arange(5.0))
        plots.draw()
        names, chart = plots._charts["rewards"]
        assert names == ("near", "success")
        steps, near, success = chart.data
        assert (len(steps), steps[-1]) == (300, 399)
        assert near[-1] == pytest.approx(39.9)
        assert not np.any(success)
        plots._chosen.value = "way"
        plots.draw()
        names, chart = plots._charts["seen"]
        assert names == ("way[0]", "way[1]", "way[2]")
        assert [line[-1] for line in chart.data[1:]] == [2.0 * 399, 3.0 * 399, 4.0 * 399]
        plots.clear()
        plots.draw()
