"""Live plots: the last steps, one line for each term and for each component."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.viewer.plots import Plots, parts_of
from tests.viewer.pages import chart, control, lines, page, press

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")

TITLES = ("Reward terms", "Success", "Observation")


def test_plots_show_the_last_steps():
    """Reward terms by name, success, and the components of the chosen part; there is nothing before a first step."""
    with page() as server:
        plots = Plots(server, [("qpos", (2,)), ("way", (3,))], lambda: None)
        plots.draw()
        assert [chart(server, title) for title in TITLES] == [None] * 3
        for i in range(1, 401):
            plots.add({"near": -0.1 * i, "effort": 0.0}, float(i > 399), i * np.arange(5.0))
        plots.draw()
        rewards = lines(server, "Reward terms")
        assert list(rewards) == ["step", "near", "effort"]
        steps = rewards["step"]
        assert (len(steps), steps[0], steps[-1]) == (300, 101, 400)
        assert rewards["near"][-1] == pytest.approx(-40.0)
        assert not np.any(rewards["effort"])
        assert [*lines(server, "Success")["success"][-2:]] == [0.0, 1.0]
        press(server, "part", "way")
        plots.draw()
        last = {name: line[-1] for name, line in lines(server, "Observation").items()}
        assert last == {"step": 400, "[0]": 2.0 * 400, "[1]": 3.0 * 400, "[2]": 4.0 * 400}


def test_a_new_episode_begins_with_empty_plots():
    """Lines of the episode before go at once, also in a part that is chosen then; a single step draws none."""
    with page() as server:
        plots = Plots(server, [("qpos", (2,)), ("way", (3,))], lambda: None)
        for _ in range(2):
            plots.add({"near": 1.0}, 1.0, np.ones(5))
        plots.draw()
        plots.clear()
        for title in TITLES:
            assert all(np.isnan(line).all() for line in chart(server, title).data[1:])
        press(server, "part", "way")
        plots.add({"near": 1.0}, 1.0, np.ones(5))
        plots.draw()
        _, *seen = lines(server, "Observation").values()
        assert len(seen) == 3
        assert all(np.isnan(line).all() for line in seen)


def test_a_change_of_the_part_is_asked_for():
    """Also while no steps are taken, such as at a pause."""
    asked: list[str] = []
    with page() as server:
        Plots(server, [("qpos", (2,)), ("way", (3,))], lambda: asked.append(control(server, "part").value))
        press(server, "part", "way")
    assert asked == ["way"]


def test_every_curve_has_a_legend_and_a_colour_of_its_own():
    """So rows of arrays are parts of their own, and long ones are cut; together they are all of the observation."""
    parts = parts_of([("qpos", (7,)), ("to_objects", (2, 3)), ("kinds", (2, 9)), ("open", ())])
    names = ["qpos", "to_objects[0]", "to_objects[1]", "kinds[0, 0:8]", "kinds[0, 8:9]", "kinds[1, 0:8]"]
    assert [part.name for part in parts] == [*names, "kinds[1, 8:9]", "open"]
    assert [part.first for part in parts] == [0, 7, 10, 13, 21, 22, 30, 31]
    assert parts[4].labels == ("[8]",)
    with page() as server:
        plots = Plots(server, [("qpos", (8,))], lambda: None)
        for _ in range(2):
            plots.add({str(i): 0.0 for i in range(10)}, 0.0, np.zeros(8))
        plots.draw()
        for title in ("Reward terms", "Observation"):
            drawn = chart(server, title)
            assert drawn.legend["show"]
            looks = {(s["stroke"], tuple(s["dash"])) for s in drawn.series[1:]}
            assert len(looks) == len(drawn.series) - 1
